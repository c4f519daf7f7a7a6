//! Seals: of every table that carries results, the number of its rows and the sum of their hashes. A row that
//! was changed, added or deleted behind our back, by a bit or by hand, breaks the seal of its table.
//!
//! Triggers of a connection that writes count what it inserts, updates and deletes, and the end of its transaction
//! puts that into the seals: at the cost of the rows that change, and no writer can forget to.

use std::sync::{Arc, Mutex};

use rusqlite::functions::{Context, FunctionFlags};
use rusqlite::types::ValueRef;
use rusqlite::{Connection, OptionalExtension};
use xxhash_rust::xxh3::xxh3_64;

use super::Store;
use super::sql::CATALOGUE;
use crate::base::{Error, Result};

/// The tables that are sealed: all but those that say who works on the store right now, and measurements.
const SEALED: [&str; 17] = [
    "model",
    "segments",
    "stages",
    "settings",
    "input_files",
    "objects",
    "skipped_faces",
    "clusters",
    "groups",
    "branches",
    "solution_versions",
    "audits",
    "cluster_materials",
    "cluster_states",
    "cluster_links",
    "tasks",
    "updates",
];

/// Hashes and sums have 62 bits: a sum of two stays within SQLite's integers.
const MASK: u64 = (1 << 62) - 1;

/// Rows of a table, and the sum of their hashes; or how both change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Seal {
    rows: i64,
    sum: u64,
}

impl Seal {
    fn add(&mut self, row: u64) {
        *self = Self { rows: self.rows + 1, sum: self.sum.wrapping_add(row) & MASK };
    }

    fn take(&mut self, row: u64) {
        *self = Self { rows: self.rows - 1, sum: self.sum.wrapping_sub(row) & MASK };
    }
}

/// The hash of a row's values. Numbers that are equal hash alike: SQLite keeps whole ones as integers, whatever the
/// column's type.
fn hash<'a>(values: impl Iterator<Item = rusqlite::Result<ValueRef<'a>>>) -> rusqlite::Result<u64> {
    let mut bytes = Vec::with_capacity(512);
    let mut put = |kind: u8, value: &[u8]| {
        bytes.push(kind);
        bytes.extend_from_slice(value);
    };
    for value in values {
        match value? {
            ValueRef::Null => put(0, &[]),
            ValueRef::Integer(i) => put(1, &i.to_le_bytes()),
            ValueRef::Real(x) if (x as i64) as f64 == x => put(1, &(x as i64).to_le_bytes()),
            ValueRef::Real(x) => put(2, &x.to_le_bytes()),
            ValueRef::Text(text) => {
                put(3, &(text.len() as u64).to_le_bytes());
                put(3, text);
            }
            ValueRef::Blob(blob) => {
                put(4, &(blob.len() as u64).to_le_bytes());
                put(4, blob);
            }
        }
    }
    Ok(xxh3_64(&bytes) & MASK)
}

/// What a transaction has changed so far, table by table.
#[derive(Clone, Default)]
pub(super) struct Ledger(Arc<Mutex<[Seal; SEALED.len()]>>);

