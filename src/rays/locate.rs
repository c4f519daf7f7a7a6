//! Which patch side a point lies on, and where it lies if it is none's.

use glam::DVec3;

use super::node::Node;
use super::scene::{PatchKey, RayScene};
use super::traverse::{Face, PARALLEL, Rank, patch_normal};
use crate::geom::bounds::Bounds;
use crate::geom::polygon::Polygon;
use crate::model::rays::RayPatch;

/// A patch side that a point lies on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The patch.
    pub key: PatchKey,
    /// 0 front, 1 back.
    pub side: u8,
}

/// Cosine of the largest angle between a point's normal and its surface's: 60 degrees.
const LEAST_COSINE: f64 = 0.5;

/// Places along and across an element that is looked at for faces that cover it.
const PLACES: u32 = 16;

/// Corners of a patch; a triangle repeats its third.
fn corners_of(patch: &RayPatch) -> [DVec3; 4] {
    patch.corners_m.map(|c| DVec3::from_array(c.map(f64::from)))
}

/// Distance of a point from a patch: in its plane from its outline (0 inside), and off its plane.
fn distances(patch: &RayPatch, normal: DVec3, point: DVec3) -> (f64, f64) {
    let c = corners_of(patch);
    let c = &c[..patch.corner_count as usize];
    let outside = (0..c.len())
        .map(|i| {
            let edge = c[(i + 1) % c.len()] - c[i];
            -normal.cross(edge).normalize_or_zero().dot(point - c[i])
        })
        .fold(0.0, f64::max);
    (outside, normal.dot(point - c[0]).abs())
}

/// A face that covers part of a side.
#[derive(Clone, Copy)]
struct Cover {
    corners: [DVec3; 4],
    /// Unit normals of its edges, inwards in its plane.
    inward: [DVec3; 4],
    count: usize,
}

impl Cover {
    fn of(patch: &RayPatch) -> Self {
        let (corners, count, normal) = (corners_of(patch), patch.corner_count as usize, patch_normal(patch));
        let inward =
            std::array::from_fn(|i| normal.cross(corners[(i + 1) % count] - corners[i % count]).normalize_or_zero());
        Self { corners, inward, count }
    }

    fn covers(&self, place: DVec3) -> bool {
        (0..self.count).all(|i| self.inward[i].dot(place - self.corners[i]) >= 0.0)
    }
}

/// Faces that cover parts of a side.
#[derive(Clone, Default)]
pub struct Covering {
    faces: Vec<Cover>,
    /// How far off the side's plane they may lie.
    off_m: f64,
}

impl Covering {
    /// Whether none does.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.faces.is_empty()
    }

    /// Those that may cover parts of an element of that side.
    #[must_use]
    pub fn over(&self, element: &Polygon) -> Self {
        let bounds = Bounds::of(element.corners());
        let around = Bounds { min: bounds.min - self.off_m, max: bounds.max + self.off_m };
        let faces = self.faces.iter().filter(|face| around.meets(Bounds::of(&face.corners)));
        Self { faces: faces.copied().collect(), ..*self }
    }

    /// Whether a place of that side lies under one of them.
    #[must_use]
    pub fn covers(&self, place: DVec3) -> bool {
        self.faces.iter().any(|face| face.covers(place))
    }

    /// Share of an element of that side that is seen.
    #[must_use]
    pub fn shown_share(&self, element: &Node) -> f64 {
        let over = self.over(&element.shape);
        if over.is_empty() {
            return 1.0;
        }
        let middle = |i: u32| (f64::from(i) + 0.5) / f64::from(PLACES);
        let places = (0..PLACES).flat_map(|i| (0..PLACES).map(move |j| (i, j)));
        let shown = places.filter(|&(i, j)| !over.covers(element.shape.point(middle(i), middle(j)))).count();
        shown as f64 / f64::from(PLACES * PLACES)
    }
}

impl RayScene<'_> {
    /// The patch side within `snap_m` of a point whose normal agrees with `normal` within 60 degrees:
    /// of several the nearest; of coincident ones the one that is seen.
    #[must_use]
    pub fn locate(&self, point: DVec3, normal: DVec3, snap_m: f64) -> Option<Place> {
        let mut best: Option<(f64, Rank, Place)> = None;
        let bounds = Bounds { min: point - snap_m, max: point + snap_m };
        self.each_in_box_of(&bounds, &mut |of, patch| {
            let front = patch_normal(patch);
            let cosine = front.dot(normal);
            let (outside, off) = distances(patch, front, point);
            if cosine.abs() < LEAST_COSINE || outside > snap_m || off > snap_m {
                return;
            }
            let place = Place { key: self.patch_at(of, patch, point), side: u8::from(cosine < 0.0) };
            let rank = self.rank(&Face { key: of.key(patch), front: place.side == 0, area_m2: patch.area_m2 });
            // Faces within the snap length of a point coincide there: their heights do not count. Outlines do, in steps
            // of a quarter, since those of neighbours differ by rounding alone.
            let distance = (outside / (0.25 * snap_m)).floor();
            if best.is_none_or(|(d, r, _)| distance < d || (distance == d && rank < r)) {
                best = Some((distance, rank, place));
            }
        });
        best.map(|(_, _, place)| place)
    }

    /// A point that faces along none of the faces within the snap length of it (a grid that ends in a wall), moved to
    /// their fronts: which of its rays meet them is no matter of rounding.
    #[must_use]
    pub fn off_surfaces(&self, point: DVec3) -> DVec3 {
        let mut near: Vec<(PatchKey, DVec3, DVec3)> = Vec::new();
        let bounds = Bounds { min: point - self.snap_m, max: point + self.snap_m };
        self.each_in_box_of(&bounds, &mut |of, patch| {
            let front = patch_normal(patch);
            let (outside, off) = distances(patch, front, point);
            if outside <= self.snap_m && off <= self.snap_m {
                near.push((of.key(patch), front, corners_of(patch)[0]));
            }
        });
        near.sort_by_key(|(key, ..)| *key);
        let (mut moved, mut fronts) = (point, Vec::<DVec3>::new());
        for (_, front, corner) in near {
            let height_m = front.dot(moved - corner);
            // Not back to where the first of two faces that turn their backs on each other has it from.
            if height_m < self.snap_m && fronts.iter().all(|other| other.dot(front) > -PARALLEL) {
                moved += front * (self.snap_m - height_m);
                fronts.push(front);
            }
        }
        moved
    }

    /// Faces that coincide with a node's side and are seen instead of it.
    #[must_use]
    pub fn covering(&self, node: &Node) -> Covering {
        let corners = node.shape.corners();
        let around = corners.iter().fold(Bounds::EMPTY, |bounds, c| bounds.with(*c));
        let bounds = Bounds { min: around.min - self.snap_m, max: around.max + self.snap_m };
        let mut faces = Vec::new();
        self.each_in_box_of(&bounds, &mut |of, patch| {
            let (key, normal) = (of.key(patch), patch_normal(patch));
            let face = Face { key, front: normal.dot(node.normal) > 0.0, area_m2: patch.area_m2 };
            let coincides = normal.dot(node.normal).abs() > PARALLEL
                && corners.iter().all(|c| distances(patch, normal, *c).1 <= self.snap_m);
            if coincides && key != node.end.face.key && self.covers_face(&face, &node.end.face) {
                faces.push(Cover::of(patch));
            }
        });
        Covering { faces, off_m: self.snap_m }
    }
}
