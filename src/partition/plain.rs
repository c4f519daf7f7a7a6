//! The two methods to compare with: a grid of regions, and chance.

use glam::DVec3;

use super::graph::{Graph, Grouping, renumber};
use crate::geom::sequence::mix;

/// Groups by the cell of a square grid over the two horizontal axes that a cluster's middle lies in;
/// `up` is the vertical axis (0..3). About `groups` cells; the paper's grid is 16 x 16.
#[must_use]
pub fn region(graph: &Graph, groups: usize, up: usize) -> Grouping {
    let cells = (groups as f64).sqrt().round().max(1.0);
    let low = graph.places.iter().fold(DVec3::INFINITY, |m, p| m.min(p.centre));
    let high = graph.places.iter().fold(DVec3::NEG_INFINITY, |m, p| m.max(p.centre));
    let cell = |p: DVec3, axis: usize| {
        let width = high[axis] - low[axis];
        if width > 0.0 { ((p[axis] - low[axis]) / width * cells).min(cells - 1.0) as u32 } else { 0 }
    };
    let (i, j) = ((up + 1) % 3, (up + 2) % 3);
    let grouping: Vec<u32> =
        graph.places.iter().map(|p| cell(p.centre, i) * cells as u32 + cell(p.centre, j)).collect();
    renumber(&grouping)
}

/// Groups by a hash of the cluster's number.
#[must_use]
pub fn random(graph: &Graph, groups: usize, seed: u64) -> Grouping {
    let grouping: Vec<u32> = graph
        .places
        .iter()
        .map(|p| (mix(seed ^ mix(u64::from(p.cluster) + 1)) % groups.max(1) as u64) as u32)
        .collect();
    renumber(&grouping)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::partition::graph::Place;

    #[test]
    fn both_make_about_as_many_groups_as_asked() {
        let places = (0..400u32)
            .map(|i| {
                let centre = DVec3::new(f64::from(i % 20), f64::from(i / 20), f64::from(i % 3));
                Place { cluster: i, centre, patches: 1 }
            })
            .collect();
        let graph = Graph { places, edges: Vec::new() };
        let groups = |g: &[u32]| g.iter().max().unwrap() + 1;
        assert_eq!(groups(&region(&graph, 16, 2)), 16);
        assert_eq!(groups(&random(&graph, 16, 1)), 16);
        assert_ne!(random(&graph, 16, 1), random(&graph, 16, 2));
    }
}
