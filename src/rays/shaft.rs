//! Shafts: the convex hull of two polygons that face each other, and what lies in it.
//!
//! If nothing does, every segment between them is free; if one patch cuts the whole hull, none is.
//! Both are proofs, so links inherit them, and of what is in between they inherit the names: a shaft
//! between parts of the ends holds no more. Source of the idea: Haines and Wallace 1991.

use std::rc::Rc;

use glam::DVec3;

use super::scene::{PatchKey, RayScene};
use super::traverse::{Face, RayEnd};
use crate::geom::bounds::Bounds;
use crate::geom::polygon::Polygon;
use crate::model::rays::{RayNode, RayPatch};

/// A patch that may stand in between, and its cluster.
pub type Blocker<'a> = (u32, &'a RayPatch);

/// All that may stand in between, where that is little.
pub type Blockers<'a> = Option<Rc<[Blocker<'a>]>>;

/// Most patches that are named: segments are tried against each of them.
const MOST_BLOCKERS: usize = 16;

/// What a shaft holds.
#[derive(Clone, Debug)]
pub enum Contents<'a> {
    /// No geometry: all segments are free.
    Nothing,
    /// A patch that cuts every segment.
    Wall,
    /// Something: segments have to be tried.
    Something(Blockers<'a>),
}

/// What one patch is to a shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Outside,
    Inside,
    Across,
}

struct Plane {
    /// Unit, pointing out of the shaft.
    normal: DVec3,
    offset: f64,
}

/// One of the two polygons with what the rays know of its patch.
#[derive(Clone, Copy)]
pub struct ShaftEnd<'a> {
    /// The polygon, clipped to the front of the other's plane.
    pub shape: &'a Polygon,
    /// Its patch.
    pub end: RayEnd,
}

struct Shaft<'a> {
    ends: [ShaftEnd<'a>; 2],
    planes: Vec<Plane>,
    bounds: Bounds,
    slack_m: f64,
    snap_m: f64,
    scene: &'a RayScene<'a>,
}

impl<'a> Shaft<'a> {
    fn new(a: ShaftEnd<'a>, b: ShaftEnd<'a>, scene: &'a RayScene<'a>) -> Self {
        let snap_m = scene.snap_m;
        let corners = a.shape.corners().iter().chain(b.shape.corners());
        let bounds = corners.fold(Bounds::EMPTY, |bounds, c| bounds.with(*c));
        // Touching is not blocking: walls that end on the hull may lean in by the rounding of
        // coordinates, which the snap length exceeds many times.
        let (planes, slack_m) = (Vec::with_capacity(16), snap_m / 8.0);
        let mut shaft = Self { ends: [a, b], planes, bounds, slack_m, snap_m, scene };
        shaft.support(a.shape, b.shape);
        shaft.support(b.shape, a.shape);
        for end in [a, b] {
            let c = end.shape.corners();
            shaft.add(end.shape.normal(), c[0]);
        }
        shaft
    }

    /// Adds the planes through an edge of `edges` and a corner of `tips` that hold all corners: turned round
    /// the edge from `edges`' own plane, the last that meets a corner.
    fn support(&mut self, edges: &Polygon, tips: &Polygon) {
        let (c, middle, own) = (edges.corners(), edges.centroid(), edges.normal());
        for i in 0..c.len() {
            let along = c[(i + 1) % c.len()] - c[i];
            let mut outmost: Option<DVec3> = None;
            for tip in tips.corners() {
                let away = *tip - c[i];
                // Corners in the own plane are held by it.
                let is_apart = own.dot(*tip - c[0]).abs() > self.slack_m;
                if !is_apart || outmost.is_some_and(|normal| normal.dot(away) <= 0.0) {
                    continue;
                }
                let normal = along.cross(away);
                let normal = if normal.dot(middle - c[i]) > 0.0 { -normal } else { normal };
                outmost = Some(normal);
            }
            if let Some(normal) = outmost.and_then(DVec3::try_normalize) {
                self.add(normal, c[i]);
            }
        }
    }

