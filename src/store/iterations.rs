//! Opening an iteration: the branch it belongs to, and one task per group, in one transaction.
//! Processes that race to open it get the same one.

use rusqlite::{Connection, OptionalExtension, Transaction, params};

use super::branches::{self, VersionRow};
use super::stage_rows::hash;
use super::{Stage, Store};
use crate::base::text::for_shell;
use crate::base::{Error, Result};
use crate::model::order::UpdateOrder;
use crate::model::solve_options::SolveOptions;

/// What a solver brings along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolveSettings {
    /// What shapes the solution.
    pub options: SolveOptions,
    /// How updates become versions.
    pub order: UpdateOrder,
}

impl SolveSettings {
    /// Hash of the options that shape the solution: what tells branches apart.
    #[must_use]
    pub fn options_hash(&self) -> String {
        hash([self.options.to_json().as_bytes()])
    }
}

/// The iteration under way.
#[derive(Clone, Debug, PartialEq)]
pub struct Iteration {
    /// Its branch.
    pub branch: u64,
    /// Its number since emission only, from 1; the last one's if converged.
    pub number: u64,
    /// Whether the branch has converged: then there are no tasks.
    pub converged: bool,
}

impl Store {
    /// Whether a version's light is that of the materials of the last ingest.
    pub fn has_ingested_materials(&self, version: u64) -> Result<bool> {
        has_ingested_materials(self.connection(), version)
    }

    /// Joins the iteration under way, opening branch and tasks where there are none yet. `from`: go
    /// on from that version rather than from the newest. Updates of other branches that wait to be merged
    /// are dropped.
    pub fn open_iteration(&self, from: Option<u64>, settings: &SolveSettings) -> Result<Iteration> {
        let partition = self.require_stage(Stage::Partition)?.chain_hash();
        self.write(|tx| {
            let branch = match from {
                Some(version) => branch_from(self, tx, version, settings)?,
                None => newest_branch(tx, settings)?,
            };
            drop_updates_of_others(tx, branch)?;
            let newest = newest_of(tx, branch)?;
            if newest.converged && newest.branch == branch {
                return Ok(Iteration { branch, number: newest.iteration, converged: true });
            }
            let under_way: Option<u64> = tx.query_row(
                "SELECT max(iteration) FROM tasks WHERE branch = ?1 AND state <> 'merged'",
                [branch],
                |r| r.get(0),
            )?;
            let number = match under_way {
                Some(number) => number,
                None => self.open_tasks(tx, branch, &newest, &partition, settings)?,
            };
            Ok(Iteration { branch, number, converged: false })
        })
    }

    fn open_tasks(
        &self,
        tx: &Transaction<'_>,
        branch: u64,
        newest: &VersionRow,
        partition: &str,
        settings: &SolveSettings,
    ) -> Result<u64> {
        let last: Option<u64> =
            tx.query_row("SELECT max(iteration) FROM tasks WHERE branch = ?1", [branch], |r| r.get(0))?;
        let number = last.unwrap_or(0).max(newest.iteration) + 1;
        let opened = tx.execute(
            "INSERT INTO tasks (branch, iteration, group_id, update_order, state, base_version, options_hash, partition_hash)
             SELECT ?1, ?2, id, ?3, 'free', ?4, ?5, ?6 FROM groups ORDER BY id",
            params![branch, number, settings.order.name(), newest.id, settings.options_hash(), partition],
        )?;
        if opened == 0 {
            return Err(Error::StageMissing {
                message: "the partition holds no groups".to_owned(),
                help: format!("run `clerestory partition {} --fresh` first", for_shell(self.dir())),
            });
        }
        Ok(number)
    }
}

/// Work on one branch at a time: what others have solved and not merged is dropped, leases on them are void.
/// Otherwise what an interrupted run leaves behind would stand in the way of every run with other options.
fn drop_updates_of_others(tx: &Transaction<'_>, branch: u64) -> Result<()> {
    const OTHERS: &str = "branch <> ?1 AND state IN ('done', 'running')";
    tx.execute(&format!("DELETE FROM updates WHERE task IN (SELECT id FROM tasks WHERE {OTHERS})"), [branch])?;
    tx.execute(
        &format!(
            "UPDATE tasks SET state = 'free', worker = NULL, worker_pid = NULL, segment = NULL, report = NULL
             WHERE {OTHERS}"
        ),
        [branch],
    )?;
    Ok(())
}

/// Newest version of a branch, or the one that it starts from.
pub(super) fn newest_of(tx: &Connection, branch: u64) -> Result<VersionRow> {
    let id: u64 = tx.query_row(
        "SELECT coalesce((SELECT max(id) FROM solution_versions WHERE branch = ?1),
                         (SELECT base_version FROM branches WHERE id = ?1))",
        [branch],
        |r| r.get(0),
    )?;
    let found = branches::version_row(tx, id)?;
    found.ok_or_else(|| Error::damaged(std::path::Path::new(super::sql::CATALOGUE), format!("no version {id}")))
}

