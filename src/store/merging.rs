//! Finished updates become a solution version, in one transaction.

use rusqlite::{OptionalExtension, Transaction, params};

use super::branches::VersionRow;
use super::iterations::newest_of;
use super::snapshot::Snapshot;
use super::{ExtentRef, Store};
use crate::base::{ClusterId, Error, Result};
use crate::model::ExtentKind;
use crate::model::figures::{IterationFigures, Phase, Power, Steering, Work};
use crate::model::order::UpdateOrder;
use crate::model::report::TaskReport;

/// Where a task stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskState {
    /// Nobody has claimed it.
    Free,
    /// A worker solves it.
    Running,
    /// Solved, not merged.
    Done,
    /// Part of a version.
    Merged,
    /// Its workers died too often.
    Failed,
}

/// A task as merge sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskRow {
    /// Its number.
    pub id: i64,
    /// Its branch.
    pub branch: u64,
    /// Its iteration.
    pub iteration: u64,
    /// Its group.
    pub group: u32,
    /// How its update becomes a version.
    pub order: UpdateOrder,
    /// Where it stands.
    pub state: TaskState,
    /// The version it read.
    pub base_version: u64,
    /// Of the options it was solved with.
    pub options_hash: String,
    /// Of the partition it belongs to.
    pub partition_hash: String,
    /// What it reported, once done.
    pub report: Option<TaskReport>,
    /// From its claim to its publication, s; once done.
    pub wall_s: Option<f64>,
}

/// How many tasks stand where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TaskCounts {
    /// Nobody has claimed them.
    pub free: u64,
    /// Workers solve them.
    pub running: u64,
    /// Solved, not merged.
    pub done: u64,
    /// Part of a version.
    pub merged: u64,
    /// Their workers died too often.
    pub failed: u64,
}

impl TaskCounts {
    /// All of them.
    #[must_use]
    pub fn total(self) -> u64 {
        self.free + self.running + self.done + self.merged + self.failed
    }
}

/// A branch's settings.
#[derive(Clone, Debug, PartialEq)]
pub struct BranchRow {
    /// Its number.
    pub id: u64,
    /// Of the options that shape it; none before the first solve.
    pub options_hash: Option<String>,
    /// The error people dial.
    pub tolerance: Option<f64>,
}

/// Figures of a new version; those of a whole iteration only at its end.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VersionFigures {
    /// Whether the branch has converged.
    pub converged: bool,
    /// The branch's tolerance.
    pub tolerance: f64,
    /// Relative change of irradiance since the last end of an iteration.
    pub residual: f64,
    /// Factor by which the error falls per iteration.
    pub contraction: f64,
    /// Relative error left by stopping here.
    pub predicted_error: f64,
    /// What its tasks came to.
    pub iteration: IterationFigures,
    /// Where refinement stands.
    pub steering: Steering,
}

/// The columns of [`VersionFigures`].
const FIGURES: &str =
    "converged, tolerance, residual, contraction, predicted_error, emitted_r_w, emitted_g_w, emitted_b_w,
    absorbed_r_w, absorbed_g_w, absorbed_b_w, escaped_r_w, escaped_g_w, escaped_b_w, energy_balance, elements,
    links_evaluated, links_stored, links_reused, rays, unlinked_mean, phase, threshold, lit_mean_w_m2, estimated_nrms,
    estimated_nrms_error, correction, correction_error, places, gain_r, gain_g, gain_b";

fn damaged(detail: impl Into<String>) -> Error {
    Error::damaged(std::path::Path::new(super::sql::CATALOGUE), detail)
}

fn state_of(text: &str) -> Result<TaskState> {
    Ok(match text {
        "free" => TaskState::Free,
        "running" => TaskState::Running,
        "done" => TaskState::Done,
        "merged" => TaskState::Merged,
        "failed" => TaskState::Failed,
        other => return Err(damaged(format!("a task's state is {other}"))),
    })
}

impl Store {
    /// The newest branch; exit code 13 before ingest.
    pub fn newest_branch(&self) -> Result<u64> {
        self.newest_version()?;
        let newest: Option<u64> = self.connection().query_row("SELECT max(id) FROM branches", [], |r| r.get(0))?;
        newest.ok_or_else(|| self.lacks("there are solution versions, but no branch"))
    }

