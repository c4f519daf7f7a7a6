//! Smooth light over one patch side: values at element corners are means of what the leaves that meet
//! there predict; inside a leaf they are interpolated. Never across patches, so never through walls.

use std::collections::HashMap;

use glam::DVec3;

use crate::base::{NodeName, Rgb};
use crate::geom::grid::{GridPoint, element_corners};
use crate::geom::polygon::Polygon;

/// Corner values of a patch side.
pub struct SmoothSide {
    corners: HashMap<GridPoint, (Rgb, f64)>,
    patch: Polygon,
}

impl SmoothSide {
    /// From its patch, the side's leaves and what each has at its corners.
    #[must_use]
    pub fn new(patch: Polygon, leaves: impl Iterator<Item = (NodeName, [Rgb; 4])>) -> Self {
        let mut corners: HashMap<GridPoint, (Rgb, f64)> = HashMap::new();
        for (leaf, values) in leaves {
            let (points, count) = element_corners(&patch, leaf.path());
            for (point, value) in points[..count].iter().zip(values) {
                let (sum, leaves) = corners.entry(*point).or_default();
                (*sum, *leaves) = (*sum + value, *leaves + 1.0);
            }
        }
        Self { corners, patch }
    }

    /// Values at a leaf's corners.
    #[must_use]
    pub fn at_corners(&self, leaf: NodeName) -> [Rgb; 4] {
        let mean = |(sum, leaves): &(Rgb, f64)| *sum * (1.0 / leaves);
        element_corners(&self.patch, leaf.path()).0.map(|point| self.corners.get(&point).map_or(Rgb::BLACK, mean))
    }

    /// The value at a point of a leaf, between those of its corners.
    #[must_use]
    pub fn at(&self, leaf: NodeName, shape: &Polygon, point: DVec3) -> Rgb {
        let weights = mean_value_weights(shape.corners(), point);
        let values = self.at_corners(leaf);
        weights.into_iter().zip(values).fold(Rgb::BLACK, |sum, (weight, value)| sum + value * weight)
    }
}

/// Mean value coordinates of a point of a convex polygon: at most four corners, adding up to 1.
///
/// Source: Floater 2003, "Mean value coordinates".
fn mean_value_weights(corners: &[DVec3], point: DVec3) -> [f64; 4] {
    let n = corners.len();
    let scale = corners.iter().map(|c| c.distance(point)).fold(0.0, f64::max);
    let mut weights = [0.0; 4];
    let half_tangent = |a: DVec3, b: DVec3| {
        let (la, lb) = (a.length(), b.length());
        a.cross(b).length() / (la * lb + a.dot(b)).max(1e-12 * la * lb)
    };
    for i in 0..n {
        let to = corners[i] - point;
        if to.length() <= 1e-9 * scale {
            weights = [0.0; 4];
            weights[i] = 1.0;
            return weights;
        }
        let (before, after) = (corners[(i + n - 1) % n] - point, corners[(i + 1) % n] - point);
        weights[i] = (half_tangent(before, to) + half_tangent(to, after)) / to.length();
    }
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, PatchSide};
    use crate::geom::quadtree;

    #[test]
    fn a_corner_has_the_mean_of_the_leaves_that_meet_there() {
        let square = Polygon::new(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]);
        let root = NodeName::root(ClusterId(0), PatchSide { patch: 0, side: 0 });
        let leaves = (0..4).map(|q| (root.child(q), [Rgb::grey(f64::from(q)); 4]));
        let side = SmoothSide::new(square, leaves);
        let shape = quadtree::child(&square, 2);
        let at = |point: DVec3| side.at(root.child(2), &shape, point).0[0];
        assert!((at(square.corners()[2]) - 2.0).abs() < 1e-12, "alone");
        assert!((at(DVec3::new(0.5, 0.5, 0.0)) - 1.5).abs() < 1e-12, "of all four");
    }

    #[test]
    fn mean_value_weights_reproduce_the_point() {
        let c = [DVec3::ZERO, DVec3::new(3.0, 0.0, 0.0), DVec3::new(2.0, 2.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
        for p in [DVec3::new(1.0, 0.5, 0.0), DVec3::new(0.1, 0.1, 0.0), c[2]] {
            let w = mean_value_weights(&c, p);
            let back = (0..4).fold(DVec3::ZERO, |s, i| s + c[i] * w[i]);
            assert!((back - p).length() < 1e-9, "{back} for {p}");
        }
    }
}
