//! A store with a few made-up clusters, for tests.

use std::path::Path;
use std::time::Duration;

use bytemuck::Zeroable;

use super::partition_rows::GroupRow;
use super::{
    ClusterRow, ExtentRef, IngestTx, Lease, ModelFacts, Offer, SegmentWriter, SolveSettings, Stage, StageRecord, Store,
    UpdateRow, Worker,
};
use crate::base::{ClusterId, NodeName, PatchSide, Result};
use crate::model::ExtentKind;
use crate::model::figures::Power;
use crate::model::free_group::Held;
use crate::model::geometry::{ClusterHead, PatchRecord, Seam, SideMaterial};
use crate::model::layout::ArraysBuilder;
use crate::model::light::{ElementLight, LightHead, RowLight};
use crate::model::order::UpdateOrder;
use crate::model::origin::PatchSource;
use crate::model::rays::{ClusterRaysView, ClusterRef, Cuts, RayNode, RayPatch, TOP, WHOLE};
use crate::model::report::{ErrorSums, TaskReport};
use crate::model::solve_options::{InnerOption, LinkStorage, SolveOptions};

/// A radiosity payload of a one-patch cluster on whose front `irradiance` arrives.
pub fn light(cluster: u32, irradiance: f32) -> Vec<u8> {
    let mut head = LightHead::zeroed();
    head.channels = 3;
    head.level_start[1..].fill(2);
    let element = |side, irradiance| ElementLight {
        name: NodeName::root(ClusterId(cluster), PatchSide { patch: 0, side }).0,
        irradiance: [irradiance; 3],
        ..ElementLight::zeroed()
    };
    let elements = [element(0, irradiance), element(1, 0.0)];
    ArraysBuilder::default().with(&[head]).with::<RowLight>(&[]).with(&elements).finish()
}

/// The unit square at height `cluster`.
fn patch(cluster: u32) -> PatchRecord {
    let mut patch = PatchRecord::zeroed();
    let z = cluster as f32;
    patch.corners_m = [[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z]];
    (patch.corner_count, patch.sides, patch.area_m2, patch.face_area_m2) = (4, 3, 1.0, 1.0);
    patch.face = cluster << 8;
    patch
}

/// A stage's record with made-up hashes.
pub fn record(stage: Stage, previous_hash: String) -> StageRecord {
    StageRecord {
        stage,
        input_hash: "input".to_owned(),
        materials_hash: "materials".to_owned(),
        options_hash: "options".to_owned(),
        previous_hash,
        options: "{}".to_owned(),
    }
}

/// Makes a store of `clusters` unit squares, one patch each; cluster 0 emits 1 W/m2.
pub fn store(dir: &Path, clusters: u32) -> Store {
    let store = Store::create(dir, Duration::from_secs(5)).unwrap();
    let mut bulk = SegmentWriter::create(&store, "ingest").unwrap();
    let mut rays = SegmentWriter::create(&store, "rays").unwrap();
    let mut ingest = IngestTx::begin(&store).unwrap();
    let file = ingest.add_file("made_up.obj", "obj", 0, "").unwrap();
    let object = ingest.add_object(file, "squares").unwrap();
    let mut refs = Vec::new();
    for id in 0..clusters {
        let patch = patch(id);
        let mut head = ClusterHead::zeroed();
        (head.cluster, head.patches, head.max_m) = (id, 1, [1.0, 1.0, id as f32]);
        head.min_m[2] = id as f32;
        let geometry = ArraysBuilder::default().with(&[head]).with(&[patch]).with::<Seam>(&[]).finish();
        let exitance = if id == 0 { [1.0; 3] } else { [0.0; 3] };
        let sides = [SideMaterial { rho: [0.5; 3], exitance }, SideMaterial { rho: [0.5; 3], exitance: [0.0; 3] }];
        let materials = ArraysBuilder::default().with(&sides).finish();
        let node = RayNode::EMPTY.with(0, (head.min_m, head.max_m), 0, 1);
        let mut ray_patch = RayPatch::zeroed();
        (ray_patch.corners_m, ray_patch.corner_count, ray_patch.area_m2, ray_patch.cut) =
            (patch.corners_m, 4, 1.0, WHOLE);
        let cuts = Cuts { faces: &[], nodes: &[], parts: &[] };
        let own_rays = ClusterRaysView { nodes: &[node], patches: &[ray_patch], cuts }.payload();
        let source = PatchSource { patch: 0, file, line: id + 1, face: id };
        let provenance = ArraysBuilder::default().with(&[source]).finish();
        let at = rays.append(ExtentKind::Rays, id, &own_rays).unwrap();
        refs.push(ClusterRef::to(id, &own_rays, at.payload_at()).unwrap());
        let row = ClusterRow {
            id: ClusterId(id),
            object,
            patches: 1,
            emitters: u32::from(id == 0),
            area_m2: 1.0,
            min_m: head.min_m,
            max_m: head.max_m,
            geometry: bulk.append(ExtentKind::Geometry, id, &geometry).unwrap(),
            rays: at,
            provenance: bulk.append(ExtentKind::Provenance, id, &provenance).unwrap(),
            bake: None,
            materials: bulk.append(ExtentKind::Materials, id, &materials).unwrap(),
            radiosity: bulk.append(ExtentKind::Radiosity, id, &light(id, 0.0)).unwrap(),
        };
        ingest.add_cluster(&row).unwrap();
    }
    let root = RayNode::EMPTY.with(0, ([0.0; 3], [1.0, 1.0, clusters as f32]), 0, clusters);
    let top = ArraysBuilder::default().with(&[root]).with(&refs).finish();
    let rays_top = rays.append(ExtentKind::Rays, TOP, &top).unwrap();
    let facts = facts(clusters, rays_top);
    ingest.finish(&facts, &record(Stage::Ingest, String::new()), &mut [bulk, rays]).unwrap();
    store
}

