//! Processes that a coordinator starts work under its lock and end when it is gone.

use std::os::unix::process::parent_id;
use std::sync::Once;
use std::time::Duration;

use super::Store;
use crate::base::Result;

/// How often a child looks whether its coordinator is still there.
const LOOK: Duration = Duration::from_millis(100);

/// Whether this process was started by the one that holds `run.lock`.
pub(super) fn is_parent(store: &Store) -> Result<bool> {
    let parent = parent_id();
    Ok(store.processes()?.iter().any(|p| p.holds_run_lock && p.pid == parent))
}

/// Ends this process soon after its coordinator, if it has one. Nothing is lost but the running
/// task, as with any kill.
pub(super) fn follow(store: &Store) -> Result<()> {
    static ONCE: Once = Once::new();
    let parent = parent_id();
    if is_parent(store)? {
        ONCE.call_once(|| {
            std::thread::spawn(move || {
                while parent_id() == parent {
                    std::thread::sleep(LOOK);
                }
                std::process::exit(1);
            });
        });
    }
    Ok(())
}

impl Store {
    /// Whether this process works for a coordinator of the store.
    pub fn is_coordinated(&self) -> Result<bool> {
        is_parent(self)
    }
}
