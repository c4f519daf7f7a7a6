//! What a store recorded of a run: what each task read, wrote and took. Read-only.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use clerestory::base::text::{for_shell, shown};
use clerestory::base::{ClusterId, Error, Result};
use clerestory::model::ExtentKind;
use clerestory::model::order::UpdateOrder;
use clerestory::model::visibility::VisibilityView;
use clerestory::store::merging::TaskRow;
use clerestory::store::partition_rows::GroupRow;
use clerestory::store::{Snapshot, Stage, Store};

use super::args::Time;

/// A run. Clusters and groups are meant by their places in the lists.
pub struct Recording {
    /// By number.
    pub groups: Vec<Group>,
    /// By cluster: bytes of its geometry, rays and materials.
    pub fixed_bytes: Vec<u64>,
    /// In order.
    pub iterations: Vec<Iteration>,
}

/// A group of clusters.
#[derive(Clone)]
pub struct Group {
    /// Its number.
    pub id: u32,
    /// Predicted, any unit.
    pub cost: f64,
    /// Its clusters.
    pub own: Vec<usize>,
    /// Clusters that any of them may exchange light with, and they themselves: the working set.
    pub visible: Vec<usize>,
}

/// An iteration.
#[derive(Clone)]
pub struct Iteration {
    /// Its number, from 1.
    pub number: u64,
    /// Whether updates are versions at once (copy-update-replace), not all together at the end.
    pub replaces: bool,
    /// By cluster: bytes of its light.
    pub light_bytes: Vec<u64>,
    /// By group.
    pub tasks: Vec<Task>,
}

/// A visit to a group.
#[derive(Clone)]
pub struct Task {
    /// Which.
    pub group: usize,
    /// What solving takes, s.
    pub time_s: f64,
    /// Bytes of the links of its clusters, before the visit.
    pub links_bytes: u64,
    /// Bytes that the visit wrote.
    pub upload_bytes: u64,
}

impl Recording {
    /// Puts everything in order, so that nothing follows from the order it came in.
    pub fn new(mut groups: Vec<Group>, fixed_bytes: Vec<u64>, mut iterations: Vec<Iteration>) -> Self {
        // Tasks know groups by place.
        let mut places: Vec<usize> = (0..groups.len()).collect();
        places.sort_by_key(|&place| groups[place].id);
        let mut new_place = vec![0; groups.len()];
        for (new, &old) in places.iter().enumerate() {
            new_place[old] = new;
        }
        groups.sort_by_key(|group| group.id);
        for iteration in &mut iterations {
            iteration.tasks.iter_mut().for_each(|task| task.group = new_place[task.group]);
            iteration.tasks.sort_by_key(|task| task.group);
        }
        Self { groups, fixed_bytes, iterations }
    }

    /// Reads the newest branch of a store: its iterations that have been solved to the end, with the groups it has now.
    pub fn read(dir: &Path, time: Time) -> Result<Self> {
        let store = Store::open(dir, Duration::from_secs(5))?;
        read(&store, time).map_err(|error| store.named(error))
    }

    /// Time of all tasks, s.
    pub fn work_s(&self) -> f64 {
        self.iterations.iter().flat_map(|iteration| &iteration.tasks).map(|task| task.time_s).sum()
    }

    /// Number of tasks.
    pub fn tasks(&self) -> usize {
        self.iterations.iter().map(|iteration| iteration.tasks.len()).sum()
    }
}

fn read(store: &Store, time: Time) -> Result<Recording> {
    let partition_hash = store.require_stage(Stage::Partition)?.chain_hash();
    store.require_sealed_rows()?;
    let newest = Snapshot::newest(store)?;
    let ids: Vec<ClusterId> = newest.clusters().map(|cluster| cluster.map(|c| c.id)).collect::<Result<_>>()?;
    let fixed = [ExtentKind::Geometry, ExtentKind::Rays, ExtentKind::Materials];
    let fixed_bytes = |&id: &ClusterId| fixed.iter().map(|&kind| bytes(&newest, kind, id)).sum();
    let fixed_bytes = ids.iter().map(fixed_bytes).collect::<Result<Vec<u64>>>()?;
    let groups = groups(&newest, &ids)?;
    let kept: BTreeSet<u64> = store.kept_versions()?.into_iter().collect();
    let branch = store.newest_branch()?;
    let mut iterations = Vec::new();
    for number in 1..=store.newest_of_branch(branch)?.iteration {
        let rows = store.tasks(branch, number)?;
        let is_solved = |row: &TaskRow| row.report.is_some() && row.partition_hash == partition_hash;
        if rows.is_empty() || rows.len() != groups.len() || !rows.iter().all(is_solved) {
            continue;
        }
        if rows[0].order == UpdateOrder::Sequential {
            return Err(sequential(store));
        }
        // Light and links of a version that `gc` took count as large as they are now.
        let base = rows.iter().map(|row| row.base_version).min().filter(|base| kept.contains(base));
        let snapshot = base.map_or_else(|| Snapshot::newest(store), |base| Snapshot::at(store, base))?;
        iterations.push(iteration(&snapshot, (&ids, &groups), &rows, time)?);
    }
    let recording = Recording::new(groups, fixed_bytes, iterations);
    if recording.work_s() > 0.0 { Ok(recording) } else { Err(unsolved(store)) }
}

