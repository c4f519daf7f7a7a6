//! Chains with fewer segments: what runs smoothly, or in steps too small to matter, within a centimetre of a straight
//! line becomes it. Corners of long segments stay where they are.

use glam::DVec2;

use super::joined::{CHAIN_M, Edge, Graph, edge, unite_equal};

/// Cosine of the turn from which a corner is one.
const CORNER: f64 = 0.906;
/// Segments from which a corner's neighbours count as long, m.
const LONG_M: f64 = 5.0 * CHAIN_M;

impl Graph {
    /// Simplifies all chains between their ends, forks and corners.
    pub fn simplify(&mut self) {
        let mut paths = Paths::of(self);
        let mut edges = Vec::with_capacity(self.edges.len());
        while let Some(path) = paths.next() {
            let kinds = path.kinds;
            simplified(&self.points, &path.points, |a, b| edges.push(edge([a, b], kinds)));
        }
        unite_equal(&mut edges);
        self.edges = edges;
    }
}

/// A run of segments without ends, forks or corners in it.
struct Path {
    points: Vec<u32>,
    kinds: u8,
}

/// All runs of a graph, one after the other.
struct Paths<'a> {
    graph: &'a Graph,
    /// Ends of segments with the segments' numbers, in order.
    ends: Vec<(u32, u32)>,
    used: Vec<bool>,
    /// Where to look for the next start: first the points where runs end, then all.
    next: usize,
    rounds: bool,
}

impl<'a> Paths<'a> {
    fn of(graph: &'a Graph) -> Self {
        let numbered = graph.edges.iter().zip(0..);
        let mut ends: Vec<(u32, u32)> = numbered.flat_map(|(e, i)| e.ends.map(|end| (end, i))).collect();
        ends.sort_unstable();
        Self { graph, ends, used: vec![false; graph.edges.len()], next: 0, rounds: false }
    }

    fn next(&mut self) -> Option<Path> {
        loop {
            while let Some((start, first)) = self.ends.get(self.next).copied() {
                if !self.used[first as usize] && (self.rounds || self.is_end(start)) {
                    return Some(self.follow(start, first));
                }
                self.next += 1;
            }
            if self.rounds {
                return None;
            }
            (self.next, self.rounds) = (0, true);
        }
    }

    fn follow(&mut self, start: u32, first: u32) -> Path {
        let mut path = Path { points: vec![start], kinds: 0 };
        let (mut at, mut along) = (start, first);
        loop {
            let Edge { ends: [a, b], kinds } = self.graph.edges[along as usize];
            self.used[along as usize] = true;
            path.kinds |= kinds;
            at = if at == a { b } else { a };
            path.points.push(at);
            if at == start || self.is_end(at) {
                return path;
            }
            along = *self.at(at).iter().map(|(_, e)| e).find(|e| **e != along).expect("two segments meet there");
        }
    }

    fn at(&self, point: u32) -> &[(u32, u32)] {
        let from = self.ends.partition_point(|e| e.0 < point);
        let count = self.ends[from..].iter().take(3).take_while(|e| e.0 == point).count();
        &self.ends[from..from + count]
    }

    /// Whether runs end at a point: it is an end, a fork or a corner.
    fn is_end(&self, point: u32) -> bool {
        let [(_, a), (_, b)] = self.at(point) else { return true };
        let away = [a, b].map(|e| {
            let [p, q] = self.graph.edges[*e as usize].ends;
            let other = if p == point { q } else { p };
            self.graph.points[other as usize] - self.graph.points[point as usize]
        });
        let is_straight = -away[0].dot(away[1]) >= CORNER * away[0].length() * away[1].length();
        !is_straight && away.iter().any(|d| d.length() >= LONG_M)
    }
}

/// Visits the segments that stand for a path, each as long as it can be. A path may end where it begins.
fn simplified(points: &[DVec2], path: &[u32], mut visit: impl FnMut(u32, u32)) {
    let at = |i: usize| points[path[i] as usize];
    let is_near = |from: usize, to: usize| (from + 1..to).all(|i| distance(at(i), [at(from), at(to)]) <= CHAIN_M);
    let mut from = 0;
    while from + 1 < path.len() {
        let to = (from + 2..path.len()).take_while(|to| is_near(from, *to)).last().unwrap_or(from + 1);
        visit(path[from], path[to]);
        from = to;
    }
}

/// How far a point is from a segment, m.
pub fn distance(point: DVec2, [a, b]: [DVec2; 2]) -> f64 {
    let along = b - a;
    let t = (point - a).dot(along) / along.length_squared().max(f64::MIN_POSITIVE);
    point.distance(a + along * t.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::super::segments::{ABOVE, Segment};
    use super::*;

    fn simple(corners: &[DVec2]) -> Graph {
        let n = corners.len();
        let segments: Vec<_> = (0..n).map(|i| Segment::new(corners[i], corners[(i + 1) % n], ABOVE)).collect();
        let mut graph = Graph::of(&segments, 1e-5);
        graph.simplify();
        graph
    }

    fn round(facets: u32) -> Vec<DVec2> {
        let angle = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(facets);
        (0..facets).map(|i| DVec2::from_angle(angle(i)) * 0.15).collect()
    }

    #[test]
    fn the_foot_of_a_round_column_keeps_its_shape_to_a_centimetre_in_ten_segments() {
        let graph = simple(&round(48));
        assert!((8..=11).contains(&graph.edges.len()), "{}", graph.edges.len());
        for p in round(480) {
            let off = |e: &Edge| distance(p, e.ends.map(|i| graph.points[i as usize]));
            assert!(graph.edges.iter().map(off).fold(1.0, f64::min) < CHAIN_M + 1e-3);
        }
    }

    #[test]
    fn corners_stay_to_the_bit_and_points_between_them_go() {
        let corners = [[0.0, 0.0], [0.3, 0.0], [0.7, 0.0], [0.7, 0.4], [0.0, 0.4]]
            .map(|[x, y]| DVec2::from_angle(0.5).rotate(DVec2::new(x, y)));
        let graph = simple(&corners);
        assert_eq!(graph.edges.len(), 4);
        for corner in [0, 2, 3, 4].map(|i| corners[i]) {
            assert!(graph.edges.iter().any(|e| e.ends.iter().any(|i| graph.points[*i as usize] == corner)));
        }
        // Thinner than what a chain is simplified to, but long.
        assert_eq!(simple(&[[0.0, 0.0], [2.0, 0.0], [2.0, 0.008], [0.0, 0.008]].map(DVec2::from_array)).edges.len(), 4);
    }
}
