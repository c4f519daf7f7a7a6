//! Which patch side a point lies on.

use std::cell::RefCell;

use glam::DVec3;

use super::scene::{PatchKey, RayScene};
use super::traverse::{Rank, patch_normal};
use crate::geom::bounds::Bounds;
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

/// Distance of a point from a patch: in its plane from its outline (0 inside), and off its plane.
fn distances(patch: &RayPatch, normal: DVec3, point: DVec3) -> (f64, f64) {
    let c = patch.corners_m.map(|c| DVec3::from_array(c.map(f64::from)));
    let c = &c[..patch.corner_count as usize];
    let outside = (0..c.len())
        .map(|i| {
            let edge = c[(i + 1) % c.len()] - c[i];
            -normal.cross(edge).normalize_or_zero().dot(point - c[i])
        })
        .fold(0.0, f64::max);
    (outside, normal.dot(point - c[0]).abs())
}

impl RayScene<'_> {
    /// The patch side within `snap_m` of a point whose normal agrees with `normal` within 60 degrees:
    /// of several the nearest; of coincident ones the one that is seen.
    #[must_use]
    pub fn locate(&self, point: DVec3, normal: DVec3, snap_m: f64) -> Option<Place> {
        let best: RefCell<Option<(f64, Rank, Place)>> = RefCell::new(None);
        let bounds = Bounds { min: point - snap_m, max: point + snap_m };
        self.any_in_box_of(&bounds, |cluster, patch| {
            let front = patch_normal(patch);
            let cosine = front.dot(normal);
            let (outside, off) = distances(patch, front, point);
            if cosine.abs() < LEAST_COSINE || outside > snap_m || off > snap_m {
                return false;
            }
            let key = PatchKey { cluster, patch: patch.patch };
            let place = Place { key, side: u8::from(cosine < 0.0) };
            let rank = Rank::new(place.side == 0, patch.area_m2, key);
            // Steps of a quarter of the snap length: coincident faces differ by rounding alone.
            let distance = ((outside + off) / (0.25 * snap_m)).floor();
            let mut best = best.borrow_mut();
            if best.is_none_or(|(d, r, _)| distance < d || (distance == d && rank < r)) {
                *best = Some((distance, rank, place));
            }
            false
        });
        best.into_inner().map(|(_, _, place)| place)
    }
}
