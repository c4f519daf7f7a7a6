//! Tasks and their leases: claimed, given back, published. A lease lives as long as its worker's
//! segment file is locked.

use rusqlite::{OptionalExtension, Transaction, params};

use super::iterations::{Iteration, newest_of};
use super::locks::PublishLock;
use super::workers::{Worker, segment_is_free};
use super::{ExtentRef, Store};
use crate::base::{ClusterId, Error, Result};
use crate::model::ExtentKind;
use crate::model::free_group::{FreeGroup, Held};
use crate::model::order::UpdateOrder;
use crate::model::report::TaskReport;

/// Deaths of workers on one task after which it has failed.
pub const DEATHS: u32 = 3;

/// Free groups offered to a schedule at a time, costliest first.
pub const OFFERED: u32 = 256;

/// The right to solve a group once.
#[derive(Clone, Debug, PartialEq)]
pub struct Lease {
    pub(super) task: i64,
    pub(super) attempt: u32,
    /// The group to solve.
    pub group: u32,
    /// The version to read.
    pub base_version: u64,
}

/// What there is to choose from.
#[derive(Clone, Debug, PartialEq)]
pub struct Offer {
    /// Free groups, at most some hundreds, costliest first.
    pub free: Vec<FreeGroup>,
    /// Groups of the iteration that have been claimed.
    pub taken: usize,
    /// All groups, costliest first.
    pub by_cost: Vec<u32>,
}

/// Picks a group of an offer.
pub type Choose<'c> = dyn FnMut(&Offer, &mut dyn FnMut(u32) -> Result<Held>) -> Result<Option<u32>> + 'c;

/// What came of claiming a certain group.
#[derive(Clone, Debug, PartialEq)]
pub enum GroupClaim {
    /// It is ours.
    Granted(Lease),
    /// It has been solved in this iteration.
    Done,
    /// Another process solves it, or must first solve one that comes before it.
    Held {
        /// Its pid, if it is being solved.
        pid: Option<u32>,
    },
    /// Its workers died [`DEATHS`] times.
    Failed,
    /// There is no such group.
    Unknown,
}

/// A new extent of a cluster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpdateRow {
    /// The cluster.
    pub cluster: ClusterId,
    /// Radiosity or links.
    pub kind: ExtentKind,
    /// Whether links are a delta; `false` for radiosity.
    pub delta: bool,
    /// Where it lies.
    pub at: ExtentRef,
}

impl Store {
    /// Claims the free group that `choose` picks; `None` if none is free or it picks none. It may ask who holds a group's
    /// clusters.
    pub fn claim(&self, iteration: &Iteration, worker: &Worker<'_>, choose: &mut Choose<'_>) -> Result<Option<Lease>> {
        self.note(|tx| {
            self.void_dead_leases(tx, iteration)?;
            let group = match in_turn(tx, iteration)? {
                Turn::Any => choose(&offer(tx, iteration)?, &mut |group| held(tx, worker, group))?,
                Turn::Only(group) => Some(group),
            };
            group.map_or(Ok(None), |group| grant(tx, iteration, worker, group))
        })
    }

    /// Claims one group, if it is free.
    pub fn claim_group(&self, iteration: &Iteration, worker: &Worker<'_>, group: u32) -> Result<GroupClaim> {
        self.note(|tx| {
            self.void_dead_leases(tx, iteration)?;
            let row: Option<(String, Option<u32>)> = tx
                .query_row(
                    "SELECT state, worker_pid FROM tasks WHERE branch = ?1 AND iteration = ?2 AND group_id = ?3",
                    params![iteration.branch, iteration.number, group],
                    |r| Ok((r.get(0)?, r.get(1)?)),
                )
                .optional()?;
            let Some((state, pid)) = row else { return Ok(GroupClaim::Unknown) };
            Ok(match state.as_str() {
                "free" => match in_turn(tx, iteration)? {
                    Turn::Only(first) if first != group => GroupClaim::Held { pid: None },
                    _ => {
                        grant(tx, iteration, worker, group)?.map_or(GroupClaim::Held { pid: None }, GroupClaim::Granted)
                    }
                },
                "running" => GroupClaim::Held { pid },
                "failed" => GroupClaim::Failed,
                _ => GroupClaim::Done,
            })
        })
    }

