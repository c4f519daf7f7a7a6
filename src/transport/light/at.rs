//! The light that a version stores, at any place of a patch side: what export, pictures, `sample --stored` and the checks
//! of a visit read.
//!
//! At corners it is the mean of what the leaves around predict, in a leaf it lies between its corners, and over the side
//! it has the mean that is stored. A corner on an edge of a larger leaf has what lies on that edge. It never reads across
//! patches, so never through walls.

use std::collections::HashMap;

use glam::DVec3;

use crate::base::{NodeName, Rgb};
use crate::geom::grid::{GridPoint, element_corners};
use crate::geom::polygon::Polygon;
use crate::geom::quadtree::{element_polygon, patch_polygon};
use crate::model::geometry::PatchRecord;
use crate::transport::light::line::Line;
use crate::transport::nodes::frame::Frame;

/// The irradiance over one patch side.
pub struct SideLight {
    patch: Polygon,
    corners: HashMap<GridPoint, Rgb>,
}

impl SideLight {
    /// From its leaves, in any order that is always the same, and their lines.
    #[must_use]
    pub fn new(patch: &PatchRecord, leaves: &[(NodeName, Line)]) -> Self {
        let (shape, frame) = (patch_polygon(patch), Frame::of(patch));
        let mut sums: HashMap<GridPoint, (Rgb, f64)> = HashMap::with_capacity(leaves.len() + leaves.len() / 2);
        let mut outlines = Vec::with_capacity(leaves.len());
        for (leaf, line) in leaves {
            let element = element_polygon(patch, leaf.path());
            let centroid = frame.plane(element.centroid());
            let (points, count) = element_corners(&shape, leaf.path());
            for (point, corner) in points.iter().zip(element.corners()) {
                let at = frame.plane(*corner);
                let value = Rgb(line.at([at[0] - centroid[0], at[1] - centroid[1]]).0.map(|x| x.max(0.0)));
                let (sum, leaves) = sums.entry(*point).or_default();
                (*sum, *leaves) = (*sum + value, *leaves + 1.0);
            }
            outlines.push((leaf.depth(), points, count, element.area()));
        }
        let mut side =
            Self { patch: shape, corners: sums.into_iter().map(|(at, (sum, n))| (at, sum * (1.0 / n))).collect() };
        let mut order: Vec<usize> = (0..outlines.len()).collect();
        order.sort_by_key(|i| outlines[*i].0);
        for (_, points, count, _) in order.into_iter().map(|i| outlines[i]) {
            (0..count).for_each(|i| side.straighten(points[i], points[(i + 1) % count]));
        }
        let (mut stored, mut between) = (Rgb::BLACK, Rgb::BLACK);
        for ((_, points, count, area), (_, line)) in outlines.iter().zip(leaves) {
            let sum = points[..*count].iter().fold(Rgb::BLACK, |sum, point| sum + side.corners[point]);
            (stored, between) = (stored + line.mean * *area, between + sum * (area / *count as f64));
        }
        let kept = Rgb(std::array::from_fn(|c| if between.0[c] > 0.0 { stored.0[c] / between.0[c] } else { 1.0 }));
        side.corners.values_mut().for_each(|value| *value = value.times(kept));
        side
    }

    /// Puts corners of smaller leaves that lie between two corners of a leaf's edge on the line between these.
    fn straighten(&mut self, from: GridPoint, to: GridPoint) {
        let middle = [0, 1].map(|i| (from[i] + to[i]) / 2);
        if middle == from || middle == to || !self.corners.contains_key(&middle) {
            return;
        }
        let value = (self.corners[&from] + self.corners[&to]) * 0.5;
        self.corners.insert(middle, value);
        self.straighten(from, middle);
        self.straighten(middle, to);
    }

    /// Corners of smaller leaves that lie between two corners of a leaf's edge, in order: where along the edge, and the
    /// light there, W/m2.
    #[must_use]
    pub fn between(&self, from: GridPoint, to: GridPoint) -> Vec<(GridPoint, f64, Rgb)> {
        let mut found = Vec::new();
        self.collect_between([(from, 0.0), (to, 1.0)], &mut found);
        found
    }

    fn collect_between(&self, [from, to]: [(GridPoint, f64); 2], found: &mut Vec<(GridPoint, f64, Rgb)>) {
        let middle = [0, 1].map(|i| (from.0[i] + to.0[i]) / 2);
        let at = 0.5 * (from.1 + to.1);
        if let Some(value) = self.corners.get(&middle).filter(|_| middle != from.0 && middle != to.0) {
            self.collect_between([from, (middle, at)], found);
            found.push((middle, at, *value));
            self.collect_between([(middle, at), to], found);
        }
    }

