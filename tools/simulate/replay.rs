//! Replays a recording for a number of workers, with the policy that real workers ask.

use std::collections::BTreeSet;

use clerestory::model::free_group::{FreeGroup, Held};
use clerestory::partition::schedule::{Policy, choose};
use clerestory::store::tasks::OFFERED;

use super::args::Master;
use super::fleet::Fleet;
use super::line::{Costs, Exchange, Line};
use super::outcome::{Outcome, Visit};
use super::recording::{Iteration, Recording};

/// How to replay.
#[derive(Clone, Copy)]
pub struct Settings {
    /// Which group a free worker takes.
    pub policy: Policy,
    /// How data moves.
    pub master: Master,
    /// What that costs.
    pub costs: Costs,
    /// Master's time after each iteration, s.
    pub merge_s: f64,
}

/// Replays a recording for `workers` workers, who hold nothing at first.
pub fn replay(recording: &Recording, settings: Settings, workers: usize) -> Outcome {
    let replay = replayed(recording, settings, workers);
    Outcome { master_busy_s: replay.line.busy_s() + replay.outcome.merge_s, ..replay.outcome }
}

/// What each of `workers` workers does when in such a replay, in the order in which tasks are taken.
pub fn timeline(recording: &Recording, settings: Settings, workers: usize) -> Vec<Visit> {
    replayed(recording, settings, workers).visits
}

fn replayed(recording: &Recording, settings: Settings, workers: usize) -> Replay<'_> {
    let mut by_cost: Vec<usize> = (0..recording.groups.len()).collect();
    by_cost.sort_by(|&a, &b| recording.groups[b].cost.total_cmp(&recording.groups[a].cost).then(a.cmp(&b)));
    let ids = by_cost.iter().map(|&group| recording.groups[group].id).collect();
    let mut replay = Replay {
        recording,
        settings,
        by_cost,
        ids,
        fleet: Fleet::new(recording, workers),
        line: Line::new(settings.master, settings.costs),
        outcome: Outcome { workers, work_s: recording.work_s(), ..Outcome::default() },
        visits: Vec::with_capacity(recording.tasks()),
    };
    for iteration in &recording.iterations {
        replay.iteration(iteration);
    }
    replay
}

struct Replay<'r> {
    recording: &'r Recording,
    settings: Settings,
    /// Places of groups, costliest first, and their numbers.
    by_cost: Vec<usize>,
    ids: Vec<u32>,
    fleet: Fleet<'r>,
    line: Line,
    outcome: Outcome,
    visits: Vec<Visit>,
}

/// Bits of a time that is not negative: in the order of times.
fn bits(time_s: f64) -> u64 {
    time_s.to_bits()
}

impl Replay<'_> {
    /// All workers begin together, and end together when the last has delivered.
    fn iteration(&mut self, iteration: &Iteration) {
        let (begin_s, workers) = (self.outcome.makespan_s, self.outcome.workers);
        let mut free: Vec<usize> = self.by_cost.clone();
        let mut solved: Vec<Option<usize>> = vec![None; workers];
        let mut solvers = Vec::with_capacity(free.len());
        let mut ready: BTreeSet<(u64, usize)> = (0..workers).map(|worker| (bits(begin_s), worker)).collect();
        let (mut free_s, mut end_s) = (0.0, begin_s);
        while let Some((at, worker)) = ready.pop_first() {
            let update = solved[worker].take();
            if iteration.replaces
                && let Some(task) = update
            {
                self.fleet.publish(worker, iteration.tasks[task].group);
            }
            let next = self.choose(worker, &free);
            let up = update.map(|task| iteration.tasks[task].upload_bytes);
            let down = next.map(|task| self.fleet.download(worker, iteration, task));
            let exchange = self.line.exchange(f64::from_bits(at), up, down);
            self.count(&exchange, up, down);
            end_s = exchange.free_s.max(exchange.delivered_s).max(end_s);
            match next {
                Some(task) => {
                    free.retain(|&group| group != task);
                    solvers.push((worker, task));
                    solved[worker] = next;
                    let visit = self.visit(iteration, task, (worker, &exchange, down.unwrap_or(0)));
                    ready.insert((bits(visit.end_s), worker));
                    self.visits.push(visit);
                }
                None => free_s += exchange.free_s,
            }
        }
        if !iteration.replaces {
            solvers.iter().for_each(|&(worker, task)| self.fleet.publish(worker, iteration.tasks[task].group));
        }
        self.end(iteration, workers as f64 * end_s - free_s, end_s);
    }

    /// The policy's choice among free groups, which are listed costliest first. Tasks and groups have the same places.
    fn choose(&self, worker: usize, free: &[usize]) -> Option<usize> {
        let candidate = |&place: &usize| {
            let group = &self.recording.groups[place];
            FreeGroup { group: group.id, cost: group.cost }
        };
        let candidates: Vec<FreeGroup> = free.iter().take(OFFERED as usize).map(candidate).collect();
        let taken = self.ids.len() - free.len();
        let place = |id: u32| self.recording.groups.binary_search_by_key(&id, |group| group.id).ok();
        let mut held = |id: u32| {
            let shares = place(id).map(|place| self.fleet.shares(worker, &self.recording.groups[place]));
            let (here, elsewhere) = shares.unwrap_or_default();
            Ok(Held { here, elsewhere })
        };
        choose(self.settings.policy, &candidates, (taken, &self.ids), &mut held).ok().flatten().and_then(place)
    }

    fn visit(&self, iteration: &Iteration, task: usize, to: (usize, &Exchange, u64)) -> Visit {
        let ((worker, exchange, download_bytes), task) = (to, &iteration.tasks[task]);
        Visit {
            workers: self.outcome.workers,
            worker,
            iteration: iteration.number,
            group: self.recording.groups[task.group].id,
            download_begin_s: exchange.download_begin_s,
            begin_s: exchange.free_s,
            end_s: exchange.free_s + task.time_s,
            download_bytes,
            upload_bytes: task.upload_bytes,
        }
    }

    fn count(&mut self, exchange: &Exchange, up: Option<u64>, down: Option<u64>) {
        let outcome = &mut self.outcome;
        outcome.upload_bytes += up.unwrap_or(0);
        outcome.download_bytes += down.unwrap_or(0);
        outcome.latency_s += exchange.latency_s;
        match self.settings.master {
            Master::Sync => {
                outcome.waiting_s += exchange.waiting_s;
                outcome.moving_s += exchange.moving_s;
            }
            // Others wait for nothing but bytes.
            Master::Async => outcome.moving_s += exchange.waiting_s + exchange.moving_s,
        }
    }

    fn end(&mut self, iteration: &Iteration, idle_s: f64, end_s: f64) {
        let times = || iteration.tasks.iter().map(|task| task.time_s);
        let longest_s = times().fold(0.0, f64::max);
        let outcome = &mut self.outcome;
        outcome.end_idle_s += idle_s;
        if longest_s > times().sum::<f64>() / outcome.workers as f64 {
            outcome.longest_idle_s += idle_s;
        }
        outcome.merge_s += self.settings.merge_s;
        outcome.makespan_s = end_s + self.settings.merge_s;
    }
}

#[cfg(test)]
mod tests;
