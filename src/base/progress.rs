//! Progress: what a stage says while it works; drawn by `cli` alone.

use super::{Error, Result};

/// Where a stage reports to. Implementations must be cheap to call often.
pub trait Progress: Sync {
    /// A new phase begins: `phase` as a verb ("gather"), what is counted ("links"), how many if known.
    fn begin(&self, phase: &str, unit: &str, total: Option<u64>);
    /// `done` of the phase's total so far.
    fn at(&self, done: u64);
    /// Something the user should know but need not act on at once; also collected for `--json`.
    fn warn(&self, message: &str);
    /// Whether the user asked to stop: the stage then returns [`Error::Interrupted`] at the next safe point.
    fn interrupted(&self) -> bool;

    /// A safe point: fails if the user asked to stop.
    fn go_on(&self) -> Result<()> {
        if self.interrupted() { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// A safe point with `done` of the phase's total behind it.
    fn step(&self, done: u64) -> Result<()> {
        self.at(done);
        self.go_on()
    }
}

/// Says nothing, never interrupts.
pub struct Quiet;

impl Progress for Quiet {
    fn begin(&self, _phase: &str, _unit: &str, _total: Option<u64>) {}
    fn at(&self, _done: u64) {}
    fn warn(&self, _message: &str) {}
    fn interrupted(&self) -> bool {
        false
    }
}