fn bytes(snapshot: &Snapshot<'_>, kind: ExtentKind, cluster: ClusterId) -> Result<u64> {
    Ok(snapshot.place(kind, cluster)?.map_or(0, |at| at.bytes))
}

fn iteration(
    before: &Snapshot<'_>,
    (ids, groups): (&[ClusterId], &[Group]),
    rows: &[TaskRow],
    time: Time,
) -> Result<Iteration> {
    let light_bytes = ids.iter().map(|&id| bytes(before, ExtentKind::Radiosity, id)).collect::<Result<Vec<u64>>>()?;
    // Groups and tasks come by number, and a group has one task.
    let tasks = rows.iter().zip(groups).enumerate().map(|(place, (row, group))| {
        let used = row.report.as_ref().map(|report| report.used).unwrap_or_default();
        let time_s = if time == Time::Cpu { used.cpu_s } else { row.wall_s.unwrap_or_default() };
        let links_bytes = group.own.iter().map(|&cluster| before.links_bytes(ids[cluster])).sum::<Result<u64>>()?;
        // A clock that was set back makes no time negative.
        Ok(Task { group: place, time_s: time_s.max(0.0), links_bytes, upload_bytes: used.bytes_written })
    });
    let replaces = rows[0].order == UpdateOrder::Replace;
    Ok(Iteration { number: rows[0].iteration, replaces, light_bytes, tasks: tasks.collect::<Result<_>>()? })
}

fn groups(snapshot: &Snapshot<'_>, ids: &[ClusterId]) -> Result<Vec<Group>> {
    let place: BTreeMap<u32, usize> = ids.iter().enumerate().map(|(place, id)| (id.0, place)).collect();
    let seen = |id: ClusterId| -> Result<Vec<u32>> {
        let list = snapshot.need(ExtentKind::Visibility, id)?;
        Ok(list.parse(VisibilityView::parse)?.clusters.iter().map(|seen| seen.cluster).collect())
    };
    let group = |row: GroupRow| {
        let own = snapshot.store().clusters_of(row.id)?;
        let mut visible: BTreeSet<u32> = own.iter().map(|id| id.0).collect();
        for &id in &own {
            visible.extend(seen(id)?);
        }
        let places = |ids: &mut dyn Iterator<Item = u32>| ids.filter_map(|id| place.get(&id).copied()).collect();
        let (own, visible) = (places(&mut own.iter().map(|id| id.0)), places(&mut visible.into_iter()));
        Ok(Group { id: row.id, cost: row.predicted_cost, own, visible })
    };
    snapshot.store().groups()?.into_iter().map(group).collect()
}

fn unsolved(store: &Store) -> Error {
    Error::StageMissing {
        message: format!("{}: no iteration has been solved to its end with the groups it has", shown(store.dir())),
        help: format!("run `clerestory run {}` first", for_shell(store.dir())),
    }
}

fn sequential(store: &Store) -> Error {
    Error::Usage {
        message: format!("{}: solved with `--order sequential`, one group after the other", shown(store.dir())),
        help: "solve with `--order jacobi` or `--order replace`, which leave something to schedule".to_owned(),
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A run of iterations whose tasks take so long, s. Each group has one cluster, of 100 bytes, 10 of light and 1 of
    /// links, and sees the next group's; a visit writes 20 bytes. The cost is the time of the first visit.
    pub fn recording(times_s: &[&[f64]]) -> Recording {
        let count = times_s[0].len();
        let group = |i: usize| {
            let visible = BTreeSet::from([i, (i + 1) % count]).into_iter().collect();
            Group { id: i as u32, cost: times_s[0][i], own: vec![i], visible }
        };
        let iterations = (1..).zip(times_s).map(|(number, times_s)| {
            let task = |(group, &time_s)| Task { group, time_s, links_bytes: 1, upload_bytes: 20 };
            let tasks = times_s.iter().enumerate().map(task).collect();
            Iteration { number, replaces: false, light_bytes: vec![10; count], tasks }
        });
        Recording::new((0..count).map(group).collect(), vec![100; count], iterations.collect())
    }
}
