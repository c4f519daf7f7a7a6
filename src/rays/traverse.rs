//! Traversal: is a segment blocked, and what does a ray meet first. f64, edge-safe.
//!
//! The triangle test evaluates each edge's Pluecker product in an order that the neighbour across
//! the edge mirrors exactly, and counts zero as inside: a ray through a shared edge meets at least
//! one of the two. Where faces coincide, a ray meets the one that fronts it: see [`Rank`].

use glam::{DVec3, Vec3A};

use super::scene::{PatchKey, RayScene, Structure};
use crate::base::PatchSide;
use crate::geom::bounds::Bounds;
use crate::model::rays::{DEEPEST, RayNode, RayPatch};

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

/// A ray: f64 for patches, f32 for boxes, which are padded by more than f32 loses.
struct Ray {
    from: DVec3,
    along: DVec3,
    box_from: Vec3A,
    box_inverse: Vec3A,
    /// See [`Ray::padding`].
    box_padding: Vec3A,
    is_wide: bool,
}

impl Ray {
    /// `root` holds all that may be met.
    fn new(from: DVec3, along: DVec3, root: &RayNode) -> Self {
        let safe = |x: f64| if x.abs() < 1e-30 { 1e30_f64.copysign(x) } else { 1.0 / x };
        let inverse = DVec3::new(safe(along.x), safe(along.y), safe(along.z));
        Self {
            from,
            along,
            box_from: from.as_vec3a(),
            box_inverse: inverse.as_vec3a(),
            box_padding: padding(inverse, from, root),
            is_wide: largest(root) > WIDE_M,
        }
    }

    /// What boxes are grown by, in lengths of the ray: more than the rounding of differences, which the largest
    /// coordinate bounds. `root` holds the boxes: in a wide model one far off costs the others nothing.
    #[inline]
    fn padding(&self, root: &RayNode) -> Vec3A {
        if self.is_wide { padding(self.box_inverse.as_dvec3(), self.from, root) } else { self.box_padding }
    }

    /// Entry distance into a box, grown by `padding`, if the ray meets it within `from..=to`.
    #[inline(always)]
    fn enters(&self, node: &RayNode, padding: Vec3A, from: f32, to: f32) -> Option<f32> {
        let a = (Vec3A::from(node.min_m) - self.box_from) * self.box_inverse;
        let b = (Vec3A::from(node.max_m) - self.box_from) * self.box_inverse;
        let near = (a.min(b) - padding).max_element().max(from);
        let far = (a.max(b) + padding).min_element().min(to);
        (near <= far).then_some(near)
    }

