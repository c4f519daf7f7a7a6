//! The last pass: clusters into segments and catalogue rows, with the totals of the model.

use std::path::Path;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use xxhash_rust::xxh3::Xxh3;

use super::clusters::{Faces, for_each_cluster};
use super::darken::light_on_known_elements;
use super::faces::{ClusterFaces, PartNames};
use super::frame::Frame;
use super::piece::{NONE, Piece};
use super::read::Spilled;
use super::record_file::RecordFile;
use super::records::{ClusterRecords, Rules};
use super::typical::Far;
use crate::base::{ClusterId, Error, Progress, Result, Rgb};
use crate::geom::bounds::Bounds;
use crate::model::ExtentKind;
use crate::model::geometry::SideMaterial;
use crate::model::layout::{Arrays, ArraysBuilder};
use crate::model::origin::{BakeCorner, PatchSource};
use crate::model::rays::{ClusterRef, TOP};
use crate::rays::build;
use crate::store::ingest_rows::MaterialsRow;
use crate::store::{ClusterRow, ExtentRef, IngestTx, SegmentWriter, Snapshot, Store};

/// What a pass over the clusters needs.
pub struct Source<'a> {
    /// What was read.
    pub spilled: &'a mut Spilled,
    /// The faces, and what contact lines cut them into.
    pub faces: Faces<'a>,
    /// Where the store's origin lies.
    pub frame: Frame,
    /// Which pieces lie far off.
    pub far: Far,
    /// How patches get their materials.
    pub rules: Rules<'a>,
    /// `--max-cluster-patches`.
    pub most: usize,
    /// Scratch folder, and memory for sorting.
    pub scratch: (&'a Path, u64),
}

/// Sums over all clusters.
#[derive(Default)]
pub struct Totals {
    /// Patches.
    pub patches: u64,
    /// Clusters.
    pub clusters: u64,
    /// Emitting faces, before contact lines cut them.
    pub emitters: u64,
    /// Area, each patch once, m2; what lies far off is left out here, of the box and of the means.
    pub area_m2: f64,
    /// Power emitted, W.
    pub emitted_w: Rgb,
    /// Box round all patches, m from the origin.
    pub bounds: Option<Bounds>,
    /// Largest reflectance.
    pub max_reflectance: f64,
    rho_area: f64,
    side_area: f64,
    geometry: Xxh3,
    materials: Xxh3,
}

impl Totals {
    fn add(&mut self, records: &ClusterRecords, far: Far) {
        self.clusters += 1;
        self.patches += records.patches.len() as u64;
        self.emitters += records.emitting_faces();
        for (patch, sides) in records.patches.iter().zip(records.materials.chunks_exact(2)) {
            let area = f64::from(patch.area_m2);
            let is_far = far.holds(&patch.corners_m);
            if !is_far {
                self.area_m2 += area;
                let corners = patch.corners_m.map(|c| DVec3::from_array(c.map(f64::from)));
                let own = Bounds::of(&corners);
                self.bounds = Some(self.bounds.map_or(own, |b| b.union(own)));
            }
            for (i, side) in sides.iter().enumerate() {
                self.emitted_w += Rgb::from_f32(side.exitance) * area;
                if patch.sides >> i & 1 == 1 && !is_far {
                    let rho = Rgb::from_f32(side.rho);
                    self.side_area += area;
                    self.rho_area += rho.0.iter().sum::<f64>() / 3.0 * area;
                    self.max_reflectance = self.max_reflectance.max(rho.max());
                }
            }
        }
    }

    /// Area-weighted mean reflectance over channels and sides.
    #[must_use]
    pub fn mean_reflectance(&self) -> f64 {
        self.rho_area / self.side_area
    }

    /// Hashes of all patches and trees, and of all materials.
    #[must_use]
    pub fn hashes(&self) -> (String, String) {
        (format!("{:032x}", self.geometry.digest128()), format!("{:032x}", self.materials.digest128()))
    }
}

/// Visits every cluster: its records and the faces they came from.
fn for_each(
    source: &mut Source<'_>,
    progress: &dyn Progress,
    totals: &mut Totals,
    mut visit: impl FnMut(&mut Spilled, &ClusterRecords, &ClusterFaces) -> Result<()>,
) -> Result<()> {
    progress.begin("write", "clusters", None);
    let (rules, far, spilled) = (source.rules, source.far, &mut *source.spilled);
    for_each_cluster(&mut source.faces, source.most, source.scratch, |faces, members| {
        if totals.clusters > u64::from(ClusterId::MAX) {
            return Err(Error::TooLarge {
                message: format!("the model has more than {} clusters", ClusterId::MAX),
                help: "give a larger `--max-cluster-patches`, or split the model into several stores".to_owned(),
            });
        }
        let of = ClusterFaces::load(faces, members)?;
        let mut records = ClusterRecords::new(ClusterId(totals.clusters as u32), &of, rules);
        records.head.object = of.faces[0].whole.object + 1;
        totals.geometry.update(&records.geometry());
        totals.materials.update(&records.materials_payload());
        totals.add(&records, far);
        visit(spilled, &records, &of)?;
        progress.step(totals.clusters)
    })
}

