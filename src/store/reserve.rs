//! A reserve of disk space in every store, so that `gc` can work on a full disk: forgetting rows needs a
//! little room in the catalogue's log before it gives any back.

use std::io::{Read, Seek, Write};
use std::path::Path;

use xxhash_rust::xxh3::xxh3_64_with_seed;

use super::files::{self, For};
use super::ownership::{self, Catalogue};

/// Name of the file.
pub(super) const RESERVE: &str = "reserve";
/// Its size: the shared index of SQLite's log (32 KiB) and the log of a batch.
const BYTES: u64 = 256 << 10;

/// What is in it. Not zeros, which some file systems do not store.
fn filling() -> Vec<u8> {
    (0..BYTES / 8).flat_map(|i| xxh3_64_with_seed(b"reserve", i).to_le_bytes()).collect()
}

/// Bytes of the file, if all of them are ours.
fn bytes_of_ours(file: &mut std::fs::File) -> Option<u64> {
    let mut bytes = Vec::new();
    file.take(BYTES + 1).read_to_end(&mut bytes).ok()?;
    filling().starts_with(&bytes).then_some(bytes.len() as u64)
}

/// Makes the reserve if it is not there. On a disk that is full there is none: no error. A file of that name which
/// is somebody else's stays as it is.
pub fn keep(dir: &Path) {
    let path = dir.join(RESERVE);
    let Ok(mut file) = files::open(&path, For::Making) else { return };
    if bytes_of_ours(&mut file).is_none_or(|bytes| bytes == BYTES) || file.rewind().is_err() {
        return;
    }
    if file.write_all(&filling()).is_err() {
        // Half a reserve would keep a full disk full.
        let _ = std::fs::remove_file(&path);
    }
}

/// Whether the whole reserve is there, and is ours.
pub(super) fn is_whole(dir: &Path) -> bool {
    files::open(&dir.join(RESERVE), For::Reading).is_ok_and(|mut file| bytes_of_ours(&mut file) == Some(BYTES))
}

/// Whether a file of that name is empty, or a reserve whose making may have been cut short.
pub(super) fn is_begun(dir: &Path) -> bool {
    files::open(&dir.join(RESERVE), For::Reading).is_ok_and(|mut file| bytes_of_ours(&mut file).is_some())
}

/// Gives the reserve of a store back to the disk. In any other folder, and where it is not ours, nothing happens.
pub fn release(dir: &Path) {
    if ownership::look(dir) == Catalogue::Ours && is_whole(dir) {
        // What can't be removed is no reserve.
        let _ = std::fs::remove_file(dir.join(RESERVE));
    }
}
