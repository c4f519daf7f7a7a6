//! A second traversal to compare with: binary trees as they were built, one box and one face at a time.

use glam::{DVec3, Vec3A};
use obvhs::bvh2::node::Bvh2Node;

use super::{Face, Hit, Nearest, PARALLEL, RayEnd, patch_normal};
use crate::model::rays::RayPatch;
use crate::rays::{PatchKey, RayScene};

/// A model's binary trees: one over the faces of each cluster, one over the clusters.
pub(super) struct Trees {
    pub(super) top: Vec<Bvh2Node>,
    /// In leaf order: cluster, its tree, its faces in leaf order.
    pub(super) clusters: Vec<(u32, Vec<Bvh2Node>, Vec<RayPatch>)>,
}

struct Ray {
    from: DVec3,
    along: DVec3,
    box_from: Vec3A,
    box_inverse: Vec3A,
}

impl Ray {
    fn new(from: DVec3, along: DVec3) -> Self {
        let safe = |x: f64| if x.abs() < 1e-30 { 1e30_f64.copysign(x) } else { 1.0 / x };
        let inverse = DVec3::new(safe(along.x), safe(along.y), safe(along.z));
        Self { from, along, box_from: from.as_vec3a(), box_inverse: inverse.as_vec3a() }
    }

    fn padding(&self, root: &Bvh2Node, top: &Bvh2Node) -> Vec3A {
        let largest = |node: &Bvh2Node| node.min.abs().max(node.max.abs()).max_element();
        let root = if largest(top) > 1e4 { root } else { top };
        let reach_m = self.from.abs().max_element().max(f64::from(largest(root)));
        (self.box_inverse.as_dvec3().abs() * (reach_m * 4e-7)).as_vec3a()
    }

    fn enters(&self, node: &Bvh2Node, padding: Vec3A, from: f32, to: f32) -> Option<f32> {
        let a = (Vec3A::from(node.min) - self.box_from) * self.box_inverse;
        let b = (Vec3A::from(node.max) - self.box_from) * self.box_inverse;
        let near = (a.min(b) - padding).max_element().max(from);
        let far = (a.max(b) + padding).min_element().min(to);
        (near <= far).then_some(near)
    }

    fn meets(&self, patch: &RayPatch) -> Option<f64> {
        let corner = |i: usize| DVec3::from_array(patch.corners_m[i].map(f64::from)) - self.from;
        let side = |p: DVec3, q: DVec3| self.along.dot(p.cross(q));
        let inside = |u: f64, v: f64, w: f64| (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        let (a, b, c, d) = (corner(0), corner(1), corner(2), corner(3));
        let distance = |b: DVec3, c: DVec3| {
            let normal = (b - a).cross(c - a);
            let speed = normal.dot(self.along);
            (speed != 0.0).then(|| normal.dot(a) / speed)
        };
        if inside(side(a, b), side(b, c), side(c, a)) {
            return distance(b, c);
        }
        let second = patch.corner_count == 4 && inside(-side(c, a), side(c, d), side(d, a));
        if second { distance(c, d) } else { None }
    }
}

fn rounded_up(x: f64) -> f32 {
    (x as f32) * (1.0 + f32::EPSILON) + f32::MIN_POSITIVE
}

/// Visits leaves, the nearer of two children first.
fn walk(
    nodes: &[Bvh2Node],
    ray: &Ray,
    padding: Vec3A,
    low: f64,
    limit: &mut f64,
    mut leaf: impl FnMut(std::ops::Range<usize>, &mut f64) -> bool,
) -> bool {
    let low = -rounded_up(-low);
    let enters = |at: u32, limit: f64| {
        let near = ray.enters(&nodes[at as usize], padding, low, rounded_up(limit));
        near.map(|near| (at, near))
    };
    let mut waiting: Vec<(u32, f32)> = enters(0, *limit).into_iter().collect();
    while let Some((at, near)) = waiting.pop() {
        let node = &nodes[at as usize];
        let (first, items) = (node.first_index, node.prim_count);
        if near > rounded_up(*limit) {
            continue;
        }
        if items > 0 {
            if leaf(first as usize..(first + items) as usize, limit) {
                return true;
            }
            continue;
        }
        match (enters(first, *limit), enters(first + 1, *limit)) {
            (Some(l), Some(r)) if l.1 <= r.1 => waiting.extend([r, l]),
            (l, r) => waiting.extend(l.into_iter().chain(r)),
        }
    }
    false
}

/// Whether two patches that a segment joins coincide.
pub(super) fn coincide(scene: &RayScene<'_>, along: DVec3, start: &RayEnd, end: &RayEnd) -> bool {
    along.dot(start.normal).abs() <= scene.snap_m && start.normal.dot(end.normal).abs() > PARALLEL
}

impl Trees {
    fn visit(
        &self,
        ray: &Ray,
        low: f64,
        mut limit: f64,
        mut met: impl FnMut(PatchKey, &RayPatch, f64, &mut f64) -> bool,
    ) {
        let top = &self.top[0];
        walk(&self.top, ray, ray.padding(top, top), low, &mut limit, |places, limit| {
            self.clusters[places].iter().any(|(cluster, nodes, faces)| {
                walk(nodes, ray, ray.padding(&nodes[0], top), low, limit, |of, limit| {
                    faces[of].iter().any(|face| {
                        let key = PatchKey { cluster: *cluster, patch: face.patch };
                        ray.meets(face).is_some_and(|t| t >= low && t <= *limit && met(key, face, t, limit))
                    })
                })
            })
        });
    }

