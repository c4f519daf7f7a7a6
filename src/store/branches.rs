//! Solution versions and the branches they form.

use rusqlite::{Connection, OptionalExtension};

use super::Store;
use crate::base::{Error, Result};
use crate::model::solve_options::SolveOptions;

/// A solution version's place and figures.
#[derive(Clone, Debug, PartialEq)]
pub struct VersionRow {
    /// Its number.
    pub id: u64,
    /// The version before.
    pub parent: Option<u64>,
    /// Its branch.
    pub branch: u64,
    /// Iterations since emission only.
    pub iteration: u64,
    /// Whether an iteration ends with it.
    pub is_iteration_end: bool,
    /// Whether its branch has converged.
    pub converged: bool,
    /// Change of irradiance since the last end of an iteration, relative.
    pub residual: Option<f64>,
    /// Largest ratio of the last residuals.
    pub contraction: Option<f64>,
    /// Relative error left by stopping here.
    pub predicted_error: Option<f64>,
}

pub(super) fn version_row(tx: &Connection, id: u64) -> Result<Option<VersionRow>> {
    let mut query = tx.prepare_cached(
        "SELECT id, parent, branch, iteration, is_iteration_end, converged, residual, contraction, predicted_error
         FROM solution_versions WHERE id = ?1",
    )?;
    let row = query.query_row([id], |row| {
        Ok(VersionRow {
            id: row.get(0)?,
            parent: row.get(1)?,
            branch: row.get(2)?,
            iteration: row.get(3)?,
            is_iteration_end: row.get(4)?,
            converged: row.get(5)?,
            residual: row.get(6)?,
            contraction: row.get(7)?,
            predicted_error: row.get(8)?,
        })
    });
    Ok(row.optional()?)
}

impl Store {
    /// The newest solution version; exit code 13 before ingest.
    pub fn newest_version(&self) -> Result<u64> {
        let newest: Option<u64> =
            self.connection().prepare_cached("SELECT max(id) FROM solution_versions")?.query_row([], |r| r.get(0))?;
        match newest {
            Some(newest) => Ok(newest),
            None if self.facts_if_any()?.is_some() => Err(self.lacks("there is a model, but no solution version")),
            None => Err(self.has_no_model()),
        }
    }

    /// The damage of rows that must be there.
    pub(super) fn lacks(&self, what: &str) -> Error {
        Error::damaged(&self.dir().join(super::sql::CATALOGUE), what)
    }

    /// A version's place and figures.
    pub fn version(&self, id: u64) -> Result<Option<VersionRow>> {
        version_row(self.connection(), id)
    }

    /// The newest end of an iteration: what people see first.
    pub fn newest_iteration_end(&self) -> Result<u64> {
        self.newest_version()?;
        let mut query =
            self.connection().prepare_cached("SELECT max(id) FROM solution_versions WHERE is_iteration_end = 1")?;
        let end: Option<u64> = query.query_row([], |r| r.get(0))?;
        end.ok_or_else(|| self.lacks("no solution version ends an iteration"))
    }

    /// The newest end of an iteration of a branch, or the version that the branch starts from.
    pub fn newest_end_of_branch(&self, branch: u64) -> Result<u64> {
        let mut query = self.connection().prepare_cached(
            "SELECT coalesce((SELECT max(id) FROM solution_versions WHERE branch = ?1 AND is_iteration_end = 1),
                             (SELECT base_version FROM branches WHERE id = ?1))",
        )?;
        let end: Option<u64> = query.query_row([branch], |r| r.get(0))?;
        end.ok_or_else(|| self.lacks(&format!("branch {branch} has no version to start from")))
    }

    /// Ends of iterations of a branch, its start not counted.
    pub fn iterations_ended(&self, branch: u64) -> Result<u64> {
        let mut query = self.connection().prepare_cached(
            "SELECT count(*) FROM solution_versions WHERE branch = ?1 AND is_iteration_end = 1 AND iteration > 0",
        )?;
        Ok(query.query_row([branch], |r| r.get(0))?)
    }

    /// What shaped a branch's solution; `None` before any task. Fails with damage if its row cannot be read.
    pub fn options_of_branch(&self, branch: u64) -> Result<Option<SolveOptions>> {
        let options = "SELECT options FROM branches WHERE id = ?1";
        let json: Option<String> = self.connection().query_row(options, [branch], |r| r.get(0))?;
        let read = |json: String| SolveOptions::from_json(&json);
        json.map(read).transpose().map_err(|e| self.lacks(&format!("options of branch {branch}: {e}")))
    }

    /// Number of groups; 0 before partition.
    pub fn group_count(&self) -> Result<u64> {
        Ok(self.connection().query_row("SELECT count(*) FROM groups", [], |r| r.get(0))?)
    }
}
