//! Seals: of every table that carries results, the number of its rows and the sum of their hashes. A row that
//! was changed, added or deleted behind our back, by a bit or by hand, breaks the seal of its table.
//!
//! Triggers of our own connection keep them with every write, in the same transaction: at the cost of the rows
//! that change, and no writer can forget to.

use rusqlite::functions::FunctionFlags;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, OptionalExtension};
use xxhash_rust::xxh3::xxh3_64;

use super::Store;
use super::sql::CATALOGUE;
use crate::base::{Error, Result};

/// The tables that are sealed: all but those that say who works on the store right now, and measurements.
const SEALED: [&str; 16] = [
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
    "cluster_materials",
    "cluster_states",
    "cluster_links",
    "tasks",
    "updates",
];

/// Hashes and sums have 62 bits: a sum of two stays within SQLite's integers.
const MASK: u64 = (1 << 62) - 1;

/// First version of the schema whose tables are sealed.
pub(super) const FORMAT: usize = 2;

/// Rows of a table, and the sum of their hashes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Seal {
    rows: u64,
    sum: u64,
}

fn hash<'a>(values: impl Iterator<Item = rusqlite::Result<ValueRef<'a>>>) -> rusqlite::Result<u64> {
    let mut bytes = Vec::with_capacity(512);
    for value in values {
        let (kind, text): (u8, &[u8]) = match value? {
            ValueRef::Null => (0, &[]),
            ValueRef::Integer(i) => {
                bytes.push(1);
                bytes.extend_from_slice(&i.to_le_bytes());
                continue;
            }
            ValueRef::Real(x) => {
                bytes.push(2);
                bytes.extend_from_slice(&x.to_le_bytes());
                continue;
            }
            ValueRef::Text(text) => (3, text),
            ValueRef::Blob(blob) => (4, blob),
        };
        bytes.push(kind);
        bytes.extend_from_slice(&(text.len() as u64).to_le_bytes());
        bytes.extend_from_slice(text);
    }
    Ok(xxh3_64(&bytes) & MASK)
}

/// Gives a connection the function `row_hash(values...)`.
pub(super) fn define_hash(connection: &Connection) -> rusqlite::Result<()> {
    let flags = FunctionFlags::SQLITE_UTF8 | FunctionFlags::SQLITE_DETERMINISTIC | FunctionFlags::SQLITE_INNOCUOUS;
    connection.create_scalar_function("row_hash", -1, flags, |values| {
        hash((0..values.len()).map(|i| Ok(values.get_raw(i)))).map(|h| h as i64)
    })
}

fn columns(connection: &Connection, table: &str) -> rusqlite::Result<Vec<String>> {
    let mut query = connection.prepare("SELECT name FROM pragma_table_info(?1, 'main') ORDER BY cid")?;
    query.query_map([table], |row| row.get(0))?.collect()
}

/// Makes a connection keep the seals with every row that it writes.
pub(super) fn keep(connection: &Connection) -> rusqlite::Result<()> {
    // So that a row which another replaces counts as deleted.
    connection.pragma_update(None, "recursive_triggers", true)?;
    for table in SEALED {
        let names = columns(connection, table)?;
        let hash_of = |row: &str| {
            let values: Vec<String> = names.iter().map(|name| format!("{row}.\"{name}\"")).collect();
            format!("row_hash({})", values.join(", "))
        };
        let (old, new) = (hash_of("OLD"), hash_of("NEW"));
        for (event, rows, sum) in [
            ("INSERT", "row_count + 1", format!("row_sum + {new}")),
            ("DELETE", "row_count - 1", format!("row_sum - {old}")),
            ("UPDATE", "row_count", format!("((row_sum - {old}) & {MASK}) + {new}")),
        ] {
            connection.execute_batch(&format!(
                "CREATE TEMP TRIGGER IF NOT EXISTS seal_{event}_{table} AFTER {event} ON main.{table} BEGIN
                     UPDATE seals SET row_count = {rows}, row_sum = ({sum}) & {MASK} WHERE name = '{table}';
                 END"
            ))?;
        }
    }
    Ok(())
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
        let own = hash((0..width).map(|i| row.get_ref(i)))?;
        seal = Seal { rows: seal.rows + 1, sum: (seal.sum + own) & MASK };
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
        Ok(if i64::try_from(found.rows) != Ok(rows) {
            Some(format!("table {table} has {} rows where {rows} were written", found.rows))
        } else if i64::try_from(found.sum) != Ok(sum) {
            Some(format!("a row of table {table} is not what was written"))
        } else {
            None
        })
    }

    /// Every table whose rows are not those that were written, and how they differ.
    pub fn broken_seals(&self) -> Result<Vec<(&'static str, String)>> {
        if self.format() < FORMAT {
            return Ok(Vec::new());
        }
        self.read(|| {
            let broken = SEALED.iter().map(|table| Ok(self.broken(table)?.map(|detail| (*table, detail))));
            broken.filter_map(Result::transpose).collect()
        })
    }

    /// Fails with damage if a table's rows are not those that were written.
    pub fn require_sealed_rows(&self) -> Result<()> {
        match self.broken_seals()?.into_iter().next() {
            Some((_, detail)) => Err(Error::damaged(&self.dir().join(CATALOGUE), detail)),
            None => Ok(()),
        }
    }

    /// The same for one small table, without looking at the others.
    pub(super) fn require_sealed(&self, table: &str) -> Result<()> {
        let detail = if self.format() < FORMAT { None } else { self.broken(table)? };
        detail.map_or(Ok(()), |detail| Err(Error::damaged(&self.dir().join(CATALOGUE), detail)))
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
