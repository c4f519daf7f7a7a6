//! The Split algorithm (section 5.1 of the paper): all clusters one group at first; then groups are
//! cut along planes of major occluders, where little light crosses.

use glam::DVec3;

use super::graph::{Graph, Grouping, far_half, renumber};

/// A plane of walls, floors or ceilings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Occluder {
    /// Unit normal.
    pub normal: DVec3,
    /// Distance from the origin along it, m.
    pub offset: f64,
    /// Area of the patches in it, m2.
    pub area_m2: f64,
}

/// Occluders tried for one cut, the largest first.
const TRIED: usize = 64;

/// Cuts the costliest group until there are `groups`, or none can be cut.
#[must_use]
pub fn split(graph: &Graph, occluders: &[Occluder], groups: usize) -> Grouping {
    let costs = graph.costs();
    let mut grouping = vec![0u32; graph.places.len()];
    let mut whole = vec![false];
    while whole.len() < groups {
        let group_costs = graph.group_costs(&grouping);
        let costliest = (0..whole.len())
            .filter(|g| !whole[*g])
            .max_by(|a, b| group_costs[*a].total_cmp(&group_costs[*b]).then(b.cmp(a)));
        let Some(group) = costliest else { break };
        let members: Vec<usize> = (0..grouping.len()).filter(|i| grouping[*i] == group as u32).collect();
        if members.len() < 2 {
            whole[group] = true;
            continue;
        }
        let cut = best_cut(graph, occluders, &grouping, group as u32, &members)
            .unwrap_or_else(|| far_half(graph, &members, &costs));
        let next = whole.len() as u32;
        for i in cut {
            grouping[i] = next;
        }
        whole.push(false);
    }
    renumber(&grouping)
}

/// The clusters beyond the plane that cuts least exchange for the balance that it gives.
fn best_cut(
    graph: &Graph,
    occluders: &[Occluder],
    grouping: &[u32],
    group: u32,
    members: &[usize],
) -> Option<Vec<usize>> {
    let inner: Vec<_> = graph
        .edges
        .iter()
        .filter(|e| grouping[e.a as usize] == group && grouping[e.b as usize] == group && e.a != e.b)
        .collect();
    let total: f64 = inner.iter().map(|e| e.weight).sum::<f64>().max(f64::MIN_POSITIVE);
    let mut beyond = vec![false; graph.places.len()];
    let mut best: Option<(f64, &Occluder)> = None;
    let cuts = |plane: &Occluder| {
        let far = members.iter().filter(|i| is_beyond(graph, plane, **i)).count();
        far.min(members.len() - far)
    };
    for plane in occluders.iter().filter(|p| cuts(p) * 8 >= members.len()).take(TRIED) {
        for &i in members {
            beyond[i] = is_beyond(graph, plane, i);
        }
        let cut: f64 = inner.iter().filter(|e| beyond[e.a as usize] != beyond[e.b as usize]).map(|e| e.weight).sum();
        let balance = cuts(plane) as f64 / members.len() as f64;
        let score = cut / total / balance;
        if best.is_none_or(|(s, _)| score < s) {
            best = Some((score, plane));
        }
    }
    let (_, plane) = best?;
    Some(members.iter().copied().filter(|i| is_beyond(graph, plane, *i)).collect())
}

fn is_beyond(graph: &Graph, plane: &Occluder, i: usize) -> bool {
    plane.normal.dot(graph.places[i].centre) > plane.offset
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::partition::graph::{Edge, Place};

    #[test]
    fn a_wall_between_two_rooms_is_where_they_are_cut() {
        let mut graph = Graph::default();
        for i in 0..12u32 {
            let x = if i < 4 { f64::from(i) } else { 5.0 + f64::from(i - 4) };
            graph.places.push(Place { cluster: i, centre: DVec3::new(x, 0.0, 0.0), patches: 1 });
        }
        for a in 0..12u32 {
            for b in a + 1..12 {
                graph.edges.push(Edge { a, b, weight: if (a < 4) == (b < 4) { 1.0 } else { 0.01 } });
            }
        }
        let planes = [2.5, 4.5, 8.5].map(|offset| Occluder { normal: DVec3::X, offset, area_m2: 10.0 });
        assert_eq!(split(&graph, &planes, 2), (0..12).map(|i| u32::from(i >= 4)).collect::<Vec<_>>());
    }
}
