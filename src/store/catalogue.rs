//! Opening a store: its folder, its catalogue, its schema, its connection.

use std::cell::{OnceCell, RefCell};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use rusqlite::{Connection, Transaction, TransactionBehavior};

use super::connection::{self, Access};
use super::extent::Mappings;
use super::files::SEGMENTS;
use super::locks::Joined;
use super::seals::Ledger;
use super::sql::CATALOGUE;
use super::{folder, locks, mounts, reserve, seals};
use crate::base::text::for_shell;
use crate::base::{Error, Result};

/// The schema's versions, in order; `user_version` counts those applied.
const SCHEMA: [&str; 2] = [include_str!("../../schema/0001_store.sql"), include_str!("../../schema/0002_seals.sql")];
const VIEWS: &str = include_str!("../../schema/views.sql");

/// Every table but `segments` (rows go with their files), `seals` and `processes`; referring ones first.
const EMPTIED: [&str; 18] = [
    "updates",
    "tasks",
    "residency",
    "workers",
    "cluster_links",
    "cluster_states",
    "cluster_materials",
    "solution_versions",
    "branches",
    "groups",
    "clusters",
    "skipped_faces",
    "objects",
    "input_files",
    "settings",
    "stages",
    "metrics",
    "model",
];

/// Where SQLite keeps `user_version` in a database file.
const USER_VERSION_AT: usize = 60;

/// Most memory that SQLite's page cache takes, KiB.
const PAGE_CACHE_KIB: i64 = 4096;

/// An open store. One per process or thread.
pub struct Store {
    dir: PathBuf,
    connection: Connection,
    access: Access,
    /// Version of the schema: an older one only where the store may only be read.
    format: usize,
    /// What the transaction under way has changed; made with the first.
    ledger: OnceCell<Ledger>,
    wait: Duration,
    pub(super) mappings: RefCell<Mappings>,
    readers: Option<Arc<File>>,
}

impl Store {
    /// Makes a store in `dir`, or opens the one that is there (finishing one whose making was cut
    /// short). `wait` is for a busy store.
    pub fn create(dir: &Path, wait: Duration) -> Result<Self> {
        folder::refuse_foreign(dir)?;
        let store = Self::enter(dir, wait, true)?;
        store.require_writable()?;
        reserve::keep(dir);
        Ok(store)
    }

    /// Like [`Store::create`], for a store that is going to be emptied: where the catalogue is damaged, it is
    /// set aside and another made. A store of a newer version is left alone.
    pub fn create_anew(dir: &Path, wait: Duration) -> Result<Self> {
        let sound = |store: &Self| store.catalogue_damages().is_ok_and(|damages| damages.is_empty());
        match Self::create(dir, wait) {
            Ok(store) if sound(&store) => return Ok(store),
            Err(error) if !matches!(error, Error::Damaged { .. }) || is_newer(dir) => return Err(error),
            _ => {}
        }
        folder::set_catalogue_aside(dir, wait)?;
        Self::create(dir, wait)
    }

    /// Opens the store in `dir`, only to read where one may not write; exit code 10 if there is none.
    pub fn open(dir: &Path, wait: Duration) -> Result<Self> {
        Self::enter(dir, wait, false)
    }

    fn enter(dir: &Path, wait: Duration, create: bool) -> Result<Self> {
        let catalogue = dir.join(CATALOGUE);
        loop {
            match catalogue.symlink_metadata() {
                Ok(meta) if meta.is_file() => {}
                Ok(_) => return Err(Error::damaged(&catalogue, "it is not a plain file")),
                Err(_) if !create => return Err(Error::NoStore { store: dir.to_path_buf() }),
                Err(_) => std::fs::create_dir_all(dir).map_err(|e| Error::io(dir, &e))?,
            }
            // A folder that was taken away meanwhile (a failed ingest's) is looked at again.
            let Joined::As(access, readers) = locks::join(dir, create)? else { continue };
            if create {
                for name in [SEGMENTS, folder::LOGS] {
                    std::fs::create_dir_all(dir.join(name)).map_err(|e| Error::io(dir, &e))?;
                }
            }
            return Self::connect(dir, wait, create, access, readers);
        }
    }

