//! Names of OBJ objects.

use rusqlite::OptionalExtension;

use super::Store;
use crate::base::Result;

impl Store {
    /// The name of an OBJ object by its number; empty if the file gave none.
    pub fn object_name(&self, object: u32) -> Result<String> {
        let mut query = self.connection().prepare_cached("SELECT name FROM objects WHERE id = ?1")?;
        Ok(query.query_row([object], |r| r.get(0)).optional()?.unwrap_or_default())
    }
}
