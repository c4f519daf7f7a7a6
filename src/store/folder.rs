//! The folder of a store: which names in it are ours, whether a folder may become one, and taking away
//! one that came to nothing.

use std::path::Path;

use rusqlite::{Connection, OpenFlags};

use super::files::{self, For, SEGMENTS};
use super::locks::{self, PUBLISH, READERS, RUN};
use super::reserve::RESERVE;
use super::sql::CATALOGUE;
use crate::base::text::shown;
use crate::base::{Error, Result};

/// Folder for what a stage keeps on disk while it works.
const SCRATCH: &str = "scratch-ingest";
/// Folder of logs.
pub(super) const LOGS: &str = "logs";
/// What SQLite and setting a damaged catalogue aside append to its name.
const ENDINGS: [&str; 5] = ["", "-wal", "-shm", "-journal", ".damaged"];

/// Whether a name in a store's folder is one that we give.
fn is_ours(name: &str) -> bool {
    [RUN, PUBLISH, READERS, RESERVE, SEGMENTS, LOGS, SCRATCH, "visibility.spool"].contains(&name)
        || name.strip_prefix(CATALOGUE).is_some_and(|ending| ENDINGS.contains(&ending))
}

/// The first name in a folder that `known` does not know.
fn foreign(dir: &Path, known: fn(&str) -> bool) -> Result<Option<String>> {
    for entry in std::fs::read_dir(dir).map_err(|e| Error::io(dir, &e))? {
        let name = entry.map_err(|e| Error::io(dir, &e))?.file_name();
        if !name.to_str().is_some_and(known) {
            return Ok(Some(shown(name)));
        }
    }
    Ok(None)
}

/// What is said of a folder in which no store is made.
pub(super) fn refused(dir: &Path, why: &str) -> Error {
    Error::Usage {
        message: format!("{}: {why}", shown(dir)),
        help: "name a folder that is empty or not there yet: a store is made in it".to_owned(),
    }
}

/// Refuses a folder that is neither absent, nor empty, nor a store, nor one whose making was cut short.
pub(super) fn refuse_foreign(dir: &Path) -> Result<()> {
    match std::fs::metadata(dir) {
        Ok(meta) if !meta.is_dir() => return Err(refused(dir, "it is a file, not a folder")),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(Error::io(dir, &e)),
        Ok(_) => {}
    }
    let mut alien = foreign(dir, is_ours)?;
    if dir.join(CATALOGUE).symlink_metadata().is_ok() {
        return Ok(());
    }
    if alien.is_none() && dir.join(SEGMENTS).is_dir() {
        alien = foreign(&dir.join(SEGMENTS), files::is_segment_name)?;
    }
    match alien {
        Some(name) => Err(refused(dir, &format!("it is no store, and holds other files ({name})"))),
        None => Ok(()),
    }
}

/// Takes away a store that this process began and that came to nothing, unless it holds a model by now or
/// somebody else has it open; only what is ours goes. What can't be removed stays: it does no harm.
///
/// Whoever opens a store holds `readers.lock`, and looks afterwards whether it is still there: so nobody is
/// left with a store whose folder has gone.
pub fn unmake(dir: &Path) {
    let path = dir.join(READERS);
    let Ok(lock) = files::open(&path, For::Writing) else { return };
    let alone = locks::try_exclusive(&lock, &path).unwrap_or(false) && files::is_at(&lock, &path).unwrap_or(false);
    if !alone || holds_model(dir) {
        return;
    }
    let remove = |name: &str| drop(std::fs::remove_file(dir.join(name)));
    for entry in std::fs::read_dir(dir.join(SEGMENTS)).into_iter().flatten().flatten() {
        if entry.file_name().to_str().is_some_and(files::is_segment_name) {
            remove(&format!("{SEGMENTS}/{}", entry.file_name().to_string_lossy()));
        }
    }
    for ending in ENDINGS {
        remove(&format!("{CATALOGUE}{ending}"));
    }
    for name in [RUN, PUBLISH, RESERVE] {
        remove(name);
    }
    let _ = std::fs::remove_dir_all(dir.join(SCRATCH));
    // Folders that hold anything else stay.
    for name in [SEGMENTS, LOGS] {
        let _ = std::fs::remove_dir(dir.join(name));
    }
    remove(READERS);
    let _ = std::fs::remove_dir(dir);
}

/// Whether the catalogue holds a model, or can't be asked.
fn holds_model(dir: &Path) -> bool {
    let path = dir.join(CATALOGUE);
    if !path.exists() {
        return false;
    }
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let count = |sql: &str| -> rusqlite::Result<u64> {
        Connection::open_with_flags(&path, flags)?.query_row(sql, [], |row| row.get(0))
    };
    match count("SELECT count(*) FROM sqlite_schema WHERE name = 'model'") {
        Ok(0) => false,
        _ => count("SELECT count(*) FROM model") != Ok(0),
    }
}

/// Sets a damaged catalogue aside, so that the store can be made anew in its place. Nobody else may have the
/// store open.
pub(super) fn set_catalogue_aside(dir: &Path, wait: std::time::Duration) -> Result<()> {
    let mut held = Vec::new();
    for name in [RUN, READERS] {
        let path = dir.join(name);
        let lock = files::open(&path, For::Making)?;
        if !locks::exclusive_within(&lock, &path, wait)? {
            return Err(Error::Busy { store: dir.to_path_buf(), holder: "a process that has it open".to_owned() });
        }
        held.push(lock);
    }
    let (from, to) = (dir.join(CATALOGUE), dir.join(format!("{CATALOGUE}.damaged")));
    std::fs::rename(&from, &to).map_err(|e| Error::io(&from, &e))?;
    for ending in ["-wal", "-shm", "-journal"] {
        let path = dir.join(format!("{CATALOGUE}{ending}"));
        match std::fs::remove_file(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(Error::io(&path, &e)),
            _ => {}
        }
    }
    Ok(())
}
