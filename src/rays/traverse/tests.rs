//! Hierarchies, their order and lanes change no bit of an answer.

use bytemuck::Zeroable;
use glam::{DMat3, DVec3};

use super::{Face, GRAZING, Hit, Nearest, Open, PARALLEL, RayEnd, Segment, patch_normal};
use crate::geom::bounds::Bounds;
use crate::geom::sequence::mix;
use crate::model::rays::{ClusterRaysView, ClusterRef, Cuts, RayPatch, TopRaysView, WHOLE};
use crate::rays::lanes::{Cast, FaceRay, Lanes, Plain};
use crate::rays::{Emitters, PatchKey, RayScene, build};

/// Random numbers in order.
struct Random(u64);

impl Random {
    fn word(&mut self) -> u64 {
        self.0 += 1;
        mix(self.0)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.word() % count as u64) as usize
    }

    /// In -1..1.
    fn number(&mut self) -> f64 {
        (self.word() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.number(), self.number(), self.number())
    }
}

/// Where a scene lies, and how it is turned.
#[derive(Clone, Copy)]
struct Frame {
    turn: DMat3,
    size: DVec3,
    at: DVec3,
}

impl Frame {
    /// To a grid of a few steps, so that faces share places, lie in each other, or are lines and points.
    fn place(&self, random: &mut Random) -> DVec3 {
        (random.vector() * 3.0).round() / 3.0
    }

    fn face(&self, random: &mut Random, earlier: &[RayPatch]) -> RayPatch {
        let mut face = RayPatch { cut: WHOLE, ..RayPatch::zeroed() };
        let quad = random.below(2) == 0;
        if !earlier.is_empty() && random.below(4) == 0 {
            face = earlier[random.below(earlier.len())];
            if random.below(2) == 0 {
                face.corners_m.swap(0, 2);
            }
        } else {
            let (a, u, v) = (self.place(random), self.place(random), self.place(random));
            let axis = random.below(4);
            let flat = |p: DVec3| if axis < 3 { p * (DVec3::ONE - DVec3::AXES[axis]) } else { p };
            let (u, v) = (flat(u), flat(v));
            let corners = if quad { [a, a + u, a + u + v, a + v] } else { [a, a + u, a + u + v, a + u + v] };
            face.corners_m = corners.map(|c| (self.turn * (c * self.size) + self.at).as_vec3().to_array());
            face.corner_count = if quad { 4 } else { 3 };
        }
        if random.below(8) == 0 {
            // Within the snap length, or a little beyond.
            let off = random.vector().as_vec3() * 2e-3;
            face.corners_m = face.corners_m.map(|c| (glam::Vec3::from(c) + off).to_array());
        }
        face.area_m2 = 1.0 + random.below(3) as f32;
        face
    }
}

fn bounds(faces: &[RayPatch]) -> ([f32; 3], [f32; 3]) {
    let corners: Vec<DVec3> =
        faces.iter().flat_map(|f| f.corners_m).map(|c| DVec3::from_array(c.map(f64::from))).collect();
    let bounds = Bounds::of(&corners);
    (bounds.min.as_vec3().to_array(), bounds.max.as_vec3().to_array())
}

fn bits(nearest: &Nearest) -> Option<(u32, [u64; 4], bool)> {
    match nearest {
        Nearest::Escaped => None,
        Nearest::Covered => Some((u32::MAX, [0; 4], false)),
        Nearest::Met(hit) => {
            let [x, y, z] = hit.normal.to_array().map(f64::to_bits);
            Some((hit.key.packed(), [x, y, z, hit.t.to_bits()], hit.front))
        }
    }
}

/// Every face of a scene, with its cluster.
struct Faces(Vec<(u32, RayPatch)>);

impl Faces {
    /// All that a ray's line crosses, and where.
    fn crossed(&self, from: DVec3, along: DVec3) -> impl Iterator<Item = (PatchKey, &RayPatch, f64)> {
        let ray = FaceRay::new(from, along);
        self.0.iter().filter_map(move |(cluster, face)| {
            let key = PatchKey { cluster: *cluster, patch: face.patch };
            Plain.crosses(face, &ray).map(|t| (key, face, t))
        })
    }

