//! Taking away what nobody reads: rows first, then whole files, then files that are mostly garbage,
//! then tails of files.

use std::collections::HashMap;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::sync::Arc;

use rusqlite::{Transaction, params};

use super::extent_header::HEADER_BYTES;
use super::files::{self, For, SEGMENTS};
use super::locks::{self, PublishLock};
use super::{ExtentRef, SegmentWriter, Store};
use crate::base::{Error, Result};
use crate::model::ExtentKind;

/// Every column that names a segment, as (table, column).
const REFERENCES: [(&str, &str); 10] = [
    ("clusters", "geometry_segment"),
    ("clusters", "rays_segment"),
    ("clusters", "provenance_segment"),
    ("clusters", "bake_segment"),
    ("clusters", "visibility_segment"),
    ("model", "rays_top_segment"),
    ("cluster_materials", "segment"),
    ("cluster_states", "segment"),
    ("cluster_links", "segment"),
    ("updates", "segment"),
];

/// Tables of rows, by cluster and version, whose extents can be moved, and what those hold.
const MOVABLE: [(&str, ExtentKind); 3] = [
    ("cluster_states", ExtentKind::Radiosity),
    ("cluster_links", ExtentKind::Links),
    ("cluster_materials", ExtentKind::Materials),
];

/// Extents moved in one transaction.
const BATCH: usize = 1024;

/// The segments whose bytes some row names.
fn referenced(tx: &Transaction<'_>) -> Result<Vec<u32>> {
    let selects: Vec<String> =
        REFERENCES.iter().map(|(table, column)| format!("SELECT {column} AS id FROM {table}")).collect();
    let sql = format!("SELECT DISTINCT id FROM ({}) WHERE id IS NOT NULL", selects.join(" UNION "));
    let mut query = tx.prepare(&sql)?;
    let ids = query.query_map([], |r| r.get(0))?.collect::<std::result::Result<_, _>>()?;
    Ok(ids)
}

impl Store {
    /// Unlinks segment files that no row names and no process writes; returns the bytes freed.
    /// Mappings of them stay valid.
    pub fn drop_unreferenced_segments(&self) -> Result<u64> {
        let _publishing = PublishLock::take(self)?;
        let (bytes, files) = self.write(|tx| self.forget_unreferenced(tx))?;
        for path in files {
            remove(&path)?;
        }
        Ok(bytes)
    }

    /// Moves what is in use out of segment files that are mostly garbage, and unlinks those, if no other
    /// process has the store open; returns the bytes freed.
    pub fn compact_segments(&self) -> Result<u64> {
        self.alone(|| {
            let sparse = self.sparse_segments()?;
            if sparse.is_empty() {
                return Ok(0);
            }
            let mut writer = SegmentWriter::create(self, "compact")?;
            let moved = self.move_all(&sparse, &mut writer);
            let written = writer.bytes();
            drop(writer);
            self.mappings.borrow_mut().clear();
            // Where there is no room to move to, what was moved so far is in use, and the rest stays where it is.
            let freed = self.drop_unreferenced_segments()?.saturating_sub(written);
            match moved {
                Err(Error::Failed { .. }) => Ok(freed),
                moved => moved.map(|()| freed),
            }
        })
    }

    fn move_all(&self, sparse: &[String], writer: &mut SegmentWriter) -> Result<()> {
        for (table, kind) in MOVABLE {
            let mut after = (-1, -1);
            while let Some(last) = self.move_rows(table, kind, sparse, after, writer)? {
                after = last;
            }
        }
        Ok(())
    }

    /// Numbers of the segments less than half of which is in use, all of it by rows that can be moved.
    fn sparse_segments(&self) -> Result<Vec<String>> {
        let used: Vec<String> =
            MOVABLE.iter().map(|(table, _)| format!("SELECT segment, bytes FROM {table}")).collect();
        let sql = format!(
            "SELECT s.id FROM segments s JOIN ({}) u ON u.segment = s.id
             WHERE s.purpose IN ('update', 'compact') AND s.id NOT IN (SELECT segment FROM updates)
             GROUP BY s.id HAVING 2 * sum(u.bytes + {HEADER_BYTES}) < s.published_bytes",
            used.join(" UNION ALL ")
        );
        let mut query = self.connection().prepare(&sql)?;
        let ids = query.query_map([], |r| r.get::<_, u32>(0).map(|id| id.to_string()))?;
        Ok(ids.collect::<std::result::Result<_, _>>()?)
    }

