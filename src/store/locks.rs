//! Lock files, kept by the kernel: the dead hold none.

use std::fs::{File, TryLockError};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::connection::{Access, unwritable};
use super::files::{self, For};
use super::sql::CATALOGUE;
use super::{ProcessGuard, Store, coordinator};
use crate::base::{Error, Result};

/// One coordinator at a time: run, ingest, visibility, partition.
pub(super) const RUN: &str = "run.lock";
/// Held for the moment of publishing or unlinking.
pub(super) const PUBLISH: &str = "publish.lock";
/// Shared by everyone who maps segments; exclusive for truncating.
pub(super) const READERS: &str = "readers.lock";

/// How soon a held lock is tried again at first, and how often in the long run: most are held for a millisecond.
const FIRST_RETRY: Duration = Duration::from_micros(200);
const RETRY: Duration = Duration::from_millis(20);

/// What SQLite is to do while others write: try again, sooner than it does by itself, for as long as `wait`.
pub(super) fn patience(wait: Duration) -> impl FnMut(i32) -> bool + Send + 'static {
    let (mut since, mut pause) = (Instant::now(), FIRST_RETRY);
    move |tries| {
        if tries == 0 {
            (since, pause) = (Instant::now(), FIRST_RETRY);
        }
        let goes_on = since.elapsed() < wait;
        if goes_on {
            std::thread::sleep(pause);
            pause = (2 * pause).min(RETRY);
        }
        goes_on
    }
}

/// Opens a lock file, made if missing.
pub(super) fn open(path: &Path) -> Result<File> {
    files::open(path, For::Making)
}

/// Whether somebody has opened the store of a folder before.
pub(super) fn has_been_joined(dir: &Path) -> bool {
    dir.join(READERS).symlink_metadata().is_ok()
}

/// What came of joining those who have a store open.
pub(super) enum Joined {
    /// One may do so much, and holds the lock, unless one may only read and there is none.
    As(Access, Option<Arc<File>>),
    /// The folder was taken away meanwhile: look again.
    Gone,
}

/// Takes `readers.lock`, shared, for as long as the file lives. Where one may not write (`create`: that is an
/// error), no lock file is made, and one that is there is locked all the same.
pub(super) fn join(dir: &Path, create: bool) -> Result<Joined> {
    let path = dir.join(READERS);
    let refused = |what_for| files::try_open(&path, what_for).is_err_and(|error| files::is_refusal(&error));
    let (access, file) = match files::open(&path, For::Making) {
        Ok(file) => (Access::Write, file),
        Err(_) if !dir.exists() => return Ok(Joined::Gone),
        Err(Error::Failed { .. }) if !create => match files::open(&path, For::Reading) {
            Ok(file) => (Access::Read, file),
            // A lock that one may not even read binds nobody here.
            Err(_) if path.symlink_metadata().is_err() || refused(For::Reading) => {
                return Ok(Joined::As(Access::Read, None));
            }
            Err(error) => return Err(error),
        },
        Err(_) if create && refused(For::Making) && dir.join(CATALOGUE).exists() => return Err(unwritable(dir)),
        Err(error) => return Err(error),
    };
    file.lock_shared().map_err(|e| Error::io(&path, &e))?;
    Ok(if files::is_at(&file, &path)? { Joined::As(access, Some(Arc::new(file))) } else { Joined::Gone })
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
    let mut patience = patience(wait);
    for tries in 0.. {
        if try_exclusive(file, path)? {
            return Ok(true);
        }
        if !patience(tries) {
            break;
        }
    }
    Ok(false)
}

/// Whether nobody holds the lock of a file. A missing file is held by nobody.
pub(super) fn is_free(path: &Path) -> Result<bool> {
    match path.symlink_metadata() {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(true),
        _ => try_exclusive(&files::open(path, For::Reading)?, path),
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
        store.require_writable()?;
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
        store.require_writable()?;
        let path = store.dir().join(PUBLISH);
        let file = open(&path)?;
        if exclusive_within(&file, &path, store.wait())? {
            Ok(Self { _file: file })
        } else {
            Err(Error::Busy { store: store.dir().to_path_buf(), holder: store.holder() })
        }
    }
}