    fn blocked(&self, scene: &RayScene<'_>, [from, to]: [DVec3; 2], start: Option<&RayEnd>, end: &RayEnd) -> bool {
        let along = to - from;
        if start.is_some_and(|start| coincide(scene, along, start, end)) {
            return true;
        }
        let (before, after) = (start.map_or(0.0, |s| scene.reach(along, s)), scene.reach(along, end));
        self.crossed(from, along).filter(|(.., t)| *t >= -before && *t <= 1.0 + after).any(|(key, face, t)| {
            let at_start = start.filter(|_| t <= before);
            let at_start = at_start.and_then(|start| scene.covers(along, t, start, key, face, true));
            let at_end = || (t >= 1.0 - after).then(|| scene.covers(along, 1.0 - t, end, key, face, false)).flatten();
            let is_own = start.is_some_and(|start| key == start.face.key) || key == end.face.key;
            !is_own && at_start.or_else(at_end).unwrap_or(t > 0.0 && t < 1.0)
        })
    }

    fn nearest(&self, scene: &RayScene<'_>, from: DVec3, along: DVec3, start: Option<&RayEnd>) -> Nearest {
        let before = start.map_or(0.0, |s| scene.reach(along, s));
        let mut met = Vec::new();
        for (key, face, t) in self.crossed(from, along).filter(|(.., t)| *t >= -before) {
            if start.is_some_and(|start| key == start.face.key) {
                continue;
            }
            let at_start = start.filter(|_| t <= before);
            match at_start.and_then(|start| scene.covers(along, t, start, key, face, true)) {
                Some(true) => return Nearest::Covered,
                None if t > 0.0 => {
                    let normal = patch_normal(face);
                    let hit = Hit { key, normal, front: normal.dot(along) < 0.0, t };
                    met.push((hit, scene.rank(&Face { key, front: hit.front, area_m2: face.area_m2 })));
                }
                _ => {}
            }
        }
        let nearest =
            met.iter().min_by(|(a, rank), (b, other)| a.t.total_cmp(&b.t).then(rank.partial_cmp(other).unwrap()));
        let Some((nearest, _)) = nearest.copied() else { return Nearest::Escaped };
        let coincide = met.iter().filter(|(hit, _)| {
            let (after, speed) = (hit.t - nearest.t, hit.normal.dot(along).abs());
            let is_near = after * speed <= scene.snap_m && after <= scene.snap_m / (GRAZING * along.length());
            is_near && (hit.normal.dot(nearest.normal).abs() > PARALLEL || hit.key == nearest.key)
        });
        Nearest::Met(coincide.min_by(|(_, a), (_, b)| a.partial_cmp(b).unwrap()).unwrap().0)
    }
}

/// Whether two patches that a segment joins coincide.
fn coincide(scene: &RayScene<'_>, along: DVec3, start: &RayEnd, end: &RayEnd) -> bool {
    along.dot(start.normal).abs() <= scene.snap_m && start.normal.dot(end.normal).abs() > PARALLEL
}

