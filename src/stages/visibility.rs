//! `visibility`: which clusters may exchange light, by sampled rays.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};

use serde::Serialize;

use super::ray_scene::with_scene;
use super::working_set::WorkingSet;
use crate::base::memory::MemoryBudget;
use crate::base::parallel::{Crew, Turns};
use crate::base::{ClusterId, Error, Progress, Result};
use crate::model::ExtentKind;
use crate::model::layout::ArraysBuilder;
use crate::model::visibility::{VisibilityHead, VisibleCluster};
use crate::store::partition_rows::VisibilityRow;
use crate::store::stage_rows::hash;
use crate::store::{SegmentWriter, Stage, StageRecord, Store};
use crate::transport::source::Loaded;
use crate::visibility::sampled::{Effort, Seen, look_around};

/// How to look.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// `--missing`: form-factor mass per cluster that may stay unseen.
    pub missing: f64,
    /// `--seed`.
    pub seed: u64,
    /// `--workers`: threads that cast rays; never changes the result.
    pub workers: usize,
    /// `--memory`.
    pub memory: MemoryBudget,
}

/// What is going to be done.
pub struct Plan<'s> {
    store: &'s Store,
    options: Options,
    record: StageRecord,
    /// Clusters to look around from.
    pub clusters: u64,
    /// Whether the store already holds this result.
    pub done: bool,
}

/// What was found.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Pairs of clusters that may exchange light, each once.
    pub pairs: u64,
    /// Rays cast.
    pub rays: u64,
    /// Mean over clusters of the estimated form factor that stays unseen.
    pub missing_form_factor_mean: f64,
    /// Its largest.
    pub missing_form_factor_max: f64,
    /// Mean over clusters of the share of rays that left the model.
    pub escape_mean: f64,
}

/// Checks that ingest is there and whether there is anything to do.
pub fn plan<'s>(store: &'s Store, options: &Options) -> Result<Plan<'s>> {
    let ingest = store.require_stage(Stage::Ingest)?;
    let facts = store.facts()?;
    let text = format!("{{\"method\":\"sampled\",\"missing\":{},\"seed\":{}}}", options.missing, options.seed);
    let record = StageRecord {
        stage: Stage::Visibility,
        input_hash: String::new(),
        materials_hash: ingest.materials_hash.clone(),
        options_hash: hash([text.as_bytes()]),
        previous_hash: ingest.chain_hash(),
        options: text,
    };
    // New lamps shine where no ray went before: their rays are added by looking again.
    let done = store.stage(Stage::Visibility)?.as_ref() == Some(&record);
    Ok(Plan { store, options: options.clone(), record, clusters: facts.clusters, done })
}

/// A pair seen from one side, spooled: 16 bytes.
const SPOOLED: usize = 16;

/// Looks around from every cluster, then makes the lists symmetric.
pub fn execute(plan: &Plan<'_>, progress: &dyn Progress) -> Result<Summary> {
    if plan.done {
        return summary_of(plan.store);
    }
    let spool_path = plan.store.dir().join("visibility.spool");
    let result = look_and_list(plan, progress, &spool_path);
    // The spool is scratch: a killed stage leaves one, which the next overwrites.
    let _ = std::fs::remove_file(&spool_path);
    result?;
    plan.store.finish_stage(&plan.record)?;
    summary_of(plan.store)
}

fn look_and_list(plan: &Plan<'_>, progress: &dyn Progress, spool_path: &std::path::Path) -> Result<()> {
    let store = plan.store;
    let io = |e: std::io::Error| Error::io(spool_path, &e);
    let figures = {
        // What is there goes first, link or file: nothing is written through it.
        let _ = std::fs::remove_file(spool_path);
        let mut spool = BufWriter::new(File::create_new(spool_path).map_err(io)?);
        let figures = look(plan, progress, &mut |from, seen| {
            for (&to, &hits) in &seen.hits {
                let form_factor = (hits as f64 / seen.rays.max(1) as f64) as f32;
                for word in [from.0, to, form_factor.to_bits(), 0] {
                    spool.write_all(&word.to_le_bytes())?;
                }
            }
            Ok(())
        })?;
        spool.flush().map_err(io)?;
        figures
    };
    // Lists of a block of clusters at a time, from a pass over the spool: memory is the block's.
    let spooled = std::fs::metadata(spool_path).map_err(io)?.len();
    let blocks = (4 * spooled).div_ceil(plan.options.memory.limit_bytes / 4).max(1);
    let clusters = figures.len() as u64;
    let per_block = clusters.div_ceil(blocks).max(1);
    let mut writer = SegmentWriter::create(store, "visibility")?;
    progress.begin("list", "clusters", Some(clusters));
    let ids: Vec<u32> = figures.keys().copied().collect();
    for block in ids.chunks(per_block as usize) {
        let lists = lists_of(spool_path, block[0], block[block.len() - 1]).map_err(io)?;
        let mut rows = Vec::with_capacity(block.len());
        for &id in block {
            let figure = figures[&id];
            let list: Vec<VisibleCluster> = lists.get(&id).map_or_else(Vec::new, |list| {
                list.iter().map(|(&cluster, &form_factor)| VisibleCluster { cluster, form_factor }).collect()
            });
            let head = VisibilityHead { rays: figure.rays, escape: figure.escape, missing: figure.missing };
            let payload = ArraysBuilder::default().with(&[head]).with(&list).finish();
            rows.push(VisibilityRow {
                id: ClusterId(id),
                list: writer.append(ExtentKind::Visibility, id, &payload)?,
                visible_clusters: list.len() as u64,
                rays: figure.rays,
                missing: f64::from(figure.missing),
                escape: f64::from(figure.escape),
            });
        }
        store.publish_visibility(&mut writer, &rows)?;
        progress.at(u64::from(block[block.len() - 1]) + 1);
    }
    Ok(())
}