    /// Adds a plane, turned outwards, unless corners lie on both sides or it is there already.
    fn add(&mut self, normal: DVec3, through: DVec3) {
        let offset = normal.dot(through);
        let tolerance = self.slack_m * 0.5;
        let (mut low, mut high) = (0.0f64, 0.0f64);
        for end in &self.ends {
            for corner in end.shape.corners() {
                let distance = normal.dot(*corner) - offset;
                low = low.min(distance);
                high = high.max(distance);
            }
        }
        let plane = if high <= tolerance {
            Plane { normal, offset: offset + high }
        } else if low >= -tolerance {
            Plane { normal: -normal, offset: -(offset + low) }
        } else {
            return;
        };
        let known =
            |p: &Plane| p.normal.dot(plane.normal) > 1.0 - 1e-12 && (p.offset - plane.offset).abs() <= tolerance;
        if !self.planes.iter().any(known) {
            self.planes.push(plane);
        }
    }

    fn misses_box(&self, node: &RayNode) -> bool {
        let bounds = Bounds::from_f32(node.min_m, node.max_m);
        let grown = Bounds { min: self.bounds.min - self.snap_m, max: self.bounds.max + self.snap_m };
        if !bounds.meets(grown) {
            return true;
        }
        // A plane misses the box if the box's innermost corner is outside; faces that coincide with
        // an end within the snap length must not be lost.
        self.planes.iter().any(|p| {
            let inner = DVec3::select(p.normal.cmpge(DVec3::ZERO), bounds.min, bounds.max);
            p.normal.dot(inner) - p.offset > self.snap_m
        })
    }

    fn holds(&self, cluster: u32, patch: &RayPatch) -> Part {
        let key = PatchKey { cluster, patch: patch.patch };
        if self.ends.iter().any(|e| e.end.face.key == key) {
            return Part::Outside;
        }
        let count = patch.corner_count as usize;
        let all = patch.corners_m.map(|c| DVec3::from_array(c.map(f64::from)));
        let corners = &all[..count];
        let normal = super::traverse::patch_normal(patch);
        for e in &self.ends {
            if self.coincides(e, corners, normal) {
                let front = normal.dot(self.facing(e)) > 0.0;
                let covers = self.scene.covers_face(&Face { key, front, area_m2: patch.area_m2 }, &e.end.face);
                return if covers && !self.beside(corners) { Part::Inside } else { Part::Outside };
            }
        }
        if self.beside(corners) || self.touches_only(corners[0], normal) {
            return Part::Outside;
        }
        if self.is_cut_by(corners, normal) { Part::Across } else { Part::Inside }
    }

    /// The normal of an end's side that looks into the shaft.
    fn facing(&self, e: &ShaftEnd<'_>) -> DVec3 {
        let other = if e.end.face.key == self.ends[0].end.face.key { &self.ends[1] } else { &self.ends[0] };
        let towards = other.shape.centre() - e.shape.centre();
        if towards.dot(e.end.normal) >= 0.0 { e.end.normal } else { -e.end.normal }
    }

    fn coincides(&self, e: &ShaftEnd<'_>, corners: &[DVec3], normal: DVec3) -> bool {
        let through = e.shape.corners()[0];
        normal.dot(e.end.normal).abs() > 0.999
            && corners.iter().all(|c| (*c - through).dot(e.end.normal).abs() <= self.snap_m)
    }

    /// Whether all corners lie outside one plane of the shaft, or on it.
    fn beside(&self, corners: &[DVec3]) -> bool {
        self.planes.iter().any(|p| {
            // The ends' own planes bound coincident faces, which the caller has dealt with.
            corners.iter().all(|c| p.normal.dot(*c) - p.offset >= -self.slack_m)
                && !self
                    .ends
                    .iter()
                    .any(|e| p.normal.dot(e.end.normal).abs() > 1.0 - 1e-9 && self.coincides(e, corners, e.end.normal))
        })
    }

    /// Whether the whole shaft lies on one side of the patch's plane.
    fn touches_only(&self, through: DVec3, normal: DVec3) -> bool {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for e in &self.ends {
            for c in e.shape.corners() {
                let distance = (*c - through).dot(normal);
                low = low.min(distance);
                high = high.max(distance);
            }
        }
        high <= self.slack_m || low >= -self.slack_m
    }