/// Casts rays in one random scene of so many clusters of up to so many faces; how many met something.
fn agree(seed: u64, frame: Frame, clusters: usize, most: usize) -> usize {
    let mut random = Random(seed << 32);
    let (mut all, mut every, mut refs, mut bytes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut emitters = Emitters::default();
    for cluster in 0..clusters as u32 {
        let mut faces = Vec::new();
        for patch in 0..1 + random.below(most) as u32 {
            let earlier = if random.below(2) == 0 { &faces } else { &all };
            let face = frame.face(&mut random, earlier);
            faces.push(RayPatch { patch, ..face });
        }
        emitters.add(cluster, (0..2 * faces.len()).filter(|_| random.below(3) == 0));
        let (nodes, patches) = build::cluster(&faces);
        every.extend(faces.iter().map(|face| (cluster, *face)));
        let cuts = Cuts { faces: &[], nodes: &[], parts: &[] };
        let payload = ClusterRaysView { nodes: &nodes, patches: &patches, cuts }.payload();
        let (min_m, max_m) = bounds(&faces);
        refs.push((ClusterRef::to(cluster, &payload, bytes.len() as u64).unwrap(), min_m, max_m));
        bytes.extend_from_slice(&payload);
        all.extend(faces);
    }
    let (nodes, places) = build::top(&refs);
    let every = Faces(every);
    let mut words = vec![0u128; bytes.len().div_ceil(16)];
    bytemuck::cast_slice_mut::<u128, u8>(&mut words)[..bytes.len()].copy_from_slice(&bytes);
    let view = TopRaysView { nodes: &nodes, clusters: &places };
    let scene = RayScene::new(view, bytemuck::cast_slice(&words), &emitters, 1e-3).unwrap();

    let sides: Vec<(RayEnd, [DVec3; 4])> = (every.0.iter())
        .map(|(cluster, face)| {
            let key = PatchKey { cluster: *cluster, patch: face.patch };
            let face_of = Face { key, front: face.patch % 2 == 0, area_m2: face.area_m2 };
            let corners = face.corners_m.map(|c| DVec3::from_array(c.map(f64::from)));
            (RayEnd { normal: patch_normal(face), face: face_of }, corners)
        })
        .collect();
    let mut met = 0;
    for _ in 0..2000 {
        let draw = |random: &mut Random| {
            let (end, c) = &sides[random.below(sides.len())];
            let (u, v) = (random.below(5) as f64 / 4.0, random.number().abs());
            (end, c[0].lerp(c[1], u).lerp(c[3].lerp(c[2], u), v))
        };
        let ((start, from), (end, to)) = (draw(&mut random), draw(&mut random));
        let direct = match random.below(3) {
            0 => frame.turn * DVec3::AXES[random.below(3)],
            1 => random.vector(),
            _ => to - from,
        };
        let start_or_none = if random.below(4) == 0 { None } else { Some(start) };
        let expected = every.nearest(&scene, from, direct, start_or_none);
        let plain = Open { scene: &scene, from, along: direct, start: start_or_none }.cast(Plain);
        for found in [scene.nearest(from, direct, start_or_none), plain] {
            assert_eq!(bits(&found), bits(&expected), "seed {seed}: {found:?}, {expected:?}");
        }
        met += usize::from(matches!(expected, Nearest::Met(_)));
        let expected = every.blocked(&scene, [from, to], start_or_none, end);
        assert_eq!(scene.blocked(from, to, start_or_none, end), expected, "seed {seed}");
        // What coincides is no matter of traversal.
        if !start_or_none.is_some_and(|start| coincide(&scene, to - from, start, end)) {
            let segment = Segment { scene: &scene, from, along: to - from, start: start_or_none, end };
            assert_eq!(segment.cast(Plain), expected, "seed {seed}");
        }
    }
    met
}

#[test]
fn rays_meet_the_same_to_the_bit_as_where_every_face_is_looked_at() {
    let turned = DMat3::from_rotation_z(0.31) * DMat3::from_rotation_x(0.47);
    let room = Frame { turn: DMat3::IDENTITY, size: DVec3::new(5.0, 4.0, 3.0), at: DVec3::ZERO };
    let frames = [room, Frame { turn: turned, ..room }, Frame { at: DVec3::new(3e4, -2e5, 50.0), ..room }];
    let mut met = 0;
    for seed in 0..60 {
        let (clusters, most) = [(1, 1), (1, 64), (3, 5), (40, 9), (90, 2), (20, 40)][seed % 6];
        met += agree(seed as u64 + 1, frames[seed / 6 % 3], clusters, most);
    }
    assert!(met > 40_000, "{met} of 120,000 rays met something");
}