    fn connect(dir: &Path, wait: Duration, create: bool, access: Access, readers: Option<Arc<File>>) -> Result<Self> {
        mounts::refuse_network(dir)?;
        let path = dir.canonicalize().map_err(|e| Error::io(dir, &e))?.join(CATALOGUE);
        let over = |connection, access| Self {
            dir: dir.to_path_buf(),
            connection,
            access,
            format: SCHEMA.len(),
            ledger: OnceCell::new(),
            wait,
            mappings: RefCell::new(Mappings::new()),
            readers: readers.clone(),
        };
        let opened = || -> Result<Self> {
            if access == Access::Write {
                let store = over(connection::to_write(&path, create)?, access);
                match store.begin() {
                    Ok(true) => return Ok(store),
                    Err(error) if create || !connection::is_refusal(&error) => return Err(error.into()),
                    // The catalogue, or the folder, may not be written.
                    _ => {}
                }
            }
            Ok(over(connection::to_read(&path, dir)?, Access::Read))
        };
        let prepare = |mut store: Self| match store.prepare(create) {
            Ok(()) => Ok(store),
            Err(error) => Err(store.named(error)),
        };
        opened().and_then(prepare).map_err(|error| complete(error, dir))
    }

    /// The first touch of a catalogue that will be worked on; whether it can be.
    fn begin(&self) -> rusqlite::Result<bool> {
        self.connection.busy_timeout(self.wait)?;
        self.connection.query_row("SELECT count(*) FROM sqlite_schema", [], |_| Ok(()))?;
        Ok(!self.connection.is_readonly("main")?)
    }

