//! Lock files, kept by the kernel: the dead hold none.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::Path;
use std::time::{Duration, Instant};

use super::{ProcessGuard, Store, coordinator};
use crate::base::{Error, Result};

/// One coordinator at a time: run, ingest, visibility, partition.
pub(super) const RUN: &str = "run.lock";
/// Held for the moment of publishing or unlinking.
pub(super) const PUBLISH: &str = "publish.lock";
/// Shared by everyone who maps segments; exclusive for truncating.
pub(super) const READERS: &str = "readers.lock";

/// How often a held lock is tried again.
const RETRY: Duration = Duration::from_millis(20);

/// Opens a lock file, made if missing.
pub(super) fn open(path: &Path) -> Result<File> {
    OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).map_err(|e| Error::io(path, &e))
}

/// Locks exclusively if free; says whether it did.
pub(super) fn try_exclusive(file: &File, path: &Path) -> Result<bool> {
    match file.try_lock() {
        Ok(()) => Ok(true),
        Err(TryLockError::WouldBlock) => Ok(false),
        Err(TryLockError::Error(e)) => Err(Error::io(path, &e)),
    }
}

/// Locks exclusively, waiting up to `wait`; says whether it did.
pub(super) fn exclusive_within(file: &File, path: &Path, wait: Duration) -> Result<bool> {
    let end = Instant::now() + wait;
    loop {
        if try_exclusive(file, path)? {
            return Ok(true);
        }
        if Instant::now() >= end {
            return Ok(false);
        }
        std::thread::sleep(RETRY);
    }
}

/// Whether nobody holds the lock of a file. A missing file is held by nobody.
pub(super) fn is_free(path: &Path) -> Result<bool> {
    match File::open(path) {
        Ok(file) => try_exclusive(&file, path),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(true),
        Err(e) => Err(Error::io(path, &e)),
    }
}

/// The right to coordinate a store: one process at a time. A coordinator's children work under its
/// lock.
pub struct RunLock<'s> {
    _file: Option<File>,
    _process: ProcessGuard<'s>,
}

impl<'s> RunLock<'s> {
    /// Takes `run.lock` for `command` (as a person would type it), waiting as long as the store was
    /// opened with; then names who holds it.
    pub fn take(store: &'s Store, command: &str) -> Result<Self> {
        let path = store.dir().join(RUN);
        let file = open(&path)?;
        if !try_exclusive(&file, &path)? && coordinator::is_parent(store)? {
            coordinator::follow(store)?;
            let process = ProcessGuard::enter(store, command, None)?;
            return Ok(Self { _file: None, _process: process });
        }
        if !exclusive_within(&file, &path, store.wait())? {
            return Err(Error::Busy { store: store.dir().to_path_buf(), holder: store.holder() });
        }
        let process = ProcessGuard::enter_with_lock(store, command)?;
        Ok(Self { _file: Some(file), _process: process })
    }
}

/// Held for the moment of publishing.
pub(super) struct PublishLock {
    _file: File,
}

impl PublishLock {
    pub(super) fn take(store: &Store) -> Result<Self> {
        let path = store.dir().join(PUBLISH);
        let file = open(&path)?;
        if exclusive_within(&file, &path, store.wait())? {
            Ok(Self { _file: file })
        } else {
            Err(Error::Busy { store: store.dir().to_path_buf(), holder: store.holder() })
        }
    }
}