    /// A branch's settings.
    pub fn branch(&self, id: u64) -> Result<Option<BranchRow>> {
        let mut query =
            self.connection().prepare_cached("SELECT id, options_hash, tolerance FROM branches WHERE id = ?1")?;
        let row =
            query.query_row([id], |r| Ok(BranchRow { id: r.get(0)?, options_hash: r.get(1)?, tolerance: r.get(2)? }));
        Ok(row.optional()?)
    }

    /// Newest version of a branch, or the one that it starts from.
    pub fn newest_of_branch(&self, branch: u64) -> Result<VersionRow> {
        newest_of(self.connection(), branch).map_err(|e| self.named(e))
    }

    /// The iteration of a branch that has tasks not merged yet.
    pub fn iteration_under_way(&self, branch: u64) -> Result<Option<u64>> {
        let mut query = self
            .connection()
            .prepare_cached("SELECT max(iteration) FROM tasks WHERE branch = ?1 AND state <> 'merged'")?;
        Ok(query.query_row([branch], |r| r.get(0))?)
    }

    /// Branches with tasks that are done but not merged, ascending.
    pub fn branches_to_merge(&self) -> Result<Vec<u64>> {
        let mut query = self
            .connection()
            .prepare_cached("SELECT DISTINCT branch FROM tasks WHERE state = 'done' ORDER BY branch")?;
        let rows = query.query_map([], |r| r.get(0))?;
        Ok(rows.collect::<std::result::Result<_, _>>()?)
    }

    /// How many tasks of an iteration stand where.
    pub fn task_counts(&self, branch: u64, iteration: u64) -> Result<TaskCounts> {
        let mut query = self
            .connection()
            .prepare_cached("SELECT state, count(*) FROM tasks WHERE branch = ?1 AND iteration = ?2 GROUP BY state")?;
        let mut rows = query.query(params![branch, iteration])?;
        let mut counts = TaskCounts::default();
        while let Some(row) = rows.next()? {
            let count: u64 = row.get(1)?;
            match state_of(&row.get::<_, String>(0)?)? {
                TaskState::Free => counts.free = count,
                TaskState::Running => counts.running = count,
                TaskState::Done => counts.done = count,
                TaskState::Merged => counts.merged = count,
                TaskState::Failed => counts.failed = count,
            }
        }
        Ok(counts)
    }

    /// The tasks of an iteration, in the order of their groups.
    pub fn tasks(&self, branch: u64, iteration: u64) -> Result<Vec<TaskRow>> {
        let mut query = self.connection().prepare_cached(
            "SELECT id, group_id, update_order, state, base_version, options_hash, partition_hash, report,
                    finished_at - claimed_at
             FROM tasks WHERE branch = ?1 AND iteration = ?2 ORDER BY group_id",
        )?;
        let mut rows = query.query(params![branch, iteration])?;
        let mut tasks = Vec::new();
        while let Some(row) = rows.next()? {
            let report: Option<Vec<u8>> = row.get(7)?;
            let group = row.get(1)?;
            tasks.push(TaskRow {
                id: row.get(0)?,
                branch,
                iteration,
                group,
                order: row.get::<_, String>(2)?.parse().map_err(damaged)?,
                state: state_of(&row.get::<_, String>(3)?)?,
                base_version: row.get(4)?,
                options_hash: row.get(5)?,
                partition_hash: row.get(6)?,
                report: report
                    .map(|bytes| TaskReport::decode(&bytes))
                    .transpose()
                    .map_err(|e| damaged(format!("report of group {group}: {e}")))?,
                wall_s: row.get(8)?,
            });
        }
        Ok(tasks)
    }

    /// Where the radiosity of a cluster lies in a task's update, if it has any.
    pub fn updated_light(&self, task: i64, cluster: ClusterId) -> Result<Option<ExtentRef>> {
        let mut query = self.connection().prepare_cached(
            "SELECT segment, offset, bytes FROM updates WHERE task = ?1 AND cluster = ?2 AND kind = ?3",
        )?;
        let row =
            query.query_row(params![task, cluster.0, ExtentKind::Radiosity as u16], |row| ExtentRef::from_row(row, 0));
        Ok(row.optional()?)
    }

