//! Files of a store that may come from a stranger: opened without following links, without waiting,
//! and only where they are plain files.

use std::fs::{File, OpenOptions};
use std::io::ErrorKind;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use crate::base::{Error, Result};

/// Folder of the segment files within a store.
pub(super) const SEGMENTS: &str = "segments";

/// How to open a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum For {
    /// To read.
    Reading,
    /// To read and write.
    Writing,
    /// To read and write, made if missing.
    Making,
}

/// Opens a plain file. A link is not followed and a pipe is not waited for: both are damage.
pub(super) fn open(path: &Path, what_for: For) -> Result<File> {
    let file = try_open(path, what_for).map_err(|e| failure(path, &e))?;
    let meta = file.metadata().map_err(|e| Error::io(path, &e))?;
    if meta.is_file() { Ok(file) } else { Err(Error::damaged(path, "it is not a plain file")) }
}

/// Opens what is there, plain or not, at once.
pub(super) fn try_open(path: &Path, what_for: For) -> std::io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(what_for != For::Reading).create(what_for == For::Making);
    options.custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK).open(path)
}

fn failure(path: &Path, error: &std::io::Error) -> Error {
    match (error.kind(), error.raw_os_error()) {
        (_, Some(libc::ELOOP)) => Error::damaged(path, "it is a symbolic link, which is not followed"),
        (_, Some(libc::ENXIO)) => Error::damaged(path, "it is not a plain file"),
        (ErrorKind::IsADirectory, _) => Error::damaged(path, "it is a folder"),
        _ => Error::io(path, error),
    }
}

/// Whether an error says that one may not write.
pub(super) fn is_refusal(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem)
}

/// Whether a name in `segments/` is one that we give: `000012-update.seg`.
pub(super) fn is_segment_name(name: &str) -> bool {
    let Some((number, purpose)) = name.strip_suffix(".seg").and_then(|stem| stem.split_once('-')) else {
        return false;
    };
    let word = |text: &str, fits: fn(&u8) -> bool| !text.is_empty() && text.as_bytes().iter().all(fits);
    number.len() >= 6 && word(number, u8::is_ascii_digit) && word(purpose, u8::is_ascii_lowercase)
}

/// Where a segment file of the catalogue lies: in the store's own folder, under a name of our own.
pub(super) fn segment_path(dir: &Path, name: &str) -> Result<PathBuf> {
    let folder = dir.join(SEGMENTS);
    if !is_segment_name(name) {
        let detail = format!("the catalogue names a segment file {}, which is not ours", name.escape_debug());
        return Err(Error::damaged(&folder, detail));
    }
    match std::fs::symlink_metadata(&folder) {
        Ok(meta) if !meta.is_dir() => Err(Error::damaged(&folder, "it is not a folder of this store")),
        _ => Ok(folder.join(name)),
    }
}

/// A segment file, opened.
pub(super) fn open_segment(path: &Path, what_for: For) -> Result<File> {
    open(path, what_for).map_err(|error| match path.symlink_metadata() {
        Err(e) if e.kind() == ErrorKind::NotFound => Error::damaged(path, "the segment file is missing"),
        _ => error,
    })
}

/// Whether a path still leads to an open file.
pub(super) fn is_at(file: &File, path: &Path) -> Result<bool> {
    let open = file.metadata().map_err(|e| Error::io(path, &e))?;
    let there = std::fs::symlink_metadata(path);
    Ok(there.is_ok_and(|there| (there.dev(), there.ino()) == (open.dev(), open.ino())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segment_names_are_plain_and_of_our_own_pattern() {
        assert!(is_segment_name("000001-geometry.seg") && is_segment_name("1234567-update.seg"));
        for name in
            ["../../x", "/etc/passwd", "000001-a/b.seg", "000001-..seg", "000001-.seg", "1-a.seg", "", "notes.seg"]
        {
            assert!(!is_segment_name(name), "{name}");
        }
    }

    #[test]
    fn links_pipes_and_folders_are_damage_and_nobody_waits_for_a_pipe() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("plain"), b"x").unwrap();
        std::os::unix::fs::symlink(dir.path().join("plain"), dir.path().join("link")).unwrap();
        std::fs::create_dir(dir.path().join("folder")).unwrap();
        let made = std::process::Command::new("mkfifo").arg(dir.path().join("pipe")).status().unwrap();
        assert!(made.success());
        for what_for in [For::Reading, For::Writing, For::Making] {
            open(&dir.path().join("plain"), what_for).unwrap();
            for name in ["link", "folder", "pipe"] {
                let error = open(&dir.path().join(name), what_for).err().unwrap();
                assert_eq!(error.exit_code(), 12, "{name} for {what_for:?}: {error}");
            }
        }
    }
}