    /// Frees the tasks of workers that are gone; after [`DEATHS`] deaths a task has failed.
    pub fn release_dead(&self, iteration: &Iteration) -> Result<()> {
        self.note(|tx| self.void_dead_leases(tx, iteration))
    }

    fn void_dead_leases(&self, tx: &Transaction<'_>, iteration: &Iteration) -> Result<()> {
        let mut query = tx.prepare_cached(
            "SELECT id, segment FROM tasks WHERE state = 'running' AND branch = ?1 AND iteration = ?2",
        )?;
        let running: Vec<(i64, Option<u32>)> = query
            .query_map(params![iteration.branch, iteration.number], |r| Ok((r.get(0)?, r.get(1)?)))?
            .collect::<std::result::Result<_, _>>()?;
        for (task, segment) in running {
            if segment_is_free(self, tx, segment)? {
                tx.execute(
                    "UPDATE tasks SET deaths = deaths + 1, worker = NULL, worker_pid = NULL, segment = NULL,
                        state = CASE WHEN deaths + 1 >= ?2 THEN 'failed' ELSE 'free' END WHERE id = ?1",
                    params![task, DEATHS],
                )?;
            }
        }
        Ok(())
    }

    /// Gives a lease back, as when interrupted.
    pub fn give_back(&self, lease: &Lease, worker: &Worker<'_>) -> Result<()> {
        self.note(|tx| {
            tx.execute(
                "UPDATE tasks SET state = 'free', worker = NULL, worker_pid = NULL, segment = NULL
                 WHERE id = ?1 AND state = 'running' AND worker = ?2 AND attempt = ?3",
                params![lease.task, worker.id(), lease.attempt],
            )?;
            Ok(())
        })
    }

    /// Publishes a task's update: brings the worker's segment to the disk, then inserts the rows and
    /// marks the task done at once, if the lease still holds. `false` if it does not: nothing is
    /// published.
    pub fn publish(
        &self,
        lease: &Lease,
        worker: &mut Worker<'_>,
        rows: &[UpdateRow],
        report: &TaskReport,
    ) -> Result<bool> {
        worker.segment.sync()?;
        let _publishing = PublishLock::take(self)?;
        self.write(|tx| {
            let held = tx.execute(
                "UPDATE tasks SET state = 'done', finished_at = unixepoch('subsec'), report = ?4
                 WHERE id = ?1 AND state = 'running' AND worker = ?2 AND attempt = ?3",
                params![lease.task, worker.id(), lease.attempt, report.encode()],
            )?;
            if held == 0 {
                return Ok(false);
            }
            let mut put = tx.prepare_cached("INSERT INTO updates VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)")?;
            for row in rows {
                let at = row.at;
                put.execute(params![
                    lease.task,
                    row.cluster.0,
                    row.kind as u16,
                    row.delta,
                    at.segment,
                    at.offset,
                    at.bytes
                ])?;
            }
            worker.segment.publish(tx)?;
            Ok(true)
        })
    }

    /// Gives failed tasks, and those whose workers died, another chance: for a new run.
    pub fn forgive_deaths(&self) -> Result<()> {
        self.write(|tx| {
            tx.execute("UPDATE tasks SET state = 'free' WHERE state = 'failed'", [])?;
            tx.execute("UPDATE tasks SET deaths = 0 WHERE state <> 'merged'", [])?;
            Ok(())
        })
    }
}

/// Which groups may be claimed now.
enum Turn {
    Any,
    Only(u32),
}