    /// Residuals of the ends of iterations of a branch, newest first, at most `count`.
    pub fn residuals(&self, branch: u64, count: u32) -> Result<Vec<f64>> {
        let mut query = self.connection().prepare_cached(
            "SELECT residual FROM solution_versions
             WHERE branch = ?1 AND is_iteration_end = 1 AND residual IS NOT NULL ORDER BY id DESC LIMIT ?2",
        )?;
        let rows = query.query_map(params![branch, count], |r| r.get(0))?;
        Ok(rows.collect::<std::result::Result<_, _>>()?)
    }

    /// Estimated errors of a branch after each marking, and the links there were then, newest first.
    pub fn markings(&self, branch: u64) -> Result<Vec<(f64, u64)>> {
        let mut query = self.connection().prepare_cached(
            "SELECT estimate, links FROM (
                 SELECT id, estimated_nrms AS estimate, links_stored AS links, lag(phase) OVER (ORDER BY id) AS asked
                 FROM solution_versions WHERE branch = ?1 AND is_iteration_end = 1 AND residual IS NOT NULL)
             WHERE asked = ?2 AND estimate IS NOT NULL ORDER BY id DESC",
        )?;
        let rows = query.query_map(params![branch, Phase::Mark.name()], |r| Ok((r.get(0)?, r.get(1)?)))?;
        Ok(rows.collect::<std::result::Result<_, _>>()?)
    }

    /// The newest end of an iteration at or before a version, along its branch and base.
    pub fn iteration_end_before(&self, version: u64) -> Result<u64> {
        let mut at = version;
        while let Some(row) = self.version(at)? {
            match row.parent {
                Some(parent) if !row.is_iteration_end => at = parent,
                _ => return Ok(row.id),
            }
        }
        Err(self.named(damaged(format!("version {at} is missing"))))
    }

    /// Figures of the end of an iteration; `None` for other versions and for version 0.
    pub fn version_figures(&self, version: u64) -> Result<Option<VersionFigures>> {
        let sql = format!("SELECT {FIGURES} FROM solution_versions WHERE id = ?1 AND residual IS NOT NULL");
        let mut query = self.connection().prepare_cached(&sql)?;
        let row = query.query_row([version], |r| {
            let triple = |at: usize| Ok::<_, rusqlite::Error>([r.get(at)?, r.get(at + 1)?, r.get(at + 2)?]);
            Ok(VersionFigures {
                converged: r.get(0)?,
                tolerance: r.get(1)?,
                residual: r.get(2)?,
                contraction: r.get(3)?,
                predicted_error: r.get(4)?,
                iteration: IterationFigures {
                    power: Power { emitted_w: triple(5)?, absorbed_w: triple(8)?, escaped_w: triple(11)? },
                    energy_balance: r.get(14)?,
                    work: Work {
                        elements: r.get(15)?,
                        links_evaluated: r.get(16)?,
                        links_stored: r.get(17)?,
                        links_reused: r.get(18)?,
                        rays: r.get(19)?,
                    },
                    unlinked_mean: r.get(20)?,
                },
                steering: Steering {
                    phase: Phase::of(&r.get::<_, String>(21)?),
                    threshold: r.get(22)?,
                    lit_mean_w_m2: r.get(23)?,
                    estimated_nrms: r.get(24)?,
                    estimated_nrms_error: r.get(25)?,
                    correction: r.get(26)?,
                    correction_error: r.get(27)?,
                    places: r.get(28)?,
                    gain: triple(29)?,
                },
            })
        });
        Ok(row.optional()?)
    }

    /// Makes the next version of a branch from done tasks. Clusters whose light is unchanged get no
    /// row. `figures` mark the end of the iteration. `None` if another process merged them meanwhile.
    pub fn merge(&self, base: &VersionRow, tasks: &[TaskRow], figures: Option<&VersionFigures>) -> Result<Option<u64>> {
        let Some(first) = tasks.first() else { return Ok(None) };
        self.write(|tx| {
            if newest_of(tx, first.branch)?.id != base.id || !all_done(tx, tasks)? {
                return Ok(None);
            }
            let version: u64 = tx.query_row("SELECT max(id) + 1 FROM solution_versions", [], |r| r.get(0))?;
            insert_version(tx, version, base.id, first, figures)?;
            let old = Snapshot::at(self, base.id)?;
            let mut changed = 0u64;
            for task in tasks {
                changed += self.move_updates(tx, task.id, version, &old)?;
                tx.execute(
                    "UPDATE tasks SET state = 'merged', merged_version = ?2 WHERE id = ?1",
                    params![task.id, version],
                )?;
                tx.execute("DELETE FROM updates WHERE task = ?1", [task.id])?;
            }
            tx.execute("UPDATE solution_versions SET clusters_changed = ?2 WHERE id = ?1", [version, changed])?;
            Ok(Some(version))
        })
    }

    fn move_updates(&self, tx: &Transaction<'_>, task: i64, version: u64, old: &Snapshot<'_>) -> Result<u64> {
        let mut query =
            tx.prepare_cached("SELECT segment, offset, bytes, cluster, kind, delta FROM updates WHERE task = ?1")?;
        let mut state = tx.prepare_cached("INSERT INTO cluster_states VALUES (?1, ?2, ?3, ?4, ?5)")?;
        let mut links = tx.prepare_cached("INSERT INTO cluster_links VALUES (?1, ?2, ?3, ?4, ?5, ?6)")?;
        let mut rows = query.query([task])?;
        let mut changed = 0;
        while let Some(row) = rows.next()? {
            let (at, cluster) = (ExtentRef::from_row(row, 0)?, ClusterId(row.get(3)?));
            if row.get::<_, u16>(4)? == ExtentKind::Links as u16 {
                let delta: bool = row.get(5)?;
                links.execute(params![cluster.0, version, delta, at.segment, at.offset, at.bytes])?;
            } else if !self.same_light(old, cluster, at)? {
                state.execute(params![cluster.0, version, at.segment, at.offset, at.bytes])?;
                changed += 1;
            }
        }
        Ok(changed)
    }

    /// Whether a new radiosity extent holds the same bytes as the old one.
    fn same_light(&self, old: &Snapshot<'_>, cluster: ClusterId, new: ExtentRef) -> Result<bool> {
        let Some(before) = old.extent(ExtentKind::Radiosity, cluster)? else { return Ok(false) };
        let after = self.extent(new, ExtentKind::Radiosity)?;
        Ok(before.header().payload_xxh3 == after.header().payload_xxh3 && before.payload() == after.payload())
    }
}

