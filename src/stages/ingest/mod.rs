//! `ingest`: OBJ files into clusters, patches, cluster trees and version 0, in bounded memory.
//!
//! `read` spills vertices and faces; `frame` finds bounds and vertical; `pieces` cuts faces into
//! triangles and quads; `coincide` resolves duplicates and opposite pairs; `join` makes quads of
//! triangle pairs; `clusters` splits objects; `tree` makes a cluster's records; `write` stores them.

mod clusters;
mod coincide;
mod darken;
mod frame;
mod join;
mod libraries;
mod materials;
mod objects;
mod piece;
mod pieces;
mod read;
mod record_file;
mod rerun;
mod scratch;
mod skipped;
mod sorter;
mod tree;
mod typical;
mod vertical;
mod whereabouts;
mod write;

use std::collections::BTreeMap;
use std::fmt;
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;
use std::time::Duration;

use serde::Serialize;

use self::coincide::Search;
use self::frame::{Frame, Survey};
use self::libraries::Libraries;
use self::materials::Material;
use self::piece::Piece;
use self::read::Spilled;
use self::record_file::RecordFile;
use self::rerun::{GeometryOptions, Recipe, hash_file};
use self::scratch::Scratch;
use self::tree::Rules;
use self::typical::Far;
use self::write::{NewMaterials, Source, Totals, Writers};
use super::entry;
use crate::base::memory::MemoryBudget;
use crate::base::text::{for_shell, shown, stored};
use crate::base::{Error, Progress, Result};
use crate::formats::mtl;
use crate::store::stage_rows::hash;
use crate::store::{
    ExtentRef, IngestTx, ModelFacts, RunLock, SegmentWriter, Snapshot, Stage, StageRecord, Store, folder,
};

/// Least memory that an ingest runs in, bytes.
const LEAST_MEMORY: u64 = 48 << 20;

/// Length units of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Units {
    /// Metres.
    M,
    /// Centimetres.
    Cm,
    /// Millimetres.
    Mm,
    /// Inches.
    In,
    /// Feet.
    Ft,
}

impl Units {
    /// Metres per unit.
    #[must_use]
    pub fn metres(self) -> f64 {
        match self {
            Self::M => 1.0,
            Self::Cm => 0.01,
            Self::Mm => 0.001,
            Self::In => 0.0254,
            Self::Ft => 0.3048,
        }
    }

    /// As typed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::M => "m",
            Self::Cm => "cm",
            Self::Mm => "mm",
            Self::In => "in",
            Self::Ft => "ft",
        }
    }
}

/// The flags of `ingest`.
#[derive(Clone, Debug)]
pub struct Options {
    /// Store folder.
    pub store: PathBuf,
    /// OBJ files.
    pub models: Vec<PathBuf>,
    /// `--units`.
    pub units: Units,
    /// `--up`: 'y' or 'z'; `None` is auto.
    pub up: Option<char>,
    /// `--sides both`.
    pub both_sides: bool,
    /// `--materials`.
    pub materials: Option<PathBuf>,
    /// `--emit both`.
    pub emit_both: bool,
    /// `--max-cluster-patches`, 1..=256.
    pub max_cluster_patches: u32,
    /// `--snap`, m; `None` is 1e-5 of the bounding diagonal, at most 1 mm.
    pub snap_m: Option<f64>,
    /// `--memory`.
    pub memory: MemoryBudget,
    /// `--fresh`.
    pub fresh: bool,
    /// `--wait`.
    pub wait: Duration,
}

/// What an ingest would do.
pub struct Plan {
    options: Options,
    model_bytes: u64,
}

