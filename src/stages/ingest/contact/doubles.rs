//! Lines that double another within a centimetre: the other side of a pane, the next book in a row, a wall just inside
//! an edge that others stand on. Between the two no light passes from one side to the other, so that one of them parts
//! the face as well as both.

use glam::DVec3;

use super::joined::CHAIN_M;
use super::plane::Line;
use super::segments::{ABOVE, BELOW, Segment, Touched};
use super::simple::distance;

/// Intervals that are held for an edge before those that meet are made one.
const HELD: usize = 1 << 12;

/// Segments without those that a longer one doubles over their whole length. They come in order of length. A line stays
/// unless something stands along the other on the same sides of the face: it must not move away from a wall.
#[must_use]
pub fn without_doubles(segments: Vec<Segment>) -> Vec<Segment> {
    let mut kept: Vec<Segment> = Vec::with_capacity(segments.len());
    for segment in segments {
        let is_double = |other: &Segment| {
            segment.standing() & !other.standing() == 0
                && segment.ends.iter().all(|p| distance(*p, other.ends) <= CHAIN_M)
        };
        if !kept.iter().any(is_double) {
            kept.push(segment);
        }
    }
    kept
}

/// Where others stand along the edges of a face.
pub struct Edges<'a> {
    touched: &'a Touched<'a>,
    /// By edge, over it and below it: intervals, m from the edge's start.
    standing: Vec<[Vec<[f64; 2]>; 2]>,
}

impl<'a> Edges<'a> {
    /// With nothing on them yet.
    #[must_use]
    pub fn new(touched: &'a Touched<'a>) -> Self {
        Self { touched, standing: vec![[Vec::new(), Vec::new()]; touched.outline.len()] }
    }

    /// Adds what a face of these corners has standing along them.
    pub fn add(&mut self, other: &[DVec3]) {
        let Self { touched, standing } = self;
        touched.everywhere(other, |segment| {
            for (i, sides) in standing.iter_mut().enumerate() {
                let Some(at) = interval(touched, i, &segment, touched.near_m) else { continue };
                for (side, intervals) in [ABOVE, BELOW].into_iter().zip(sides) {
                    if segment.kinds & side != 0 {
                        intervals.push(at);
                        if intervals.len() >= HELD {
                            unite(intervals);
                        }
                    }
                }
            }
        });
    }

    /// To be called once all is added.
    pub fn finish(&mut self) {
        self.standing.iter_mut().flatten().for_each(unite);
    }

    /// Whether a segment runs within a centimetre of an edge along which others stand on the same sides of the face, or
    /// is too short to part anything from it.
    #[must_use]
    pub fn double(&self, segment: &Segment) -> bool {
        self.standing.iter().enumerate().any(|(i, sides)| {
            let Some([from, to]) = interval(self.touched, i, segment, CHAIN_M) else { return false };
            let holds = |[start, end]: &[f64; 2]| *start <= from + CHAIN_M && to <= end + CHAIN_M;
            let is_short = to - from <= 2.0 * CHAIN_M;
            let mut needed = [ABOVE, BELOW].into_iter().zip(sides).filter(|(side, _)| segment.kinds & side != 0);
            is_short || needed.all(|(_, intervals)| intervals.iter().any(holds))
        })
    }
}

/// Where a segment lies along an edge, m from the edge's start, if it is that near inside it.
fn interval(touched: &Touched, edge: usize, segment: &Segment, within_m: f64) -> Option<[f64; 2]> {
    let (start, end) = (touched.outline[edge], touched.outline[(edge + 1) % touched.outline.len()]);
    let line = Line::through(start, end);
    if !segment.ends.iter().all(|p| (-touched.near_m..=within_m).contains(&line.left_m(*p))) {
        return None;
    }
    let along = (end - start).normalize();
    let [a, b] = segment.ends.map(|p| (p - start).dot(along));
    Some([a.min(b), a.max(b)])
}

/// Makes intervals one where they meet within a centimetre.
fn unite(intervals: &mut Vec<[f64; 2]>) {
    intervals.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    intervals.dedup_by(|later, kept| {
        let meets = later[0] <= kept[1] + CHAIN_M;
        if meets {
            kept[1] = kept[1].max(later[1]);
        }
        meets
    });
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::super::Rules;
    use super::super::plane::Plane;
    use super::super::segments::{CROSSING, LEFT};
    use super::*;

    fn level(from: f64, to: f64, y: f64, kinds: u8) -> Segment {
        Segment::new(DVec2::new(from, y), DVec2::new(to, y), kinds)
    }

    #[test]
    fn of_two_walls_within_a_centimetre_the_longer_stays_and_a_wall_stays_beside_what_lies() {
        let is_left = |other, segment| without_doubles(vec![other, segment]).len() == 2;
        let wall = level(0.0, 2.0, 0.0, ABOVE);
        assert!(!is_left(wall, level(0.5, 1.5, 0.008, ABOVE)));
        assert!(!is_left(wall, level(0.5, 1.5, 0.008, LEFT)));
        assert!(is_left(wall, level(0.5, 1.5, 0.012, ABOVE)));
        assert!(is_left(wall, level(1.5, 2.1, 0.008, ABOVE)));
        assert!(is_left(wall, level(0.5, 1.5, 0.008, BELOW)));
        assert!(is_left(level(0.0, 2.0, 0.0, LEFT), level(0.5, 1.5, 0.008, ABOVE)));
    }

    #[test]
    fn a_line_beside_an_edge_doubles_it_only_where_walls_stand_on_the_edge_on_its_side() {
        let corners = [DVec3::ZERO, DVec3::X * 3.0, DVec3::new(3.0, 3.0, 0.0), DVec3::Y * 3.0];
        let plane = Plane::of(&corners);
        let outline = corners.map(|p| plane.flat(p));
        let rules = Rules { contact_m: 0.01, least_m: 0.05, snap_m: 1e-4 };
        let touched = Touched { plane, outline: &outline, near_m: 1e-4, rules: &rules };
        let mut edges = Edges::new(&touched);
        for x in [0.0, 1.0] {
            let foot = DVec3::X * x;
            edges.add(&[foot, foot + DVec3::X, foot + DVec3::X + DVec3::Z, foot + DVec3::Z]);
        }
        edges.finish();
        assert!(edges.double(&level(0.5, 1.5, 0.008, ABOVE)));
        assert!(!edges.double(&level(0.5, 1.5, 0.012, ABOVE)));
        assert!(!edges.double(&level(1.5, 2.5, 0.008, ABOVE)));
        assert!(edges.double(&level(2.5, 2.515, 0.008, ABOVE)));
        assert!(!edges.double(&level(0.5, 1.5, 2.995, ABOVE)));
        assert!(!edges.double(&level(0.5, 1.5, 0.008, CROSSING | ABOVE | BELOW)));
    }
}
