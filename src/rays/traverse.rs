//! Traversal: is a segment blocked, and what does a ray meet first. f64, edge-safe.
//!
//! The triangle test evaluates what each edge spans with the ray in an order that the neighbour across
//! the edge mirrors exactly, and counts zero as inside: a ray through a shared edge meets at least
//! one of the two. Where faces coincide, a ray meets the one that fronts it: see [`Rank`]. No answer depends on the order
//! in which faces come.

#[cfg(test)]
mod tests;

use glam::DVec3;

use super::lanes::{Cast, Lanes, cast};
use super::scene::{PatchKey, RayScene, Structure};
use super::walk::Ray;
use crate::base::PatchSide;
use crate::geom::bounds::Bounds;
use crate::model::rays::{RayNode, RayPatch};

/// Which of several coincident faces a viewer sees: the least. What emits there before what does not (a lamp among
/// the tiles of a ceiling, however either is divided), fronts before backs, then the smaller (a panel laid on a
/// ceiling), then the first.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Rank(bool, bool, f32, PatchKey);

/// A side of a face as a viewer finds it among coincident ones.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// The face's first part: parts of one face are one to rays.
    pub key: PatchKey,
    /// Whether its front is looked at.
    pub front: bool,
    /// Its area, m2.
    pub area_m2: f32,
}

/// One end of a segment, on a patch that the segment itself never meets.
#[derive(Clone, Copy, Debug)]
pub struct RayEnd {
    /// The patch's unit front normal.
    pub normal: DVec3,
    /// The side that the segment touches.
    pub face: Face,
}

/// What a ray met first.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// The patch: a part of the face that was met.
    pub key: PatchKey,
    /// The face's unit front normal.
    pub normal: DVec3,
    /// Whether its front was met.
    pub front: bool,
    /// Distance in lengths of the ray's direction.
    pub t: f64,
}

impl Hit {
    /// The side that was met.
    #[must_use]
    pub fn side(&self) -> PatchSide {
        PatchSide { patch: self.key.patch as u8, side: u8::from(!self.front) }
    }
}

/// Unit front normal of a patch.
#[must_use]
pub fn patch_normal(patch: &RayPatch) -> DVec3 {
    let corner = |i: usize| DVec3::from_array(patch.corners_m[i].map(f64::from));
    (corner(2) - corner(0))
        .cross(corner(3) - corner(1))
        .normalize_or((corner(1) - corner(0)).cross(corner(2) - corner(0)).normalize_or_zero())
}

/// Cosine above which two planes count as parallel (2.5 degrees).
pub(super) const PARALLEL: f64 = 0.999;

/// Cosine of rays with faces below which those that nearly coincide are met as they come.
const GRAZING: f64 = 0.02;

impl RayScene<'_> {
    /// A side's place among those that coincide with it.
    #[must_use]
    pub fn rank(&self, face: &Face) -> Rank {
        Rank(!self.emitters.emits(face.key, face.front), !face.front, face.area_m2, face.key)
    }

    /// Whether, of two sides that coincide, `face` is what is seen.
    #[must_use]
    pub fn covers_face(&self, face: &Face, other: &Face) -> bool {
        self.rank(face) < self.rank(other)
    }

    /// How far beyond its end a ray must look for faces that coincide with it.
    fn reach(&self, along: DVec3, end: &RayEnd) -> f64 {
        let speed = along.dot(end.normal).abs();
        if speed > 0.0 { (2.0 * self.snap_m / speed).min(0.5) } else { 0.0 }
    }

    /// Whether `patch`, crossed at a plane distance within the snap length of `end`, coincides with
    /// it; then whether it is what is seen instead.
    fn covers(
        &self,
        along: DVec3,
        gap: f64,
        end: &RayEnd,
        key: PatchKey,
        patch: &RayPatch,
        leaving: bool,
    ) -> Option<bool> {
        let normal = patch_normal(patch);
        let coincide = (gap * along.dot(end.normal)).abs() <= self.snap_m && normal.dot(end.normal).abs() > PARALLEL;
        coincide.then(|| {
            let front = (normal.dot(along) > 0.0) == leaving;
            self.covers_face(&Face { key, front, area_m2: patch.area_m2 }, &end.face)
        })
    }

    /// Whether anything lies between a point, of a patch or free, and one of another patch, or those patches coincide;
    /// neither of them counts.
    #[must_use]
    pub fn blocked(&self, from: DVec3, to: DVec3, start: Option<&RayEnd>, end: &RayEnd) -> bool {
        // Nothing passes between faces that coincide, whatever rounding has put between them.
        let coincide = |start: &RayEnd| {
            let gap = (to - from).dot(start.normal).abs();
            gap <= self.snap_m && start.normal.dot(end.normal).abs() > PARALLEL
        };
        if start.is_some_and(coincide) {
            return true;
        }
        cast(Segment { scene: self, from, along: to - from, start, end })
    }

    /// Calls `visit` with every face whose leaf's box meets `bounds`.
    pub(super) fn each_in_box_of(&self, bounds: &Bounds, visit: &mut dyn FnMut(&Structure<'_>, &RayPatch)) {
        each_leaf(self.top.nodes, bounds, &mut |places| {
            for of in places.filter_map(|place| self.cluster_at(place)) {
                each_leaf(of.nodes, bounds, &mut |faces| of.faces[faces].iter().for_each(|face| visit(&of, face)));
            }
        });
    }

    /// What a ray from a patch (if any) meets first; of coincident faces the one that fronts it.
    /// `Covered` if the start itself lies under another face.
    #[must_use]
    pub fn nearest(&self, from: DVec3, along: DVec3, start: Option<&RayEnd>) -> Nearest {
        cast(Open { scene: self, from, along, start })
    }
}