/// In sequential order only the first group that is not merged has its turn.
fn in_turn(tx: &Transaction<'_>, iteration: &Iteration) -> Result<Turn> {
    let first: Option<(u32, String)> = tx
        .prepare_cached(
            "SELECT group_id, update_order FROM tasks WHERE branch = ?1 AND iteration = ?2 AND state <> 'merged'
             ORDER BY group_id LIMIT 1",
        )?
        .query_row(params![iteration.branch, iteration.number], |r| Ok((r.get(0)?, r.get(1)?)))
        .optional()?;
    Ok(match first {
        Some((group, order)) if order == UpdateOrder::Sequential.name() => Turn::Only(group),
        _ => Turn::Any,
    })
}

fn offer(tx: &Transaction<'_>, iteration: &Iteration) -> Result<Offer> {
    let key = params![iteration.branch, iteration.number];
    let mut query = tx.prepare_cached(
        "SELECT t.group_id, g.predicted_cost FROM tasks t JOIN groups g ON g.id = t.group_id
         WHERE t.state = 'free' AND t.branch = ?1 AND t.iteration = ?2
         ORDER BY g.predicted_cost DESC, g.id LIMIT ?3",
    )?;
    let free = query
        .query_map(params![iteration.branch, iteration.number, OFFERED], |r| {
            Ok(FreeGroup { group: r.get(0)?, cost: r.get(1)? })
        })?
        .collect::<std::result::Result<_, _>>()?;
    let taken = tx.query_row(
        "SELECT count(*) FROM tasks WHERE branch = ?1 AND iteration = ?2 AND state <> 'free'",
        key,
        |r| r.get(0),
    )?;
    let mut query = tx.prepare_cached("SELECT id FROM groups ORDER BY predicted_cost DESC, id")?;
    let by_cost = query.query_map([], |r| r.get(0))?.collect::<std::result::Result<_, _>>()?;
    Ok(Offer { free, taken, by_cost })
}

/// Who holds a group's clusters. They are few, what workers hold is much: so each cluster is looked up there.
fn held(tx: &Transaction<'_>, worker: &Worker<'_>, group: u32) -> Result<Held> {
    let mut query = tx.prepare_cached(
        "SELECT avg(here), avg(NOT here AND EXISTS (SELECT 1 FROM residency WHERE cluster = id AND worker <> ?2))
         FROM (SELECT id, EXISTS (SELECT 1 FROM residency WHERE worker = ?2 AND cluster = id) AS here
               FROM clusters WHERE group_id = ?1)",
    )?;
    Ok(query.query_row(params![group, worker.id()], |r| Ok(Held { here: r.get(0)?, elsewhere: r.get(1)? }))?)
}

/// Marks a free task as the worker's. Tasks that may read what others wrote read the newest version.
fn grant(tx: &Transaction<'_>, iteration: &Iteration, worker: &Worker<'_>, group: u32) -> Result<Option<Lease>> {
    let task: Option<(i64, String, u64, u32)> = tx
        .query_row(
            "SELECT id, update_order, base_version, attempt FROM tasks
             WHERE branch = ?1 AND iteration = ?2 AND group_id = ?3 AND state = 'free'",
            params![iteration.branch, iteration.number, group],
            |r| Ok((r.get(0)?, r.get(1)?, r.get(2)?, r.get(3)?)),
        )
        .optional()?;
    let Some((task, order, base, attempt)) = task else { return Ok(None) };
    let order: UpdateOrder =
        order.parse().map_err(|e: String| Error::damaged(std::path::Path::new(super::sql::CATALOGUE), e))?;
    let base_version = match order {
        UpdateOrder::Jacobi => base,
        UpdateOrder::Replace | UpdateOrder::Sequential => newest_of(tx, iteration.branch)?.id,
    };
    tx.execute(
        "UPDATE tasks SET state = 'running', attempt = ?2, worker = ?3, worker_pid = ?4, segment = ?5,
            base_version = ?6, claimed_at = unixepoch('subsec') WHERE id = ?1",
        params![task, attempt + 1, worker.id(), std::process::id(), worker.segment.id(), base_version],
    )?;
    Ok(Some(Lease { task, attempt: attempt + 1, group, base_version }))
}
