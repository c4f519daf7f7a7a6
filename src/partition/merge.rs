//! The Merge algorithm (section 5.1 of the paper): every cluster a group at first; then the pair of
//! groups that exchange most is merged, again and again.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

use super::graph::{Graph, Grouping, renumber};

/// A pair of groups that might be merged; stale ones are skipped when they come up.
#[derive(PartialEq)]
struct Candidate {
    weight: f64,
    a: u32,
    b: u32,
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.weight.total_cmp(&other.weight).then_with(|| (other.a, other.b).cmp(&(self.a, self.b)))
    }
}

/// Merges until `min_groups` are left or no pair may be merged: a group's predicted links stay
/// below 1.25 / `min_groups` of all.
#[must_use]
pub fn merge(graph: &Graph, min_groups: usize) -> Grouping {
    let count = graph.places.len();
    let mut cost = graph.costs();
    let limit = 1.25 * cost.iter().sum::<f64>() / min_groups.max(1) as f64;
    let mut neighbours: Vec<BTreeMap<u32, f64>> = vec![BTreeMap::new(); count];
    let mut heap = BinaryHeap::new();
    for edge in &graph.edges {
        if edge.a != edge.b && edge.weight > 0.0 {
            neighbours[edge.a as usize].insert(edge.b, edge.weight);
            neighbours[edge.b as usize].insert(edge.a, edge.weight);
            heap.push(Candidate { weight: edge.weight, a: edge.a, b: edge.b });
        }
    }
    let mut group: Vec<u32> = (0..count as u32).collect();
    let mut members: Vec<Vec<u32>> = (0..count as u32).map(|i| vec![i]).collect();
    let mut left = count;
    while left > min_groups {
        let Some(best) = heap.pop() else { break };
        let (a, b) = (best.a as usize, best.b as usize);
        if neighbours[a].get(&best.b) != Some(&best.weight) {
            continue;
        }
        // Links between the two are counted once in the merged group.
        let merged = cost[a] + cost[b] - best.weight;
        if merged > limit {
            continue;
        }
        cost[a] = merged;
        neighbours[a].remove(&best.b);
        for (other, weight) in std::mem::take(&mut neighbours[b]) {
            if other == best.a {
                continue;
            }
            neighbours[other as usize].remove(&best.b);
            let sum = neighbours[a].get(&other).copied().unwrap_or(0.0) + weight;
            neighbours[a].insert(other, sum);
            neighbours[other as usize].insert(best.a, sum);
            heap.push(Candidate { weight: sum, a: best.a.min(other), b: best.a.max(other) });
        }
        for member in std::mem::take(&mut members[b]) {
            group[member as usize] = best.a;
            members[a].push(member);
        }
        left -= 1;
    }
    collect_loose(graph, &mut group, left, min_groups);
    renumber(&group)
}

/// Groups that exchange nothing with any other never merge by weight: they join their neighbour in
/// order of number while there are too many groups, since each would be a task of its own.
fn collect_loose(graph: &Graph, group: &mut [u32], mut left: usize, min_groups: usize) {
    let mut connected = vec![false; graph.places.len()];
    for edge in graph.edges.iter().filter(|e| e.a != e.b && e.weight > 0.0) {
        connected[edge.a as usize] = true;
        connected[edge.b as usize] = true;
    }
    let mut target: Option<u32> = None;
    for i in 0..group.len() {
        if connected[i] || left <= min_groups {
            continue;
        }
        if let Some(first) = target {
            group[i] = first;
            left -= 1;
        } else {
            target = Some(group[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::partition::graph::{Edge, Place};
    use glam::DVec3;

    /// Rooms of `each` clusters in a row; inside a room all exchange 1, neighbours exchange `door`.
    pub(crate) fn rooms(count: u32, each: u32, door: f64) -> Graph {
        let mut graph = Graph::default();
        for i in 0..count * each {
            let centre = DVec3::new(f64::from(i / each) * 5.0, f64::from(i % each), 0.0);
            graph.places.push(Place { cluster: i, centre, patches: 4 });
        }
        for a in 0..count * each {
            for b in a..count * each {
                let weight = match (a / each).abs_diff(b / each) {
                    0 => 1.0,
                    1 => door,
                    _ => continue,
                };
                graph.edges.push(Edge { a, b, weight });
            }
        }
        graph
    }

    #[test]
    fn rooms_become_groups() {
        let graph = rooms(4, 6, 0.01);
        let grouping = merge(&graph, 4);
        assert_eq!(grouping, (0..24).map(|i| i / 6).collect::<Vec<u32>>());
        assert!(graph.intra_group_share(&grouping) > 0.9);
    }
}
