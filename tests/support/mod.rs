//! What tests share: a folder to work in, the program, scenes that may be absent.
#![allow(dead_code, reason = "each test file uses a part of it")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Mutex;
use std::time::Duration;

use clerestory::base::Progress;
use clerestory::base::memory::MemoryBudget;
use clerestory::stages::ingest;

/// `--memory` at its default.
pub const MEMORY: MemoryBudget = MemoryBudget { limit_bytes: 512 << 20 };

/// Collects warnings.
#[derive(Default)]
pub struct Heard(pub Mutex<Vec<String>>);

impl Progress for Heard {
    fn begin(&self, _phase: &str, _unit: &str, _total: Option<u64>) {}
    fn at(&self, _done: u64) {}
    fn warn(&self, message: &str) {
        self.0.lock().unwrap().push(message.to_owned());
    }
    fn interrupted(&self) -> bool {
        false
    }
}

impl Heard {
    /// All warnings, one a line.
    pub fn text(&self) -> String {
        self.0.lock().unwrap().join("\n")
    }
}

/// Options of an ingest at their defaults.
pub fn options(store: &Path, model: &Path) -> ingest::Options {
    ingest::Options {
        store: store.to_path_buf(),
        models: vec![model.to_path_buf()],
        units: ingest::Units::M,
        up: None,
        both_sides: true,
        materials: None,
        emit_both: false,
        max_cluster_patches: 64,
        contact_m: 0.01,
        least_contact_m: 0.05,
        snap_m: None,
        memory: MEMORY,
        fresh: false,
        wait: Duration::from_secs(1),
    }
}

/// Ingests; what was said, and the summary.
pub fn ingest(options: &ingest::Options) -> (String, clerestory::base::Result<ingest::Summary>) {
    let heard = Heard::default();
    let done = ingest::plan(options).and_then(|plan| ingest::execute(plan, &heard));
    (heard.text(), done)
}

/// A file of the shared scenes; `None`, said aloud, where they are absent.
pub fn shared(path: &str) -> Option<PathBuf> {
    let full = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(path);
    if full.exists() {
        return Some(full);
    }
    eprintln!("SKIPPED: ../shared/{path} is absent");
    None
}

/// Runs the program in a folder.
pub fn clerestory(dir: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_clerestory")).args(args).current_dir(dir).output().unwrap()
}