/// What is kept in memory of a cluster between the two passes.
#[derive(Clone, Copy)]
struct Figure {
    rays: u64,
    escape: f32,
    missing: f32,
}

/// Casts the rays of all clusters on several threads; `found` gets each cluster's result in order of
/// number, whatever thread was first.
fn look(
    plan: &Plan<'_>,
    progress: &dyn Progress,
    found: &mut dyn FnMut(ClusterId, &Seen) -> std::io::Result<()>,
) -> Result<BTreeMap<u32, Figure>> {
    let store = plan.store;
    let (dir, wait, version) = (store.dir().to_path_buf(), store.wait(), store.newest_version()?);
    let ids: Vec<ClusterId> =
        WorkingSet::open(store, version)?.snapshot().clusters().map(|c| c.map(|c| c.id)).collect::<Result<_>>()?;
    progress.begin("look", "clusters", Some(ids.len() as u64));
    let effort = Effort { missing: plan.options.missing, seed: plan.options.seed };
    let work = |turns: &Turns<'_, Seen>| {
        let store = Store::open(&dir, wait)?;
        let set = WorkingSet::open(&store, version)?;
        with_scene(&set, |open| {
            turns.each(|at| {
                let loaded = set.mapped(ids[at])?;
                let view = loaded.view();
                let seen = look_around(&open.scene, view.id, view.geometry.patches, view.materials, &effort);
                open.look.verdict()?;
                Ok(seen)
            })
        })
    };
    let mut figures = BTreeMap::new();
    let (mut blocked_emitters, mut lost_emitters) = (0, 0);
    let crew = Crew { threads: plan.options.workers, progress };
    crew.in_order(ids.len(), work, |at, seen| {
        found(ids[at], &seen).map_err(|e| Error::io(store.dir(), &e))?;
        blocked_emitters += seen.blocked_emitters;
        lost_emitters += seen.lost_emitters;
        let figure = Figure { rays: seen.rays, escape: seen.escape() as f32, missing: seen.missing as f32 };
        figures.insert(ids[at].0, figure);
        Ok(())
    })?;
    for (count, what) in [(blocked_emitters, "are blocked at once"), (lost_emitters, "light nothing of the model")] {
        if count > 0 {
            progress
                .warn(&format!("{count} emitting sides {what}: their winding may be wrong; try `ingest --emit both`"));
        }
    }
    Ok(figures)
}

/// Lists of the clusters `first..=last`: what each saw, and 0 for what saw it and it did not see.
fn lists_of(spool: &std::path::Path, first: u32, last: u32) -> std::io::Result<BTreeMap<u32, BTreeMap<u32, f32>>> {
    let mut lists: BTreeMap<u32, BTreeMap<u32, f32>> = BTreeMap::new();
    let mut reader = BufReader::new(File::open(spool)?);
    let mut record = [0u8; SPOOLED];
    loop {
        match reader.read_exact(&mut record) {
            Ok(()) => {}
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(lists),
            Err(e) => return Err(e),
        }
        let word = |i: usize| u32::from_le_bytes(record[4 * i..4 * i + 4].try_into().expect("four bytes"));
        let (from, to, form_factor) = (word(0), word(1), f32::from_bits(word(2)));
        if (first..=last).contains(&from) {
            lists.entry(from).or_default().insert(to, form_factor);
        }
        if (first..=last).contains(&to) {
            lists.entry(to).or_default().entry(from).or_insert(0.0);
        }
    }
}

/// The figures of a finished visibility, from the catalogue.
fn summary_of(store: &Store) -> Result<Summary> {
    let figures = store.visibility_figures()?;
    Ok(Summary {
        pairs: figures.pairs,
        rays: figures.rays,
        missing_form_factor_mean: figures.missing_mean,
        missing_form_factor_max: figures.missing_max,
        escape_mean: figures.escape_mean,
    })
}
