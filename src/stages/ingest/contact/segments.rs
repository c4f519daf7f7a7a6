//! The segments along which one face touches another: its edges within the contact distance of the other's plane, or
//! the chord in which it passes through.

use glam::{DVec2, DVec3};

use super::Rules;
use super::plane::{Line, Plane, clipped, crossing, is_along_edge};
use crate::geom::split::area_vector;

/// Of what touches: it passes through.
pub const CROSSING: u8 = 1;
/// It rises over the face, or hangs below it.
pub const ABOVE: u8 = 2;
/// See [`ABOVE`].
pub const BELOW: u8 = 4;
/// It is within the contact distance, but stands there on its edge.
pub const UPRIGHT: u8 = 8;
/// It lies to the left of the segment, seen from its lesser end.
pub const LEFT: u8 = 16;
/// It lies to the right.
pub const RIGHT: u8 = 32;

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
        Self { ends: [b, a], kinds: turned(kinds) }
    }

    /// On which sides of the face something stands there.
    #[must_use]
    pub fn standing(&self) -> u8 {
        self.kinds & (ABOVE | BELOW)
    }

    /// The line it lies on.
    #[must_use]
    pub fn line(&self) -> Line {
        Line::through(self.ends[0], self.ends[1])
    }

    /// Length, m.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }
}

/// What touches, seen from a segment's other end.
#[must_use]
pub fn turned(kinds: u8) -> u8 {
    (kinds & !(LEFT | RIGHT)) | (kinds & LEFT) << 1 | (kinds & RIGHT) >> 1
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
    /// Visits the segments within the face along which a face of these corners touches it.
    pub fn segments(&self, other: &[DVec3], mut visit: impl FnMut(Segment)) {
        self.everywhere(other, |segment| {
            if let Some(ends) = clipped(self.outline, segment.ends)
                && ends[0].distance(ends[1]) > self.near_m
                && !is_along_edge(self.outline, ends, self.near_m)
            {
                visit(Segment { ends, ..segment });
            }
        });
    }

    /// Visits the segments along which a face of these corners touches this one's plane.
    pub fn everywhere(&self, other: &[DVec3], mut visit: impl FnMut(Segment)) {
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
                visit(Segment::new(a, b, CROSSING | ABOVE | BELOW));
            }
            return;
        }
        let kinds = self.kinds(other, [low, high]);
        for i in 0..other.len() {
            let j = (i + 1) % other.len();
            if let Some([a, b]) = self.in_slab([other[i], other[j]], [heights[i], heights[j]]) {
                visit(Segment::new(a, b, kinds));
            }
        }
    }

    /// What a face that does not pass through does at its edges, as they wind.
    fn kinds(&self, other: &[DVec3], [low, high]: [f64; 2]) -> u8 {
        let contact_m = self.rules.contact_m;
        let facing = area_vector(other).normalize_or_zero().dot(self.plane.normal);
        let is_within = low >= -contact_m && high <= contact_m;
        if facing.abs() > if is_within { STEEP } else { SHALLOW } {
            if facing > 0.0 { LEFT } else { RIGHT }
        } else if is_within {
            UPRIGHT
        } else if high > contact_m {
            ABOVE
        } else {
            BELOW
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
}