    fn prepare(&mut self, create: bool) -> Result<()> {
        self.connection.busy_timeout(self.wait)?;
        // In one statement: another process may be making the store.
        let (version, ours, strange, all): (usize, u32, u32, u32) = self.connection.query_row(
            "SELECT (SELECT user_version FROM pragma_user_version),
                    (SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name IN ('model', 'clusters', 'segments')),
                    (SELECT count(*) FROM sqlite_schema WHERE type = 'trigger' OR (type = 'view' AND name NOT GLOB 'v_*')),
                    (SELECT count(*) FROM sqlite_schema)",
            [],
            |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?)),
        )?;
        if version > SCHEMA.len() {
            return Err(newer(&self.dir, version));
        }
        if (version > 0 && (ours < 3 || strange > 0)) || (version == 0 && all > 0) {
            let detail = "it is a database, but no catalogue of a store";
            return Err(if create {
                folder::refused(&self.dir, detail)
            } else {
                Error::damaged(&self.dir.join(CATALOGUE), detail)
            });
        }
        if version == 0 && !create {
            return Err(Error::NoStore { store: self.dir.clone() });
        }
        self.connection.pragma_update(None, "foreign_keys", true)?;
        self.connection.pragma_update(None, "cache_size", -PAGE_CACHE_KIB)?;
        self.connection.pragma_update(None, "temp_store", "FILE")?;
        self.connection.set_prepared_statement_cache_capacity(64);
        if self.access == Access::Read {
            self.format = version;
            return Ok(());
        }
        self.connection.pragma_update(None, "journal_mode", "WAL")?;
        // Files are unlinked after the commit that forgets them: the commit must be on disk by then.
        self.connection.pragma_update(None, "synchronous", "FULL")?;
        if version == SCHEMA.len() {
            return Ok(());
        }
        self.transaction(apply_schema)
    }

    /// The store's folder.
    #[must_use]
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// How long to wait while the store is busy.
    #[must_use]
    pub fn wait(&self) -> Duration {
        self.wait
    }

    pub(super) fn connection(&self) -> &Connection {
        &self.connection
    }

    /// The shared lock that keeps mapped files from being truncated; `None` where one may only read, and there is
    /// no lock to take.
    pub(super) fn readers(&self) -> Option<&Arc<File>> {
        self.readers.as_ref()
    }

    /// Version of the schema.
    pub(super) fn format(&self) -> usize {
        self.format
    }

    /// Whether one may write.
    pub(super) fn is_writable(&self) -> bool {
        self.access == Access::Write
    }

    /// Fails, with what to do instead, if one may only read.
    pub(super) fn require_writable(&self) -> Result<()> {
        if self.is_writable() {
            return Ok(());
        }
        Err(connection::unwritable(&self.dir))
    }

    /// Runs `work` in one IMMEDIATE transaction: all of it is done, or nothing.
    pub(super) fn write<T>(&self, work: impl FnOnce(&Transaction<'_>) -> Result<T>) -> Result<T> {
        let ledger = self.ledger().map_err(|e| self.named(e))?;
        self.transaction(|tx| {
            ledger.clear();
            let out = work(tx)?;
            ledger.settle(tx)?;
            Ok(out)
        })
    }

    fn transaction<T>(&self, work: impl FnOnce(&Transaction<'_>) -> Result<T>) -> Result<T> {
        let run = || {
            let tx = Transaction::new_unchecked(&self.connection, TransactionBehavior::Immediate)?;
            let out = work(&tx)?;
            tx.commit()?;
            Ok(out)
        };
        run().map_err(|e| self.named(e))
    }

    /// What counts the rows that a transaction changes; an error where one may only read.
    pub(super) fn ledger(&self) -> Result<&Ledger> {
        self.require_writable()?;
        if self.ledger.get().is_none() {
            // Nobody else can have set it: a connection is one thread's.
            let _ = self.ledger.set(Ledger::keep(&self.connection)?);
        }
        Ok(self.ledger.get().expect("it was set"))
    }

    /// Runs `work` on one state of the catalogue, whatever others write meanwhile.
    pub(super) fn read<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let run = || {
            // Within a transaction of our own that holds anyway.
            if !self.connection.is_autocommit() {
                return work();
            }
            let _reading = Transaction::new_unchecked(&self.connection, TransactionBehavior::Deferred)?;
            work()
        };
        run().map_err(|e| self.named(e))
    }

    /// Moves the write-ahead log into the catalogue, as far as readers let it.
    pub fn checkpoint(&self) -> Result<()> {
        // The answer (busy or not) does not matter: the log is only a little longer if busy.
        self.connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()))?;
        Ok(())
    }

    /// Bytes of the store's files.
    pub fn bytes_on_disk(&self) -> Result<u64> {
        let mut sum = 0;
        for dir in [self.dir.clone(), self.dir.join(SEGMENTS)] {
            for entry in std::fs::read_dir(&dir).map_err(|e| Error::io(&dir, &e))? {
                // A file unlinked while we count is no longer ours to count.
                let Ok(meta) = entry.and_then(|e| e.metadata()) else { continue };
                sum += if meta.is_file() { meta.len() } else { 0 };
            }
        }
        Ok(sum)
    }

    /// Forgets everything in the store, for `--fresh`: rows first, then files.
    pub fn empty(&self) -> Result<()> {
        self.write(|tx| {
            for table in EMPTIED {
                tx.execute(&format!("DELETE FROM {table}"), [])?;
            }
            // What somebody else changed does not matter any more.
            self.ledger()?.clear();
            Ok(seals::renew(tx)?)
        })?;
        self.mappings.borrow_mut().clear();
        self.drop_unreferenced_segments()?;
        Ok(())
    }
}

fn apply_schema(tx: &Transaction<'_>) -> Result<()> {
    let version: usize = tx.pragma_query_value(None, "user_version", |r| r.get(0))?;
    for sql in SCHEMA.iter().skip(version) {
        tx.execute_batch(sql)?;
    }
    tx.execute_batch(VIEWS)?;
    seals::renew(tx)?;
    tx.pragma_update(None, "user_version", SCHEMA.len())?;
    Ok(())
}