    /// Whether every segment from one end to the other crosses the patch.
    fn is_cut_by(&self, corners: &[DVec3], normal: DVec3) -> bool {
        let [a, b] = &self.ends;
        let side = |p: &Polygon, sign: f64| p.corners().iter().all(|c| sign * (*c - corners[0]).dot(normal) > 0.0);
        let sign = if side(a.shape, 1.0) && side(b.shape, -1.0) {
            1.0
        } else if side(a.shape, -1.0) && side(b.shape, 1.0) {
            -1.0
        } else {
            return false;
        };
        // From the side that the normal points to, the corners run anticlockwise: segments that go
        // down through the patch pass every edge on the same side.
        (0..corners.len()).all(|i| {
            let (p, q) = (corners[i], corners[(i + 1) % corners.len()]);
            a.shape.corners().iter().all(|from| {
                let (p, q) = (p - *from, q - *from);
                let turn = p.cross(q) * sign;
                b.shape.corners().iter().all(|to| turn.dot(*to - *from) < 0.0)
            })
        })
    }
}

/// What has been met so far: one more than can be named stands for too many.
#[derive(Default)]
struct Found<'a>(Vec<Blocker<'a>>);

impl<'a> Found<'a> {
    /// Returns whether the patch cuts the whole shaft.
    fn add(&mut self, shaft: &Shaft<'_>, (cluster, patch): Blocker<'a>) -> bool {
        let part = shaft.holds(cluster, patch);
        if part == Part::Inside && self.0.len() <= MOST_BLOCKERS {
            self.0.push((cluster, patch));
        }
        part == Part::Across
    }

    fn contents(self) -> Contents<'a> {
        match self.0.len() {
            0 => Contents::Nothing,
            count => Contents::Something((count <= MOST_BLOCKERS).then(|| self.0.into())),
        }
    }
}

impl<'a> RayScene<'a> {
    /// What lies between two polygons, the patches they lie on left out; `among`: all that lies between two
    /// polygons that hold these.
    #[must_use]
    pub fn shaft(&self, a: ShaftEnd<'_>, b: ShaftEnd<'_>, among: &Blockers<'a>) -> Contents<'a> {
        let shaft = Shaft::new(a, b, self);
        let mut found = Found::default();
        if let Some(among) = among {
            if among.iter().any(|blocker| found.add(&shaft, *blocker)) {
                return Contents::Wall;
            }
            return found.contents();
        }
        let is_cut = self.any_in_shaft(&shaft, |blocker| found.add(&shaft, blocker));
        if is_cut { Contents::Wall } else { found.contents() }
    }

    /// Whether nothing lies between two polygons, the patches they lie on left out: [`Self::shaft`], but ends at
    /// the first that does.
    #[must_use]
    pub fn is_free(&self, a: ShaftEnd<'_>, b: ShaftEnd<'_>) -> bool {
        let shaft = Shaft::new(a, b, self);
        !self.any_in_shaft(&shaft, |(cluster, patch)| shaft.holds(cluster, patch) != Part::Outside)
    }

    /// Whether `test` holds for any patch whose leaf's box meets a shaft.
    fn any_in_shaft(&self, shaft: &Shaft<'_>, mut test: impl FnMut(Blocker<'a>) -> bool) -> bool {
        let (mut top, mut stack) = (vec![0u32], Vec::with_capacity(32));
        while let Some(at) = top.pop() {
            let node = &self.top.nodes[at as usize];
            if shaft.misses_box(node) {
                continue;
            }
            if node.count == 0 {
                top.extend([node.first, node.first + 1]);
                continue;
            }
            for place in Self::places(node) {
                let Some(of) = self.cluster_at(place) else { continue };
                stack.clear();
                stack.push(0u32);
                while let Some(at) = stack.pop() {
                    let node = &of.nodes[at as usize];
                    if shaft.misses_box(node) {
                        continue;
                    }
                    if node.count == 0 {
                        stack.extend([node.first, node.first + 1]);
                        continue;
                    }
                    let faces = &of.faces[node.first as usize..(node.first + node.count) as usize];
                    if faces.iter().any(|face| test((of.cluster, face))) {
                        return true;
                    }
                }
            }
        }
        false
    }
}
