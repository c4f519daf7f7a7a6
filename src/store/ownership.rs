//! Whose the catalogue of a folder is, told from what it holds and not from its name, and without writing anything:
//! files of a store's name may be somebody else's.

use std::io::Read;
use std::path::Path;
use std::time::Duration;

use super::extent_header::MAGIC;
use super::files::{self, For, SEGMENTS};
use super::sql::CATALOGUE;
use super::{connection, reserve};
use crate::base::Result;

/// What lies where a store's catalogue belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Catalogue {
    /// Nothing.
    Absent,
    /// A file without a table yet: the making of a store was cut short, or is under way.
    Unmade,
    /// A catalogue of a store, damaged or not.
    Ours,
    /// Something else.
    Foreign,
}

/// Tables of every store's; that many of them make a catalogue ours.
const TABLES: &str = "'model', 'segments', 'stages', 'settings', 'input_files', 'objects', 'clusters', 'groups', \
                      'branches', 'solution_versions', 'cluster_states', 'cluster_links', 'tasks', 'updates'";
const ENOUGH: u32 = 8;

/// A statement that stands in every catalogue of ours, and how far it is looked for.
const SCHEMA_TEXT: &[u8] = b"CREATE TABLE cluster_states";
const LOOKED_THROUGH: u64 = 1 << 20;

/// How often a catalogue that can't be read is looked at again: somebody may be making it.
const TRIES: u32 = 5;

/// Looks whose the catalogue of a folder is.
pub(super) fn look(dir: &Path) -> Catalogue {
    for _ in 1..TRIES {
        match look_once(dir) {
            Catalogue::Foreign => std::thread::sleep(Duration::from_millis(10)),
            found => return found,
        }
    }
    look_once(dir)
}

fn look_once(dir: &Path) -> Catalogue {
    let path = dir.join(CATALOGUE);
    match path.symlink_metadata() {
        Err(_) => return Catalogue::Absent,
        Ok(meta) if !meta.is_file() => return if is_lived_in(dir) { Catalogue::Ours } else { Catalogue::Foreign },
        Ok(meta) if meta.len() == 0 => return Catalogue::Unmade,
        Ok(_) => {}
    }
    match tables(&path, dir) {
        Ok((_, 0)) => Catalogue::Unmade,
        Ok((ours, _)) if ours >= ENOUGH => Catalogue::Ours,
        Ok(_) => Catalogue::Foreign,
        // Damaged, or out of reach: that is for whoever opens it to say.
        Err(_) if is_lived_in(dir) || has_schema_text(&path) => Catalogue::Ours,
        Err(_) => Catalogue::Foreign,
    }
}

/// Tables of a store, and all objects, in a database.
fn tables(path: &Path, dir: &Path) -> Result<(u32, u32)> {
    let sql = format!(
        "SELECT count(*) FILTER (WHERE type IN ('table', 'view') AND name IN ({TABLES})), count(*) FROM sqlite_schema"
    );
    Ok(connection::to_read(path, dir)?.query_row(&sql, [], |row| Ok((row.get(0)?, row.get(1)?)))?)
}

/// Whether a file that SQLite can't read was a catalogue of ours, or may not be looked into.
fn has_schema_text(path: &Path) -> bool {
    let file = match files::try_open(path, For::Reading) {
        Ok(file) => file,
        Err(error) => return files::is_refusal(&error),
    };
    let mut bytes = Vec::new();
    let read = file.take(LOOKED_THROUGH).read_to_end(&mut bytes);
    read.is_ok() && bytes.windows(SCHEMA_TEXT.len()).any(|text| text == SCHEMA_TEXT)
}

/// Whether a folder holds files that only a store has: its reserve, or a segment with an extent.
fn is_lived_in(dir: &Path) -> bool {
    let segments = std::fs::read_dir(dir.join(SEGMENTS)).into_iter().flatten().flatten();
    reserve::is_whole(dir)
        || segments.into_iter().any(|entry| {
            entry.file_name().to_str().is_some_and(files::is_segment_name) && begins_with_extent(&entry.path())
        })
}

fn begins_with_extent(path: &Path) -> bool {
    let mut first = [0; MAGIC.len()];
    files::open(path, For::Reading).is_ok_and(|mut file| file.read_exact(&mut first).is_ok()) && first == MAGIC
}

/// Whether a file may stay from a segment: it is empty, or begins with an extent.
pub(super) fn is_segment(path: &Path) -> bool {
    is_empty(path) || begins_with_extent(path)
}

/// Whether there is nothing in a file or a folder, or it has gone by now.
pub(super) fn is_empty(path: &Path) -> bool {
    match path.symlink_metadata() {
        Ok(meta) if meta.is_file() => meta.len() == 0,
        Ok(meta) if meta.is_dir() => std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none()),
        Ok(_) => false,
        Err(error) => error.kind() == std::io::ErrorKind::NotFound,
    }
}
