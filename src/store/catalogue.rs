//! Opening a store: its folder, its catalogue, its schema, its connection.

use std::cell::{OnceCell, RefCell};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rusqlite::{Connection, ErrorCode, Transaction, TransactionBehavior};

use super::connection::{self, Access};
use super::extent::Mappings;
use super::files::{self, SEGMENTS};
use super::locks::Joined;
use super::ownership::{self, Catalogue};
use super::schema::{self, FORMAT};
use super::seals::Ledger;
use super::sql::{CATALOGUE, FULL};
use super::{folder, locks, mounts, reserve, seals};
use crate::base::text::shown;
use crate::base::{Error, Result};

/// Every table but `segments` (rows go with their files), `seals` and `processes`; referring ones first.
const EMPTIED: [&str; 19] = [
    "updates",
    "tasks",
    "residency",
    "workers",
    "cluster_links",
    "cluster_states",
    "cluster_materials",
    "audits",
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

/// How often a folder is looked at again that goes while it is opened.
const TRIES: u32 = 100;

/// Most memory that SQLite's page cache takes, KiB.
const PAGE_CACHE_KIB: i64 = 4096;

/// An open store. One per process or thread.
pub struct Store {
    dir: PathBuf,
    connection: Connection,
    access: Access,
    /// What the transaction under way has changed; made with the first.
    ledger: OnceCell<Ledger>,
    wait: Duration,
    pub(super) mappings: RefCell<Mappings>,
    readers: Option<Arc<File>>,
    /// Whether one may only read because the disk is full.
    is_full: bool,
}

impl Store {
    /// Makes a store in `dir`, or opens the one that is there (finishing one whose making was cut
    /// short). `wait` is for a busy store.
    pub fn create(dir: &Path, wait: Duration) -> Result<Self> {
        folder::refuse_foreign(dir)?;
        Self::make(dir, wait)
    }

    /// Like [`Store::create`], for a store that is going to be emptied: where the catalogue is damaged, it is
    /// set aside and another made. A store of a newer version is left alone.
    pub fn create_anew(dir: &Path, wait: Duration) -> Result<Self> {
        let sound = |store: &Self| store.catalogue_damages().is_ok_and(|damages| damages.is_empty());
        match Self::create(dir, wait) {
            Ok(store) if sound(&store) => return Ok(store),
            Err(error) if !matches!(error, Error::Damaged { .. }) || schema::is_newer(dir) => return Err(error),
            _ => {}
        }
        folder::set_catalogue_aside(dir, wait)?;
        Self::make(dir, wait)
    }

    fn make(dir: &Path, wait: Duration) -> Result<Self> {
        let store = Self::enter(dir, wait, true)?;
        store.require_writable()?;
        reserve::keep(dir);
        Ok(store)
    }

    /// Opens the store in `dir`, only to read where one may not write; exit code 10 if there is none.
    pub fn open(dir: &Path, wait: Duration) -> Result<Self> {
        Self::enter(dir, wait, false)
    }

    fn enter(dir: &Path, wait: Duration, create: bool) -> Result<Self> {
        let catalogue = dir.join(CATALOGUE);
        for _ in 0..TRIES {
            match catalogue.symlink_metadata() {
                // Beside what is somebody else's no lock is made.
                Ok(meta) if meta.is_file() && !locks::has_been_joined(dir) => {
                    if ownership::look(dir) == Catalogue::Foreign {
                        let error = Error::damaged(&catalogue, "it is no catalogue of a store");
                        return Err(schema::complete(error, dir));
                    }
                }
                Ok(meta) if meta.is_file() => {}
                Ok(_) => return Err(Error::damaged(&catalogue, "it is not a plain file")),
                Err(e) if files::is_refusal(&e) => return Err(connection::forbidden(dir)),
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
        Err(Error::Busy { store: dir.to_path_buf(), holder: "processes that make it and take it away".to_owned() })
    }

    fn connect(dir: &Path, wait: Duration, create: bool, access: Access, readers: Option<Arc<File>>) -> Result<Self> {
        mounts::refuse_network(dir)?;
        let path = dir.canonicalize().map_err(|e| Error::io(dir, &e))?.join(CATALOGUE);
        let over = |connection, access| Self {
            dir: dir.to_path_buf(),
            connection,
            access,
            ledger: OnceCell::new(),
            wait,
            mappings: RefCell::new(Mappings::new()),
            readers: readers.clone(),
            is_full: false,
        };
        let opened = || -> Result<Self> {
            let mut is_full = false;
            if access == Access::Write {
                let mut store = over(connection::to_write(&path, create)?, access);
                match store.begin() {
                    Ok(true) => return Ok(store),
                    Err(error) if !create && connection::is_without_room(&error) => is_full = true,
                    Err(error) if create || !connection::is_refusal(&error) => return Err(error.into()),
                    // The catalogue, or the folder, may not be written.
                    _ => {}
                }
            }
            Ok(Self { is_full, ..over(connection::to_read(&path, dir)?, Access::Read) })
        };
        let prepare = |mut store: Self| match store.prepare(create) {
            Ok(()) => Ok(store),
            Err(error) => Err(store.named(error)),
        };
        opened().and_then(prepare).map_err(|error| match error {
            Error::Failed { .. } if connection::is_forbidden(&path) => connection::forbidden(&dir.join(CATALOGUE)),
            error => schema::complete(error, dir),
        })
    }

    /// The first touch of a catalogue that will be worked on; whether it can be.
    fn begin(&mut self) -> rusqlite::Result<bool> {
        self.connection.busy_handler(Some(locks::patience(self.wait)))?;
        self.connection.query_row("SELECT count(*) FROM sqlite_schema", [], |_| Ok(()))?;
        Ok(!self.connection.is_readonly("main")?)
    }

    fn prepare(&mut self, create: bool) -> Result<()> {
        self.connection.busy_handler(Some(locks::patience(self.wait)))?;
        // In one statement: another process may be making the store.
        let (version, ours, strange, all): (usize, u32, u32, u32) = self.connection.query_row(
            "SELECT (SELECT user_version FROM pragma_user_version),
                    (SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name IN ('model', 'clusters', 'segments')),
                    (SELECT count(*) FROM sqlite_schema WHERE type = 'trigger' OR (type = 'view' AND name NOT GLOB 'v_*')),
                    (SELECT count(*) FROM sqlite_schema)",
            [],
            |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?)),
        )?;
        if version == 0 && all > 0 && create && ours == 0 {
            return Err(folder::refused(&self.dir, folder::NO_CATALOGUE));
        }
        if (version > 0 && (ours == 0 || strange > 0)) || (version == 0 && all > 0) {
            let detail = "it is a database, but no catalogue of a store";
            return Err(Error::damaged(&self.dir.join(CATALOGUE), detail));
        }
        if version > 0 && version != FORMAT {
            return Err(schema::other(&self.dir, version));
        }
        if version > 0 {
            // Another process may be making the tables: one state of them.
            self.read(|| schema::require_tables(&self.connection))?;
        }
        if version == 0 && !create {
            return Err(Error::NoStore { store: self.dir.clone() });
        }
        self.connection.pragma_update(None, "foreign_keys", true)?;
        self.connection.pragma_update(None, "cache_size", -PAGE_CACHE_KIB)?;
        self.connection.pragma_update(None, "temp_store", "FILE")?;
        self.connection.set_prepared_statement_cache_capacity(64);
        if self.access == Access::Read {
            return Ok(());
        }
        self.keep_a_log()?;
        // Files are unlinked after the commit that forgets them: the commit must be on disk by then.
        self.connection.pragma_update(None, "synchronous", "FULL")?;
        if version == FORMAT {
            return Ok(());
        }
        self.transaction(schema::apply)
    }

    /// Brings the catalogue to write ahead. SQLite does not wait for those who do the same at this moment.
    fn keep_a_log(&self) -> Result<()> {
        let end = Instant::now() + self.wait;
        loop {
            match self.connection.pragma_update(None, "journal_mode", "WAL") {
                Err(error) if is_busy(&error) && Instant::now() < end => std::thread::sleep(Duration::from_millis(10)),
                done => return Ok(done?),
            }
        }
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

    /// Whether one may write.
    pub(super) fn is_writable(&self) -> bool {
        self.access == Access::Write
    }

    /// Fails, with what to do instead, if one may only read.
    pub(super) fn require_writable(&self) -> Result<()> {
        if self.is_writable() {
            return Ok(());
        }
        if self.is_full {
            return Err(Error::failed(format!("{}: {FULL}", shown(&self.dir)), self.room_help()));
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

    /// The same without waiting for the disk: for what says who works right now, and measurements. A failure of power
    /// may take it back, but nothing that [`Store::write`] wrote before or after it.
    pub(super) fn note<T>(&self, work: impl FnOnce(&Transaction<'_>) -> Result<T>) -> Result<T> {
        self.require_writable()?;
        let synchronous = |how: &str| self.connection.pragma_update(None, "synchronous", how);
        synchronous("NORMAL")?;
        let done = self.write(work);
        synchronous("FULL")?;
        done
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

fn is_busy(error: &rusqlite::Error) -> bool {
    matches!(error.sqlite_error_code(), Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked))
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
        assert_eq!(views, 11);
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
    fn only_notes_do_not_wait_for_the_disk() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), Duration::ZERO).unwrap();
        let waits = || store.connection().pragma_query_value(None, "synchronous", |r| r.get::<_, u32>(0)).unwrap();
        const NORMAL: u32 = 1;
        const FULL: u32 = 2;
        assert_eq!(store.note(|_| Ok(waits())).unwrap(), NORMAL);
        assert_eq!(store.write(|_| Ok(waits())).unwrap(), FULL);
        assert!(store.note::<()>(|_| Err(Error::Interrupted)).is_err());
        assert_eq!(waits(), FULL, "a note that fails, too");
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
