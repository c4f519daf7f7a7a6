//! Workers: each appends to a segment file of its own and keeps it locked as long as it lives; what
//! it holds in its caches helps to choose its next group.

use rusqlite::{Transaction, params};

use super::{SegmentWriter, Store, coordinator, files, locks};
use crate::base::{ClusterId, Result};

/// This process as a worker.
pub struct Worker<'s> {
    store: &'s Store,
    id: i64,
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
        Ok(Self { store, id, segment })
    }

    /// Its number, never given again.
    #[must_use]
    pub fn id(&self) -> i64 {
        self.id
    }

    /// Says which cluster versions this worker's caches hold now.
    pub fn holds(&self, clusters: &[(ClusterId, u64)]) -> Result<()> {
        self.store.note(|tx| {
            tx.execute("DELETE FROM residency WHERE worker = ?1", [self.id])?;
            let mut put = tx.prepare_cached("INSERT OR REPLACE INTO residency VALUES (?1, ?2, ?3)")?;
            for (cluster, version) in clusters {
                put.execute(params![self.id, cluster.0, version])?;
            }
            Ok(())
        })
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