/// Checks that inputs are there and memory suffices.
pub fn plan(options: &Options) -> Result<Plan> {
    if options.memory.limit_bytes < LEAST_MEMORY {
        return Err(Error::TooLarge {
            message: format!(
                "ingest needs {} MiB, over the limit of {} MiB",
                LEAST_MEMORY >> 20,
                options.memory.limit_bytes >> 20
            ),
            help: format!("give `--memory {}M` or more", LEAST_MEMORY >> 20),
        });
    }
    if options.emit_both && !options.both_sides {
        return Err(Error::Usage {
            message: "`--emit both` and `--sides front` contradict each other: a back that is not there emits nothing"
                .to_owned(),
            help: "leave out one of them".to_owned(),
        });
    }
    let mut model_bytes = 0;
    for path in options.models.iter().chain(&options.materials) {
        let meta = std::fs::metadata(path).map_err(|e| Error::io(path, &e))?;
        if !meta.is_file() {
            return Err(Error::failed(format!("{}: not a file", shown(path)), "name an OBJ file"));
        }
        model_bytes += meta.len();
    }
    Ok(Plan { options: options.clone(), model_bytes })
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        writeln!(f, "ingest {} files, {} MiB", self.options.models.len(), mib(self.model_bytes))?;
        writeln!(f, "memory: at most {} MiB", mib(self.options.memory.limit_bytes))?;
        writeln!(f, "disk: about {} MiB while it works", mib(8 * self.model_bytes))?;
        write!(f, "store: {}", shown(&self.options.store))
    }
}

/// What an ingest found.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    #[serde(skip)]
    store: PathBuf,
    /// Patches.
    pub patches: u64,
    /// Clusters.
    pub clusters: u64,
    /// Emitting patches.
    pub emitters: u64,
    /// Area, each patch once, m2.
    pub area_m2: f64,
    /// `f` records read.
    pub input_polygons: u64,
    /// Faces left out: cause -> count.
    pub skipped: BTreeMap<String, u64>,
    /// Bounding box in model axes, m: smallest corner, largest corner.
    pub bounds_m: [[f64; 3]; 2],
    /// The vertical.
    pub up: char,
    /// Whether what speaks for it is clear, or it was given.
    pub up_is_sure: bool,
    /// Nothing had to be done.
    pub unchanged: bool,
    /// Version that opened a branch with new materials, if that is what was done.
    pub materials_version: Option<u64>,
}

impl super::summary::Summary for Summary {
    fn lines(&self) -> Vec<String> {
        let [low, high] = self.bounds_m;
        let size: Vec<String> = (0..3).map(|i| format!("{:.2}", high[i] - low[i])).collect();
        let skipped: u64 = self.skipped.values().sum();
        let mut lines = vec![
            format!(
                "{} patches ({} emitting) of {} polygons in {} clusters, {:.1} m2; {skipped} faces skipped",
                self.patches, self.emitters, self.input_polygons, self.clusters, self.area_m2
            ),
            format!("{} m, {}", size.join(" x "), vertical_line(self.up, self.up_is_sure)),
        ];
        if self.unchanged {
            lines.push("Nothing has changed since the last ingest.".to_owned());
        }
        if let Some(version) = self.materials_version {
            lines.push(format!("Only materials have changed: version {version} opens a new branch."));
        }
        lines
    }

    fn next(&self) -> Option<String> {
        Some(format!("clerestory visibility {}", for_shell(&self.store)))
    }
}

/// What an ingest would do to the store that is there, if any; refuses what it would refuse.
pub fn foresee(options: &Options) -> Result<&'static str> {
    let before = match Store::open(&options.store, options.wait) {
        Ok(store) if !options.fresh => store.stage(Stage::Ingest)?,
        Ok(_) => return Ok("the store is emptied"),
        Err(Error::NoStore { .. }) => None,
        Err(error) => return Err(error),
    };
    Ok(match before {
        None => "a new store",
        Some(record) if rerun::is_unchanged(&record, options)? => "nothing to do",
        Some(_) => "the model is read again: other materials open a branch, another geometry is refused",
    })
}

/// Ingests. A store that was made here goes again if it fails.
pub fn execute(plan: Plan, progress: &dyn Progress) -> Result<Summary> {
    let options = plan.options;
    let is_new = !options.store.exists();
    let done = ingest(&options, progress);
    if done.is_err() && is_new {
        folder::unmake(&options.store);
    }
    done
}

