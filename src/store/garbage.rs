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