impl Ledger {
    /// Counts whatever a connection writes from now on to tables that are sealed.
    pub(super) fn keep(connection: &Connection) -> rusqlite::Result<Self> {
        let ledger = Self::default();
        let own = ledger.clone();
        // `count(place of the table, 1 added or -1 taken, values of the row...)`
        let count = move |call: &Context<'_>| {
            let row = hash((2..call.len()).map(|i| Ok(call.get_raw(i))))?;
            let mut seals = own.0.lock().expect("nobody panics with it");
            let seal = &mut seals[call.get::<usize>(0)?];
            if call.get::<i64>(1)? > 0 {
                seal.add(row)
            } else {
                seal.take(row)
            }
            Ok(0)
        };
        let flags = FunctionFlags::SQLITE_UTF8 | FunctionFlags::SQLITE_INNOCUOUS;
        connection.create_scalar_function("count_row", -1, flags, count)?;
        // So that a row which another replaces counts as deleted.
        connection.pragma_update(None, "recursive_triggers", true)?;
        let mut triggers = "BEGIN;".to_owned();
        for (place, table) in SEALED.iter().enumerate() {
            let query = connection.prepare(&format!("SELECT * FROM main.{table}"))?;
            let of = |row: &str, sign: i32| {
                let values: String = query.column_names().map(|name| format!(",{row}.{name}")).collect();
                format!("SELECT count_row({place},{sign}{values});")
            };
            let (added, taken) = (of("NEW", 1), of("OLD", -1));
            for (event, body) in [("INSERT", &added), ("DELETE", &taken), ("UPDATE", &format!("{taken}{added}"))] {
                let name = format!("{event}_{table}");
                triggers += &format!("CREATE TEMP TRIGGER {name} AFTER {event} ON main.{table} BEGIN {body} END;");
            }
        }
        connection.execute_batch(&(triggers + "COMMIT"))?;
        Ok(ledger)
    }

    /// Forgets what was counted: a transaction begins.
    pub(super) fn clear(&self) {
        *self.0.lock().expect("nobody panics with it") = Default::default();
    }

    /// Puts what was counted into the seals, as the last thing before the transaction's end.
    pub(super) fn settle(&self, connection: &Connection) -> Result<()> {
        let counted = std::mem::take(&mut *self.0.lock().expect("nobody panics with it"));
        let sql =
            format!("UPDATE seals SET row_count = row_count + ?2, row_sum = (row_sum + ?3) & {MASK} WHERE name = ?1");
        let mut put = connection.prepare_cached(&sql)?;
        for (table, change) in SEALED.iter().zip(counted).filter(|(_, change)| *change != Seal::default()) {
            put.execute((table, change.rows, change.sum))?;
        }
        Ok(())
    }
}

/// Seals all tables as they are.
pub(super) fn renew(connection: &Connection) -> rusqlite::Result<()> {
    for table in SEALED {
        let seal = seal_of(connection, table)?;
        connection.execute("INSERT OR REPLACE INTO seals VALUES (?1, ?2, ?3)", (table, seal.rows, seal.sum))?;
    }
    Ok(())
}

fn seal_of(connection: &Connection, table: &str) -> rusqlite::Result<Seal> {
    let mut query = connection.prepare(&format!("SELECT * FROM main.{table}"))?;
    let width = query.column_count();
    let mut rows = query.query([])?;
    let mut seal = Seal::default();
    while let Some(row) = rows.next()? {
        seal.add(hash((0..width).map(|i| row.get_ref(i)))?);
    }
    Ok(seal)
}

impl Store {
    /// What breaks the seal of a table, if anything does.
    fn broken(&self, table: &str) -> Result<Option<String>> {
        let connection = self.connection();
        let kept = connection
            .prepare_cached("SELECT row_count, row_sum FROM seals WHERE name = ?1")?
            .query_row([table], |row| Ok((row.get::<_, i64>(0)?, row.get::<_, i64>(1)?)))
            .optional()?;
        let Some((rows, sum)) = kept else { return Ok(Some(format!("table {table} has no seal"))) };
        let found = seal_of(connection, table)?;
        Ok(if found.rows != rows {
            Some(format!("table {table} has {} rows where {rows} were written", found.rows))
        } else if i64::try_from(found.sum) != Ok(sum) {
            Some(format!("a row of table {table} is not what was written"))
        } else {
            None
        })
    }

    /// Every table whose rows are not those that were written, and how they differ.
    pub fn broken_seals(&self) -> Result<Vec<(&'static str, String)>> {
        self.read(|| {
            let broken = SEALED.iter().map(|table| Ok(self.broken(table)?.map(|detail| (*table, detail))));
            broken.filter_map(Result::transpose).collect()
        })
    }

