//! The form-factor graph: clusters and the light that they may exchange.

use glam::DVec3;

use crate::geom::bounds::Bounds;

/// A cluster as the partition sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Cluster number.
    pub cluster: u32,
    /// Middle of its box, m.
    pub centre: DVec3,
    /// Patches.
    pub patches: u32,
}

/// An undirected edge: `weight` is area times form factor, m2, both ways together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Position of one cluster in [`Graph::places`].
    pub a: u32,
    /// Position of the other; may be the same.
    pub b: u32,
    /// Exchange, m2.
    pub weight: f64,
}

/// The graph; edges ascending by (a, b), each pair once, a <= b.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    /// Clusters, ascending by number.
    pub places: Vec<Place>,
    /// What they exchange.
    pub edges: Vec<Edge>,
}

/// Group of each cluster, by position; groups are numbered from 0 by their first cluster.
pub type Grouping = Vec<u32>;

impl Graph {
    /// Predicted cost of each cluster: the exchange that it takes part in.
    #[must_use]
    pub fn costs(&self) -> Vec<f64> {
        let mut costs = vec![0.0; self.places.len()];
        for edge in &self.edges {
            costs[edge.a as usize] += edge.weight;
            if edge.a != edge.b {
                costs[edge.b as usize] += edge.weight;
            }
        }
        costs
    }

    /// Predicted cost of each group: all pairs with at least one end in it.
    #[must_use]
    pub fn group_costs(&self, grouping: &[u32]) -> Vec<f64> {
        let mut costs = vec![0.0; grouping.iter().map(|g| *g as usize + 1).max().unwrap_or(0)];
        for edge in &self.edges {
            let (a, b) = (grouping[edge.a as usize], grouping[edge.b as usize]);
            costs[a as usize] += edge.weight;
            if a != b {
                costs[b as usize] += edge.weight;
            }
        }
        costs
    }

    /// Share of all exchange that stays within groups, 0..=1.
    #[must_use]
    pub fn intra_group_share(&self, grouping: &[u32]) -> f64 {
        let total: f64 = self.edges.iter().map(|e| e.weight).sum();
        let intra: f64 =
            self.edges.iter().filter(|e| grouping[e.a as usize] == grouping[e.b as usize]).map(|e| e.weight).sum();
        if total > 0.0 { intra / total } else { 1.0 }
    }
}

/// Predicted ratio of successive errors of group Jacobi: q (1 - w) / (1 - q w).
#[must_use]
pub fn predicted_contraction(q: f64, intra_group_share: f64) -> f64 {
    q * (1.0 - intra_group_share) / (1.0 - q * intra_group_share)
}

/// Renumbers groups from 0 by their first cluster.
#[must_use]
pub fn renumber(grouping: &[u32]) -> Grouping {
    let mut number = std::collections::HashMap::new();
    grouping
        .iter()
        .map(|g| {
            let next = number.len() as u32;
            *number.entry(*g).or_insert(next)
        })
        .collect()
}

/// Splits groups whose predicted cost is more than four times the mean, so that no tail remains:
/// across the longest extent of their clusters' middles, in halves of equal cost.
#[must_use]
pub fn split_oversized(graph: &Graph, grouping: Grouping) -> Grouping {
    let costs = graph.costs();
    let mut grouping = grouping;
    loop {
        let group_costs = graph.group_costs(&grouping);
        let count = group_costs.len();
        let mean = group_costs.iter().sum::<f64>() / count.max(1) as f64;
        let mut changed = false;
        for (group, cost) in group_costs.iter().enumerate() {
            let members: Vec<usize> = (0..grouping.len()).filter(|i| grouping[*i] == group as u32).collect();
            if *cost > 4.0 * mean && members.len() > 1 {
                let next = grouping.iter().max().map_or(0, |g| g + 1);
                for i in far_half(graph, &members, &costs) {
                    grouping[i] = next;
                }
                changed = true;
            }
        }
        // Costs count pairs across groups on both sides: splitting need not lower them for ever.
        if !changed || grouping.iter().max().is_some_and(|g| *g as usize > 8 * count.max(8)) {
            return renumber(&grouping);
        }
    }
}

/// Splits the costliest groups until there are as many as asked for, or every cluster is one.
#[must_use]
pub fn split_into(graph: &Graph, grouping: Grouping, least: usize) -> Grouping {
    let costs = graph.costs();
    let mut members: Vec<Vec<usize>> = Vec::new();
    for (cluster, group) in renumber(&grouping).into_iter().enumerate() {
        members.resize_with(members.len().max(group as usize + 1), Vec::new);
        members[group as usize].push(cluster);
    }
    let cost = |group: &Vec<usize>| group.iter().map(|i| costs[*i]).sum::<f64>();
    while members.len() < least {
        let divisible = (0..members.len()).filter(|g| members[*g].len() > 1);
        let Some(costliest) = divisible.max_by(|a, b| cost(&members[*a]).total_cmp(&cost(&members[*b])).then(b.cmp(a)))
        else {
            break;
        };
        let half = far_half(graph, &members[costliest], &costs);
        members[costliest].retain(|i| !half.contains(i));
        members.push(half);
    }
    let mut out = vec![0; grouping.len()];
    for (group, of) in members.iter().enumerate() {
        of.iter().for_each(|cluster| out[*cluster] = group as u32);
    }
    renumber(&out)
}

/// The second half, by cost, of some clusters along the longest extent of their middles.
#[must_use]
pub fn far_half(graph: &Graph, members: &[usize], costs: &[f64]) -> Vec<usize> {
    let centre = |i: usize| graph.places[i].centre;
    let axis = members.iter().fold(Bounds::EMPTY, |all, i| all.with(centre(*i))).size().max_position();
    let mut order = members.to_vec();
    order.sort_by(|a, b| centre(*a)[axis].total_cmp(&centre(*b)[axis]).then(a.cmp(b)));
    let total: f64 = order.iter().map(|i| costs[*i]).sum();
    let mut sum = 0.0;
    let mut cut = order.len() / 2;
    for (n, i) in order.iter().enumerate() {
        sum += costs[*i];
        if 2.0 * sum >= total {
            cut = n + 1;
            break;
        }
    }
    order.split_off(cut.clamp(1, members.len() - 1))
}
