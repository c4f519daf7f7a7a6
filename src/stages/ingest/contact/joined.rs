//! Segments of contact as a graph: ends that meet are one, equal segments are one, and what lies between two faces of
//! one surface is none.

use glam::DVec2;

use super::segments::{LEFT, RIGHT, Segment, turned};
use super::weld::{Sets, in_order, number_of, weld};

/// Ends this near belong to one chain, and chains are simplified to this, m.
pub const CHAIN_M: f64 = 0.01;

/// A segment between two points of a [`Graph`], the lesser first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Edge {
    /// Numbers of its ends.
    pub ends: [u32; 2],
    /// What touches there.
    pub kinds: u8,
}

/// Segments that share ends.
pub struct Graph {
    /// Ends in order, m.
    pub points: Vec<DVec2>,
    /// Segments in order, each once.
    pub edges: Vec<Edge>,
}

impl Graph {
    /// Of segments in any order. Ends within `near_m` of each other become one.
    #[must_use]
    pub fn of(segments: &[Segment], near_m: f64) -> Self {
        let points = in_order(segments.iter().flat_map(|s| s.ends).collect());
        let welded = weld(&points, near_m, |_, _| {});
        let number = |p: DVec2| welded[number_of(&points, p)];
        let mut edges: Vec<Edge> = segments.iter().map(|s| edge(s.ends.map(number), s.kinds)).collect();
        edges.retain(|e| e.ends[0] != e.ends[1]);
        unite_equal(&mut edges);
        edges.retain(|e| e.kinds != LEFT | RIGHT);
        Self { points, edges }
    }

    /// Drops chains, connected or almost, whose extent is below `least_m`.
    pub fn drop_short_chains(&mut self, near_m: f64, least_m: f64) {
        let points = in_order(self.edges.iter().flat_map(|e| e.ends).map(|i| self.points[i as usize]).collect());
        let mut number = vec![usize::MAX; self.points.len()];
        for end in self.edges.iter().flat_map(|e| e.ends) {
            number[end as usize] = number_of(&points, self.points[end as usize]);
        }
        let mut chains = Sets::new(points.len());
        weld(&points, near_m, |a, b| chains.unite(a, b));
        for Edge { ends: [a, b], .. } in &self.edges {
            chains.unite(number[*a as usize], number[*b as usize]);
        }
        let mut boxes = vec![[DVec2::INFINITY, DVec2::NEG_INFINITY]; points.len()];
        for (i, p) in points.iter().enumerate() {
            let [low, high] = &mut boxes[chains.of(i)];
            (*low, *high) = (low.min(*p), high.max(*p));
        }
        self.edges.retain(|e| {
            let [low, high] = boxes[chains.of(number[e.ends[0] as usize])];
            low.distance(high) >= least_m
        });
    }
}

/// With its ends in order.
#[must_use]
pub fn edge([a, b]: [u32; 2], kinds: u8) -> Edge {
    if a <= b {
        return Edge { ends: [a, b], kinds };
    }
    Edge { ends: [b, a], kinds: turned(kinds) }
}

/// Sorts edges and makes equal ones one, with the kinds of all.
pub fn unite_equal(edges: &mut Vec<Edge>) {
    edges.sort_unstable();
    edges.dedup_by(|later, kept| {
        let same = later.ends == kept.ends;
        if same {
            kept.kinds |= later.kinds;
        }
        same
    });
}

#[cfg(test)]
mod tests {
    use super::super::segments::ABOVE;
    use super::*;

    fn at(x: f64, y: f64) -> DVec2 {
        DVec2::new(x, y)
    }

    #[test]
    fn what_lies_between_two_faces_of_a_surface_is_no_line_and_what_stands_there_is_one() {
        let (a, b) = (at(1.0, 1.0), at(0.0, 0.0));
        let both = [Segment::new(a, b, LEFT), Segment::new(b + 1e-6, a, LEFT)];
        assert!(Graph::of(&both, 1e-4).edges.is_empty());
        let graph = Graph::of(&[both[0], both[1], Segment::new(b, a, ABOVE)], 1e-4);
        assert_eq!(graph.edges.len(), 1);
        assert_eq!(Graph::of(&[both[0], both[0]], 1e-4).edges.len(), 1);
    }

    #[test]
    fn a_chain_is_as_long_as_its_extent_and_gaps_below_a_centimetre_do_not_end_it() {
        let short = |x: f64, y: f64| Segment::new(at(x, y), at(x + 0.02, y), ABOVE);
        let chain = [short(0.0, 0.0), short(0.025, 0.0), short(0.05, 0.0)];
        let mut graph = Graph::of(&[chain[0], chain[1], chain[2], short(1.0, 0.0), short(1.03, 0.0)], 1e-4);
        graph.drop_short_chains(CHAIN_M, 0.05);
        assert_eq!(graph.edges.len(), 3);
    }
}