/// The newest branch if it has these settings and the materials of the last ingest; else a new one from the
/// newest version that has those materials.
fn newest_branch(tx: &Transaction<'_>, settings: &SolveSettings) -> Result<u64> {
    let (branch, hash): (u64, Option<String>) =
        tx.query_row("SELECT id, options_hash FROM branches ORDER BY id DESC LIMIT 1", [], |r| {
            Ok((r.get(0)?, r.get(1)?))
        })?;
    let newest = newest_of(tx, branch)?.id;
    if !has_ingested_materials(tx, newest)? {
        return open_branch(tx, newest_with_ingested_materials(tx)?, settings);
    }
    match hash {
        None => adopt(tx, branch, settings).map(|()| branch),
        Some(hash) if hash == settings.options_hash() => Ok(branch),
        Some(_) => open_branch(tx, newest, settings),
    }
}

/// Whether a version's light is that of the materials of the last ingest, rather than of earlier ones.
/// Every change of materials writes a row of every cluster: one cluster tells.
pub(super) fn has_ingested_materials(tx: &Connection, version: u64) -> Result<bool> {
    let mut query = tx.prepare_cached(
        "WITH RECURSIVE chain (id) AS (
            SELECT ?1 UNION
            SELECT v.parent FROM chain c JOIN solution_versions v ON v.id = c.id WHERE v.parent IS NOT NULL)
         SELECT max(m.version) IS max(m.version) FILTER (WHERE m.version IN (SELECT id FROM chain))
         FROM cluster_materials m WHERE m.cluster = (SELECT min(id) FROM clusters)",
    )?;
    Ok(query.query_row([version], |r| r.get(0))?)
}

fn newest_with_ingested_materials(tx: &Connection) -> Result<u64> {
    let mut query = tx.prepare("SELECT id FROM solution_versions WHERE is_kept = 1 ORDER BY id DESC")?;
    let mut rows = query.query([])?;
    while let Some(row) = rows.next()? {
        let version = row.get(0)?;
        if has_ingested_materials(tx, version)? {
            return Ok(version);
        }
    }
    let catalogue = std::path::Path::new(super::sql::CATALOGUE);
    Err(Error::damaged(catalogue, "no version has the materials of the last ingest"))
}

fn branch_from(store: &Store, tx: &Transaction<'_>, version: u64, settings: &SolveSettings) -> Result<u64> {
    let Some(row) = branches::version_row(tx, version)? else {
        return Err(store.no_such_version(version, "there is no version"));
    };
    let joined: Option<u64> = tx
        .query_row(
            "SELECT id FROM branches WHERE (base_version = ?1 AND cause = 'settings' OR continued_from = ?1) AND options_hash = ?2
             ORDER BY id DESC LIMIT 1",
            params![version, settings.options_hash()],
            |r| r.get(0),
        )
        .optional()?;
    if let Some(branch) = joined {
        return Ok(branch);
    }
    let (hash, is_kept): (Option<String>, bool) = tx.query_row(
        "SELECT b.options_hash, v.is_kept FROM solution_versions v JOIN branches b ON b.id = v.branch WHERE v.id = ?1",
        [version],
        |r| Ok((r.get(0)?, r.get(1)?)),
    )?;
    if !is_kept {
        return Err(store.no_such_version(version, "gc has removed version"));
    }
    if newest_of(tx, row.branch)?.id != version || hash.is_some_and(|hash| hash != settings.options_hash()) {
        return open_branch(tx, version, settings);
    }
    adopt(tx, row.branch, settings)?;
    tx.execute("UPDATE branches SET continued_from = ?2 WHERE id = ?1", [row.branch, version])?;
    Ok(row.branch)
}

/// Gives its options to a branch that nobody has solved on yet.
fn adopt(tx: &Transaction<'_>, branch: u64, settings: &SolveSettings) -> Result<()> {
    tx.execute(
        "UPDATE branches SET options_hash = ?2, options = ?3, tolerance = ?4 WHERE id = ?1",
        params![branch, settings.options_hash(), settings.options.to_json(), settings.options.tolerance],
    )?;
    Ok(())
}

fn open_branch(tx: &Transaction<'_>, base: u64, settings: &SolveSettings) -> Result<u64> {
    let branch: u64 = tx.query_row("SELECT max(id) + 1 FROM branches", [], |r| r.get(0))?;
    tx.execute(
        "INSERT INTO branches (id, base_version, cause, opened_at) VALUES (?1, ?2, 'settings', unixepoch('subsec'))",
        [branch, base],
    )?;
    adopt(tx, branch, settings)?;
    Ok(branch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::fixture;

    #[test]
    fn versions_that_come_from_themselves_end() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 2);
        store.connection().execute("UPDATE solution_versions SET parent = id", []).unwrap();
        assert!(has_ingested_materials(store.connection(), 0).unwrap());
    }

    #[test]
    fn options_of_a_branch_are_read_back_unless_their_row_is_damaged() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 2);
        fixture::partition(&store, 1);
        assert_eq!(store.options_of_branch(0).unwrap(), None);
        let settings = fixture::settings(UpdateOrder::Jacobi);
        store.open_iteration(None, &settings).unwrap();
        assert_eq!(store.options_of_branch(0).unwrap(), Some(settings.options));
        store.connection().execute("UPDATE branches SET options = '{\"tolerance\":0.02}'", []).unwrap();
        let error = store.options_of_branch(0).unwrap_err();
        assert!(error.to_string().contains("options of branch 0: missing field"), "{error}");
    }
}