    /// Fails with damage if a table's rows are not those that were written, or can't be.
    pub fn require_sealed_rows(&self) -> Result<()> {
        let mut broken = self.broken_seals()?;
        if broken.is_empty() {
            broken = self.impossible_rows()?;
        }
        match broken.into_iter().next() {
            Some((_, detail)) => Err(Error::damaged(&self.dir().join(CATALOGUE), detail)),
            None => Ok(()),
        }
    }

    /// The same for one small table, without looking at the others.
    pub(super) fn require_sealed(&self, table: &str) -> Result<()> {
        self.broken(table)?.map_or(Ok(()), |detail| Err(Error::damaged(&self.dir().join(CATALOGUE), detail)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ClusterId;
    use crate::model::order::UpdateOrder;
    use crate::store::{Snapshot, fixture};

    fn solved(dir: &std::path::Path) -> Store {
        let store = fixture::store(dir, 5);
        fixture::partition(&store, 2);
        fixture::solve_all(&store, UpdateOrder::Jacobi, 2.0);
        store
    }

    #[test]
    fn every_write_keeps_the_seals() {
        let dir = tempfile::tempdir().unwrap();
        let store = solved(dir.path());
        assert_eq!(store.broken_seals().unwrap(), []);
        let facts = store.facts().unwrap();
        store.write(|tx| facts.insert(tx)).unwrap();
        assert_eq!(store.broken_seals().unwrap(), [], "a row that replaces another");
        store.write(|tx| Ok(tx.execute("DELETE FROM tasks", [])?)).unwrap();
        assert_eq!(store.broken_seals().unwrap(), [], "rows that go with others: updates with their tasks");
        store.empty().unwrap();
        assert_eq!(store.broken_seals().unwrap(), []);
    }

    #[test]
    fn a_row_changed_deleted_or_added_behind_our_back_breaks_its_tables_seal() {
        let changes = [
            ("clusters", "DELETE FROM clusters WHERE id = 3"),
            ("clusters", "UPDATE clusters SET patches = 2 WHERE id = 1"),
            ("model", "UPDATE model SET metres_per_unit = 0.02"),
            ("model", "DELETE FROM model"),
            ("cluster_states", "DELETE FROM cluster_states WHERE cluster = 2"),
            ("cluster_materials", "UPDATE cluster_materials SET bytes = bytes + 1 WHERE cluster = 2"),
            ("cluster_links", "INSERT INTO cluster_links VALUES (0, 0, 0, 1, 0, 64)"),
            ("segments", "UPDATE segments SET published_bytes = 0 WHERE id = 1"),
            ("updates", "DELETE FROM updates WHERE cluster = 4"),
            ("solution_versions", "UPDATE solution_versions SET is_kept = 0"),
        ];
        for (table, sql) in changes {
            let dir = tempfile::tempdir().unwrap();
            drop(solved(dir.path()));
            let stranger = Connection::open(dir.path().join(CATALOGUE)).unwrap();
            stranger.pragma_update(None, "foreign_keys", false).unwrap();
            assert!(stranger.execute(sql, []).unwrap() > 0, "{sql}");
            drop(stranger);
            let store = Store::open(dir.path(), std::time::Duration::ZERO).unwrap();
            let broken: Vec<_> = store.broken_seals().unwrap().into_iter().map(|(name, _)| name).collect();
            assert_eq!(broken, [table], "{sql}");
            assert_eq!(store.require_sealed_rows().err().unwrap().exit_code(), 12, "{sql}");
            if table == "model" {
                assert_eq!(store.facts_if_any().err().unwrap().exit_code(), 12, "{sql}");
            }
        }
    }

    #[test]
    fn versions_that_gc_forgets_and_rows_that_it_moves_keep_the_seals() {
        let dir = tempfile::tempdir().unwrap();
        let store = solved(dir.path());
        store.forget_old_versions(1).unwrap();
        store.compact_segments().unwrap();
        assert_eq!(store.broken_seals().unwrap(), []);
        assert!(Snapshot::at(&store, 0).unwrap().place(crate::model::ExtentKind::Radiosity, ClusterId(0)).is_ok());
    }
}
