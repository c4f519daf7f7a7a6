//! `export`: the adaptive mesh with its light, cluster by cluster in order of name.
//!
//! The files are functions of model, options and version alone.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::Serialize;

use super::entry;
use super::leaves::{self, Leaf, SideMesh};
use super::output::{self, Output};
use super::working_set::WorkingSet;
use crate::base::text::shown;
use crate::base::{Error, PatchSide, Progress, Result, Rgb, lux};
use crate::formats::glb::{GlbFacts, GlbMesh, GlbWriter};
use crate::formats::leaf_csv::{self, LeafRow};
use crate::formats::ply::{PlyVertex, PlyWriter};
use crate::geom::quadtree::patch_polygon;
use crate::render::tone;
use crate::store::snapshot::ClusterSummary;
use crate::store::{ModelFacts, Store};
use crate::transport::light::at::SideLights;
use crate::transport::source::{ClusterView, Loaded};

/// A GLB file counts its bytes in 32 bits: beyond this another file begins.
const LARGEST_GLB: u64 = 4_000_000_000;

/// What to write.
#[derive(Clone, Debug)]
pub struct Options {
    /// `-o`: its ending names the format; `-` is CSV on stdout.
    pub output: PathBuf,
    /// `--force`.
    pub force: bool,
    /// `--version`.
    pub version: Option<u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Glb,
    Ply,
    Csv,
}

/// What is going to be written.
pub struct Plan<'s> {
    store: &'s Store,
    options: Options,
    format: Format,
    /// The version.
    pub version: u64,
}

/// What was written.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Files.
    pub files: Vec<String>,
    /// Leaf elements in them, each side.
    pub elements: u64,
    /// The version.
    pub solution_version: u64,
}

impl super::summary::Summary for Summary {
    fn lines(&self) -> Vec<String> {
        vec![format!("{} elements of version {} in {}", self.elements, self.solution_version, self.files.join(", "))]
    }
}

/// Finds version and format; refuses to overwrite.
pub fn plan<'s>(store: &'s Store, options: &Options) -> Result<Plan<'s>> {
    let ending = options.output.extension().map(|e| e.to_string_lossy().to_lowercase());
    let format = match ending.as_deref() {
        Some("glb") => Format::Glb,
        Some("ply") => Format::Ply,
        Some("csv") => Format::Csv,
        None if options.output.as_os_str() == "-" => Format::Csv,
        _ => {
            return Err(Error::Usage {
                message: format!("{}: no format has that ending", shown(&options.output)),
                help: "end the file name in .glb, .ply or .csv".to_owned(),
            });
        }
    };
    output::check(&options.output, options.force)?;
    let version = entry::version_to_read(store, options.version)?;
    Ok(Plan { store, options: options.clone(), format, version })
}

/// Writes the files.
pub fn execute(plan: &Plan<'_>, progress: &dyn Progress) -> Result<Summary> {
    let set = WorkingSet::open(plan.store, plan.version)?;
    let facts = plan.store.facts()?;
    let mut walk = Walk { plan, set, facts, progress, elements: 0 };
    let files = match plan.format {
        Format::Csv => vec![walk.csv()?],
        Format::Ply => vec![walk.ply()?],
        Format::Glb => walk.glb()?,
    };
    let files = files.into_iter().map(shown).collect();
    Ok(Summary { files, elements: walk.elements, solution_version: plan.version })
}

struct Walk<'a, 's> {
    plan: &'a Plan<'s>,
    set: WorkingSet<'s>,
    facts: ModelFacts,
    progress: &'a dyn Progress,
    elements: u64,
}