fn all_done(tx: &Transaction<'_>, tasks: &[TaskRow]) -> Result<bool> {
    let mut query = tx.prepare_cached("SELECT state = 'done' FROM tasks WHERE id = ?1")?;
    for task in tasks {
        if query.query_row([task.id], |r| r.get(0)).optional()? != Some(true) {
            return Ok(false);
        }
    }
    Ok(true)
}

fn insert_version(
    tx: &Transaction<'_>,
    version: u64,
    parent: u64,
    task: &TaskRow,
    figures: Option<&VersionFigures>,
) -> Result<()> {
    tx.execute(
        "INSERT INTO solution_versions (id, parent, branch, iteration, is_iteration_end, made_at)
         VALUES (?1, ?2, ?3, ?4, ?5, unixepoch('subsec'))",
        params![version, parent, task.branch, task.iteration, figures.is_some()],
    )?;
    let Some(f) = figures else { return Ok(()) };
    let IterationFigures { work, power, energy_balance, unlinked_mean } = f.iteration;
    let ([er, eg, eb], [ar, ag, ab], [sr, sg, sb]) = (power.emitted_w, power.absorbed_w, power.escaped_w);
    let values = params![
        version,
        f.converged,
        f.tolerance,
        f.residual,
        f.contraction,
        f.predicted_error,
        er,
        eg,
        eb,
        ar,
        ag,
        ab,
        sr,
        sg,
        sb,
        energy_balance,
        work.elements,
        work.links_evaluated,
        work.links_stored,
        work.links_reused,
        work.rays,
        unlinked_mean,
        f.steering.phase.name(),
        f.steering.threshold,
        f.steering.lit_mean_w_m2,
        f.steering.estimated_nrms,
        f.steering.estimated_nrms_error,
        f.steering.correction,
        f.steering.correction_error,
        f.steering.places,
        f.steering.gain[0],
        f.steering.gain[1],
        f.steering.gain[2],
    ];
    let places: Vec<String> = (2..=values.len()).map(|at| format!("?{at}")).collect();
    let sql = format!("UPDATE solution_versions SET ({FIGURES}) = ({}) WHERE id = ?1", places.join(", "));
    tx.execute(&sql, values)?;
    Ok(())
}
