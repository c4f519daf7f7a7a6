//! A model read, and cut along contact lines, and how that becomes a store, or new materials of one.

use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;

use super::clusters::Faces;
use super::coincide::Search;
use super::contact::{self, Cuts};
use super::frame::{self, Frame, Survey};
use super::libraries::{self, Libraries};
use super::materials::{self, Material};
use super::piece::Piece;
use super::read::Spilled;
use super::record_file::RecordFile;
use super::records::Rules;
use super::rerun::{self, GeometryOptions, Recipe, hash_file};
use super::scratch::Scratch;
use super::summary::MostPieces;
use super::typical::{self, Far};
use super::write::{self, NewMaterials, Source, Totals, Writers};
use super::{Options, Summary, join, pieces, summary};
use crate::base::text::{shown, stored};
use crate::base::{Error, Progress, Result};
use crate::formats::mtl;
use crate::store::stage_rows::hash;
use crate::store::{ExtentRef, IngestTx, ModelFacts, SegmentWriter, Snapshot, Stage, StageRecord, Store};

/// The model, on disk: its faces, and what contact lines cut them into.
pub(super) struct Made {
    spilled: Spilled,
    /// Before contact lines cut them.
    faces: RecordFile<Piece>,
    cuts: Cuts,
    materials: Vec<Material>,
    libraries: Libraries,
    survey: Survey,
    frame: Frame,
    far: Far,
    snap_m: f64,
    typical_m: f64,
}

impl Made {
    pub(super) fn from_files(options: &Options, scratch: &Scratch, progress: &dyn Progress) -> Result<Self> {
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
        survey.refuse_snap(snap_m, unit)?;
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
        let rules = contact::Rules { contact_m: options.contact_m, least_m: options.least_contact_m, snap_m };
        let cuts = contact::cut(&mut pieces, &rules, dir, options.memory.share(10), progress)?;
        if let (None, (up, false)) = (options.up, survey.vertical.up(survey.bounds.size())) {
            progress.warn(&summary::vertical_line(up, false));
        }
        for warning in survey.warnings(unit, typical_m, &paths).into_iter().chain(spilled.skipped.warnings(&paths)) {
            progress.warn(&warning);
        }
        if let Some((n, first)) = spilled.crossing {
            let place = format!("{}:{}", shown(&paths[first.file as usize]), first.line);
            progress.warn(&format!(
                "{n} faces cross themselves, first {place}: what they enclose twice, or turned, is a guess"
            ));
        }
        for (what, n) in &spilled.ignored {
            progress.warn(&format!("{n} {what} ignored: they have no area"));
        }
        Ok(Self { spilled, faces: pieces, cuts, materials, libraries, survey, frame, far, snap_m, typical_m })
    }

    fn source<'a>(&'a mut self, options: &Options, scratch: &'a Scratch) -> Source<'a> {
        Source {
            spilled: &mut self.spilled,
            faces: Faces { whole: &mut self.faces, cuts: &mut self.cuts },
            frame: self.frame,
            far: self.far,
            rules: Rules { materials: &self.materials, both_sides: options.both_sides, emit_both: options.emit_both },
            most: options.max_cluster_patches as usize,
            scratch: (scratch.dir(), options.memory.share(10)),
        }
    }

    pub(super) fn into_empty_store(
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
        let most_pieces = self.most_pieces();
        Ok(Summary { most_pieces, ..summary::of(options, store, self.spilled.skipped.counts())? })
    }

    /// The face that contact lines cut into most pieces.
    fn most_pieces(&self) -> Option<MostPieces> {
        let (source, pieces) = self.cuts.tally.most?;
        let file = shown(&self.spilled.files[source.file as usize].path);
        Some(MostPieces { face: format!("{file}:{}", source.line), pieces })
    }

    pub(super) fn into_known_store(
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
        let NewMaterials { totals, mut rows, rows_stay } =
            write::write_materials(&mut source, &newest, &mut writers, progress)?;
        let record = record(&recipe, &totals, self.frame);
        if record.input_hash != before.input_hash {
            return Err(rerun::refused(options, "its geometry differs"));
        }
        let old = store.facts()?;
        let skipped = self.spilled.skipped.counts();
        if record.materials_hash == before.materials_hash {
            return Ok(Summary { unchanged: true, ..summary::of(options, store, skipped)? });
        }
        let facts = self.facts(options, &totals, old.rays_top);
        warn_if_dark(&totals, progress);
        let base = if rows_stay { newest.version() } else { 0 };
        let [materials, kept, fresh] = writers;
        let mut used = [materials, if rows_stay { kept } else { fresh }];
        let mut waiting = (0..rows.len()).map(|i| rows.get(i).map(|row| row.row(rows_stay)));
        let version = store.replace_materials(&facts, &record, base, &mut used, &mut waiting)?;
        Ok(Summary { materials_version: Some(version), ..summary::of(options, store, skipped)? })
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
            patches_uncut: self.cuts.tally.faces,
            cuts: [self.cuts.tally.crossings, self.cuts.tally.contacts, self.cuts.tally.outlines],
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
