//! What each stage was made from, so that a rerun knows what to redo.

use rusqlite::{Connection, OptionalExtension, params};
use xxhash_rust::xxh3::Xxh3;

use super::Store;
use crate::base::text::{for_shell, shown};
use crate::base::{Error, Result};

/// The stages whose results lie in the catalogue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Model to clusters.
    Ingest,
    /// Which clusters see each other.
    Visibility,
    /// Clusters to groups.
    Partition,
}

impl Stage {
    /// As typed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ingest => "ingest",
            Self::Visibility => "visibility",
            Self::Partition => "partition",
        }
    }

    /// What its command takes besides the store.
    #[must_use]
    pub fn takes(self) -> &'static str {
        if self == Self::Ingest { " MODEL.obj" } else { "" }
    }

    /// The stage before.
    #[must_use]
    pub fn before(self) -> Option<Self> {
        match self {
            Self::Ingest => None,
            Self::Visibility => Some(Self::Ingest),
            Self::Partition => Some(Self::Visibility),
        }
    }
}

/// What a finished stage was made from. Hashes are text from [`hash`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StageRecord {
    /// Which stage.
    pub stage: Stage,
    /// Of its input: for ingest the geometry, for others empty.
    pub input_hash: String,
    /// Of materials (`Kd`, `Ke`, `--materials`, `--emit`): for ingest only, else empty.
    pub materials_hash: String,
    /// Of the options that shape its result.
    pub options_hash: String,
    /// [`StageRecord::chain_hash`] of the stage before; empty for ingest.
    pub previous_hash: String,
    /// The options that shape its result, as JSON for people.
    pub options: String,
}

/// A hash as the catalogue keeps it: xxh3 of 128 bits, in hex, over the parts with their lengths.
#[must_use]
pub fn hash<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> String {
    let mut hasher = Xxh3::new();
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    format!("{:032x}", hasher.digest128())
}

impl StageRecord {
    /// What the stages after this one depend on: everything but materials.
    #[must_use]
    pub fn chain_hash(&self) -> String {
        hash([self.input_hash.as_bytes(), self.options_hash.as_bytes(), self.previous_hash.as_bytes()])
    }

    pub(super) fn insert(&self, tx: &Connection) -> Result<()> {
        tx.execute(
            "INSERT INTO stages VALUES (?1, ?2, ?3, ?4, ?5, ?6, 1, unixepoch('subsec'))
             ON CONFLICT (name) DO UPDATE SET input_hash = ?2, materials_hash = ?3, options_hash = ?4,
                previous_hash = ?5, options = ?6, generation = generation + 1, finished_at = unixepoch('subsec')",
            params![
                self.stage.name(),
                self.input_hash,
                self.materials_hash,
                self.options_hash,
                self.previous_hash,
                self.options
            ],
        )?;
        Ok(())
    }
}

impl Store {
    /// What a stage was made from; `None` if it has not been run.
    pub fn stage(&self, stage: Stage) -> Result<Option<StageRecord>> {
        let mut query = self.connection().prepare_cached(
            "SELECT input_hash, materials_hash, options_hash, previous_hash, options FROM stages WHERE name = ?1",
        )?;
        let record = query.query_row([stage.name()], |row| {
            Ok(StageRecord {
                stage,
                input_hash: row.get(0)?,
                materials_hash: row.get(1)?,
                options_hash: row.get(2)?,
                previous_hash: row.get(3)?,
                options: row.get(4)?,
            })
        });
        Ok(record.optional()?)
    }

    /// What a stage was made from, if it still fits the stages before it; exit code 13 otherwise.
    pub fn require_stage(&self, stage: Stage) -> Result<StageRecord> {
        let missing = |why: &str| Error::StageMissing {
            message: format!("{}: {why} {} data in this store", shown(self.dir()), stage.name()),
            help: format!("run `clerestory {} {}{}` first", stage.name(), for_shell(self.dir()), stage.takes()),
        };
        let record = self.stage(stage)?.ok_or_else(|| missing("no"))?;
        if let Some(before) = stage.before() {
            let before = self.require_stage(before)?;
            if before.chain_hash() != record.previous_hash {
                return Err(missing("out of date"));
            }
        }
        Ok(record)
    }

    /// Forgets the results of a stage and of those after it (for `--fresh`); the solution stays when
    /// only visibility or partition are dropped, since links and light are named by node.
    pub fn drop_stage(&self, stage: Stage) -> Result<()> {
        if stage == Stage::Ingest {
            return self.empty();
        }
        self.write(|tx| {
            tx.execute("DELETE FROM tasks WHERE state <> 'merged'", [])?;
            tx.execute("UPDATE clusters SET group_id = NULL", [])?;
            tx.execute("DELETE FROM groups", [])?;
            tx.execute("DELETE FROM stages WHERE name = 'partition'", [])?;
            if stage == Stage::Visibility {
                tx.execute(
                    "UPDATE clusters SET visibility_segment = NULL, visibility_offset = NULL, visibility_bytes = NULL,
                        visible_clusters = NULL, visibility_rays = NULL, missing_form_factor = NULL, escape_share = NULL",
                    [],
                )?;
                tx.execute("DELETE FROM stages WHERE name = 'visibility'", [])?;
            }
            Ok(())
        })
    }

    /// Records the settings a stage ran with, as (name, value).
    pub fn put_settings(&self, stage: &str, settings: &[(String, String)]) -> Result<()> {
        self.write(|tx| {
            let mut put = tx.prepare_cached("INSERT OR REPLACE INTO settings VALUES (?1, ?2, ?3)")?;
            for (name, value) in settings {
                put.execute([stage, name, value])?;
            }
            Ok(())
        })
    }

    /// The settings recorded for a stage, by name.
    pub fn settings(&self, stage: &str) -> Result<Vec<(String, String)>> {
        let mut query =
            self.connection().prepare_cached("SELECT name, value FROM settings WHERE stage = ?1 ORDER BY name")?;
        let rows = query.query_map([stage], |r| Ok((r.get(0)?, r.get(1)?)))?;
        Ok(rows.collect::<std::result::Result<_, _>>()?)
    }

    /// Records a measured figure.
    pub fn put_metric(&self, stage: &str, version: Option<u64>, name: &str, value: f64, unit: &str) -> Result<()> {
        self.note(|tx| {
            tx.execute(
                "INSERT INTO metrics (stage, version, name, value, unit, at)
                 VALUES (?1, ?2, ?3, ?4, ?5, unixepoch('subsec'))",
                params![stage, version, name, value, unit],
            )?;
            Ok(())
        })
    }
}