    /// Distance to a patch where the ray crosses it: corners are taken relative to the ray's start.
    #[inline]
    fn meets(&self, patch: &RayPatch) -> Option<f64> {
        let corner = |i: usize| DVec3::from_array(patch.corners_m[i].map(f64::from)) - self.from;
        let side = |p: DVec3, q: DVec3| self.along.dot(p.cross(q));
        let inside = |u: f64, v: f64, w: f64| (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        let (a, b, c) = (corner(0), corner(1), corner(2));
        let diagonal = side(c, a);
        if inside(side(a, b), side(b, c), diagonal) {
            return self.distance(a, b, c);
        }
        if patch.corner_count < 4 {
            return None;
        }
        let d = corner(3);
        // The mirrored order of the products gives exactly the negative.
        if inside(-diagonal, side(c, d), side(d, a)) { self.distance(a, c, d) } else { None }
    }

    /// Distance to the plane of a triangle.
    fn distance(&self, a: DVec3, b: DVec3, c: DVec3) -> Option<f64> {
        let normal = (b - a).cross(c - a);
        let speed = normal.dot(self.along);
        (speed != 0.0).then(|| normal.dot(a) / speed)
    }
}

/// Largest coordinate, m, from which a model is wide: boxes are grown by millimetres and more.
const WIDE_M: f32 = 1e4;

fn largest(root: &RayNode) -> f32 {
    Vec3A::from(root.min_m).abs().max(Vec3A::from(root.max_m).abs()).max_element()
}

fn padding(inverse: DVec3, from: DVec3, root: &RayNode) -> Vec3A {
    let reach_m = from.abs().max_element().max(f64::from(largest(root)));
    (inverse.abs() * (reach_m * 4e-7)).as_vec3a()
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

impl<'a> RayScene<'a> {
    /// Visits every patch that the ray crosses within `low..=limit`, near boxes first; `met` may
    /// lower the limit, and stops the visit by returning true.
    #[inline]
    fn visit(
        &self,
        ray: &Ray,
        low: f64,
        mut limit: f64,
        mut met: impl FnMut(&Structure<'a>, &'a RayPatch, f64, &mut f64) -> bool,
    ) {
        // Cleared once for all clusters that the ray enters.
        let (mut of_top, mut of_cluster) = ([(0, 0.0); DEPTH], [(0, 0.0); DEPTH]);
        let mut top = Stack::new(&mut of_top, ray, self.top.nodes, low, limit);
        while let Some(node) = top.pop(ray, limit) {
            for place in Self::places(node) {
                let Some(of) = self.cluster_at(place) else { continue };
                let mut stack = Stack::new(&mut of_cluster, ray, of.nodes, low, limit);
                while let Some(leaf) = stack.pop(ray, limit) {
                    for patch in &of.faces[leaf.first as usize..(leaf.first + leaf.count) as usize] {
                        if let Some(t) = ray.meets(patch)
                            && t >= low
                            && t <= limit
                            && met(&of, patch, t, &mut limit)
                        {
                            return;
                        }
                    }
                }
            }
        }
    }

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

    /// Whether anything lies between two points on two patches, or those coincide; neither patch counts.
    #[must_use]
    pub fn blocked(&self, from: DVec3, to: DVec3, start: &RayEnd, end: &RayEnd) -> bool {
        // Nothing passes between faces that coincide, whatever rounding has put between them.
        let gap = (to - from).dot(start.normal).abs();
        if gap <= self.snap_m && start.normal.dot(end.normal).abs() > PARALLEL {
            return true;
        }
        let ray = Ray::new(from, to - from, &self.top.nodes[0]);
        let (before, after) = (self.reach(ray.along, start), self.reach(ray.along, end));
        let blocks = |key: PatchKey, patch: &RayPatch, t: f64| {
            if key == start.face.key || key == end.face.key {
                return false;
            }
            if t <= before
                && let Some(covers) = self.covers(ray.along, t, start, key, patch, true)
            {
                return covers;
            }
            if t >= 1.0 - after
                && let Some(covers) = self.covers(ray.along, 1.0 - t, end, key, patch, false)
            {
                return covers;
            }
            t > 0.0 && t < 1.0
        };
        let mut blocked = false;
        self.visit(&ray, -before, 1.0 + after, |of, patch, t, _| {
            blocked = blocks(of.key(patch), patch, t);
            blocked
        });
        blocked
    }

    /// Whether `test` holds for any face whose leaf's box meets `bounds`.
    pub(super) fn any_in_box_of(&self, bounds: &Bounds, test: impl Fn(&Structure<'_>, &RayPatch) -> bool) -> bool {
        let meets = |node: &RayNode| Bounds::from_f32(node.min_m, node.max_m).meets(*bounds);
        let mut top = vec![0u32];
        while let Some(at) = top.pop() {
            let node = &self.top.nodes[at as usize];
            if !meets(node) {
                continue;
            }
            if node.count == 0 {
                top.extend([node.first, node.first + 1]);
                continue;
            }
            for place in Self::places(node) {
                let Some(of) = self.cluster_at(place) else { continue };
                let mut stack = vec![0u32];
                while let Some(at) = stack.pop() {
                    let node = &of.nodes[at as usize];
                    if !meets(node) {
                        continue;
                    }
                    let items = node.first as usize..(node.first + node.count) as usize;
                    if node.count == 0 {
                        stack.extend([node.first, node.first + 1]);
                    } else if of.faces[items].iter().any(|patch| test(&of, patch)) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// What a ray from a patch (if any) meets first; of coincident faces the one that fronts it.
    /// `Covered` if the start itself lies under another face.
    #[must_use]
    pub fn nearest(&self, from: DVec3, along: DVec3, start: Option<&RayEnd>) -> Nearest {
        let ray = Ray::new(from, along, &self.top.nodes[0]);
        let before = start.map_or(0.0, |s| self.reach(along, s));
        let mut covered = false;
        let mut best: Option<(Hit, Face, Structure<'a>, &RayPatch)> = None;
        self.visit(&ray, -before, f64::INFINITY, |of, patch, t, limit| {
            let key = of.key(patch);
            if let Some(start) = start {
                if key == start.face.key {
                    return false;
                }
                if t <= before
                    && let Some(covers) = self.covers(along, t, start, key, patch, true)
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
            // Faces within the snap length of the nearest compete by rank; others by distance.
            let slack = 2.0 * self.snap_m / speed.abs().max(1e-6 * along.length());
            let wins = best.as_ref().is_none_or(|(other, other_face, ..)| {
                let gap = (t - other.t) * speed.abs();
                if gap.abs() <= self.snap_m && normal.dot(other.normal).abs() > PARALLEL {
                    self.covers_face(&face, other_face)
                } else {
                    t < other.t || (t == other.t && self.covers_face(&face, other_face))
                }
            });
            if wins {
                *limit = t + slack;
                best = Some((hit, face, *of, patch));
            }
            false
        });
        match best {
            _ if covered => Nearest::Covered,
            Some((hit, _, of, face)) => {
                Nearest::Met(Hit { key: self.patch_at(&of, face, from + along * hit.t), ..hit })
            }
            None => Nearest::Escaped,
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

/// Deepest stack of a traversal.
const DEPTH: usize = DEEPEST + 2;

/// Nodes still to visit, with where the ray enters them.
struct Stack<'a, 'w> {
    nodes: &'a [RayNode],
    waiting: &'w mut [(u32, f32); DEPTH],
    count: usize,
    padding: Vec3A,
    low: f32,
}

/// A distance as f32, not below it.
fn rounded_up(x: f64) -> f32 {
    (x as f32) * (1.0 + f32::EPSILON) + f32::MIN_POSITIVE
}

impl<'a, 'w> Stack<'a, 'w> {
    #[inline(always)]
    fn new(waiting: &'w mut [(u32, f32); DEPTH], ray: &Ray, nodes: &'a [RayNode], low: f64, limit: f64) -> Self {
        let low = -rounded_up(-low);
        let padding = ray.padding(&nodes[0]);
        let mut stack = Self { nodes, waiting, count: 0, padding, low };
        if let Some(near) = ray.enters(&nodes[0], padding, low, rounded_up(limit)) {
            stack.push(0, near);
        }
        stack
    }

    #[inline(always)]
    fn push(&mut self, node: u32, near: f32) {
        self.waiting[self.count] = (node, near);
        self.count += 1;
    }

    /// The next leaf that the ray enters before `limit`, nearer ones first.
    #[inline(always)]
    fn pop(&mut self, ray: &Ray, limit: f64) -> Option<&'a RayNode> {
        let limit = rounded_up(limit);
        loop {
            self.count = self.count.checked_sub(1)?;
            let (at, near) = self.waiting[self.count];
            if near > limit {
                continue;
            }
            let node = &self.nodes[at as usize];
            if node.count > 0 {
                return Some(node);
            }
            let left = ray.enters(&self.nodes[node.first as usize], self.padding, self.low, limit);
            let right = ray.enters(&self.nodes[node.first as usize + 1], self.padding, self.low, limit);
            match (left, right) {
                (Some(l), Some(r)) if l <= r => {
                    self.push(node.first + 1, r);
                    self.push(node.first, l);
                }
                (Some(l), Some(r)) => {
                    self.push(node.first, l);
                    self.push(node.first + 1, r);
                }
                (Some(l), None) => self.push(node.first, l),
                (None, Some(r)) => self.push(node.first + 1, r),
                (None, None) => {}
            }
        }
    }
}
