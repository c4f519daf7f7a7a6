//! Errors: what happened with path, number and limit; then the one thing to try; and an exit code.
//!
//! Only `cli` prints them, as two lines on stderr: `error: ...` and `help: ...`.

use std::fmt;
use std::path::{Path, PathBuf};

use super::text::{for_shell, shown};

/// The result of everything that can fail outside our control.
pub type Result<T> = std::result::Result<T, Error>;

/// Why a command could not do its work. One variant per exit code of `help exit-codes`.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// 1: input or machine; the message names file and line where there is one.
    Failed {
        /// What happened.
        message: String,
        /// What to do.
        help: String,
    },
    /// 2: the command line asks for something that cannot be.
    Usage {
        /// What is wrong.
        message: String,
        /// What to write instead.
        help: String,
    },
    /// 3: finished, but not converged or with failed groups; the summary is printed all the same.
    NotConverged {
        /// What is missing.
        message: String,
        /// What to do.
        help: String,
    },
    /// 10: no store there.
    NoStore {
        /// Where one was looked for.
        store: PathBuf,
    },
    /// 11: somebody else holds the store.
    Busy {
        /// Store folder.
        store: PathBuf,
        /// Pid, host, command, since when.
        holder: String,
    },
    /// 12: damaged, or written by another version.
    Damaged {
        /// File or table.
        path: PathBuf,
        /// What is wrong with it.
        detail: String,
        /// What to do, where it is not to see all damages.
        help: Option<String>,
    },
    /// 13: an earlier stage is missing or out of date.
    StageMissing {
        /// Which one and why.
        message: String,
        /// The command that makes it.
        help: String,
    },
    /// 14: would not fit in memory or on disk.
    TooLarge {
        /// What needs how much, over which limit.
        message: String,
        /// The flag and value that would do.
        help: String,
    },
    /// 130: interrupted; the same command resumes.
    Interrupted,
    /// 0: whoever read what is written has seen enough; nobody is left to tell.
    ReaderGone,
}

impl Error {
    /// An input or machine failure.
    #[must_use]
    pub fn failed(message: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Failed { message: message.into(), help: help.into() }
    }

    /// An I/O failure on a path. A pipe that breaks is our output, whose reader has seen enough.
    #[must_use]
    pub fn io(path: &Path, source: &std::io::Error) -> Self {
        if source.kind() == std::io::ErrorKind::BrokenPipe {
            return Self::ReaderGone;
        }
        Self::failed(
            format!("{}: {source}", shown(path)),
            "check that the path exists, that you may use it, and that the disk has room",
        )
    }

    /// Damage found in a store.
    #[must_use]
    pub fn damaged(path: &Path, detail: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_path_buf(), detail: detail.into(), help: None }
    }

    /// The same error with another help, if it is damage.
    #[must_use]
    pub fn with_help_for_damage(self, text: impl FnOnce() -> String) -> Self {
        match self {
            Self::Damaged { path, detail, help } => {
                Self::Damaged { path, detail, help: Some(help.unwrap_or_else(text)) }
            }
            other => other,
        }
    }

    /// One imperative sentence that, followed literally, removes the cause.
    #[must_use]
    pub fn remedy(&self) -> String {
        match self {
            Self::Failed { help, .. }
            | Self::Usage { help, .. }
            | Self::NotConverged { help, .. }
            | Self::StageMissing { help, .. }
            | Self::TooLarge { help, .. } => help.clone(),
            Self::NoStore { store } => {
                format!("make one with `clerestory ingest {} MODEL.obj`, or name another store", for_shell(store))
            }
            Self::Busy { .. } => "wait for it to end, or give `--wait 600` to wait ten minutes".to_owned(),
            Self::Damaged { path, help, .. } => help.clone().unwrap_or_else(|| {
                format!("run `clerestory check {}`: it names all damages, and what to do", for_shell(store_of(path)))
            }),
            Self::Interrupted => "run the same command again: it resumes".to_owned(),
            Self::ReaderGone => "nothing is left to do".to_owned(),
        }
    }

    /// Stable exit status, listed in `clerestory help exit-codes`.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Failed { .. } => 1,
            Self::Usage { .. } => 2,
            Self::NotConverged { .. } => 3,
            Self::NoStore { .. } => 10,
            Self::Busy { .. } => 11,
            Self::Damaged { .. } => 12,
            Self::StageMissing { .. } => 13,
            Self::TooLarge { .. } => 14,
            Self::Interrupted => 130,
            Self::ReaderGone => 0,
        }
    }
}

/// The store that a file of it lies in; a store's folder itself.
fn store_of(path: &Path) -> &Path {
    let within = |path: &Path, name: &str| path.file_name().is_some_and(|n| n == name);
    let parent = path.parent().unwrap_or(path);
    let folder = match path.extension().and_then(|e| e.to_str()) {
        Some("seg") if within(parent, "segments") => parent.parent().unwrap_or(parent),
        Some("sqlite" | "lock") => parent,
        _ if within(path, "segments") => parent,
        _ => path,
    };
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Failed { message, .. }
            | Self::Usage { message, .. }
            | Self::NotConverged { message, .. }
            | Self::StageMissing { message, .. }
            | Self::TooLarge { message, .. } => f.write_str(message),
            Self::NoStore { store } => write!(f, "{}: no store here", shown(store)),
            Self::Busy { store, holder } => write!(f, "{}: busy, held by {holder}", shown(store)),
            Self::Damaged { path, detail, .. } => write!(f, "{}: damaged: {detail}", shown(path)),
            Self::Interrupted => f.write_str("interrupted"),
            Self::ReaderGone => f.write_str("whoever read the output has gone away"),
        }
    }
}

impl std::error::Error for Error {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damage_of_any_file_of_a_store_names_the_command_for_that_store() {
        for file in ["segments/000001-rays.seg", "segments", "scene.sqlite", "readers.lock", ""] {
            let path = Path::new("my house.clr").join(file);
            let path = if file.is_empty() { Path::new("my house.clr") } else { &path };
            let help = Error::damaged(path, "cut off").remedy();
            assert!(help.contains("`clerestory check 'my house.clr'`"), "{file}: {help}");
        }
    }
}
