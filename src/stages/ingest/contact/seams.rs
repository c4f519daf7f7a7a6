//! Seams: where two parts of a face meet along a line and nothing stands, so that light goes on from one to the other.

use bytemuck::{Pod, Zeroable};
use glam::DVec2;

use super::joined::CHAIN_M;
use super::segments::{ABOVE, BELOW, Segment};

/// An edge of a part on a line of the face's cut tree.
#[derive(Clone, Copy, Debug)]
pub struct PartEdge {
    /// The line's node.
    pub node: u32,
    /// The part.
    pub part: u32,
    /// Which of its edges.
    pub edge: u32,
    /// Where it begins and ends as the part winds, m.
    pub ends: [DVec2; 2],
}

/// A seam between two parts of a face.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PartSeam {
    /// The parts.
    pub parts: [u32; 2],
    /// Which edge of each.
    pub edges: [u32; 2],
    /// Where on each edge it begins, as shares of the edge in its winding; the second runs the other way.
    pub from: [f32; 2],
    /// Where it ends, seen from the first.
    pub to: [f32; 2],
    /// On which sides of the face it is open: 1 the front, 2 the back.
    pub sides: u32,
}

const FRONT: u32 = 1;
const BACK: u32 = 2;

/// The seams of a face, by line and place. `contact`: by node, what stands along its line. None shorter than `near_m`.
#[must_use]
pub fn seams(mut edges: Vec<PartEdge>, contact: &[Vec<Segment>], near_m: f64) -> Vec<PartSeam> {
    edges.sort_by_key(|e| (e.node, e.part, e.edge));
    let mut found = Vec::new();
    for of_line in edges.chunk_by(|a, b| a.node == b.node) {
        let [from, to] = of_line[0].ends;
        let (origin, along) = (from, (to - from).normalize_or_zero());
        let at = |p: DVec2| (p - origin).dot(along);
        let closed: Vec<Closed> = contact[of_line[0].node as usize].iter().map(|s| Closed::by(s, at)).collect();
        let place = |e: &PartEdge| Placed { of: *e, ends: e.ends.map(at) };
        let (mut ahead, mut back): (Vec<_>, Vec<_>) = of_line.iter().map(place).partition(|e| e.ends[0] <= e.ends[1]);
        ahead.sort_by(|a, b| a.ends[0].total_cmp(&b.ends[0]));
        back.sort_by(|a, b| a.ends[1].total_cmp(&b.ends[1]));
        // Edges of one half do not overlap: those that meet an edge follow each other.
        let mut first = 0;
        for one in &ahead {
            while first < back.len() && back[first].ends[0] <= one.ends[0] {
                first += 1;
            }
            for other in back[first..].iter().take_while(|other| other.ends[1] < one.ends[1]) {
                between(one, other, &closed, near_m, &mut found);
            }
        }
    }
    found
}

/// An edge along its line, m.
struct Placed {
    of: PartEdge,
    ends: [f64; 2],
}

impl Placed {
    fn share(&self, at: f64) -> f32 {
        ((at - self.ends[0]) / (self.ends[1] - self.ends[0])).clamp(0.0, 1.0) as f32
    }
}

/// An interval of a line on which something stands.
struct Closed {
    from: f64,
    to: f64,
    sides: u32,
}

impl Closed {
    /// It reaches a little beyond what stands there: gaps below a centimetre are none.
    fn by(segment: &Segment, at: impl Fn(DVec2) -> f64) -> Self {
        let [a, b] = segment.ends.map(at);
        // What lies on the face may be seen in its place from either side.
        let sides = match segment.kinds {
            ABOVE => FRONT,
            BELOW => BACK,
            _ => FRONT | BACK,
        };
        Self { from: a.min(b) - 0.5 * CHAIN_M, to: a.max(b) + 0.5 * CHAIN_M, sides }
    }
}

/// Adds what is open of where two edges lie side by side.
fn between(one: &Placed, other: &Placed, closed: &[Closed], near_m: f64, found: &mut Vec<PartSeam>) {
    let (from, to) = (one.ends[0].max(other.ends[1]), one.ends[1].min(other.ends[0]));
    let inside = |x: &f64| (from..=to).contains(x);
    let mut stops: Vec<f64> = closed.iter().flat_map(|c| [c.from, c.to]).filter(inside).chain([from, to]).collect();
    stops.sort_by(f64::total_cmp);
    let open = |at: f64| {
        let stands = closed.iter().filter(|c| c.from < at && at < c.to);
        (FRONT | BACK) & !stands.fold(0, |sides, c| sides | c.sides)
    };
    for ends in stops.windows(2).filter(|ends| ends[1] - ends[0] > near_m) {
        let sides = open(0.5 * (ends[0] + ends[1]));
        if sides != 0 {
            found.push(PartSeam {
                parts: [one.of.part, other.of.part],
                edges: [one.of.edge, other.of.edge],
                from: [one.share(ends[0]), other.share(ends[0])],
                to: [one.share(ends[1]), other.share(ends[1])],
                sides,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::segments::LEFT;
    use super::*;

    fn edge(part: u32, from: f64, to: f64) -> PartEdge {
        PartEdge { node: 0, part, edge: 2, ends: [DVec2::new(from, 1.0), DVec2::new(to, 1.0)] }
    }

    fn on(from: f64, to: f64, kinds: u8) -> Segment {
        Segment::new(DVec2::new(from, 1.0), DVec2::new(to, 1.0), kinds)
    }

    /// Parts, where on the first, and open sides.
    fn found(edges: &[PartEdge], contact: Vec<Segment>) -> Vec<([u32; 2], [f32; 2], u32)> {
        let rounded = |x: f32| (x * 1000.0).round() / 1000.0;
        let all = seams(edges.to_vec(), &[contact], 1e-4);
        all.iter().map(|s| (s.parts, [rounded(s.from[0]), rounded(s.to[0])], s.sides)).collect()
    }

    #[test]
    fn parts_that_lie_side_by_side_share_a_seam_with_shares_of_either_edge() {
        let edges = [edge(0, 0.0, 4.0), edge(1, 1.0, 0.0), edge(2, 5.0, 1.0)];
        assert_eq!(found(&edges, Vec::new()), [([0, 1], [0.0, 0.25], 3), ([0, 2], [0.25, 1.0], 3)]);
        let second = seams(edges.to_vec(), &[Vec::new()], 1e-4)[1];
        assert_eq!((second.from[1], second.to[1]), (1.0, 0.25), "the other runs the other way");
    }

    #[test]
    fn a_seam_ends_where_something_stands_on_the_side_on_which_it_stands() {
        let edges = [edge(0, 0.0, 1.0), edge(1, 1.0, 0.0)];
        assert_eq!(found(&edges, vec![on(0.0, 1.0, LEFT)]), []);
        assert_eq!(found(&edges, vec![on(0.0, 1.0, ABOVE)]), [([0, 1], [0.0, 1.0], BACK)]);
        let wall = on(0.2, 0.6, ABOVE | BELOW);
        assert_eq!(found(&edges, vec![wall]), [([0, 1], [0.0, 0.195], 3), ([0, 1], [0.605, 1.0], 3)]);
        assert_eq!(found(&edges, vec![wall, on(0.605, 1.0, ABOVE | BELOW)]).len(), 1, "a gap below a centimetre");
    }
}
