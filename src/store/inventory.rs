//! Everything that a store holds, gone through once: for `check`.

use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt;
use std::path::PathBuf;

use xxhash_rust::xxh3::xxh3_64;

use super::extent_header::{ALIGN, ExtentHeader, HEADER_BYTES};
use super::{ExtentRef, Store, files, segment};
use crate::base::Result;
use crate::base::text::from_stored;
use crate::model::ExtentKind;

/// A segment file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SegmentRow {
    /// Its number.
    pub id: u32,
    /// Its file, as the catalogue names it.
    pub name: String,
    /// Bytes in use; what lies behind is garbage.
    pub published_bytes: u64,
}

/// A row that names an extent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExtentRow {
    /// The cluster.
    pub cluster: u32,
    /// The version, where the kind has versions.
    pub version: Option<u64>,
    /// Where it lies.
    pub at: ExtentRef,
}

impl Store {
    /// The segment files that the catalogue knows and that hold published bytes.
    pub fn segments(&self) -> Result<Vec<SegmentRow>> {
        let mut query = self
            .connection()
            .prepare("SELECT id, file, published_bytes FROM segments WHERE published_bytes > 0 ORDER BY id")?;
        let mut rows = query.query([])?;
        let mut segments = Vec::new();
        while let Some(row) = rows.next()? {
            let name: String = row.get(1)?;
            segments.push(SegmentRow { id: row.get(0)?, name, published_bytes: row.get(2)? });
        }
        Ok(segments)
    }

    /// Goes through a segment's extents, checking each; `damage` gets the byte and what is wrong.
    /// Returns the bytes that were verified. Fails only where the file cannot be mapped.
    pub fn walk_segment(&self, row: &SegmentRow, damage: &mut dyn FnMut(u64, String)) -> Result<u64> {
        let map = segment::map(&files::segment_path(self.dir(), &row.name)?, self.readers())?;
        if (map.len() as u64) < row.published_bytes {
            damage(0, format!("cut off: {} bytes where {} are in use", map.len(), row.published_bytes));
        }
        let end = row.published_bytes.min(map.len() as u64);
        let (mut at, mut verified) = (0, 0);
        while at < end {
            let header = match ExtentHeader::parse(&map[at as usize..]) {
                Ok(header) => header,
                Err(detail) => {
                    damage(at, detail);
                    break;
                }
            };
            let start = at + HEADER_BYTES;
            let Some(stop) = start.checked_add(header.payload_bytes).filter(|&stop| stop <= end) else {
                damage(at, "the payload is cut off".to_owned());
                break;
            };
            if xxh3_64(&map[start as usize..stop as usize]) == header.payload_xxh3 {
                verified += stop - at;
            } else {
                damage(at, "the payload's checksum is wrong".to_owned());
            }
            at = stop.div_ceil(ALIGN) * ALIGN;
        }
        Ok(verified)
    }

    /// Every row that names an extent of a kind; updates that are not merged included.
    pub fn for_each_extent(&self, kind: ExtentKind, each: &mut dyn FnMut(ExtentRow) -> Result<()>) -> Result<()> {
        let own = |columns: &str| {
            format!(
                "SELECT {columns}_segment, {columns}_offset, {columns}_bytes, id, NULL FROM clusters
                 WHERE {columns}_segment IS NOT NULL ORDER BY id"
            )
        };
        let versioned = |table: &str| {
            format!(
                "SELECT segment, offset, bytes, cluster, version FROM {table}
                 UNION ALL SELECT segment, offset, bytes, cluster, NULL FROM updates WHERE kind = {}",
                kind as u16
            )
        };
        let sql = match kind {
            ExtentKind::Geometry => own("geometry"),
            ExtentKind::Rays => own("rays"),
            ExtentKind::Bake => own("bake"),
            ExtentKind::Provenance => own("provenance"),
            ExtentKind::Visibility => own("visibility"),
            ExtentKind::Materials => versioned("cluster_materials"),
            ExtentKind::Radiosity => versioned("cluster_states"),
            ExtentKind::Links => versioned("cluster_links"),
        };
        let mut query = self.connection().prepare(&sql)?;
        let mut rows = query.query([])?;
        while let Some(row) = rows.next()? {
            each(ExtentRow { cluster: row.get(3)?, version: row.get(4)?, at: ExtentRef::from_row(row, 0)? })?;
        }
        Ok(())
    }

    /// Versions that can be read, ascending.
    pub fn kept_versions(&self) -> Result<Vec<u64>> {
        let mut query = self.connection().prepare("SELECT id FROM solution_versions WHERE is_kept = 1 ORDER BY id")?;
        let rows = query.query_map([], |r| r.get(0))?;
        Ok(rows.collect::<std::result::Result<_, _>>()?)
    }

    /// The OBJ files that the model came from, as far as they can be told.
    pub fn models(&self) -> Result<Vec<PathBuf>> {
        let mut query = self.connection().prepare("SELECT path FROM input_files WHERE kind = 'obj' ORDER BY id")?;
        let paths = query.query_map([], |row| row.get::<_, String>(0))?.collect::<std::result::Result<Vec<_>, _>>()?;
        let known = |path: String| from_stored(&path).map(|bytes| PathBuf::from(OsString::from_vec(bytes)));
        Ok(paths.into_iter().filter_map(known).collect())
    }

    /// What SQLite itself finds wrong with the catalogue.
    pub fn catalogue_damages(&self) -> Result<Vec<String>> {
        let mut found = Vec::new();
        let mut query = self.connection().prepare("PRAGMA integrity_check(100)")?;
        let mut rows = query.query([])?;
        while let Some(row) = rows.next()? {
            let line: String = row.get(0)?;
            if line != "ok" {
                found.push(line);
            }
        }
        let mut query = self.connection().prepare("PRAGMA foreign_key_check")?;
        let mut rows = query.query([])?;
        while let Some(row) = rows.next()? {
            let (table, row_id, parent): (String, Option<i64>, String) = (row.get(0)?, row.get(1)?, row.get(2)?);
            let which = row_id.map_or("a row".to_owned(), |id| format!("row {id}"));
            found.push(format!("{which} of {table} refers to a row of {parent} that is not there"));
        }
        Ok(found)
    }
}
