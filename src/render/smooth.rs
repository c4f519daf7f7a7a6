//! Smooth light over one patch side: values at element corners are means of the leaves that meet
//! there; inside a leaf they are interpolated. Never across patches, so never through walls. A wall that stands on a
//! leaf parts its corners: each knows only the leaves that stand for its part, and a place only the corners of its own.
//! One that stands along the edges of leaves parts the leaves that meet there.

use std::collections::HashMap;

use glam::DVec3;

use crate::base::{NodeName, Rgb};
use crate::geom::grid::{GridPoint, element_corners};
use crate::geom::polygon::Polygon;

/// Corner values of a patch side.
pub struct SmoothSide {
    corners: HashMap<GridPoint, Vec<Corner>>,
    patch: Polygon,
}

/// What the leaves that meet at a corner have between the walls that stand there.
struct Corner {
    /// A place of the first of them, close to the corner.
    place: DVec3,
    sum: Rgb,
    leaves: f64,
}

impl Corner {
    fn mean(&self) -> Rgb {
        self.sum * (1.0 / self.leaves)
    }
}

impl SmoothSide {
    /// From its patch, the side's leaves and what each has, whatever stands on them.
    #[must_use]
    pub fn new(patch: Polygon, leaves: impl Iterator<Item = (NodeName, Rgb)>) -> Self {
        Self::among_walls(patch, leaves, |_, _| Some(DVec3::ZERO), |_, _| true)
    }

    /// The same where walls part what stands on a side; `place`: close to a corner of a leaf, if the leaf stands for
    /// it; `joins`: whether nothing stands between two such places.
    #[must_use]
    pub fn among_walls(
        patch: Polygon,
        leaves: impl Iterator<Item = (NodeName, Rgb)>,
        place: impl Fn(NodeName, usize) -> Option<DVec3>,
        joins: impl Fn(DVec3, DVec3) -> bool,
    ) -> Self {
        let mut corners: HashMap<GridPoint, Vec<Corner>> = HashMap::new();
        for (leaf, value) in leaves {
            let (points, count) = element_corners(&patch, leaf.path());
            for (i, point) in points.into_iter().enumerate().take(count) {
                let Some(place) = place(leaf, i) else { continue };
                let here = corners.entry(point).or_default();
                match here.iter_mut().find(|corner| joins(corner.place, place)) {
                    Some(corner) => (corner.sum, corner.leaves) = (corner.sum + value, corner.leaves + 1.0),
                    None => here.push(Corner { place, sum: value, leaves: 1.0 }),
                }
            }
        }
        Self { corners, patch }
    }

    /// Values at a leaf's corners, as if no walls stood there; black where no leaf does.
    #[must_use]
    pub fn at_corners(&self, leaf: NodeName) -> [Rgb; 4] {
        self.known(leaf).map(|here| here.first().map_or(Rgb::BLACK, Corner::mean))
    }

    fn known(&self, leaf: NodeName) -> [&[Corner]; 4] {
        element_corners(&self.patch, leaf.path())
            .0
            .map(|point| self.corners.get(&point).map_or(&[] as &[Corner], Vec::as_slice))
    }

    /// The value at a point of a leaf, between those of its corners that the point may `ask`, by number and the place
    /// of the leaves that meet there; `None` if there are none. A leaf `is_whole` if nothing stands on it: what all
    /// leaves round a corner share is then its own.
    #[must_use]
    pub fn at(
        &self,
        leaf: NodeName,
        shape: &Polygon,
        point: DVec3,
        is_whole: bool,
        ask: impl Fn(usize, DVec3) -> bool,
    ) -> Option<Rgb> {
        let known = self.known(leaf);
        let weights = mean_value_weights(shape.corners(), point);
        let (mut sum, mut all) = (Rgb::BLACK, 0.0);
        for i in (0..shape.corners().len()).filter(|i| weights[*i] > 0.0) {
            let is_own = is_whole && known[i].len() == 1;
            if let Some(corner) = known[i].iter().find(|corner| is_own || ask(i, corner.place)) {
                sum += corner.mean() * weights[i];
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
        let place = |leaf: NodeName, corner: usize| (leaf != root.child(2) || outer(corner)).then_some(DVec3::ZERO);
        let side = SmoothSide::among_walls(square, leaves, place, |_, _| true);
        let shape = quadtree::child(&square, 2);
        let at = |ask: &dyn Fn(usize) -> bool| {
            side.at(root.child(2), &shape, shape.centre(), false, |corner, _| ask(corner)).map(|v| v.0[0])
        };
        assert_eq!(at(&|corner| !outer(corner)), Some(3.0));
        assert_eq!(at(&outer), Some(0.0));
        assert_eq!(at(&|_| false), None);
    }

    #[test]
    fn a_wall_along_edges_of_leaves_parts_those_that_meet_there() {
        let square = Polygon::new(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]);
        let root = NodeName::root(ClusterId(0), PatchSide { patch: 0, side: 0 });
        let shapes: [Polygon; 4] = std::array::from_fn(|q| quadtree::child(&square, q as u32));
        let is_left = |p: DVec3| p.x < 0.5;
        let leaves =
            (0..4).map(|q| (root.child(q), Rgb::grey(if is_left(shapes[q as usize].centre()) { 0.0 } else { 3.0 })));
        let numbers: HashMap<NodeName, usize> = (0..4).map(|q| (root.child(q), q as usize)).collect();
        let near = |shape: &Polygon, corner: usize| shape.corners()[corner].lerp(shape.centre(), 0.02);
        let place = |leaf: NodeName, corner: usize| Some(near(&shapes[numbers[&leaf]], corner));
        let joins = |a: DVec3, b: DVec3| is_left(a) == is_left(b);
        let side = SmoothSide::among_walls(square, leaves, place, joins);
        for (leaf, q) in &numbers {
            let shape = &shapes[*q];
            for point in shape.corners() {
                let found = side.at(*leaf, shape, *point, true, |corner, place| joins(near(shape, corner), place));
                assert_eq!(found.map(|v| v.0[0]), Some(if is_left(shape.centre()) { 0.0 } else { 3.0 }));
            }
        }
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
