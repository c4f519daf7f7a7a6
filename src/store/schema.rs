//! The catalogue's format, and what is said of others.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

use rusqlite::{Connection, Transaction};

use super::sql::CATALOGUE;
use super::{connection, seals};
use crate::base::text::{for_shell, shown};
use crate::base::{Error, Result};

const SCHEMA: &str = include_str!("../../schema/store.sql");
/// Today's format, the catalogue's `user_version`: 1 and 2 held patches that walls stood across, 3 one value an element,
/// 4 lamps of rows without their rounds, 5 ray nodes of two children and no audits, 6 no seams, 7 trees that nobody read.
pub(super) const FORMAT: usize = 8;
const VIEWS: &str = include_str!("../../schema/views.sql");

/// Where SQLite keeps `user_version` in a database file.
const USER_VERSION_AT: usize = 60;

/// Makes the tables of an empty catalogue, within a transaction.
pub(super) fn apply(tx: &Transaction<'_>) -> Result<()> {
    let version: usize = tx.pragma_query_value(None, "user_version", |r| r.get(0))?;
    if version == FORMAT {
        // Another process was faster.
        return Ok(());
    }
    tx.execute_batch(SCHEMA)?;
    tx.execute_batch(VIEWS)?;
    seals::renew(tx)?;
    tx.pragma_update(None, "user_version", FORMAT)?;
    Ok(())
}

/// Tables as a catalogue defines them, comments and white space left out: SQLite keeps the text as it was typed.
fn tables(connection: &Connection) -> Result<BTreeMap<String, String>> {
    let sql = "SELECT name, sql FROM sqlite_schema WHERE type = 'table' AND name NOT GLOB 'sqlite_*'";
    let mut query = connection.prepare(sql)?;
    let rows = query.query_map([], |row| Ok((row.get(0)?, bare(&row.get::<_, String>(1)?))))?;
    Ok(rows.collect::<std::result::Result<_, _>>()?)
}

fn bare(sql: &str) -> String {
    let code = sql.lines().flat_map(|line| line.split("--").next()).flat_map(str::split_whitespace);
    code.collect::<Vec<_>>().join(" ")
}

/// The same of our tables: read from the text that makes them, which takes less than making them.
fn our_tables() -> BTreeMap<String, String> {
    let named = |statement: &str| {
        let name = statement.trim().strip_prefix("CREATE TABLE ")?.split([' ', '(']).next()?;
        Some((name.to_owned(), statement.trim().to_owned()))
    };
    bare(SCHEMA).split(';').filter_map(named).collect()
}

/// Fails with damage unless a catalogue has our tables, each as we define it. Tables of others do no harm.
pub(super) fn require_tables(connection: &Connection) -> Result<()> {
    let mut wrong = Vec::new();
    let found = tables(connection)?;
    for (name, definition) in our_tables() {
        match found.get(&name) {
            None => wrong.push(format!("table {name} is missing")),
            Some(own) if *own != definition => wrong.push(format!("table {name} has other columns than ours")),
            Some(_) => {}
        }
    }
    if wrong.is_empty() { Ok(()) } else { Err(Error::damaged(Path::new(CATALOGUE), wrong.join(", "))) }
}

/// The error of a store that another version of the program made: nothing of it is touched.
pub(super) fn other(dir: &Path, version: usize) -> Error {
    let (age, name) = (if version > FORMAT { "a newer" } else { "an older" }, for_shell(dir));
    let detail = format!("its format is {version}, this program reads {FORMAT}: it was made by {age} version");
    Error::damaged(&dir.join(CATALOGUE), detail).with_help_for_damage(|| match version > FORMAT {
        true => format!("use the newer version of clerestory that made {name}, or name another store"),
        false => format!(
            "ingest the model into another store, or here with `--fresh`; or use the version of clerestory that made \
             {name}"
        ),
    })
}

/// Whether a catalogue says that a newer version made it, damaged or not. The number stands in the file's first
/// page, and may be newer in its log.
pub(super) fn is_newer(dir: &Path) -> bool {
    let path = dir.join(CATALOGUE);
    if !path.symlink_metadata().is_ok_and(|meta| meta.is_file()) {
        return false;
    }
    let asked = || -> Option<usize> {
        connection::to_read(&path, dir).ok()?.pragma_query_value(None, "user_version", |row| row.get(0)).ok()
    };
    let written = || {
        let mut page = [0; 64];
        File::open(&path).ok()?.read_exact_at(&mut page, 0).ok()?;
        let number = page[USER_VERSION_AT..].first_chunk().map(|bytes| u32::from_be_bytes(*bytes) as usize);
        number.filter(|_| page.starts_with(b"SQLite format 3\0"))
    };
    asked().or_else(written).is_some_and(|version| version > FORMAT)
}

/// Completes an error of opening: its path, and what to do where not even `check` can read the catalogue.
pub(super) fn complete(error: Error, dir: &Path) -> Error {
    let name = for_shell(dir);
    let path = dir.join(CATALOGUE);
    let error = match error {
        Error::Damaged { path: bare, detail, help } if bare.as_os_str() == CATALOGUE => {
            Error::Damaged { path, detail, help }
        }
        Error::Failed { message, help } if message.starts_with(CATALOGUE) => {
            Error::Failed { message: format!("{}/{message}", shown(dir)), help }
        }
        Error::Busy { holder, .. } if holder.is_empty() => {
            Error::Busy { store: dir.to_path_buf(), holder: "a process that writes to its catalogue".to_owned() }
        }
        other => other,
    };
    error.with_help_for_damage(|| {
        format!("set it aside with `mv {name} {name}.damaged`, then run the command that made it again")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_read_from_the_text_as_the_catalogue_keeps_them() {
        let made = Connection::open_in_memory().unwrap();
        made.execute_batch(SCHEMA).unwrap();
        assert_eq!(our_tables(), tables(&made).unwrap());
        assert!(our_tables().len() > 20);
    }
}