fn ingest(options: &Options, progress: &dyn Progress) -> Result<Summary> {
    let make = if options.fresh { Store::create_anew } else { Store::create };
    let store = make(&options.store, options.wait)?;
    let _lock = RunLock::take(&store, &format!("clerestory ingest {}", for_shell(&options.store)))?;
    if !options.fresh {
        entry::trust_rows(&store)?;
    }
    let before = if options.fresh { None } else { store.stage(Stage::Ingest)? };
    if let Some(record) = &before
        && rerun::is_unchanged(record, options)?
    {
        return Ok(Summary { unchanged: true, ..summary(options, &store, BTreeMap::new())? });
    }
    let scratch = Scratch::create(&options.store)?;
    let made = Made::from_files(options, &scratch, progress)?;
    if options.fresh {
        // Only now: a model that can't be read costs nobody a store.
        store.empty()?;
    }
    match before {
        None => made.into_empty_store(options, &store, &scratch, progress),
        Some(record) => made.into_known_store(options, &store, &record, &scratch, progress),
    }
}

/// The model, cut into pieces, on disk.
struct Made {
    spilled: Spilled,
    pieces: RecordFile<Piece>,
    materials: Vec<Material>,
    libraries: Libraries,
    survey: Survey,
    frame: Frame,
    far: Far,
    snap_m: f64,
    typical_m: f64,
}

impl Made {
    fn from_files(options: &Options, scratch: &Scratch, progress: &dyn Progress) -> Result<Self> {
        let dir = scratch.dir();
        let cache = options.memory.share(8);
        let mut spilled = Spilled::create(dir, cache)?;
        for model in &options.models {
            spilled.read(model, progress)?;
        }
        spilled.warn_of_faceless_files(progress);
        let libraries = libraries::read(&spilled.files, progress)?;
        let given = options.materials.as_deref().map(mtl::read).transpose()?;
        let materials = materials::materials_of(&spilled.materials, &libraries.of_model, given.as_ref(), progress);
        materials::warn_of_oddities(libraries.of_model.iter().flatten().chain(&given), progress);

        let unit = options.units.metres();
        let survey = Survey::of(&mut spilled, &materials, unit, progress)?;
        let frame = survey.frame(unit);
        let far = Far::of(&survey, frame);
        let snap_m = options.snap_m.unwrap_or(survey.snap_m(unit));
        let mut raw = RecordFile::create(dir, "raw", cache)?;
        pieces::make(&mut spilled, (frame, survey.whereabouts), snap_m, &mut raw, progress)?;
        let search = Search { dir, memory_bytes: options.memory.share(10), snap_m, materials: &materials };
        search.run(&mut raw, &mut spilled.skipped, progress)?;
        let mut pieces = RecordFile::create(dir, "pieces", cache)?;
        join::join(&mut raw, &mut pieces, snap_m, progress)?;
        drop(raw);
        search.run(&mut pieces, &mut spilled.skipped, progress)?;
        let typical_m = typical::width_m(&mut pieces, far)?;
        let paths: Vec<PathBuf> = spilled.files.iter().map(|f| f.path.clone()).collect();
        pieces::split_long(&mut pieces, typical_m, far, &paths)?;
        if pieces.len() == 0 {
            return Err(frame::no_faces(&spilled));
        }
        if options.up.is_none() && !survey.vertical.up(survey.bounds.size()).1 {
            progress.warn("whether y or z is the vertical is not sure: z is taken; if it is y, give `--up y`");
        }
        for warning in survey.warnings(unit, &paths).into_iter().chain(spilled.skipped.warnings(&paths)) {
            progress.warn(&warning);
        }
        for (what, n) in &spilled.ignored {
            progress.warn(&format!("{n} {what} ignored: they have no area"));
        }
        Ok(Self { spilled, pieces, materials, libraries, survey, frame, far, snap_m, typical_m })
    }