impl Walk<'_, '_> {
    /// Visits every cluster in order.
    fn clusters(
        &self,
        phase: &str,
        mut visit: impl FnMut(&ClusterSummary, &ClusterView<'_>) -> Result<()>,
    ) -> Result<()> {
        self.progress.begin(phase, "clusters", Some(self.facts.clusters));
        for (done, cluster) in self.set.snapshot().clusters().enumerate() {
            let cluster = cluster?;
            visit(&cluster, &self.set.mapped(cluster.id)?.view())?;
            self.progress.step(done as u64 + 1)?;
        }
        Ok(())
    }

    /// Folder for temporary files: that of the output.
    fn folder(&self) -> &Path {
        let parent = self.plan.options.output.parent().unwrap_or(Path::new(""));
        if parent.as_os_str().is_empty() { Path::new(".") } else { parent }
    }

    fn io(&self, source: &io::Error) -> Error {
        Error::io(&self.plan.options.output, source)
    }

    /// A stored place in model coordinates and units.
    fn model_place(&self, at: DVec3) -> [f64; 3] {
        (DVec3::from_array(self.facts.origin) + at / self.facts.metres_per_unit).to_array()
    }

    fn csv(&mut self) -> Result<PathBuf> {
        let options = &self.plan.options;
        let mut out = Output::create(&options.output, options.force)?;
        writeln!(out, "{}", leaf_csv::HEADER).map_err(|e| self.io(&e))?;
        let mut elements = 0;
        self.clusters("export", |_, view| {
            for side in leaves::sides(view) {
                for leaf in leaves::of_side(view, side) {
                    leaf_csv::write(&self.row(&leaf), &mut out).map_err(|e| self.io(&e))?;
                    elements += 1;
                }
            }
            Ok(())
        })?;
        self.elements = elements;
        out.finish()?;
        Ok(options.output.clone())
    }

    fn row(&self, leaf: &Leaf) -> LeafRow {
        let at = leaf.name.patch_side();
        LeafRow {
            name: [leaf.name.cluster().0, u32::from(at.patch), u32::from(at.side), leaf.name.path()],
            centroid: self.model_place(leaf.shape.centroid()),
            normal: leaf.shape.normal().to_array(),
            area_m2: leaf.shape.area(),
            radiosity: leaf.radiosity.to_f32(),
            irradiance: leaf.irradiance.to_f32(),
            illuminance_lx: lux(leaf.irradiance) as f32,
        }
    }

    /// Radiosity that is shown as white, W/m2: three times the mean of what is lit and does not emit.
    fn exposure_w_m2(&self) -> Result<f64> {
        let (mut sum, mut area) = (0.0, 0.0);
        self.clusters("expose", |_, view| {
            for side in leaves::sides(view) {
                let material = &view.materials[side.index()];
                let light = view.light.level(0)[side.index()].irradiance;
                let leaving = Rgb::from_f32(material.rho).times(Rgb::from_f32(light)).max();
                if material.exitance == [0.0; 3] && leaving > 0.0 && view.takes_part(side.index()) {
                    let own = patch_polygon(&view.geometry.patches[usize::from(side.patch)]).area();
                    sum += leaving * own;
                    area += own;
                }
            }
            Ok(())
        })?;
        Ok(if area > 0.0 { 3.0 * sum / area } else { 1.0 })
    }

    fn ply(&mut self) -> Result<PathBuf> {
        let options = &self.plan.options;
        let exposure = self.exposure_w_m2()?;
        let mut ply = PlyWriter::create(self.folder()).map_err(|e| self.io(&e))?;
        let mut elements = 0;
        self.clusters("export", |_, view| {
            let mut lights = SideLights::default();
            for patch in 0..view.geometry.patches.len() {
                let sides = [2 * patch, 2 * patch + 1].map(PatchSide::from_index);
                let meshes = sides.into_iter().filter_map(|side| SideMesh::new(view, side, &mut lights)).collect();
                elements += self.ply_patch(meshes, exposure, &mut ply)?;
            }
            Ok(())
        })?;
        self.elements = elements;
        let comments = [
            "places in model coordinates and units".to_owned(),
            "radiosity in W/m2".to_owned(),
            format!("red green blue: sRGB of radiosity / {exposure} W/m2, at most 1"),
        ];
        let mut out = Output::create(&options.output, options.force)?;
        ply.finish(&comments, &mut out).map_err(|e| self.io(&e))?;
        out.finish()?;
        Ok(options.output.clone())
    }

    /// Both sides of a patch lie in one place, and PLY viewers show both: a dark one makes way.
    fn ply_patch(&self, meshes: Vec<SideMesh>, exposure: f64, ply: &mut PlyWriter) -> Result<u64> {
        let lit = meshes.iter().any(|m| !m.is_dark());
        let mut elements = 0;
        for (i, mesh) in meshes.iter().enumerate() {
            if mesh.is_dark() && (lit || i > 0) {
                continue;
            }
            let mut first = None;
            for (place, radiosity) in &mesh.vertices {
                let shown = |x: f64| (tone::srgb((x / exposure).min(1.0)) * 255.0).round() as u8;
                let vertex = PlyVertex {
                    position: self.model_place(DVec3::from_array(*place)),
                    normal: mesh.normal,
                    display: radiosity.0.map(shown),
                    radiosity: radiosity.to_f32(),
                };
                let number = ply.vertex(&vertex).map_err(|e| self.io(&e))?;
                first.get_or_insert(number);
            }
            let too_many = || Error::TooLarge {
                message: "the mesh has more vertices than PLY can number".to_owned(),
                help: "export as GLB, which splits into several files".to_owned(),
            };
            let first = u32::try_from(first.unwrap_or(0)).map_err(|_| too_many())?;
            for (leaf, face) in &mesh.faces {
                let face: Vec<u32> = face.iter().map(|v| first + v).collect();
                ply.face(&face, *leaf).map_err(|e| self.io(&e))?;
            }
            elements += mesh.leaves;
        }
        Ok(elements)
    }

    /// Metres from the store's origin, or a direction, to glTF's axes: +Y up.
    fn upright(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        if self.facts.up == 'z' { [x, z, -y] } else { [x, y, z] }
    }

    fn glb_mesh(&self, view: &ClusterView<'_>) -> (GlbMesh, u64) {
        let (mut mesh, mut elements, mut lights) = (GlbMesh::default(), 0, SideLights::default());
        let narrow = |p: [f64; 3]| self.upright(p).map(|x| (x + 0.0) as f32);
        for side in leaves::sides(view) {
            let Some(of_side) = SideMesh::new(view, side, &mut lights) else { continue };
            let first = mesh.positions.len() as u32;
            for (place, radiosity) in &of_side.vertices {
                mesh.positions.push(narrow(*place));
                mesh.normals.push(narrow(of_side.normal));
                mesh.radiosity.push(radiosity.to_f32());
            }
            mesh.indices.extend(of_side.triangles().flatten().map(|v| first + v));
            elements += of_side.leaves;
        }
        (mesh, elements)
    }

    fn glb(&mut self) -> Result<Vec<PathBuf>> {
        let exposure_w_m2 = self.exposure_w_m2()?;
        let origin_m = self.upright(self.facts.origin.map(|x| x * self.facts.metres_per_unit)).map(|x| x + 0.0);
        let new = || GlbWriter::create(self.folder(), GlbFacts { exposure_w_m2, origin_m }).map_err(|e| self.io(&e));
        let mut glb = new()?;
        let mut files = Vec::new();
        let mut elements = 0;
        self.clusters("export", |cluster, view| {
            let (mesh, count) = self.glb_mesh(view);
            elements += count;
            let vertex_bytes = (mesh.positions.len() * 44 + mesh.indices.len() * 4) as u64;
            if glb.bytes() + vertex_bytes + 8192 > LARGEST_GLB {
                let full = std::mem::replace(&mut glb, new()?);
                files.push(self.finish_glb(full, files.len())?);
            }
            let name = self.plan.store.object_name(cluster.object)?;
            glb.mesh(&name, &mesh).map_err(|e| self.io(&e))
        })?;
        files.push(self.finish_glb(glb, files.len())?);
        self.elements = elements;
        Ok(files)
    }

    /// Writes a file; those after the first are numbered from 2.
    fn finish_glb(&self, glb: GlbWriter, before: usize) -> Result<PathBuf> {
        let options = &self.plan.options;
        let path = if before == 0 {
            options.output.clone()
        } else {
            let mut name = options.output.file_stem().unwrap_or_default().to_os_string();
            name.push(format!("-{}.glb", before + 1));
            options.output.with_file_name(name)
        };
        let mut out = Output::create(&path, options.force)?;
        glb.finish(&mut out).map_err(|e| Error::io(&path, &e))?;
        out.finish()?;
        Ok(path)
    }
}
