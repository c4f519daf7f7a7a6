//! Opening a store: its folder, its catalogue, its schema, its connection.

use std::cell::RefCell;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rusqlite::{Connection, OpenFlags, Transaction, TransactionBehavior};

use super::extent::Mappings;
use super::sql::CATALOGUE;
use super::{locks, mounts};
use crate::base::{Error, Result};

/// The schema's versions, in order; `user_version` counts those applied.
const SCHEMA: [&str; 1] = [include_str!("../../schema/0001_store.sql")];
const VIEWS: &str = include_str!("../../schema/views.sql");

/// Every table but `segments` (rows go with their files) and `processes`; referring ones first.
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

/// Most memory that SQLite's page cache takes, KiB.
const PAGE_CACHE_KIB: i64 = 4096;

/// An open store. One per process or thread.
pub struct Store {
    dir: PathBuf,
    connection: Connection,
    wait: Duration,
    pub(super) mappings: RefCell<Mappings>,
    readers: File,
}

impl Store {
    /// Makes a store in `dir`, or opens the one that is there (finishing one whose making was cut
    /// short). `wait` is for a busy store.
    pub fn create(dir: &Path, wait: Duration) -> Result<Self> {
        std::fs::create_dir_all(dir.join("segments")).map_err(|e| Error::io(dir, &e))?;
        std::fs::create_dir_all(dir.join("logs")).map_err(|e| Error::io(dir, &e))?;
        Self::connect(dir, wait, true)
    }

    /// Opens the store in `dir`; exit code 10 if there is none.
    pub fn open(dir: &Path, wait: Duration) -> Result<Self> {
        if !dir.join(CATALOGUE).is_file() {
            return Err(Error::NoStore { store: dir.to_path_buf() });
        }
        Self::connect(dir, wait, false)
    }

    fn connect(dir: &Path, wait: Duration, create: bool) -> Result<Self> {
        mounts::refuse_network(dir)?;
        let path = dir.join(CATALOGUE);
        let mut flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        flags.set(OpenFlags::SQLITE_OPEN_CREATE, create);
        let connection = Connection::open_with_flags(&path, flags).map_err(|e| at(&path, e))?;
        connection.busy_timeout(wait).map_err(|e| at(&path, e))?;
        let readers_path = dir.join(locks::READERS);
        let readers = locks::open(&readers_path)?;
        readers.lock_shared().map_err(|e| Error::io(&readers_path, &e))?;
        let store = Self { dir: dir.to_path_buf(), connection, wait, mappings: RefCell::new(Mappings::new()), readers };
        store.prepare(create).map_err(|e| store.named(e))?;
        Ok(store)
    }

    fn prepare(&self, create: bool) -> Result<()> {
        let version: usize = self.connection.pragma_query_value(None, "user_version", |r| r.get(0))?;
        if version > SCHEMA.len() {
            let detail = format!(
                "its format is {version}, this program reads up to {}: it was made by a newer version",
                SCHEMA.len()
            );
            return Err(Error::damaged(&self.dir.join(CATALOGUE), detail));
        }
        if version == 0 && !create {
            return Err(Error::NoStore { store: self.dir.clone() });
        }
        self.connection.pragma_update(None, "journal_mode", "WAL")?;
        // Files are unlinked after the commit that forgets them: the commit must be on disk by then.
        self.connection.pragma_update(None, "synchronous", "FULL")?;
        self.connection.pragma_update(None, "foreign_keys", true)?;
        self.connection.pragma_update(None, "cache_size", -PAGE_CACHE_KIB)?;
        self.connection.pragma_update(None, "temp_store", "FILE")?;
        self.connection.set_prepared_statement_cache_capacity(64);
        if version < SCHEMA.len() {
            self.write(|tx| {
                let version: usize = tx.pragma_query_value(None, "user_version", |r| r.get(0))?;
                for sql in SCHEMA.iter().skip(version) {
                    tx.execute_batch(sql)?;
                }
                tx.execute_batch(VIEWS)?;
                tx.pragma_update(None, "user_version", SCHEMA.len())?;
                Ok(())
            })?;
        }
        Ok(())
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

    /// The shared lock that keeps mapped files from being truncated.
    pub(super) fn readers(&self) -> &File {
        &self.readers
    }

    /// Where a segment file lies.
    pub(super) fn segment_path(&self, file: &str) -> PathBuf {
        self.dir.join("segments").join(file)
    }

    /// Runs `work` in one IMMEDIATE transaction: all of it is done, or nothing.
    pub(super) fn write<T>(&self, work: impl FnOnce(&Transaction<'_>) -> Result<T>) -> Result<T> {
        let run = || {
            let tx = Transaction::new_unchecked(&self.connection, TransactionBehavior::Immediate)?;
            let out = work(&tx)?;
            tx.commit()?;
            Ok(out)
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
        for dir in [self.dir.clone(), self.dir.join("segments")] {
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
            Ok(())
        })?;
        self.drop_unreferenced_segments()?;
        Ok(())
    }
}

fn at(path: &Path, error: rusqlite::Error) -> Error {
    match Error::from(error) {
        Error::Damaged { detail, .. } => Error::damaged(path, detail),
        other => other,
    }
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
