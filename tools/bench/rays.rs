//! Times rays on real models, beside obvhs' own CwBvh over the same triangles: `cargo bench --bench rays`. One JSON
//! line a figure. One core; each figure is the best of some passes, taken in turns.

mod closed;
mod common;

use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

use clerestory::base::{Quiet, Result};
use clerestory::geom::polygon::Polygon;
use clerestory::geom::sequence::{Sequence, cosine_direction};
use clerestory::model::rays::RayPatch;
use clerestory::rays::traverse::{Face, Nearest, RayEnd, patch_normal};
use clerestory::rays::{PatchKey, RayScene};
use clerestory::stages::ingest;
use clerestory::stages::ray_scene::with_scene;
use clerestory::stages::working_set::WorkingSet;
use clerestory::store::{Snapshot, Store};
use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;

use self::common::support::options;
use self::common::{PASSES, print, thread_cpu_s};

/// What is looked for: from the repository's folder, where the model is.
const MODELS: [(&str, &str); 2] =
    [("office", "data/office.obj"), ("soda-floor5", "../shared/scenes/soda-floor5/soda-floor5.obj")];
const RAYS: usize = 1 << 18;
/// Rays from one face, as rows cast them.
const A_FACE: usize = 16;
/// Lamps of which the nearest is asked for, about as the light tree draws them.
const LAMPS: usize = 8;
/// Where obvhs begins and ends, in lengths of a ray: it knows nothing of faces that coincide.
const SKIN: f32 = 1e-4;

/// A face, by whatever casts.
struct Side {
    shape: Polygon,
    end: RayEnd,
    emits: [bool; 2],
}

struct Segment {
    from: DVec3,
    along: DVec3,
    start: usize,
    /// The lamp; of no meaning for rays.
    end: usize,
}

fn sides(set: &WorkingSet<'_>) -> Result<Vec<Side>> {
    let (rays, emitters) = (set.snapshot().store().rays()?, set.emitters()?);
    let mut sides = Vec::new();
    for at in rays.top()?.clusters {
        let start = at.patches_at as usize;
        let faces = &rays.file()[start..start + at.patches as usize * size_of::<RayPatch>()];
        for face in bytemuck::cast_slice::<u8, RayPatch>(faces) {
            let key = PatchKey { cluster: at.cluster, patch: face.patch };
            let corners = face.corners_m.map(|c| DVec3::from_array(c.map(f64::from)));
            sides.push(Side {
                shape: Polygon::new(&corners[..face.corner_count as usize]),
                end: RayEnd { normal: patch_normal(face), face: Face { key, front: true, area_m2: face.area_m2 } },
                emits: [true, false].map(|front| emitters.emits(key, front)),
            });
        }
    }
    Ok(sides)
}

fn hemispheres(sides: &[Side]) -> Vec<Segment> {
    let sequence = Sequence::new(1);
    let ray = |i: usize| {
        let [u, v, a, b] = sequence.point(i as u64);
        let start = at_random(i / A_FACE, sides.len());
        let from = sides[start].shape.point(u, v);
        Segment { from, along: cosine_direction(sides[start].end.normal, a, b), start, end: start }
    };
    (0..RAYS).map(ray).collect()
}

fn at_random(i: usize, count: usize) -> usize {
    clerestory::geom::sequence::mix(i as u64) as usize % count
}

fn shadows(sides: &[Side]) -> Vec<Segment> {
    let lamps: Vec<usize> = (0..sides.len()).filter(|&i| sides[i].emits.contains(&true)).collect();
    let sequence = Sequence::new(2);
    let mut segments = Vec::new();
    for i in 0..64 * RAYS {
        if lamps.is_empty() || segments.len() == RAYS {
            break;
        }
        let [u, v, a, b] = sequence.point(i as u64);
        let start = at_random(i / A_FACE, sides.len());
        let from = sides[start].shape.point(u, v);
        let drawn = (0..LAMPS).map(|k| lamps[at_random(i * LAMPS + k, lamps.len())]);
        let far = |&lamp: &usize| sides[lamp].shape.corners()[0].distance(from);
        let end = drawn.min_by(|x, y| far(x).total_cmp(&far(y))).expect("there are some");
        let along = sides[end].shape.point(a, b) - from;
        let shines = sides[end].emits[usize::from(along.dot(sides[end].end.normal) > 0.0)];
        if along.dot(sides[start].end.normal) > 0.0 && shines && start != end {
            segments.push(Segment { from, along, start, end });
        }
    }
    segments
}

/// obvhs over the same triangles: which side each is of.
struct Other {
    bvh: CwBvh,
    triangles: Vec<RtTriangle>,
    side: Vec<u32>,
}

