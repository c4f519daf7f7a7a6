//! The segments along which one face touches another: its edges within the contact distance of the other's plane, or
//! the chord in which it passes through.

use glam::{DVec2, DVec3};

use super::Rules;
use super::plane::{Plane, clipped, crossing, is_along_edge};
use crate::geom::split::area_vector;

/// Of what touches: it passes through.
pub const CROSSING: u8 = 1;
/// It stands.
pub const CONTACT: u8 = 2;
/// It lies to the left of the segment, seen from its lesser end.
pub const LEFT: u8 = 4;
/// It lies to the right.
pub const RIGHT: u8 = 8;

/// Cosine of the slope to which what lies within the contact distance has two sides as seen from above.
const STEEP: f64 = 0.05;
/// The same where some of it lies beyond: the wedge below opens more slowly than light finds its way in.
const SHALLOW: f64 = 0.985;

/// A segment of contact in a face's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// The lesser end by its coordinates, then the other, m.
    pub ends: [DVec2; 2],
    /// What touches there: a union of the constants.
    pub kinds: u8,
}

impl Segment {
    /// With its ends in order.
    #[must_use]
    pub fn new(a: DVec2, b: DVec2, kinds: u8) -> Self {
        if before(a, b) {
            return Self { ends: [a, b], kinds };
        }
        let swapped = (kinds & (CROSSING | CONTACT)) | (kinds & LEFT) << 1 | (kinds & RIGHT) >> 1;
        Self { ends: [b, a], kinds: swapped }
    }

    /// Length, m.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }
}

/// Whether a point comes before another: by its first coordinate, then its second.
#[must_use]
pub fn before(a: DVec2, b: DVec2) -> bool {
    (a.x, a.y) < (b.x, b.y)
}

/// The face that is touched.
pub struct Touched<'a> {
    /// Its plane.
    pub plane: Plane,
    /// Its corners there, anticlockwise.
    pub outline: &'a [DVec2],
    /// What runs this near to an edge of it runs along it, m; what is shorter is none.
    pub near_m: f64,
    /// What counts as contact.
    pub rules: &'a Rules,
}

impl Touched<'_> {
    /// Visits the segments along which a face of these corners touches.
    pub fn segments(&self, other: &[DVec3], mut visit: impl FnMut(Segment)) {
        let contact_m = self.rules.contact_m;
        let mut heights = [0.0; 4];
        for (height, corner) in heights.iter_mut().zip(other) {
            *height = self.plane.height(*corner);
        }
        let heights = &heights[..other.len()];
        let (low, high) = heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        if low > contact_m || high < -contact_m {
            return;
        }
        if low < -contact_m && high > contact_m {
            if let Some([a, b]) = self.chord(other, heights) {
                self.clip(Segment::new(a, b, CROSSING), &mut visit);
            }
            return;
        }
        let sides = self.sides(other, low >= -contact_m && high <= contact_m);
        for i in 0..other.len() {
            let j = (i + 1) % other.len();
            if let Some([a, b]) = self.in_slab([other[i], other[j]], [heights[i], heights[j]]) {
                self.clip(Segment::new(a, b, sides), &mut visit);
            }
        }
    }

    /// On which side of its edges, as they wind, a face lies as seen from above; [`CONTACT`] if on none.
    fn sides(&self, other: &[DVec3], is_within: bool) -> u8 {
        let facing = area_vector(other).normalize_or_zero().dot(self.plane.normal);
        if facing.abs() <= if is_within { STEEP } else { SHALLOW } {
            CONTACT
        } else if facing > 0.0 {
            LEFT
        } else {
            RIGHT
        }
    }

    /// The part of an edge within the contact distance, seen from above. What leaves it at once is no line of contact.
    fn in_slab(&self, edge: [DVec3; 2], heights: [f64; 2]) -> Option<[DVec2; 2]> {
        let contact_m = self.rules.contact_m;
        let flat = edge.map(|p| self.plane.flat(p));
        if heights.iter().all(|h| h.abs() <= contact_m) {
            return Some(flat);
        }
        let (mut start, mut end) = (0.0, 1.0);
        for sign in [1.0, -1.0] {
            let [from, to] = heights.map(|h| contact_m - sign * h);
            if from < 0.0 && to < 0.0 {
                return None;
            }
            if from < 0.0 {
                start = f64::max(start, crossing(from, to));
            } else if to < 0.0 {
                end = f64::min(end, crossing(from, to));
            }
        }
        let [a, b] = [start, end].map(|t| flat[0].lerp(flat[1], t));
        (start < end && a.distance(b) >= self.rules.least_m).then_some([a, b])
    }

    /// Where a face with corners on both sides passes through.
    fn chord(&self, other: &[DVec3], heights: &[f64]) -> Option<[DVec2; 2]> {
        let mut points = [DVec2::ZERO; 4];
        let mut count = 0;
        let mut add = |point| {
            points[count] = point;
            count += 1;
        };
        for i in 0..other.len() {
            let j = (i + 1) % other.len();
            if heights[i] == 0.0 {
                add(self.plane.flat(other[i]));
            } else if heights[i] * heights[j] < 0.0 {
                // From the lower corner, so that it is the same point whichever way the edge winds.
                let (a, b) = if heights[i] < 0.0 { (i, j) } else { (j, i) };
                add(self.plane.flat(other[a].lerp(other[b], crossing(heights[a], heights[b]))));
            }
        }
        let least = points[..count].iter().copied().reduce(|a, b| if before(b, a) { b } else { a })?;
        let most = points[..count].iter().copied().reduce(|a, b| if before(a, b) { b } else { a })?;
        (count >= 2).then_some([least, most])
    }

    fn clip(&self, segment: Segment, visit: &mut impl FnMut(Segment)) {
        if let Some(ends) = clipped(self.outline, segment.ends)
            && ends[0].distance(ends[1]) > self.near_m
            && !is_along_edge(self.outline, ends, self.near_m)
        {
            visit(Segment { ends, ..segment });
        }
    }
}
