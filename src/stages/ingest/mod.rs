//! `ingest`: OBJ files into clusters, patches, version 0, in bounded memory.
//!
//! `read` spills vertices and faces; `frame` finds bounds and vertical; `pieces` cuts faces into
//! triangles and quads; `coincide` resolves duplicates and opposite pairs; `join` makes quads of
//! triangle pairs; `clusters` splits objects; `records` makes a cluster's records; `write` stores them.

mod clusters;
mod coincide;
mod contact;
mod darken;
mod faces;
mod frame;
mod join;
mod libraries;
mod made;
mod materials;
mod objects;
mod piece;
mod pieces;
mod plan;
mod read;
mod record_file;
mod records;
mod rerun;
mod scratch;
mod skipped;
mod sorter;
mod summary;
mod typical;
mod vertical;
mod whereabouts;
mod write;

use std::collections::BTreeMap;

use self::made::Made;
pub use self::plan::{Options, Plan, Units, foresee, plan};
use self::scratch::Scratch;
pub use self::summary::{Summary, vertical, vertical_line};
use super::entry;
use crate::base::text::for_shell;
use crate::base::{Progress, Result};
use crate::store::{RunLock, Stage, Store, folder};

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
        return Ok(Summary { unchanged: true, ..summary::of(options, &store, BTreeMap::new())? });
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
