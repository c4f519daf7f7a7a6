//! Names of OBJ objects.

use rusqlite::OptionalExtension;

use super::Store;
use crate::base::{ClusterId, Result};

impl Store {
    /// The name of an OBJ object by its number; empty if the file gave none.
    pub fn object_name(&self, object: u32) -> Result<String> {
        let mut query = self.connection().prepare_cached("SELECT name FROM objects WHERE id = ?1")?;
        Ok(query.query_row([object], |r| r.get(0)).optional()?.unwrap_or_default())
    }

    /// The name of the OBJ object that a cluster is part of.
    pub fn object_of(&self, cluster: ClusterId) -> Result<String> {
        let mut query = self.connection().prepare_cached("SELECT object FROM clusters WHERE id = ?1")?;
        let object = query.query_row([cluster.0], |r| r.get(0)).optional()?;
        object.map_or_else(|| Ok(String::new()), |object| self.object_name(object))
    }
}
