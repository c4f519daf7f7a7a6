//! Workers: each appends to a segment file of its own and keeps it locked as long as it lives; what
//! it holds in its caches helps to choose its next group.

use std::collections::BTreeMap;

use rusqlite::{Transaction, params};

use super::{SegmentWriter, Store, coordinator, files, locks};
use crate::base::{ClusterId, Result};

/// This process as a worker.
pub struct Worker<'s> {
    store: &'s Store,
    id: i64,
    /// What it has said that it holds: versions by cluster.
    said: BTreeMap<u32, u64>,
    /// Where its updates go.
    pub segment: SegmentWriter,
}

impl<'s> Worker<'s> {
    /// Starts a worker with a new segment file. One worker works on one iteration; started by a
    /// coordinator, it ends with it.
    pub fn start(store: &'s Store) -> Result<Self> {
        coordinator::follow(store)?;
        let segment = SegmentWriter::create(store, "update")?;
        let id = store.note(|tx| {
            drop_dead(store, tx)?;
            tx.execute(
                "INSERT INTO workers (pid, segment, since) VALUES (?1, ?2, unixepoch('subsec'))",
                params![std::process::id(), segment.id()],
            )?;
            Ok(tx.last_insert_rowid())
        })?;
        Ok(Self { store, id, said: BTreeMap::new(), segment })
    }

    /// Its number, never given again.
    #[must_use]
    pub fn id(&self) -> i64 {
        self.id
    }

    /// Says which cluster versions this worker's caches hold now.
    pub fn holds(&mut self, clusters: &[(ClusterId, u64)]) -> Result<()> {
        let now: BTreeMap<u32, u64> = clusters.iter().map(|(cluster, version)| (cluster.0, *version)).collect();
        if now == self.said {
            return Ok(());
        }
        self.store.note(|tx| {
            let mut drop = tx.prepare_cached("DELETE FROM residency WHERE worker = ?1 AND cluster = ?2")?;
            for cluster in self.said.keys().filter(|cluster| !now.contains_key(cluster)) {
                drop.execute(params![self.id, cluster])?;
            }
            let mut put = tx.prepare_cached("INSERT OR REPLACE INTO residency VALUES (?1, ?2, ?3)")?;
            for (cluster, version) in now.iter().filter(|(cluster, version)| self.said.get(cluster) != Some(version)) {
                put.execute(params![self.id, cluster, version])?;
            }
            Ok(())
        })?;
        self.said = now;
        Ok(())
    }
}

/// Whether the process that writes a segment is gone.
pub(super) fn segment_is_free(store: &Store, tx: &Transaction<'_>, segment: Option<u32>) -> Result<bool> {
    let mut query = tx.prepare_cached("SELECT file FROM segments WHERE id = ?1")?;
    let mut rows = query.query([segment])?;
    match rows.next()? {
        Some(row) => locks::is_free(&files::segment_path(store.dir(), &row.get::<_, String>(0)?)?),
        // gc takes only files that nobody writes.
        None => Ok(true),
    }
}

/// Deletes workers that are gone, with what they held.
fn drop_dead(store: &Store, tx: &Transaction<'_>) -> Result<()> {
    let mut query = tx.prepare("SELECT id, segment FROM workers")?;
    let all: Vec<(i64, u32)> =
        query.query_map([], |r| Ok((r.get(0)?, r.get(1)?)))?.collect::<std::result::Result<_, _>>()?;
    for (id, segment) in all {
        if segment_is_free(store, tx, Some(segment))? {
            tx.execute("DELETE FROM workers WHERE id = ?1", [id])?;
        }
    }
    Ok(())
}
