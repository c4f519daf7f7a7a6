//! What a replay comes to, and which part of it costs most.

use serde::Serialize;

/// Times of all workers added up, but for the makespan, `master_busy_s` and `merge_s`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// How many.
    pub workers: usize,
    /// From the first download to the end of the last iteration, s.
    pub makespan_s: f64,
    /// Solving, s.
    pub work_s: f64,
    /// Waiting for first bytes, s.
    pub latency_s: f64,
    /// Moving bytes, and waiting for the line where the master is asynchronous, s.
    pub moving_s: f64,
    /// Waiting for a synchronous master, s.
    pub waiting_s: f64,
    /// From a worker's last task to the end of an iteration, s.
    pub end_idle_s: f64,
    /// The part of it in iterations with a task longer than a worker's share of all, s.
    pub longest_idle_s: f64,
    /// Merging, s.
    pub merge_s: f64,
    /// The master's, s.
    pub master_busy_s: f64,
    /// To workers.
    pub download_bytes: u64,
    /// From workers.
    pub upload_bytes: u64,
}

/// A replayed task: a line of the timeline. Times are s since the first download began.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Visit {
    /// How many.
    pub workers: usize,
    /// Which of them, from 0.
    pub worker: usize,
    /// As recorded.
    pub iteration: u64,
    /// Its number.
    pub group: u32,
    /// When what the worker lacks begins to come.
    pub download_begin_s: f64,
    /// When solving begins.
    pub begin_s: f64,
    /// When it ends.
    pub end_s: f64,
    /// What the worker lacked.
    pub download_bytes: u64,
    /// What it wrote.
    pub upload_bytes: u64,
}

/// Below this share of all workers' time a loss is none.
const LEAST_LOSS: f64 = 1e-3;

/// A line of the table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// How many.
    pub workers: usize,
    /// s.
    pub makespan_s: f64,
    /// Time of all tasks over the makespan.
    pub speedup: f64,
    /// Speedup over workers.
    pub share_of_linear: f64,
    /// To workers.
    pub download_bytes: u64,
    /// From workers.
    pub upload_bytes: u64,
    /// Of all workers' time: moving data, latencies included.
    pub transfer_share: f64,
    /// Of all workers' time: waiting for a synchronous master.
    pub waiting_share: f64,
    /// Of all workers' time: waiting for the ends of iterations.
    pub end_idle_share: f64,
    /// Of the makespan.
    pub master_busy_share: f64,
    /// What costs most.
    pub next_bottleneck: &'static str,
}

impl Outcome {
    /// Shares and names.
    pub fn row(&self) -> Row {
        let all_s = self.makespan_s * self.workers as f64;
        let share = |time_s: f64| time_s / all_s;
        Row {
            workers: self.workers,
            makespan_s: self.makespan_s,
            speedup: self.work_s / self.makespan_s,
            share_of_linear: share(self.work_s),
            download_bytes: self.download_bytes,
            upload_bytes: self.upload_bytes,
            transfer_share: share(self.latency_s + self.moving_s),
            waiting_share: share(self.waiting_s),
            end_idle_share: share(self.end_idle_s),
            master_busy_share: self.master_busy_s / self.makespan_s,
            next_bottleneck: self.bottleneck(all_s),
        }
    }

    /// The largest loss of time, of equal ones the first.
    fn bottleneck(&self, all_s: f64) -> &'static str {
        let losses = [
            ("longest group", self.longest_idle_s),
            ("bandwidth", self.moving_s),
            ("latency", self.latency_s),
            ("master", self.waiting_s),
            ("merge", self.merge_s * self.workers as f64),
            ("end-of-iteration idle", self.end_idle_s - self.longest_idle_s),
        ];
        let largest_s = losses.iter().fold(LEAST_LOSS * all_s, |most, loss| most.max(loss.1));
        losses.iter().find(|loss| loss.1 > 0.0 && loss.1 >= largest_s).map_or("none", |loss| loss.0)
    }
}
