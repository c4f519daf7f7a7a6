//! A face's plane, and plane geometry in it: points are metres along two axes across the face's normal.

use glam::{DVec2, DVec3};

use crate::geom::cut_tree::axes_kept;
use crate::geom::split::area_vector;

/// The plane of a face.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    origin: DVec3,
    /// Of the corners' mean over the origin, m: 0 unless they are bent.
    middle_m: f64,
    /// Unit normal.
    pub normal: DVec3,
    axes: [DVec3; 2],
    kept: [usize; 2],
}

impl Plane {
    /// Through a face's corners, which must have an area. A face across a coordinate axis keeps its coordinates' bits.
    #[must_use]
    pub fn of(corners: &[DVec3]) -> Self {
        let across = area_vector(corners);
        let normal = across.normalize_or(DVec3::Z);
        let kept = axes_kept(across);
        let u = (DVec3::AXES[kept[0]] - normal * normal[kept[0]]).normalize();
        let least = |a: DVec3, b: DVec3| if b.to_array() < a.to_array() { b } else { a };
        let origin = corners.iter().copied().reduce(least).expect("a face has corners");
        let middle_m = corners.iter().map(|p| (*p - origin).dot(normal)).sum::<f64>() / corners.len() as f64;
        Self { origin, middle_m, normal, axes: [u, normal.cross(u)], kept }
    }

    /// How far a point is over the plane, m.
    #[must_use]
    pub fn height(&self, point: DVec3) -> f64 {
        (point - self.origin).dot(self.normal) - self.middle_m
    }

    /// Where it is in the plane.
    #[must_use]
    pub fn flat(&self, point: DVec3) -> DVec2 {
        let from = point - self.origin;
        DVec2::new(from.dot(self.axes[0]), from.dot(self.axes[1]))
    }

    /// A line as a cut tree has it.
    #[must_use]
    pub fn in_space(&self, line: Line) -> [f64; 3] {
        let along = self.axes[0] * line.normal.x + self.axes[1] * line.normal.y;
        let [i, j] = self.kept;
        let dropped = 3 - i - j;
        // In the plane the dropped coordinate follows from the others.
        let slope = along[dropped] / self.normal[dropped];
        let (a, b) = (along[i] - slope * self.normal[i], along[j] - slope * self.normal[j]);
        [a, b, line.offset_m + slope * self.middle_m - a * self.origin[i] - b * self.origin[j]]
    }
}

/// A directed line; positive to its left.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    normal: DVec2,
    offset_m: f64,
}

impl Line {
    /// From one point to another that is not the same.
    #[must_use]
    pub fn through(a: DVec2, b: DVec2) -> Self {
        let normal = (b - a).normalize().perp();
        Self { normal, offset_m: -normal.dot(a) }
    }

    /// How far a point is to the left, m.
    #[must_use]
    pub fn left_m(&self, point: DVec2) -> f64 {
        self.normal.dot(point) + self.offset_m
    }
}

/// Where from `a` to `b` what is `from` at the one and `to` at the other is 0; they differ in sign.
#[must_use]
pub fn crossing(from: f64, to: f64) -> f64 {
    from / (from - to)
}

/// The part of a segment inside a convex polygon that runs anticlockwise.
#[must_use]
pub fn clipped(polygon: &[DVec2], [a, b]: [DVec2; 2]) -> Option<[DVec2; 2]> {
    let (mut start, mut end) = (0.0, 1.0);
    for (i, corner) in polygon.iter().enumerate() {
        let edge = polygon[(i + 1) % polygon.len()] - *corner;
        let (from, to) = (edge.perp_dot(a - *corner), edge.perp_dot(b - *corner));
        if from <= 0.0 && to <= 0.0 {
            return None;
        }
        if from < 0.0 {
            start = f64::max(start, crossing(from, to));
        } else if to < 0.0 {
            end = f64::min(end, crossing(from, to));
        }
    }
    let at = |t: f64| if t == 1.0 { b } else { a + (b - a) * t };
    (start < end).then(|| [at(start), at(end)])
}

/// Whether a segment runs along an edge of a convex polygon that runs anticlockwise, both ends within `near_m`.
#[must_use]
pub fn is_along_edge(polygon: &[DVec2], segment: [DVec2; 2], near_m: f64) -> bool {
    (0..polygon.len()).any(|i| {
        let line = Line::through(polygon[i], polygon[(i + 1) % polygon.len()]);
        segment.iter().all(|p| line.left_m(*p) <= near_m)
    })
}

/// Box round points: smallest and largest corner.
#[must_use]
pub fn box_of(points: impl Iterator<Item = DVec2>) -> [DVec2; 2] {
    points.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_in_space_has_the_sign_of_the_line_in_the_plane() {
        let corners = [DVec3::new(3.0, 1.0, 2.0), DVec3::new(7.0, 2.0, 3.0), DVec3::new(4.0, 6.0, -1.0)];
        let plane = Plane::of(&corners);
        let line = Line::through(plane.flat(corners[0]), plane.flat((corners[1] + corners[2]) * 0.5));
        let [a, b, c] = plane.in_space(line);
        for i in 0..20 {
            let (s, t) = (f64::from(i) * 0.13 - 1.0, f64::from(i * i) * 0.01 - 1.0);
            let point = corners[0] + (corners[1] - corners[0]) * s + (corners[2] - corners[0]) * t;
            let [i, j] = plane.kept;
            let value = a * point[i] + b * point[j] + c;
            assert!((value - line.left_m(plane.flat(point))).abs() < 1e-12, "{value}");
        }
    }

    #[test]
    fn the_line_of_a_bent_quad_is_that_of_its_mean_plane() {
        let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.5], [2.0, 2.0, 0.0], [0.0, 1.0, 0.7]].map(DVec3::from_array);
        let plane = Plane::of(&corners);
        let line = Line::through(plane.flat(corners[0]), plane.flat(corners[2]));
        let [a, b, c] = plane.in_space(line);
        let [i, j] = plane.kept;
        for corner in corners {
            let point = corner - plane.normal * plane.height(corner);
            assert!((a * point[i] + b * point[j] + c - line.left_m(plane.flat(corner))).abs() < 1e-12);
        }
    }

    #[test]
    fn clipping_keeps_ends_that_are_inside_to_the_bit() {
        let square = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        let inside = DVec2::new(0.3, 0.1 + 0.2);
        assert_eq!(clipped(&square, [inside, DVec2::new(2.3, 0.1 + 0.2)]), Some([inside, DVec2::new(1.0, 0.1 + 0.2)]));
        assert_eq!(clipped(&square, [DVec2::new(-1.0, 2.0), DVec2::new(2.0, 2.0)]), None);
        assert_eq!(clipped(&square, [DVec2::new(-0.5, 0.5), DVec2::new(0.5, -0.5)]), None);
        assert!(is_along_edge(&square, [DVec2::new(0.1, 1e-4), DVec2::new(0.9, 0.0)], 1e-3));
        assert!(!is_along_edge(&square, [DVec2::new(0.0, 0.0), DVec2::new(0.0, 1.0)].map(|p| p + 0.1), 1e-3));
    }
}