/// The segment files of an ingest.
pub struct Writers {
    /// In the order below; handed to the store at the end.
    pub all: Vec<SegmentWriter>,
}

const GEOMETRY: usize = 0;
const RAYS: usize = 1;
const ORIGIN: usize = 2;
const MATERIALS: usize = 3;
const LIGHT: usize = 4;

impl Writers {
    /// Starts them; before the ingest's transaction.
    pub fn create(store: &Store) -> Result<Self> {
        let all = ["geometry", "rays", "origin", "materials", "light"]
            .iter()
            .map(|purpose| SegmentWriter::create(store, purpose))
            .collect::<Result<_>>()?;
        Ok(Self { all })
    }
}

/// Writes all clusters; returns the totals and where the top of the ray structure lies.
pub fn write_clusters(
    source: &mut Source<'_>,
    writers: &mut Writers,
    tx: &mut IngestTx<'_>,
    progress: &dyn Progress,
) -> Result<(Totals, ExtentRef)> {
    let mut totals = Totals::default();
    let frame = source.frame;
    // About 64 bytes per cluster: the one thing here that grows with the model, as the top of the
    // ray structure does.
    let mut rays = RayFaces::default();
    for_each(source, progress, &mut totals, |spilled, records, faces| {
        let row = write_cluster(&mut writers.all, spilled, frame, records, faces, &mut rays)?;
        tx.add_cluster(&row)
    })?;
    let (nodes, clusters) = build::top(&rays.tops);
    let payload = ArraysBuilder::default().with(&nodes).with(&clusters).finish();
    let top = writers.all[RAYS].append(ExtentKind::Rays, TOP, &payload)?;
    Ok((totals, top))
}

/// What is gathered for rays, from cluster to cluster.
#[derive(Default)]
struct RayFaces {
    tops: Vec<(ClusterRef, [f32; 3], [f32; 3])>,
    names: PartNames,
}

fn write_cluster(
    writers: &mut [SegmentWriter],
    spilled: &mut Spilled,
    frame: Frame,
    records: &ClusterRecords,
    faces: &ClusterFaces,
    rays: &mut RayFaces,
) -> Result<ClusterRow> {
    let id = records.head.cluster;
    let rays = write_rays(&mut writers[RAYS], records, faces, rays)?;
    let ordered: Vec<&Piece> = records.order.iter().map(|i| &faces.parts[*i as usize].piece).collect();
    let provenance = ArraysBuilder::default().with(&sources(&ordered)).finish();
    let corners = bake_corners(spilled, frame, &ordered)?;
    let bake = match corners.is_empty() {
        true => None,
        false => {
            Some(writers[ORIGIN].append(ExtentKind::Bake, id, &ArraysBuilder::default().with(&corners).finish())?)
        }
    };
    Ok(ClusterRow {
        id: ClusterId(id),
        object: records.head.object,
        patches: records.head.patches,
        emitters: records.emitters(),
        area_m2: records.patches.iter().map(|p| f64::from(p.area_m2)).sum(),
        min_m: records.head.min_m,
        max_m: records.head.max_m,
        geometry: writers[GEOMETRY].append(ExtentKind::Geometry, id, &records.geometry())?,
        rays,
        provenance: writers[ORIGIN].append(ExtentKind::Provenance, id, &provenance)?,
        bake,
        materials: writers[MATERIALS].append(ExtentKind::Materials, id, &records.materials_payload())?,
        radiosity: writers[LIGHT].append(ExtentKind::Radiosity, id, &records.light_at_start())?,
    })
}

fn write_rays(
    writer: &mut SegmentWriter,
    records: &ClusterRecords,
    faces: &ClusterFaces,
    rays: &mut RayFaces,
) -> Result<ExtentRef> {
    let id = ClusterId(records.head.cluster);
    rays.names.add(id, faces, &records.order);
    let arrays = faces.rays(&records.keys, &rays.names);
    let payload = arrays.payload();
    let at = writer.append(ExtentKind::Rays, id.0, &payload)?;
    if let Some((min_m, max_m)) = arrays.bounds_m() {
        let reference = ClusterRef::to(id.0, &payload, at.payload_at()).expect("just built");
        rays.tops.push((reference, min_m, max_m));
    }
    Ok(at)
}

fn sources(pieces: &[&Piece]) -> Vec<PatchSource> {
    let of = |(patch, piece): (usize, &&Piece)| {
        let sources = piece.sources[..piece.source_count as usize].to_vec();
        sources.into_iter().map(move |s| PatchSource {
            patch: patch as u32,
            file: s.file + 1,
            line: s.line,
            face: s.face,
        })
    };
    pieces.iter().enumerate().flat_map(of).collect()
}

