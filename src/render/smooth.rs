//! Smooth light over one patch side: values at element corners are means of the leaves that meet
//! there; inside a leaf they are interpolated. Never across patches, so never through walls. A wall that stands on a
//! leaf parts its corners: each knows only the leaves that stand for its part, and a place only the corners of its own.

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
    /// From its patch, the side's leaves and what each has; `stands_for`: whether that is so at a corner of the leaf.
    #[must_use]
    pub fn new(
        patch: Polygon,
        leaves: impl Iterator<Item = (NodeName, Rgb)>,
        stands_for: impl Fn(NodeName, usize) -> bool,
    ) -> Self {
        let mut corners: HashMap<GridPoint, (Rgb, f64)> = HashMap::new();
        for (leaf, value) in leaves {
            let (points, count) = element_corners(&patch, leaf.path());
            for i in (0..count).filter(|i| stands_for(leaf, *i)) {
                let at = corners.entry(points[i]).or_default();
                at.0 += value;
                at.1 += 1.0;
            }
        }
        Self { corners, patch }
    }

    /// Values at a leaf's corners; black where nothing stands for one.
    #[must_use]
    pub fn at_corners(&self, leaf: NodeName) -> [Rgb; 4] {
        self.known(leaf).map(|value| value.unwrap_or(Rgb::BLACK))
    }

    fn known(&self, leaf: NodeName) -> [Option<Rgb>; 4] {
        element_corners(&self.patch, leaf.path())
            .0
            .map(|point| self.corners.get(&point).map(|(sum, count)| *sum * (1.0 / count)))
    }

    /// The value at a point of a leaf, between those corners that the point may `ask`; `None` if it knows of none.
    #[must_use]
    pub fn at(&self, leaf: NodeName, shape: &Polygon, point: DVec3, ask: impl Fn(usize) -> bool) -> Option<Rgb> {
        let values = self.known(leaf);
        let weights = mean_value_weights(shape.corners(), point);
        let (mut sum, mut all) = (Rgb::BLACK, 0.0);
        for i in (0..shape.corners().len()).filter(|i| weights[*i] > 0.0) {
            if let Some(value) = values[i]
                && ask(i)
            {
                sum += value * weights[i];
                all += weights[i];
            }
        }
        (all > 0.0).then(|| sum * (1.0 / all))
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
    fn a_wall_keeps_what_lies_behind_it_out_of_corners_and_places() {
        let square = Polygon::new(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]);
        let root = NodeName::root(ClusterId(0), PatchSide { patch: 0, side: 0 });
        let leaves = (0..4).map(|q| (root.child(q), Rgb::grey(if q == 2 { 0.0 } else { 3.0 })));
        // The dark quarter stands for what lies behind a wall that leaves only its outer corner there.
        let outer = |corner: usize| quadtree::child(&square, 2).corners()[corner] == square.corners()[2];
        let side = SmoothSide::new(square, leaves, |leaf, corner| leaf != root.child(2) || outer(corner));
        let shape = quadtree::child(&square, 2);
        let at = |ask: &dyn Fn(usize) -> bool| side.at(root.child(2), &shape, shape.centre(), ask).map(|v| v.0[0]);
        assert_eq!(at(&|corner| !outer(corner)), Some(3.0));
        assert_eq!(at(&outer), Some(0.0));
        assert_eq!(at(&|_| false), None);
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