    /// Moves the next extents of a table that lie in `sparse`; gives the last row, or none at the end.
    fn move_rows(
        &self,
        table: &str,
        kind: ExtentKind,
        sparse: &[String],
        after: (i64, i64),
        writer: &mut SegmentWriter,
    ) -> Result<Option<(i64, i64)>> {
        let mut query = self.connection().prepare(&format!(
            "SELECT segment, offset, bytes, cluster, version FROM {table}
             WHERE (cluster, version) > (?1, ?2) AND segment IN ({}) ORDER BY cluster, version LIMIT {BATCH}",
            sparse.join(", ")
        ))?;
        let rows = query.query_map(params![after.0, after.1], |r| {
            Ok((ExtentRef::from_row(r, 0)?, r.get::<_, i64>(3)?, r.get::<_, i64>(4)?))
        })?;
        let mut moved = Vec::new();
        for row in rows {
            let (at, cluster, version) = row?;
            let extent = self.extent(at, kind)?;
            moved.push((writer.append(kind, extent.header().cluster, extent.payload())?, cluster, version));
        }
        writer.sync()?;
        self.write(|tx| {
            let mut put = tx.prepare(&format!(
                "UPDATE {table} SET segment = ?1, offset = ?2, bytes = ?3 WHERE cluster = ?4 AND version = ?5"
            ))?;
            for (to, cluster, version) in &moved {
                put.execute(params![to.segment, to.offset, to.bytes, cluster, version])?;
            }
            writer.publish(tx)
        })?;
        Ok(moved.last().map(|(_, cluster, version)| (*cluster, *version)))
    }

    /// Works on segment files while no other process has the store open, nor this one a mapping; 0 if one has.
    fn alone(&self, work: impl FnOnce() -> Result<u64>) -> Result<u64> {
        let path = self.dir().join(locks::READERS);
        self.mappings.borrow_mut().clear();
        let Some(readers) = self.readers().filter(|lock| Arc::strong_count(lock) == 1) else { return Ok(0) };
        // Our own shared lock becomes exclusive, or we are not alone.
        readers.unlock().map_err(|e| Error::io(&path, &e))?;
        let freed = if locks::try_exclusive(readers, &path)? { work() } else { Ok(0) };
        self.mappings.borrow_mut().clear();
        readers.unlock().map_err(|e| Error::io(&path, &e))?;
        readers.lock_shared().map_err(|e| Error::io(&path, &e))?;
        freed
    }

    /// Cuts off what lies behind the published bytes of segment files that nobody writes, if no other
    /// process has the store open; returns the bytes freed.
    pub fn truncate_segments(&self) -> Result<u64> {
        self.require_writable()?;
        self.alone(|| self.cut_tails())
    }

    fn cut_tails(&self) -> Result<u64> {
        let mut query = self.connection().prepare("SELECT file, published_bytes FROM segments")?;
        let mut rows = query.query([])?;
        let mut freed = 0;
        while let Some(row) = rows.next()? {
            let path = files::segment_path(self.dir(), &row.get::<_, String>(0)?)?;
            let used = row.get::<_, u64>(1)?;
            if path.symlink_metadata().is_err() {
                continue;
            }
            let file = files::open(&path, For::Writing)?;
            let meta = file.metadata().map_err(|e| Error::io(&path, &e))?;
            // A file with a second name may be somebody's copy of the store.
            if used < meta.len() && meta.nlink() == 1 && locks::try_exclusive(&file, &path)? {
                file.set_len(used).map_err(|e| Error::io(&path, &e))?;
                freed += meta.len() - used;
            }
        }
        Ok(freed)
    }

    /// Deletes the rows of unused segments and gives their files. Segments are made, and their
    /// extents published, in IMMEDIATE transactions too: none changes under us.
    fn forget_unreferenced(&self, tx: &Transaction<'_>) -> Result<(u64, Vec<PathBuf>)> {
        let mut rows: HashMap<String, u32> = HashMap::new();
        let mut query = tx.prepare("SELECT file, id FROM segments")?;
        let mut all = query.query([])?;
        while let Some(row) = all.next()? {
            rows.insert(row.get(0)?, row.get(1)?);
        }
        let in_use = referenced(tx)?;
        let dir = self.dir().join(SEGMENTS);
        let (mut bytes, mut forgotten) = (0, Vec::new());
        for entry in std::fs::read_dir(&dir).map_err(|e| Error::io(&dir, &e))? {
            let entry = entry.map_err(|e| Error::io(&dir, &e))?;
            let name = entry.file_name();
            // What is not named as we name files is not ours to remove.
            let Some(name) = name.to_str().filter(|name| files::is_segment_name(name)) else { continue };
            let path = files::segment_path(self.dir(), name)?;
            let row = rows.remove(name);
            if row.is_some_and(|id| in_use.contains(&id)) || !locks::is_free(&path)? {
                continue;
            }
            bytes += entry.metadata().map_err(|e| Error::io(&path, &e))?.len();
            match row {
                Some(id) => {
                    tx.execute("DELETE FROM segments WHERE id = ?1", [id])?;
                    forgotten.push(path);
                }
                // Its making was killed before the commit: the name may be given again, so now.
                None => remove(&path)?,
            }
        }
        // Rows whose files are gone already; rows in use stay, for `check` to name.
        for id in rows.into_values().filter(|id| !in_use.contains(id)) {
            tx.execute("DELETE FROM segments WHERE id = ?1", [id])?;
        }
        Ok((bytes, forgotten))
    }
}

fn remove(path: &std::path::Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io(path, &e)),
        _ => Ok(()),
    }
}