    fn source<'a>(&'a mut self, options: &Options, scratch: &'a Scratch) -> Source<'a> {
        Source {
            spilled: &mut self.spilled,
            pieces: &mut self.pieces,
            frame: self.frame,
            far: self.far,
            rules: Rules { materials: &self.materials, both_sides: options.both_sides, emit_both: options.emit_both },
            most: options.max_cluster_patches as usize,
            scratch: (scratch.dir(), options.memory.share(10)),
        }
    }

    fn into_empty_store(
        mut self,
        options: &Options,
        store: &Store,
        scratch: &Scratch,
        progress: &dyn Progress,
    ) -> Result<Summary> {
        let recipe = self.recipe(options)?;
        let mut writers = Writers::create(store)?;
        let mut tx = IngestTx::begin(store)?;
        let mut files = Vec::new();
        for (i, (path, hash)) in recipe.inputs.iter().enumerate() {
            let kind = if i < recipe.models { "obj" } else { "mtl" };
            let bytes = rerun::input_bytes(path)?;
            files.push(tx.add_file(path, kind, bytes, hash)?);
        }
        self.spilled.objects.for_each(|file, name| {
            tx.add_object(files[file as usize], &stored(name))?;
            Ok(())
        })?;
        self.spilled.skipped.for_each(|file, line, cause| tx.add_skipped(files[file as usize], line, cause))?;
        let (totals, top) = write::write_clusters(&mut self.source(options, scratch), &mut writers, &mut tx, progress)?;
        let facts = self.facts(options, &totals, top);
        let record = record(&recipe, &totals, self.frame);
        warn_if_dark(&totals, progress);
        tx.finish(&facts, &record, &mut writers.all)?;
        summary(options, store, self.spilled.skipped.counts())
    }

    fn into_known_store(
        mut self,
        options: &Options,
        store: &Store,
        before: &StageRecord,
        scratch: &Scratch,
        progress: &dyn Progress,
    ) -> Result<Summary> {
        let recipe = self.recipe(options)?;
        let create = |purpose| SegmentWriter::create(store, purpose);
        let mut writers = [create("materials")?, create("light")?, create("light")?];
        let newest = Snapshot::newest(store)?;
        let mut source = self.source(options, scratch);
        let NewMaterials { totals, mut rows, same_emitters } =
            write::write_materials(&mut source, &newest, &mut writers, progress)?;
        let record = record(&recipe, &totals, self.frame);
        if record.input_hash != before.input_hash {
            return Err(rerun::refused(options, "its geometry differs"));
        }
        let old = store.facts()?;
        let skipped = self.spilled.skipped.counts();
        if record.materials_hash == before.materials_hash {
            return Ok(Summary { unchanged: true, ..summary(options, store, skipped)? });
        }
        let facts = self.facts(options, &totals, old.rays_top);
        warn_if_dark(&totals, progress);
        // Rows tell emitting sides from others: where other sides emit, nothing of the solution stays.
        let base = if same_emitters { newest.version() } else { 0 };
        let [materials, kept, fresh] = writers;
        let mut used = [materials, if same_emitters { kept } else { fresh }];
        let mut waiting = (0..rows.len()).map(|i| rows.get(i).map(|row| row.row(same_emitters)));
        let version = store.replace_materials(&facts, &record, base, &mut used, &mut waiting)?;
        Ok(Summary { materials_version: Some(version), ..summary(options, store, skipped)? })
    }

    fn recipe(&self, options: &Options) -> Result<Recipe> {
        let found = self.libraries.of_model.iter().flatten().map(|l| &l.path);
        let mut inputs = Vec::new();
        for path in options.models.iter().chain(found).chain(&options.materials) {
            let full = std::fs::canonicalize(path).map_err(|e| Error::io(path, &e))?;
            inputs.push((stored(full.as_os_str().as_bytes()), hash_file(path)?));
        }
        Ok(Recipe {
            geometry: GeometryOptions::of(options),
            emit: rerun::emit_name(options).to_owned(),
            inputs,
            models: options.models.len(),
            has_given_materials: options.materials.is_some(),
            up_is_sure: self.up(options).1,
            incomplete: self.libraries.incomplete,
        })
    }