    pub(super) fn blocked(
        &self,
        scene: &RayScene<'_>,
        [from, to]: [DVec3; 2],
        start: Option<&RayEnd>,
        end: &RayEnd,
    ) -> bool {
        if start.is_some_and(|start| coincide(scene, to - from, start, end)) {
            return true;
        }
        let ray = Ray::new(from, to - from);
        let before = start.map_or(0.0, |s| scene.reach(ray.along, s));
        let after = scene.reach(ray.along, end);
        let mut blocked = false;
        self.visit(&ray, -before, 1.0 + after, |key, patch, t, _| {
            let at_start = || {
                let near_start = start.filter(|_| t <= before);
                near_start.and_then(|start| scene.covers(ray.along, t, start, key, patch, true))
            };
            let at_end =
                || (t >= 1.0 - after).then(|| scene.covers(ray.along, 1.0 - t, end, key, patch, false)).flatten();
            let is_own = start.is_some_and(|start| key == start.face.key) || key == end.face.key;
            blocked = !is_own && at_start().or_else(at_end).unwrap_or(t > 0.0 && t < 1.0);
            blocked
        });
        blocked
    }

    pub(super) fn nearest(&self, scene: &RayScene<'_>, from: DVec3, along: DVec3, start: Option<&RayEnd>) -> Nearest {
        let before = start.map_or(0.0, |s| scene.reach(along, s));
        let mut covered = false;
        let mut best: Option<(Hit, Face)> = None;
        self.visit(&Ray::new(from, along), -before, f64::INFINITY, |key, patch, t, limit| {
            if start.is_some_and(|start| key == start.face.key) {
                return false;
            }
            let near_start = start.filter(|_| t <= before);
            if let Some(covers) = near_start.and_then(|start| scene.covers(along, t, start, key, patch, true)) {
                covered |= covers;
                return covered;
            }
            if t <= 0.0 {
                return false;
            }
            let normal = patch_normal(patch);
            let speed = normal.dot(along);
            let hit = Hit { key, normal, front: speed < 0.0, t };
            let face = Face { key, front: hit.front, area_m2: patch.area_m2 };
            let wins = best.as_ref().is_none_or(|(other, other_face)| {
                let gap = (t - other.t) * speed.abs();
                if gap.abs() <= scene.snap_m && normal.dot(other.normal).abs() > PARALLEL {
                    scene.covers_face(&face, other_face)
                } else {
                    t < other.t || (t == other.t && scene.covers_face(&face, other_face))
                }
            });
            if wins {
                *limit = t + 2.0 * scene.snap_m / speed.abs().max(1e-6 * along.length());
                best = Some((hit, face));
            }
            false
        });
        match best {
            _ if covered => Nearest::Covered,
            Some((hit, _)) => Nearest::Met(hit),
            None => Nearest::Escaped,
        }
    }
}