/// Calls `visit` with the items of every leaf whose box meets `bounds`.
fn each_leaf(nodes: &[RayNode], bounds: &Bounds, visit: &mut dyn FnMut(std::ops::Range<usize>)) {
    let mut waiting = vec![0];
    while let Some(at) = waiting.pop() {
        let node: &RayNode = &nodes[at as usize];
        for slot in node.used() {
            let (min_m, max_m) = node.bounds_m(slot);
            if !Bounds::from_f32(min_m, max_m).meets(*bounds) {
                continue;
            }
            let first = node.first[slot];
            if node.items[slot] == 0 {
                waiting.push(first);
            } else {
                visit(first as usize..(first + node.items[slot]) as usize);
            }
        }
    }
}

/// Where a ray ends.
#[derive(Clone, Copy, Debug)]
pub enum Nearest {
    /// On a patch.
    Met(Hit),
    /// Outside the model.
    Escaped,
    /// Nowhere: another face covers the place it starts from.
    Covered,
}

/// A ray from a patch (if any) to another.
struct Segment<'s, 'a> {
    scene: &'s RayScene<'a>,
    from: DVec3,
    along: DVec3,
    start: Option<&'s RayEnd>,
    end: &'s RayEnd,
}

impl Cast for Segment<'_, '_> {
    type Answer = bool;

    #[inline(always)]
    fn cast<L: Lanes>(self, lanes: L) -> bool {
        let Self { scene, from, along, start, end } = self;
        let (before, after) = (start.map_or(0.0, |s| scene.reach(along, s)), scene.reach(along, end));
        let blocks = |key: PatchKey, patch: &RayPatch, t: f64| {
            if start.is_some_and(|s| key == s.face.key) || key == end.face.key {
                return false;
            }
            if let Some(start) = start
                && t <= before
                && let Some(covers) = scene.covers(along, t, start, key, patch, true)
            {
                return covers;
            }
            if t >= 1.0 - after
                && let Some(covers) = scene.covers(along, 1.0 - t, end, key, patch, false)
            {
                return covers;
            }
            t > 0.0 && t < 1.0
        };
        let ray = Ray::new(from, along, -before, scene.largest_m);
        let mut blocked = false;
        scene.visit::<L, false>(lanes, &ray, (-before, 1.0 + after), |of, patch, t, _| {
            blocked = blocks(of.key(patch), patch, t);
            blocked
        });
        blocked
    }
}

/// A ray that ends where it meets something.
struct Open<'s, 'a> {
    scene: &'s RayScene<'a>,
    from: DVec3,
    along: DVec3,
    start: Option<&'s RayEnd>,
}

/// A face that a ray crosses.
#[derive(Clone, Copy)]
struct Met<'a> {
    hit: Hit,
    face: Face,
    of: Structure<'a>,
    patch: &'a RayPatch,
    /// Of the ray towards the face, in metres a length of its own.
    speed: f64,
}

impl Met<'_> {
    /// Whether it lies within the snap length of a face that the ray crosses at `t` before.
    fn is_at(&self, t: f64, snap_m: f64) -> bool {
        (self.hit.t - t) * self.speed <= snap_m
    }
}

impl<'a> Cast for Open<'_, 'a> {
    type Answer = Nearest;

    #[inline(always)]
    fn cast<L: Lanes>(self, lanes: L) -> Nearest {
        let Self { scene, from, along, start } = self;
        let before = start.map_or(0.0, |s| scene.reach(along, s));
        let ray = Ray::new(from, along, -before, scene.largest_m);
        let slack = scene.snap_m / (GRAZING * along.length());
        let mut covered = false;
        let mut nearest: Option<Met<'a>> = None;
        // Hardly ever any: what lies as near, or a little beyond.
        let mut others: Vec<Met<'a>> = Vec::new();
        scene.visit::<L, true>(lanes, &ray, (-before, f64::INFINITY), |of, patch, t, limit| {
            let key = of.key(patch);
            if let Some(start) = start {
                if key == start.face.key {
                    return false;
                }
                if t <= before
                    && let Some(covers) = scene.covers(along, t, start, key, patch, true)
                {
                    covered |= covers;
                    return covered;
                }
            }
            if t <= 0.0 {
                return false;
            }
            let normal = patch_normal(patch);
            let speed = normal.dot(along);
            let hit = Hit { key, normal, front: speed < 0.0, t };
            let face = Face { key, front: hit.front, area_m2: patch.area_m2 };
            let met = Met { hit, face, of: *of, patch, speed: speed.abs() };
            let behind = match nearest {
                Some(other) if other.hit.t < t || (other.hit.t == t && scene.covers_face(&other.face, &face)) => {
                    Some(met)
                }
                _ => nearest.replace(met),
            };
            let first_t = nearest.as_ref().map_or(t, |nearest| nearest.hit.t);
            // What covers the start is looked for as far as it may be.
            *limit = (first_t + slack).max(before);
            others.extend(behind.filter(|other| other.is_at(first_t, scene.snap_m)));
            false
        });
        let Some(nearest) = nearest.filter(|_| !covered) else {
            return if covered { Nearest::Covered } else { Nearest::Escaped };
        };
        let t = nearest.hit.t;
        let seen = others.iter().fold(&nearest, |seen, other| {
            let coincides = other.hit.normal.dot(nearest.hit.normal).abs() > PARALLEL
                && other.is_at(t, scene.snap_m)
                && other.hit.t <= t + slack;
            if coincides && scene.covers_face(&other.face, &seen.face) { other } else { seen }
        });
        Nearest::Met(Hit { key: scene.patch_at(&seen.of, seen.patch, from + along * seen.hit.t), ..seen.hit })
    }
}
