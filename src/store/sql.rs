//! SQLite's errors as ours.

use rusqlite::ErrorCode;

use super::Store;
use crate::base::Error;

/// File name of the catalogue within a store.
pub(super) const CATALOGUE: &str = "scene.sqlite";

impl From<rusqlite::Error> for Error {
    /// Paths are the catalogue's bare name until [`Store::named`] completes them.
    fn from(error: rusqlite::Error) -> Self {
        let path = std::path::Path::new(CATALOGUE);
        match error.sqlite_error_code() {
            Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => {
                Self::Busy { store: path.to_path_buf(), holder: String::new() }
            }
            Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => Self::damaged(path, error.to_string()),
            Some(ErrorCode::DiskFull) => Self::failed(
                format!("{CATALOGUE}: the disk is full"),
                "free some space, then run the same command again: it resumes",
            ),
            _ => match error {
                rusqlite::Error::FromSqlConversionFailure(..)
                | rusqlite::Error::IntegralValueOutOfRange(..)
                | rusqlite::Error::InvalidColumnType(..) => Self::damaged(path, error.to_string()),
                _ => Self::failed(
                    format!("{CATALOGUE}: {error}"),
                    "check that the disk has room and that you may write to the store",
                ),
            },
        }
    }
}

impl Store {
    /// Completes an error of the catalogue with the store's path and, if busy, the holder.
    pub(super) fn named(&self, error: Error) -> Error {
        match error {
            Error::Busy { holder, .. } if holder.is_empty() => {
                Error::Busy { store: self.dir().to_path_buf(), holder: self.holder() }
            }
            Error::Damaged { path, detail } if path.as_os_str() == CATALOGUE => {
                Error::Damaged { path: self.dir().join(CATALOGUE), detail }
            }
            other => other,
        }
    }
}
