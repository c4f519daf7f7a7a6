//! How a verb enters a store: opening it, taking the lock that its work needs, starting over.

use std::path::Path;
use std::time::Duration;

use crate::base::Result;
use crate::store::{ProcessGuard, RunLock, Stage, Store};

/// Opens a store; exit code 10 if there is none. `wait`: for a busy one.
pub fn open(dir: &Path, wait: Duration) -> Result<Store> {
    Store::open(dir, wait)
}

/// Takes the right to coordinate, for `verb`; waits, then exit code 11 names who has it.
pub fn coordinate<'s>(store: &'s Store, verb: &str) -> Result<RunLock<'s>> {
    RunLock::take(store, &named(store, verb))
}

/// Lists this process as working on the store with `verb`; the version it reads stays kept.
pub fn enter<'s>(store: &'s Store, verb: &str, version: Option<u64>) -> Result<ProcessGuard<'s>> {
    ProcessGuard::enter(store, &named(store, verb), version)
}

fn named(store: &Store, verb: &str) -> String {
    format!("clerestory {verb} {}", store.dir().display())
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
    version.map_or_else(|| store.newest_iteration_end(), Ok)
}