    /// The vertical, and whether it is sure.
    fn up(&self, options: &Options) -> (char, bool) {
        options.up.map_or_else(|| self.survey.vertical.up(self.survey.bounds.size()), |up| (up, true))
    }

    fn facts(&self, options: &Options, totals: &Totals, rays_top: ExtentRef) -> ModelFacts {
        let bounds = totals.bounds.expect("there is a patch");
        ModelFacts {
            origin: self.frame.origin.to_array(),
            metres_per_unit: self.frame.metres_per_unit,
            up: self.up(options).0,
            min_m: bounds.min.to_array(),
            max_m: bounds.max.to_array(),
            snap_m: self.snap_m,
            both_sides: options.both_sides,
            emit_both: options.emit_both,
            patches: totals.patches,
            clusters: totals.clusters,
            emitters: totals.emitters,
            input_polygons: self.spilled.polygons,
            area_m2: totals.area_m2,
            mean_patch_area_m2: self.typical_m * self.typical_m,
            emitted_w: totals.emitted_w.0,
            mean_reflectance: totals.mean_reflectance(),
            max_reflectance: totals.max_reflectance,
            rays_top,
        }
    }
}

fn warn_if_dark(totals: &Totals, progress: &dyn Progress) {
    if totals.emitters == 0 {
        progress.warn("no material emits (`Ke`): everything stays dark; give lamps with `--materials FILE.mtl`");
    }
}

fn record(recipe: &Recipe, totals: &Totals, frame: Frame) -> StageRecord {
    let (geometry, materials) = totals.hashes();
    // Where a model lies is part of what it is: points are asked for in its own coordinates.
    let place = frame.origin.to_array().map(f64::to_le_bytes);
    StageRecord {
        stage: Stage::Ingest,
        input_hash: hash([geometry.as_bytes(), place.as_flattened()]),
        materials_hash: materials,
        options_hash: recipe.geometry.hash(),
        previous_hash: String::new(),
        options: serde_json::to_string(recipe).expect("plain data"),
    }
}

/// The vertical of a store's model, and whether it is sure.
pub fn vertical(store: &Store) -> Result<(char, bool)> {
    let recipe = store.stage(Stage::Ingest)?.and_then(|record| serde_json::from_str::<Recipe>(&record.options).ok());
    Ok((store.facts()?.up, recipe.is_none_or(|recipe| recipe.up_is_sure)))
}

/// The vertical as people read it.
#[must_use]
pub fn vertical_line(up: char, is_sure: bool) -> String {
    let other = if up == 'z' { 'y' } else { 'z' };
    let doubt =
        if is_sure { String::new() } else { format!(", but that is not sure: if it is {other}, give `--up {other}`") };
    format!("up is {up}{doubt}")
}

fn summary(options: &Options, store: &Store, skipped: BTreeMap<String, u64>) -> Result<Summary> {
    let facts = store.facts()?;
    let (up, up_is_sure) = vertical(store)?;
    // To the micrometre: stored coordinates are f32.
    let micro = |x: f64| (x * 1e6).round() / 1e6;
    let corner = |at: [f64; 3]| std::array::from_fn(|i| micro(at[i] + facts.origin[i] * facts.metres_per_unit));
    Ok(Summary {
        store: options.store.clone(),
        patches: facts.patches,
        clusters: facts.clusters,
        emitters: facts.emitters,
        area_m2: facts.area_m2,
        input_polygons: facts.input_polygons,
        skipped,
        bounds_m: [corner(facts.min_m), corner(facts.max_m)],
        up,
        up_is_sure,
        unchanged: false,
        materials_version: None,
    })
}
