//! `status`: where am I, what is running, what next.

use serde::Serialize;

use crate::base::Result;
use crate::base::text::for_shell;
use crate::store::processes::ProcessRow;
use crate::store::{Stage, Store};

/// A stage and whether its results can be used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct StageState {
    /// As typed.
    pub name: &'static str,
    /// `done`, `missing` or `out of date`.
    pub state: &'static str,
}

/// Where the store stands. Of a store without a model all is empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Whether the newest branch has converged.
    pub converged: bool,
    /// Newest version.
    pub version: Option<u64>,
    /// Newest branch.
    pub branch: Option<u64>,
    /// Iteration under way, or the last one.
    pub iteration: Option<u64>,
    /// The stages, in order.
    pub stages: Vec<StageState>,
    /// Groups solved in the iteration under way.
    pub groups_done: u64,
    /// Groups.
    pub groups_total: u64,
    /// Change of irradiance between the last two ends of iterations.
    pub residual: Option<f64>,
    /// Who works on the store.
    pub processes: Vec<ProcessRow>,
    /// The command to type next.
    pub next: Option<String>,
}

impl super::summary::Summary for Summary {
    fn lines(&self) -> Vec<String> {
        let stages: Vec<String> = self.stages.iter().map(|s| format!("{} {}", s.name, s.state)).collect();
        let mut lines = vec![stages.join(", ")];
        if let (Some(version), Some(branch), Some(iteration)) = (self.version, self.branch, self.iteration) {
            let residual = self.residual.map_or(String::new(), |r| format!(", residual {r:.2e}"));
            let converged = if self.converged { ", converged" } else { "" };
            lines.push(format!(
                "version {version}, branch {branch}, iteration {iteration}: {} of {} groups{residual}{converged}",
                self.groups_done, self.groups_total
            ));
        }
        for p in &self.processes {
            lines.push(format!("pid {} on {} since {}: {}", p.pid, p.host, p.since, p.command));
        }
        lines
    }
}

/// Reads where the store stands.
pub fn read(store: &Store) -> Result<Summary> {
    look(store).map_err(|error| store.named(error))
}

fn look(store: &Store) -> Result<Summary> {
    let stages = [Stage::Ingest, Stage::Visibility, Stage::Partition]
        .into_iter()
        .map(|stage| {
            let state = match (store.require_stage(stage), store.stage(stage)?) {
                (Ok(_), _) => "done",
                (Err(_), Some(_)) => "out of date",
                (Err(_), None) => "missing",
            };
            Ok(StageState { name: stage.name(), state })
        })
        .collect::<Result<Vec<_>>>()?;
    let dir = for_shell(store.dir());
    let processes = store.processes()?;
    let undone = stages.iter().find(|s| s.state != "done").map(|s| s.name);
    let model = if undone == Some("ingest") { Stage::Ingest.takes() } else { "" };
    let mut summary = Summary {
        next: undone.map(|name| format!("clerestory {name} {dir}{model}")),
        processes,
        stages,
        ..Summary::default()
    };
    if store.facts_if_any()?.is_none() {
        return Ok(summary);
    }
    let branch = store.newest_branch()?;
    let newest = store.newest_of_branch(branch)?;
    let end = store.newest_end_of_branch(branch)?;
    let iteration = store.iteration_under_way(branch)?;
    let counts = iteration.map(|i| store.task_counts(branch, i)).transpose()?;
    let end_row = store.version(end)?;
    summary.converged = end_row.as_ref().is_some_and(|row| row.converged && row.branch == branch);
    summary.version = Some(newest.id);
    summary.branch = Some(branch);
    summary.iteration = Some(iteration.unwrap_or(newest.iteration));
    summary.residual = end_row.and_then(|row| row.residual);
    summary.groups_total = store.group_count()?;
    summary.groups_done = match counts {
        Some(counts) => counts.done + counts.merged,
        None if newest.iteration > 0 => summary.groups_total,
        None => 0,
    };
    if summary.next.is_none() {
        // Updates of two branches cannot be merged: going on with one drops those of the other.
        let one_waits = store.branches_to_merge()?.len() < 2;
        let all_done = one_waits && counts.is_some_and(|c| c.free + c.running + c.failed == 0);
        summary.next = Some(match (summary.converged, all_done) {
            (true, _) => format!("clerestory render {dir} -o picture.png"),
            (false, true) => format!("clerestory merge {dir}"),
            (false, false) => format!("clerestory solve-group {dir} --until-done"),
        });
    }
    Ok(summary)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::order::UpdateOrder;
    use crate::store::{ProcessGuard, fixture};

    #[test]
    fn status_names_the_next_command_at_every_step() {
        let dir = tempfile::tempdir().unwrap();
        let next = |store: &Store| {
            let next = read(store).unwrap().next.unwrap();
            next.split(' ').nth(1).unwrap().to_owned()
        };
        let store = Store::create(&dir.path().join("a.clr"), std::time::Duration::ZERO).unwrap();
        assert_eq!(next(&store), "ingest");
        let store = fixture::store(&dir.path().join("b.clr"), 4);
        assert_eq!(next(&store), "visibility");
        fixture::partition(&store, 2);
        assert_eq!(next(&store), "solve-group");
        fixture::solve_all(&store, UpdateOrder::Jacobi, 1.0);
        assert_eq!(next(&store), "merge");
        let guard = ProcessGuard::enter(&store, "clerestory sample", Some(0)).unwrap();
        let status = read(&store).unwrap();
        assert_eq!((status.groups_done, status.groups_total, status.iteration), (2, 2, Some(1)));
        assert_eq!(status.processes[0].command, "clerestory sample");
        drop(guard);
        assert!(read(&store).unwrap().processes.is_empty());
    }
}