    /// Values at a leaf's corners, W/m2, in the winding of the front.
    #[must_use]
    pub fn at_corners(&self, leaf: NodeName) -> [Rgb; 4] {
        element_corners(&self.patch, leaf.path()).0.map(|point| self.corners.get(&point).copied().unwrap_or(Rgb::BLACK))
    }

    /// The light at a point of a leaf, W/m2. `shape`: the leaf's, in the winding of the front.
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
        let next = corners[(i + 1) % n] - point;
        if to.cross(next).length() <= 1e-9 * to.length() * next.length() && to.dot(next) < 0.0 {
            // On an edge.
            let sum = to.length() + next.length();
            weights = [0.0; 4];
            (weights[i], weights[(i + 1) % n]) = (next.length() / sum, to.length() / sum);
            return weights;
        }
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
    use bytemuck::Zeroable;

    fn square() -> PatchRecord {
        let mut patch = PatchRecord::zeroed();
        patch.corners_m = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        (patch.corner_count, patch.sides) = (4, 3);
        patch
    }

    fn constant(of: f64) -> Line {
        Line { mean: Rgb::grey(of), ..Line::default() }
    }

    fn at(side: &SideLight, leaf: NodeName, point: DVec3) -> f64 {
        side.at(leaf, &element_polygon(&square(), leaf.path()), point).0[0]
    }

    #[test]
    fn a_corner_has_the_mean_of_the_leaves_that_meet_there() {
        let root = NodeName::root(ClusterId(0), PatchSide { patch: 0, side: 0 });
        let leaves: Vec<_> = (0..4).map(|q| (root.child(q), constant(f64::from(q)))).collect();
        let side = SideLight::new(&square(), &leaves);
        assert!((at(&side, root.child(2), DVec3::new(1.0, 1.0, 0.0)) - 2.0).abs() < 1e-12, "alone");
        assert!((at(&side, root.child(2), DVec3::new(0.5, 0.5, 0.0)) - 1.5).abs() < 1e-12, "of all four");
    }

    #[test]
    fn light_is_continuous_where_a_small_leaf_meets_a_large_one_and_keeps_its_mean() {
        let root = NodeName::root(ClusterId(0), PatchSide { patch: 0, side: 0 });
        let mut leaves: Vec<_> = (1..4).map(|q| (root.child(q), constant(f64::from(q)))).collect();
        leaves.extend((0..4).map(|q| (root.child(0).child(q), constant(8.0 + f64::from(q * q)))));
        let side = SideLight::new(&square(), &leaves);
        for y in [0.05, 0.2, 0.25, 0.3, 0.45] {
            let small = root.child(0).child(if y < 0.25 { 1 } else { 2 });
            let [left, right] = [small, root.child(1)].map(|leaf| at(&side, leaf, DVec3::new(0.5, y, 0.0)));
            assert!((left - right).abs() < 1e-9, "{left} and {right} at {y}");
        }
        let stored = leaves.iter().map(|(leaf, line)| line.mean.0[0] * 0.25f64.powi(leaf.depth() as i32)).sum::<f64>();
        let n = 32;
        let sum: f64 = (0..n * n)
            .map(|i| DVec3::new(f64::from(i % n) + 0.5, f64::from(i / n) + 0.5, 0.0) / f64::from(n))
            .map(|point| {
                let mut leaf = root;
                while !leaves.iter().any(|(name, _)| *name == leaf) {
                    leaf = leaf.child(quadtree::child_at(&element_polygon(&square(), leaf.path()), point));
                }
                at(&side, leaf, point)
            })
            .sum();
        assert!((sum / f64::from(n * n) / stored - 1.0).abs() < 1e-3, "{} for {stored}", sum / f64::from(n * n));
    }

    #[test]
    fn mean_value_weights_reproduce_the_point() {
        let c = [DVec3::ZERO, DVec3::new(3.0, 0.0, 0.0), DVec3::new(2.0, 2.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
        for p in [DVec3::new(1.0, 0.5, 0.0), DVec3::new(0.1, 0.1, 0.0), c[2], DVec3::new(1.2, 0.0, 0.0)] {
            let w = mean_value_weights(&c, p);
            let back = (0..4).fold(DVec3::ZERO, |s, i| s + c[i] * w[i]);
            assert!((back - p).length() < 1e-9, "{back} for {p}");
        }
    }
}