fn facts(clusters: u32, rays_top: ExtentRef) -> ModelFacts {
    ModelFacts {
        origin: [10.0, 20.0, 30.0],
        metres_per_unit: 0.01,
        up: 'z',
        min_m: [0.0; 3],
        max_m: [1.0, 1.0, f64::from(clusters)],
        snap_m: 1e-5,
        both_sides: true,
        emit_both: false,
        patches: u64::from(clusters),
        patches_uncut: u64::from(clusters),
        cuts: [0; 3],
        clusters: u64::from(clusters),
        emitters: 1,
        input_polygons: u64::from(clusters),
        area_m2: f64::from(clusters),
        mean_patch_area_m2: 1.0,
        emitted_w: [1.0; 3],
        mean_reflectance: 0.5,
        max_reflectance: 0.5,
        rays_top,
    }
}

/// Puts clusters `i` into groups `i % groups`.
pub fn partition(store: &Store, groups: u32) {
    let ingest = store.stage(Stage::Ingest).unwrap().unwrap();
    let visibility = record(Stage::Visibility, ingest.chain_hash());
    store.finish_stage(&visibility).unwrap();
    let ids: Vec<ClusterId> = super::Snapshot::at(store, 0).unwrap().clusters().map(|c| c.unwrap().id).collect();
    let rows: Vec<GroupRow> = (0..groups)
        .map(|id| GroupRow {
            id,
            clusters: ids.iter().filter(|c| c.0 % groups == id).count() as u64,
            patches: 1,
            predicted_cost: f64::from(id),
            working_set_bytes: 1000,
            intra_group_share: 0.5,
        })
        .collect();
    let partition = record(Stage::Partition, visibility.chain_hash());
    store.publish_partition(&partition, &rows, &mut ids.into_iter().map(|c| (c, c.0 % groups))).unwrap();
}

/// What the made-up branches are asked for.
const TOLERANCE: f64 = 0.02;

/// Settings to solve with.
pub fn settings(order: UpdateOrder) -> SolveSettings {
    let (inner, links) = (InnerOption::Converge, LinkStorage::Keep);
    SolveSettings { options: SolveOptions { tolerance: TOLERANCE, min_element_m: None, inner, links, seed: 1 }, order }
}

/// Solves a leased group: `irradiance` arrives on the front of each of its clusters.
pub fn solve(store: &Store, lease: &Lease, worker: &mut Worker<'_>, irradiance: f32) -> bool {
    let mut rows = Vec::new();
    for cluster in store.clusters_of(lease.group).unwrap() {
        let at = worker.segment.append(ExtentKind::Radiosity, cluster.0, &light(cluster.0, irradiance)).unwrap();
        rows.push(UpdateRow { cluster, kind: ExtentKind::Radiosity, delta: false, at });
    }
    let power = Power { emitted_w: [1.0; 3], absorbed_w: [1.0; 3], ..Power::default() };
    // A tenth of the tolerance: the branch closes once the light no longer changes.
    let norm = f64::from(irradiance * irradiance) * rows.len() as f64;
    let rough = norm * (0.1 * TOLERANCE).powi(2);
    let error = ErrorSums { rough, checked: [rough, (0.01 * rough).powi(2)], places: 1, norm, ..ErrorSums::default() };
    let report = TaskReport { complete: true, q_max: 0.5, power, error, ..TaskReport::default() };
    store.publish(lease, worker, &rows, &report).unwrap()
}

/// Solves every free group of the iteration under way.
pub fn solve_all(store: &Store, order: UpdateOrder, irradiance: f32) {
    let mut worker = Worker::start(store).unwrap();
    let iteration = store.open_iteration(None, &settings(order)).unwrap();
    while let Some(lease) = store.claim(&iteration, &worker, &mut first).unwrap() {
        assert!(solve(store, &lease, &mut worker, irradiance));
    }
}

/// Chooses the costliest group.
pub fn first(offer: &Offer, _: &mut dyn FnMut(u32) -> Result<Held>) -> Result<Option<u32>> {
    Ok(offer.free.first().map(|f| f.group))
}
