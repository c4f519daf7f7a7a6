//! How a verb enters a store: opening it, taking the lock that its work needs, starting over.

use std::path::Path;
use std::time::Duration;

use crate::base::Result;
use crate::base::text::for_shell;
pub use crate::store::Store;
use crate::store::{ProcessGuard, RunLock, Snapshot, Stage, reserve};

/// Opens a store; exit code 10 if there is none. `wait`: for a busy one.
pub fn open(dir: &Path, wait: Duration) -> Result<Store> {
    Store::open(dir, wait)
}

/// Opens a store to give room back to the disk: its reserve at once, since opening it needs a little.
pub fn open_to_make_room(dir: &Path, wait: Duration) -> Result<Store> {
    reserve::release(dir);
    Store::open(dir, wait)
}

/// Takes the right to coordinate, for `verb`; waits, then exit code 11 names who has it. Rows that are not what
/// was written are damage.
pub fn coordinate<'s>(store: &'s Store, verb: &str) -> Result<RunLock<'s>> {
    let lock = RunLock::take(store, &named(store, verb))?;
    trust_rows(store)?;
    Ok(lock)
}

/// Lists this process as working on the store with `verb`; the version it reads stays kept. Rows that are not what
/// was written are damage.
pub fn enter<'s>(store: &'s Store, verb: &str, version: Option<u64>) -> Result<ProcessGuard<'s>> {
    let process = ProcessGuard::enter(store, &named(store, verb), version)?;
    trust_rows(store)?;
    Ok(process)
}

/// Verifies all rows, once for a coordinator and all its children.
pub fn trust_rows(store: &Store) -> Result<()> {
    if store.is_coordinated()? { Ok(()) } else { store.require_sealed_rows() }
}

fn named(store: &Store, verb: &str) -> String {
    format!("clerestory {verb} {}", for_shell(store.dir()))
}

/// Drops the results of visibility and of what follows from it.
pub fn forget_visibility(store: &Store) -> Result<()> {
    store.drop_stage(Stage::Visibility)
}

/// Drops the groups.
pub fn forget_partition(store: &Store) -> Result<()> {
    store.drop_stage(Stage::Partition)
}

/// The version to read: that asked for, or the newest end of an iteration.
pub fn version_to_read(store: &Store, version: Option<u64>) -> Result<u64> {
    let Some(version) = version else { return store.newest_iteration_end() };
    Snapshot::at(store, version).map(|snapshot| snapshot.version())
}