/// The error of a store that a newer version of the program made: nothing of it is touched.
fn newer(dir: &Path, version: usize) -> Error {
    let (reads, name) = (SCHEMA.len(), for_shell(dir));
    let detail = format!("its format is {version}, this program reads up to {reads}: it was made by a newer version");
    Error::damaged(&dir.join(CATALOGUE), detail)
        .with_help_for_damage(|| format!("use the newer version of clerestory that made {name}, or name another store"))
}

/// Whether a catalogue says that a newer version made it, damaged or not. The number stands in the file's first
/// page, and may be newer in its log.
fn is_newer(dir: &Path) -> bool {
    let path = dir.join(CATALOGUE);
    let asked = || -> Option<usize> {
        connection::to_read(&path, dir).ok()?.pragma_query_value(None, "user_version", |row| row.get(0)).ok()
    };
    let written = || {
        let mut page = [0; 64];
        File::open(&path).ok()?.read_exact_at(&mut page, 0).ok()?;
        let number = page[USER_VERSION_AT..].first_chunk().map(|bytes| u32::from_be_bytes(*bytes) as usize);
        number.filter(|_| page.starts_with(b"SQLite format 3\0"))
    };
    asked().or_else(written).is_some_and(|version| version > SCHEMA.len())
}

/// Completes an error of opening: its path, and what to do where not even `check` can read the catalogue.
fn complete(error: Error, dir: &Path) -> Error {
    let name = for_shell(dir);
    let path = dir.join(CATALOGUE);
    let error = match error {
        Error::Damaged { path: bare, detail, help } if bare.as_os_str() == CATALOGUE => {
            Error::Damaged { path, detail, help }
        }
        Error::Failed { message, help } if message.starts_with(CATALOGUE) => {
            Error::Failed { message: format!("{}/{message}", dir.display()), help }
        }
        Error::Busy { holder, .. } if holder.is_empty() => {
            Error::Busy { store: dir.to_path_buf(), holder: "a process that writes to its catalogue".to_owned() }
        }
        other => other,
    };
    error.with_help_for_damage(|| {
        format!("set it aside with `mv {name} {name}.damaged`, then run the command that made it again")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_store_opens_again_and_a_newer_one_is_refused_with_12() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.clr");
        assert_eq!(Store::open(&path, Duration::ZERO).err().unwrap().exit_code(), 10);
        let store = Store::create(&path, Duration::ZERO).unwrap();
        let views: u32 = store
            .connection()
            .query_row("SELECT count(*) FROM sqlite_schema WHERE type = 'view'", [], |r| r.get(0))
            .unwrap();
        assert_eq!(views, 10);
        drop(store);
        let store = Store::open(&path, Duration::ZERO).unwrap();
        store.connection().pragma_update(None, "user_version", 99).unwrap();
        drop(store);
        assert_eq!(Store::open(&path, Duration::ZERO).err().unwrap().exit_code(), 12);
    }

    #[test]
    fn a_folder_whose_making_was_cut_short_is_no_store_yet_and_can_be_made() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join(CATALOGUE), b"").unwrap();
        assert_eq!(Store::open(dir.path(), Duration::ZERO).err().unwrap().exit_code(), 10);
        Store::create(dir.path(), Duration::ZERO).unwrap();
        Store::open(dir.path(), Duration::ZERO).unwrap();
    }

    #[test]
    fn a_file_that_is_no_catalogue_is_damaged() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join(CATALOGUE), vec![7u8; 8192]).unwrap();
        assert_eq!(Store::open(dir.path(), Duration::ZERO).err().unwrap().exit_code(), 12);
    }

    #[test]
    fn a_second_coordinator_waits_and_then_names_the_first() {
        let dir = tempfile::tempdir().unwrap();
        let first = Store::create(dir.path(), Duration::from_millis(50)).unwrap();
        let lock = super::super::RunLock::take(&first, "clerestory ingest a.clr").unwrap();
        let second = Store::open(dir.path(), Duration::from_millis(50)).unwrap();
        let refused = super::super::RunLock::take(&second, "clerestory run").err().unwrap();
        assert_eq!(refused.exit_code(), 11);
        drop(lock);
        super::super::RunLock::take(&second, "clerestory run").unwrap();
    }
}