impl Other {
    fn new(sides: &[Side]) -> Self {
        let (mut triangles, mut side) = (Vec::new(), Vec::new());
        for (i, of) in sides.iter().enumerate() {
            let c: Vec<Vec3A> = of.shape.corners().iter().map(|c| c.as_vec3a()).collect();
            for k in 2..c.len() {
                triangles.push(Triangle { v0: c[0], v1: c[k - 1], v2: c[k] });
                side.push(i as u32);
            }
        }
        let bvh = build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
        let pick = |values: &[u32]| bvh.primitive_indices.iter().map(|&i| values[i as usize]).collect();
        let side = pick(&side);
        let triangles = bvh.primitive_indices.iter().map(|&i| RtTriangle::from(&triangles[i as usize])).collect();
        Self { bvh, triangles, side }
    }

    fn nearest(&self, of: &Segment) -> bool {
        let ray = Ray::new(of.from.as_vec3a(), of.along.as_vec3a(), SKIN, f32::INFINITY);
        let mut hit = RayHit::none();
        self.bvh.ray_traverse(ray, &mut hit, |ray, at| self.meets(ray, at, of))
    }

    fn blocked(&self, of: &Segment) -> bool {
        let ray = Ray::new(of.from.as_vec3a(), of.along.as_vec3a(), SKIN, 1.0 - SKIN);
        !self.bvh.ray_traverse_miss(ray, |ray, at| self.meets(ray, at, of))
    }

    fn meets(&self, ray: &Ray, at: usize, of: &Segment) -> f32 {
        let t = self.triangles[at].intersect(ray);
        let own = |side: usize| self.side[at] as usize == side;
        if t < f32::INFINITY && (own(of.start) || own(of.end)) { f32::INFINITY } else { t }
    }
}

/// Rays a second of two casters in turns, and how many of their rays met something.
fn race(segments: &[Segment], mut casters: [&mut dyn FnMut(&Segment) -> bool; 2]) -> [(f64, usize); 2] {
    let mut best = [(0.0, 0); 2];
    for _ in 0..PASSES {
        for (caster, best) in casters.iter_mut().zip(&mut best) {
            let begun_s = thread_cpu_s();
            best.1 = segments.iter().filter(|segment| black_box(caster(segment))).count();
            best.0 = (segments.len() as f64 / (thread_cpu_s() - begun_s)).max(best.0);
        }
    }
    best
}

fn measure(name: &str, scene: &RayScene<'_>, sides: &[Side]) {
    let other = Other::new(sides);
    print(name, "faces", sides.len() as f64, "1");
    let rays = hemispheres(sides);
    let mut ours = |of: &Segment| {
        let met = scene.nearest(of.from, of.along, Some(&sides[of.start].end));
        matches!(met, Nearest::Met(_))
    };
    let [own, theirs] = race(&rays, [&mut ours, &mut |of| other.nearest(of)]);
    print(name, "rays_per_s_core", own.0, "1/s");
    print(name, "nearest_ratio_to_obvhs_cwbvh", own.0 / theirs.0, "1");
    print(name, "met_share", own.1 as f64 / rays.len() as f64, "1");
    let segments = shadows(sides);
    if segments.is_empty() {
        eprintln!("SKIPPED: {name} has no lamps to cast shadow rays to");
        return;
    }
    let mut ours = |of: &Segment| {
        let end = RayEnd { face: Face { front: false, ..sides[of.end].end.face }, ..sides[of.end].end };
        scene.blocked(of.from, of.from + of.along, Some(&sides[of.start].end), &end)
    };
    let [own, theirs] = race(&segments, [&mut ours, &mut |of| other.blocked(of)]);
    print(name, "shadow_rays_per_s_core", own.0, "1/s");
    print(name, "any_hit_ratio_to_obvhs_cwbvh", own.0 / theirs.0, "1");
    print(name, "blocked_share", own.1 as f64 / segments.len() as f64, "1");
}

fn model(name: &str, model: &Path) -> Result<()> {
    let dir = tempfile::tempdir().expect("a place for a store");
    let store = dir.path().join("bench.clr");
    ingest::execute(ingest::plan(&options(&store, model))?, &Quiet)?;
    let store = Store::open(&store, Duration::from_secs(1))?;
    let set = WorkingSet::open(&store, Snapshot::newest(&store)?.version())?;
    let sides = sides(&set)?;
    with_scene(&set, |open| {
        measure(name, &open.scene, &sides);
        Ok(())
    })
}

fn main() -> Result<()> {
    for (name, path) in MODELS {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
        if path.exists() {
            model(name, &path)?;
        } else {
            eprintln!("SKIPPED: {} is absent", path.display());
        }
    }
    closed::leaks();
    Ok(())
}
