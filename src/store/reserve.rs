//! A reserve of disk space in every store, so that `gc` can work on a full disk: forgetting rows needs a
//! little room in the catalogue's log before it gives any back.

use std::io::Write;
use std::path::Path;

use xxhash_rust::xxh3::xxh3_64_with_seed;

use super::files::{self, For};

/// Name of the file.
pub(super) const RESERVE: &str = "reserve";
/// Its size: the shared index of SQLite's log (32 KiB) and the log of a batch.
const BYTES: u64 = 256 << 10;

/// Makes the reserve if it is not there. On a disk that is full there is none: no error.
pub fn keep(dir: &Path) {
    let path = dir.join(RESERVE);
    let Ok(file) = files::open(&path, For::Making) else { return };
    if file.metadata().is_ok_and(|meta| meta.len() >= BYTES) {
        return;
    }
    // Not zeros, which some file systems do not store.
    let words: Vec<u8> = (0..BYTES / 8).flat_map(|i| xxh3_64_with_seed(b"reserve", i).to_le_bytes()).collect();
    if (&file).write_all(&words).is_err() {
        // Half a reserve would keep a full disk full.
        let _ = std::fs::remove_file(&path);
    }
}

/// Gives the reserve back to the disk.
pub fn release(dir: &Path) {
    let path = dir.join(RESERVE);
    // Only a plain file of ours; what can't be removed is no reserve.
    if files::open(&path, For::Writing).is_ok() {
        let _ = std::fs::remove_file(&path);
    }
}