/// Corners as modelled; none if no face has texture coordinates or normals.
fn bake_corners(spilled: &mut Spilled, frame: Frame, pieces: &[&Piece]) -> Result<Vec<BakeCorner>> {
    let used = |p: &Piece| p.named[..p.corner_count as usize].to_vec();
    if pieces.iter().all(|p| used(p).iter().all(|n| n.uv == NONE && n.normal == NONE)) {
        return Ok(Vec::new());
    }
    let mut out = Vec::new();
    for (patch, piece) in pieces.iter().enumerate() {
        for (i, named) in used(piece).into_iter().enumerate() {
            let position = match named.vertex {
                NONE => frame.model_position(piece.corners_m[i]).to_array(),
                row => spilled.positions.get(u64::from(row))?,
            };
            let uv = if u64::from(named.uv) < spilled.uvs.len() {
                spilled.uvs.get(u64::from(named.uv))?
            } else {
                [f32::NAN; 2]
            };
            let normal = if u64::from(named.normal) < spilled.normals.len() {
                spilled.normals.get(u64::from(named.normal))?
            } else {
                [f32::NAN; 3]
            };
            out.push(BakeCorner { position, uv, normal, corner: (patch * 4 + i) as u32 });
        }
    }
    Ok(out)
}

/// A [`MaterialsRow`] as it waits on disk.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct WaitingRow {
    materials: [u64; 3],
    /// Light on the elements that the cluster had, then on none but its sides.
    radiosity: [[u64; 3]; 2],
    cluster: u32,
    emitters: u32,
}

fn words(at: ExtentRef) -> [u64; 3] {
    [u64::from(at.segment), at.offset, at.bytes]
}

fn extent([segment, offset, bytes]: [u64; 3]) -> ExtentRef {
    ExtentRef { segment: segment as u32, offset, bytes }
}

impl WaitingRow {
    /// For the catalogue, with the light to begin from.
    #[must_use]
    pub fn row(self, rows_stay: bool) -> MaterialsRow {
        MaterialsRow {
            id: ClusterId(self.cluster),
            emitters: self.emitters,
            materials: extent(self.materials),
            radiosity: extent(self.radiosity[usize::from(!rows_stay)]),
        }
    }
}

/// New materials of a model whose geometry is in the store already.
pub struct NewMaterials {
    /// Sums over all clusters.
    pub totals: Totals,
    /// A row for every cluster.
    pub rows: RecordFile<WaitingRow>,
    /// Whether rows of the newest version stay: they tell sides that emit from others, and rays to lamps were drawn by what
    /// these sent.
    pub rows_stay: bool,
}

/// Writes materials (first writer) and light: on the elements that a cluster has (second) and on none but its sides
/// (third).
pub fn write_materials(
    source: &mut Source<'_>,
    newest: &Snapshot<'_>,
    [materials, kept, fresh]: &mut [SegmentWriter; 3],
    progress: &dyn Progress,
) -> Result<NewMaterials> {
    let mut totals = Totals::default();
    let mut rows = RecordFile::create(source.scratch.0, "rows", 0)?;
    let mut powers = Some([f64::INFINITY, 0.0]);
    for_each(source, progress, &mut totals, |_, records, _| {
        let id = records.head.cluster;
        powers = powers_beside(newest, records, powers)?;
        let light = [
            kept.append(ExtentKind::Radiosity, id, &light_on_known_elements(newest, records)?)?,
            fresh.append(ExtentKind::Radiosity, id, &records.light_at_start())?,
        ];
        rows.push(WaitingRow {
            materials: words(materials.append(ExtentKind::Materials, id, &records.materials_payload())?),
            radiosity: light.map(words),
            cluster: id,
            emitters: records.emitters(),
        })
    })?;
    let rows_stay = powers.is_some_and(|[least, most]| most <= ALIKE * least);
    Ok(NewMaterials { totals, rows, rows_stay })
}

/// How far apart the changes of lamps' powers may lie: rays are drawn to those that were bright, and what was dim beside them
/// and is bright now would be missed.
const ALIKE: f64 = 4.0;

/// The least and the most of `powers` and of the lamps of a cluster relative to what they were in a version; `None` if other
/// sides emitted there.
fn powers_beside(
    version: &Snapshot<'_>,
    cluster: &ClusterRecords,
    powers: Option<[f64; 2]>,
) -> Result<Option<[f64; 2]>> {
    let (Some(powers), Some(before)) =
        (powers, version.extent(ExtentKind::Materials, ClusterId(cluster.head.cluster))?)
    else {
        return Ok(None);
    };
    let sides: &[SideMaterial] = before.parse(|payload| Arrays::new(payload).get(0))?;
    if sides.len() != cluster.materials.len() {
        return Ok(None);
    }
    let power = |side: &SideMaterial| Rgb::from_f32(side.exitance).norm_squared().sqrt();
    let both = sides.iter().zip(&cluster.materials).map(|(before, now)| (power(before), power(now)));
    Ok(both.filter(|both| *both != (0.0, 0.0)).try_fold(powers, |[least, most], (before, now)| {
        (before > 0.0 && now > 0.0).then(|| [least.min(now / before), most.max(now / before)])
    }))
}
