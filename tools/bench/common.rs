//! What benches share: how a figure is printed, and a solved store.

#![allow(dead_code, reason = "each bench uses a part of it")]

#[path = "../../tests/support/mod.rs"]
pub mod support;

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use clerestory::base::Result;
use clerestory::store::Store;

/// Measurements of which the best counts.
pub const PASSES: usize = 3;

/// A furnished room, with books.
const MODEL: &str = "data/office.obj";

/// Prints a figure.
pub fn print(scene: &str, name: &str, value: f64, unit: &str) {
    println!("{}", serde_json::json!({ "name": name, "value": value, "unit": unit, "scene": scene }));
}

/// Processor time of this thread, s: what others do beside it does not count.
pub fn thread_cpu_s() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` may be written to.
    let told = unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &raw mut time) };
    assert_eq!(told, 0, "the thread's clock");
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Result and processor time, s, of the fastest of some passes.
pub fn best<T>(mut pass: impl FnMut() -> Result<T>) -> Result<(T, f64)> {
    let mut best: Option<(T, f64)> = None;
    for _ in 0..PASSES {
        let begun_s = thread_cpu_s();
        let done = pass()?;
        let cpu_s = thread_cpu_s() - begun_s;
        if best.as_ref().is_none_or(|(_, least_s)| cpu_s < *least_s) {
            best = Some((done, cpu_s));
        }
    }
    Ok(best.expect("some passes"))
}

/// Works with a store that holds the office, solved at a quality.
pub fn with_office<T>(quality: &str, work: impl FnOnce(&Store) -> Result<T>) -> Result<T> {
    let dir = tempfile::tempdir().expect("a place for a store");
    let store = dir.path().join("bench.clr");
    let mut run = Command::new(env!("CARGO_BIN_EXE_clerestory"));
    run.arg("run").arg(Path::new(env!("CARGO_MANIFEST_DIR")).join(MODEL)).arg("--store").arg(&store);
    let ended = run.args(["--quality", quality, "--audit", "0", "-q"]).status().expect("the program starts");
    assert!(ended.success(), "the office was not solved: {ended}");
    work(&Store::open(&store, Duration::from_secs(1))?)
}
