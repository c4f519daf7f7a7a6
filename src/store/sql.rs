//! SQLite's errors as ours.

use rusqlite::ErrorCode;

use super::Store;
use crate::base::Error;
use crate::base::text::{for_shell, shown};

/// File name of the catalogue within a store.
pub(super) const CATALOGUE: &str = "scene.sqlite";

/// What is said where nothing more can be written.
pub(super) const FULL: &str = "the disk is full";

/// Whether SQLite failed because a catalogue lacks what our statements name.
fn is_of_another_shape(error: &rusqlite::Error) -> bool {
    let said = error.to_string();
    ["no such table", "no such column", "has no column named"].iter().any(|what| said.contains(what))
}

/// Whether nothing could be written because the disk is full.
pub(super) fn is_full(error: &Error) -> bool {
    matches!(error, Error::Failed { message, .. } if message.ends_with(FULL))
}

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
                format!("{CATALOGUE}: {FULL}"),
                "free some space, then run the same command again: it resumes",
            ),
            _ if is_of_another_shape(&error) => Self::damaged(path, error.to_string()),
            _ => match error {
                rusqlite::Error::QueryReturnedNoRows => Self::damaged(path, "a row that must be there is missing"),
                rusqlite::Error::FromSqlConversionFailure(..)
                | rusqlite::Error::IntegralValueOutOfRange(..)
                | rusqlite::Error::InvalidColumnType(..)
                // Numbers that we write come from what was read.
                | rusqlite::Error::ToSqlConversionFailure(..) => Self::damaged(path, error.to_string()),
                _ => Self::failed(
                    format!("{CATALOGUE}: {error}"),
                    "check that the disk has room and that you may write to the store",
                ),
            },
        }
    }
}

impl Store {
    pub(super) fn room_help(&self) -> String {
        format!(
            "free some space (`clerestory gc {}` needs none itself), then run the same command again: it resumes",
            for_shell(self.dir())
        )
    }

    /// Completes an error of the catalogue with the store's path and, if busy, the holder.
    pub fn named(&self, error: Error) -> Error {
        match error {
            Error::Busy { holder, .. } if holder.is_empty() => {
                Error::Busy { store: self.dir().to_path_buf(), holder: self.holder() }
            }
            Error::Damaged { path, detail, help } if path.as_os_str() == CATALOGUE => {
                Error::Damaged { path: self.dir().join(CATALOGUE), detail, help }
            }
            Error::Failed { message, help } if message.starts_with(CATALOGUE) => {
                let help = if message.ends_with(FULL) { self.room_help() } else { help };
                Error::Failed { message: format!("{}/{message}", shown(self.dir())), help }
            }
            other => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use rusqlite::Connection;

    use super::*;

    #[test]
    fn a_catalogue_that_lacks_what_our_statements_name_or_holds_numbers_out_of_range_is_damage() {
        let catalogue = Connection::open_in_memory().unwrap();
        catalogue.execute_batch("CREATE TABLE numbers (n INTEGER); INSERT INTO numbers VALUES (-1)").unwrap();
        let code = |error: rusqlite::Error| Error::from(error).exit_code();
        for sql in ["SELECT n FROM words", "SELECT word FROM numbers", "INSERT INTO numbers (word) VALUES (1)"] {
            assert_eq!(code(catalogue.prepare(sql).err().unwrap()), 12, "{sql}");
        }
        let read = |sql: &str| catalogue.query_row(sql, [], |row| row.get::<_, u32>(0)).err().unwrap();
        assert_eq!(code(read("SELECT n FROM numbers")), 12);
        assert_eq!(code(read("SELECT n FROM numbers WHERE n > 0")), 12, "a row that must be there");
        assert_eq!(code(catalogue.execute("INSERT INTO numbers VALUES (?1)", [u64::MAX]).err().unwrap()), 12);
    }
}
