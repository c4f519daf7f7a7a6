//! The folder of a store: which names in it are ours, whether a folder may become one, and taking away
//! one that came to nothing.

use std::path::Path;
use std::time::Duration;

use rusqlite::{Connection, OpenFlags};

use super::files::{self, For, SEGMENTS};
use super::locks::{self, PUBLISH, READERS, RUN};
use super::ownership::{self, Catalogue};
use super::reserve::{self, RESERVE};
use super::sql::CATALOGUE;
use crate::base::text::shown;
use crate::base::{Error, Result};

/// Folder for what a stage keeps on disk while it works.
const SCRATCH: &str = "scratch-ingest";
/// Folder of logs.
pub(super) const LOGS: &str = "logs";
/// What SQLite appends to the name of a catalogue.
const ENDINGS: [&str; 4] = ["", "-wal", "-shm", "-journal"];
/// What setting a damaged catalogue aside appends to its name, before a number.
const ASIDE: &str = ".damaged";

/// Whether what lies under a name in a folder without a catalogue may stay from the making of a store that was
/// cut short: nothing in it is anybody else's.
fn is_left_over(dir: &Path, name: &str, catalogue: Catalogue) -> bool {
    let path = dir.join(name);
    match name {
        RESERVE => reserve::is_begun(dir) || ownership::is_empty(&path),
        SEGMENTS => path.symlink_metadata().is_ok_and(|meta| meta.is_dir()),
        RUN | PUBLISH | READERS | LOGS | SCRATCH | "visibility.spool" => ownership::is_empty(&path),
        _ => name.strip_prefix(CATALOGUE).is_some_and(|ending| {
            // What was set aside is never touched.
            let of_sqlite = ENDINGS.contains(&ending);
            ending.starts_with(ASIDE) || (of_sqlite && (catalogue == Catalogue::Unmade || ownership::is_empty(&path)))
        }),
    }
}

/// The first name in a folder that `known` does not know.
fn foreign(dir: &Path, known: impl Fn(&str) -> bool) -> Result<Option<String>> {
    for entry in std::fs::read_dir(dir).map_err(|e| Error::io(dir, &e))? {
        let name = entry.map_err(|e| Error::io(dir, &e))?.file_name();
        if !name.to_str().is_some_and(&known) {
            return Ok(Some(shown(name)));
        }
    }
    Ok(None)
}

/// What is said of a catalogue that is somebody else's.
pub(super) const NO_CATALOGUE: &str = "its scene.sqlite is no catalogue of a store";

/// What is said of a folder in which no store is made.
pub(super) fn refused(dir: &Path, why: &str) -> Error {
    Error::Usage {
        message: format!("{}: {why}", shown(dir)),
        help: "name a folder that is empty or not there yet: a store is made in it".to_owned(),
    }
}

/// How often files of a catalogue that is being made or taken away are looked at again.
const LOOKS: u32 = 50;

/// Refuses a folder that is neither absent, nor empty, nor a store, nor one whose making was cut short.
pub(super) fn refuse_foreign(dir: &Path) -> Result<()> {
    for _ in 1..LOOKS {
        match alien(dir)? {
            None => return Ok(()),
            // A log of SQLite's comes before the catalogue can be told, and goes after it.
            Some(name) if ENDINGS[1..].iter().any(|ending| name == format!("{CATALOGUE}{ending}")) => {
                std::thread::sleep(Duration::from_millis(20));
            }
            Some(_) => break,
        }
    }
    match alien(dir)? {
        Some(name) => Err(refused(dir, &format!("it is no store, and holds other files ({name})"))),
        None => Ok(()),
    }
}

/// A file that speaks against making a store in a folder, if there is one.
fn alien(dir: &Path) -> Result<Option<String>> {
    match std::fs::metadata(dir) {
        Ok(meta) if !meta.is_dir() => return Err(refused(dir, "it is a file, not a folder")),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Error::io(dir, &e)),
        Ok(_) => {}
    }
    let catalogue = ownership::look(dir);
    match catalogue {
        Catalogue::Ours => return Ok(None),
        Catalogue::Foreign => return Err(refused(dir, NO_CATALOGUE)),
        Catalogue::Absent | Catalogue::Unmade => {}
    }
    let mut alien = foreign(dir, |name| is_left_over(dir, name, catalogue))?;
    let segments = dir.join(SEGMENTS);
    if alien.is_none() && segments.is_dir() {
        alien = foreign(&segments, |name| files::is_segment_name(name) && ownership::is_segment(&segments.join(name)))?;
    }
    // Somebody may have made the store meanwhile.
    Ok(alien.filter(|_| ownership::look(dir) != Catalogue::Ours))
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
    // While the catalogue still says that they are ours.
    let _ = std::fs::remove_dir_all(dir.join(SCRATCH));
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
    // An earlier one that was set aside stays.
    let numbers = std::iter::once(String::new()).chain((2..).map(|number: u32| number.to_string()));
    let names = numbers.map(|number| format!("{CATALOGUE}{ASIDE}{number}"));
    let is_free = |name: &String| ENDINGS.iter().all(|e| dir.join(format!("{name}{e}")).symlink_metadata().is_err());
    let aside = names.into_iter().find(is_free).expect("numbers do not end");
    // Its log goes with it: it may hold what can still be saved.
    for ending in ENDINGS {
        let from = dir.join(format!("{CATALOGUE}{ending}"));
        match std::fs::rename(&from, dir.join(format!("{aside}{ending}"))) {
            Err(e) if ending.is_empty() || e.kind() != std::io::ErrorKind::NotFound => {
                return Err(Error::io(&from, &e));
            }
            _ => {}
        }
    }
    Ok(())
}
