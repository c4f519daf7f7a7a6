//! Connections to the catalogue: to work on it, or only to read where one may not write.

use std::fmt::Write;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use rusqlite::config::DbConfig;
use rusqlite::{Connection, ErrorCode, OpenFlags};

use super::files::{self, For};
use crate::base::text::{for_shell, shown};
use crate::base::{Error, Result};

/// What one may do with a store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    /// Everything.
    Write,
    /// Read: somebody else's folder, or a read-only mount.
    Read,
}

/// Whether SQLite failed because one may only read.
pub(super) fn is_refusal(error: &rusqlite::Error) -> bool {
    use ErrorCode::{CannotOpen, PermissionDenied, ReadOnly};
    matches!(error.sqlite_error_code(), Some(ReadOnly | CannotOpen | PermissionDenied))
}

/// Whether SQLite failed because the disk is full: also where it could not make the index of its log.
pub(super) fn is_without_room(error: &rusqlite::Error) -> bool {
    use rusqlite::ffi::{
        SQLITE_FULL, SQLITE_IOERR_SHMMAP, SQLITE_IOERR_SHMOPEN, SQLITE_IOERR_SHMSIZE, SQLITE_IOERR_WRITE,
    };
    let codes = [SQLITE_FULL, SQLITE_IOERR_SHMMAP, SQLITE_IOERR_SHMOPEN, SQLITE_IOERR_SHMSIZE, SQLITE_IOERR_WRITE];
    error.sqlite_error().is_some_and(|error| codes.contains(&error.extended_code))
}

/// Opens a catalogue to work on it.
pub(super) fn to_write(path: &Path, create: bool) -> rusqlite::Result<Connection> {
    let mut flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    flags.set(OpenFlags::SQLITE_OPEN_CREATE, create);
    distrust(Connection::open_with_flags(path, flags)?)
}

/// What a catalogue brings along is data: it makes nothing run.
fn distrust(connection: Connection) -> rusqlite::Result<Connection> {
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
    // A plan holds for all values: else a statement is compiled anew whenever it is given others.
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_QPSG, true)?;
    Ok(connection)
}

/// Opens a catalogue without writing anything, not even beside it.
///
/// Where a log lies beside it, it is read with the catalogue. Without one the catalogue is all there is, and is
/// read as a file that nobody changes.
pub(super) fn to_read(path: &Path, dir: &Path) -> Result<Connection> {
    let beside = |ending: &str| {
        let mut name = path.as_os_str().to_owned();
        name.push(ending);
        std::fs::metadata(PathBuf::from(name)).ok().map(|meta| meta.len())
    };
    let log = beside("-wal").unwrap_or(0);
    if beside("-shm").is_some() && beside("-wal").is_some() {
        match open_by_uri(path, "mode=ro&readonly_shm=1") {
            Ok(connection) => return Ok(connection),
            Err(error) if log > 0 && is_refusal(&error) => return Err(unreadable_log(dir)),
            Err(error) if log > 0 => return Err(error.into()),
            Err(_) => {}
        }
    }
    if log > 0 {
        return Err(unreadable_log(dir));
    }
    Ok(open_by_uri(path, "immutable=1")?)
}

fn open_by_uri(path: &Path, how: &str) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_URI;
    let connection = distrust(Connection::open_with_flags(format!("file:{}?{how}", encoded(path)), flags)?)?;
    // Nothing is read before this.
    connection.query_row("SELECT count(*) FROM sqlite_schema", [], |_| Ok(()))?;
    Ok(connection)
}

/// A path as part of a URI.
fn encoded(path: &Path) -> String {
    let mut out = String::new();
    for &byte in path.as_os_str().as_bytes() {
        match byte {
            b'/' | b'.' | b'-' | b'_' => out.push(char::from(byte)),
            _ if byte.is_ascii_alphanumeric() => out.push(char::from(byte)),
            _ => write!(out, "%{byte:02X}").expect("a string takes all"),
        }
    }
    out
}

fn unreadable_log(dir: &Path) -> Error {
    let message = format!("{}: its last changes lie in a log that only who may write can read", shown(dir));
    Error::failed(message, copy_help(dir))
}

/// What is said to who may not write.
pub(super) fn unwritable(dir: &Path) -> Error {
    Error::failed(format!("{}: you may read this store, but not write to it", shown(dir)), copy_help(dir))
}

fn copy_help(dir: &Path) -> String {
    let names = std::iter::once("copy.clr".to_owned()).chain((2..).map(|number: u32| format!("copy-{number}.clr")));
    let free = |name: &String| Path::new(name).symlink_metadata().is_err();
    let copy = names.into_iter().find(free).expect("numbers do not end");
    format!("work on a copy: `cp -r {} {copy} && chmod -R u+w {copy}`", for_shell(dir))
}

/// Whether a catalogue may not even be read. Only where it could not be opened: closing a file takes the locks of
/// all connections of this process from it.
pub(super) fn is_forbidden(path: &Path) -> bool {
    files::try_open(path, For::Reading).is_err_and(|error| files::is_refusal(&error))
}

/// What is said where one may not even look.
pub(super) fn forbidden(path: &Path) -> Error {
    Error::failed(
        format!("{}: permission denied: you may not read this store", shown(path)),
        "ask its owner for permission to read it, or name another store",
    )
}
