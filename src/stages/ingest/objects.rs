//! OBJ objects by name: numbers in order of appearance, in a scratch database, since a building may
//! have more names than memory.

use std::path::Path;

use rusqlite::{Connection, OptionalExtension, params};

use crate::base::Result;

/// (file, name) <-> number from 0.
pub struct Objects {
    names: Connection,
}

impl Objects {
    /// An empty table in `dir`.
    pub fn create(dir: &Path) -> Result<Self> {
        let names = Connection::open(dir.join("objects.sqlite"))?;
        names.execute_batch(
            "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; PRAGMA cache_size = -2048;
             CREATE TABLE objects (id INTEGER PRIMARY KEY, file INTEGER, name BLOB, UNIQUE (file, name));
             BEGIN;",
        )?;
        Ok(Self { names })
    }

    /// The number of an object, a new one if its name is new in that file.
    pub fn number(&mut self, file: u32, name: &[u8]) -> Result<u32> {
        let known = self
            .names
            .prepare_cached("SELECT id - 1 FROM objects WHERE file = ?1 AND name = ?2")?
            .query_row(params![file, name], |r| r.get(0))
            .optional()?;
        match known {
            Some(id) => Ok(id),
            None => {
                let mut put = self.names.prepare_cached("INSERT INTO objects (file, name) VALUES (?1, ?2)")?;
                Ok((put.insert(params![file, name])? - 1) as u32)
            }
        }
    }

    /// Every object in order of number: (file, name).
    pub fn for_each(&self, mut visit: impl FnMut(u32, &[u8]) -> Result<()>) -> Result<()> {
        let mut query = self.names.prepare("SELECT file, name FROM objects ORDER BY id")?;
        let mut rows = query.query([])?;
        while let Some(row) = rows.next()? {
            visit(row.get(0)?, row.get_ref(1)?.as_blob().map_err(rusqlite::Error::from)?)?;
        }
        Ok(())
    }
}
