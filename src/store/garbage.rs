//! Taking away what nobody reads: rows first, then whole files, then tails of files.

use std::collections::HashMap;
use std::path::PathBuf;

use rusqlite::Transaction;

use super::Store;
use super::locks::{self, PublishLock};
use crate::base::{Error, Result};

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

    /// Cuts off what lies behind the published bytes of segment files that nobody writes, if no other
    /// process has the store open; returns the bytes freed.
    pub fn truncate_segments(&self) -> Result<u64> {
        let path = self.dir().join(locks::READERS);
        self.mappings.borrow_mut().clear();
        // Our own shared lock becomes exclusive, or we are not alone.
        self.readers().unlock().map_err(|e| Error::io(&path, &e))?;
        let alone = locks::try_exclusive(self.readers(), &path)?;
        let freed = if alone { self.cut_tails() } else { Ok(0) };
        self.readers().unlock().map_err(|e| Error::io(&path, &e))?;
        self.readers().lock_shared().map_err(|e| Error::io(&path, &e))?;
        freed
    }

    fn cut_tails(&self) -> Result<u64> {
        let mut query = self.connection().prepare("SELECT file, published_bytes FROM segments")?;
        let mut rows = query.query([])?;
        let mut freed = 0;
        while let Some(row) = rows.next()? {
            let (path, used) = (self.segment_path(&row.get::<_, String>(0)?), row.get::<_, u64>(1)?);
            let Ok(file) = std::fs::OpenOptions::new().write(true).open(&path) else { continue };
            let length = file.metadata().map_err(|e| Error::io(&path, &e))?.len();
            if used < length && locks::try_exclusive(&file, &path)? {
                file.set_len(used).map_err(|e| Error::io(&path, &e))?;
                freed += length - used;
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
        let dir = self.dir().join("segments");
        let (mut bytes, mut forgotten) = (0, Vec::new());
        for entry in std::fs::read_dir(&dir).map_err(|e| Error::io(&dir, &e))? {
            let entry = entry.map_err(|e| Error::io(&dir, &e))?;
            let path = entry.path();
            let row = entry.file_name().to_str().and_then(|name| rows.remove(name));
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
