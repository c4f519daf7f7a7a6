//! Who works on the store: pid, host, command, since when.

use rusqlite::{OptionalExtension, params};
use serde::Serialize;

use super::Store;
use super::sql::is_full;
use crate::base::Result;

/// A process that works on the store.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProcessRow {
    /// Its number.
    pub pid: u32,
    /// Its machine.
    pub host: String,
    /// As a person would type it.
    pub command: String,
    /// Local ISO time.
    pub since: String,
    /// Whether it coordinates (holds `run.lock`).
    pub holds_run_lock: bool,
}

/// Lists this process in the catalogue for as long as it lives.
pub struct ProcessGuard<'s> {
    store: &'s Store,
    /// `None` in a store that one may only read.
    id: Option<i64>,
}

fn host() -> String {
    std::fs::read_to_string("/proc/sys/kernel/hostname")
        .map_or_else(|_| "localhost".to_owned(), |h| h.trim().to_owned())
}

/// When a process of this machine started, in kernel ticks since boot; `None` if it is gone.
fn started(pid: u32) -> Option<i64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The command, in parentheses, may hold spaces; field 22 is the 20th behind it.
    stat.rsplit_once(')')?.1.split_whitespace().nth(19)?.parse().ok()
}

impl<'s> ProcessGuard<'s> {
    /// Lists this process; `reads_version` stays kept by gc as long as it lives. Who reads a store that one may
    /// only read, or that lies on a full disk, is not listed.
    pub fn enter(store: &'s Store, command: &str, reads_version: Option<u64>) -> Result<Self> {
        if reads_version.is_some() && !store.is_writable() {
            return Ok(Self { store, id: None });
        }
        match Self::insert(store, command, reads_version, false) {
            // Reading needs no room.
            Err(error) if reads_version.is_some() && is_full(&error) => Ok(Self { store, id: None }),
            entered => entered,
        }
    }

    /// Lists this process as the holder of `run.lock`.
    pub(super) fn enter_with_lock(store: &'s Store, command: &str) -> Result<Self> {
        Self::insert(store, command, None, true)
    }

    fn insert(store: &'s Store, command: &str, reads_version: Option<u64>, lock: bool) -> Result<Self> {
        let pid = std::process::id();
        let id = store.note(|tx| {
            drop_dead(tx)?;
            tx.execute(
                "INSERT INTO processes (pid, pid_started, host, command, holds_run_lock, reads_version, since)
                 VALUES (?1, ?2, ?3, ?4, ?5, ?6, unixepoch('subsec'))",
                params![pid, started(pid).unwrap_or(0), host(), command, lock, reads_version],
            )?;
            Ok(tx.last_insert_rowid())
        })?;
        Ok(Self { store, id: Some(id) })
    }
}

impl Drop for ProcessGuard<'_> {
    fn drop(&mut self) {
        let Some(id) = self.id else { return };
        // A row that stays behind is dropped with the dead by the next process.
        let _ = self.store.note(|tx| Ok(tx.execute("DELETE FROM processes WHERE id = ?1", [id])?));
    }
}

/// Deletes rows of this machine's processes that are gone.
fn drop_dead(tx: &rusqlite::Connection) -> Result<()> {
    let mut all = tx.prepare_cached("SELECT id, pid, pid_started FROM processes WHERE host = ?1")?;
    let mut dead = Vec::new();
    let mut rows = all.query([host()])?;
    while let Some(row) = rows.next()? {
        if started(row.get(1)?) != Some(row.get(2)?) {
            dead.push(row.get::<_, i64>(0)?);
        }
    }
    for id in dead {
        tx.execute("DELETE FROM processes WHERE id = ?1", [id])?;
    }
    Ok(())
}

impl Store {
    /// The processes that work on the store now; the dead of this machine are left out.
    pub fn processes(&self) -> Result<Vec<ProcessRow>> {
        let here = host();
        let mut query = self.connection().prepare_cached(
            "SELECT pid, host, command, strftime('%Y-%m-%dT%H:%M:%S', since, 'unixepoch', 'localtime'),
                    holds_run_lock, pid_started FROM processes ORDER BY id",
        )?;
        let rows = query.query_map([], |row| {
            let process = ProcessRow {
                pid: row.get(0)?,
                host: row.get(1)?,
                command: row.get(2)?,
                since: row.get(3)?,
                holds_run_lock: row.get(4)?,
            };
            Ok((process, row.get::<_, i64>(5)?))
        })?;
        let mut living = Vec::new();
        for row in rows {
            let (process, ticks) = row?;
            if process.host != here || started(process.pid) == Some(ticks) {
                living.push(process);
            }
        }
        Ok(living)
    }

    /// Who to name when the store is busy: the coordinator, or else the first process.
    pub fn holder(&self) -> String {
        let mut all = self.processes().unwrap_or_default();
        all.retain(|p| p.pid != std::process::id());
        all.iter().find(|p| p.holds_run_lock).or(all.first()).map_or_else(
            || "a process that has not said its name".to_owned(),
            |p| format!("pid {} on {}: `{}`, since {}", p.pid, p.host, p.command, p.since),
        )
    }

    /// Versions that living processes read.
    pub(super) fn versions_being_read(&self) -> Result<Vec<u64>> {
        let first = self
            .connection()
            .query_row("SELECT count(*) FROM processes WHERE reads_version IS NOT NULL", [], |r| r.get::<_, u64>(0))
            .optional()?;
        if first == Some(0) {
            return Ok(Vec::new());
        }
        self.note(|tx| {
            drop_dead(tx)?;
            let mut query =
                tx.prepare("SELECT DISTINCT reads_version FROM processes WHERE reads_version IS NOT NULL")?;
            let versions = query.query_map([], |r| r.get(0))?.collect::<std::result::Result<_, _>>()?;
            Ok(versions)
        })
    }
}
