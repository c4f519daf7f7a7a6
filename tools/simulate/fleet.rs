//! What workers hold: which version of which cluster, and whose links.

use super::recording::{Group, Iteration, Recording};

/// Workers hold what they have downloaded for as long as they live, as in the paper.
pub struct Fleet<'r> {
    recording: &'r Recording,
    /// By worker and cluster: the version held, 0 if none.
    held: Vec<Vec<u16>>,
    /// By cluster: how many workers hold it in any version.
    holders: Vec<u16>,
    /// By cluster: the newest version, from 1.
    newest: Vec<u16>,
    /// By group: who solved it last, and so has its links.
    solver: Vec<Option<usize>>,
}

impl<'r> Fleet<'r> {
    /// Workers that hold nothing.
    pub fn new(recording: &'r Recording, workers: usize) -> Self {
        let clusters = recording.fixed_bytes.len();
        Self {
            recording,
            held: vec![vec![0; clusters]; workers],
            holders: vec![0; clusters],
            newest: vec![1; clusters],
            solver: vec![None; recording.groups.len()],
        }
    }

    /// Shares of a group's own clusters that a worker holds, and that only others hold: what `store/tasks.rs` offers
    /// to a schedule, whatever the version.
    pub fn shares(&self, worker: usize, group: &Group) -> (f64, f64) {
        let (mut here, mut elsewhere) = (0u32, 0u32);
        for &cluster in &group.own {
            if self.held[worker][cluster] > 0 {
                here += 1;
            } else if self.holders[cluster] > 0 {
                elsewhere += 1;
            }
        }
        let all = group.own.len().max(1) as f64;
        (f64::from(here) / all, f64::from(elsewhere) / all)
    }

    /// Brings to a worker what a task reads and it lacks; how many bytes those are.
    pub fn download(&mut self, worker: usize, iteration: &Iteration, task: usize) -> u64 {
        let task = &iteration.tasks[task];
        let mut bytes = if self.solver[task.group] == Some(worker) { 0 } else { task.links_bytes };
        for &cluster in &self.recording.groups[task.group].visible {
            let held = &mut self.held[worker][cluster];
            if *held == 0 {
                bytes += self.recording.fixed_bytes[cluster];
                self.holders[cluster] += 1;
            }
            if *held != self.newest[cluster] {
                bytes += iteration.light_bytes[cluster];
                *held = self.newest[cluster];
            }
        }
        self.solver[task.group] = Some(worker);
        bytes
    }

    /// Makes a version of a group's clusters, which the worker that solved it holds.
    pub fn publish(&mut self, worker: usize, group: usize) {
        for &cluster in &self.recording.groups[group].own {
            self.newest[cluster] += 1;
            let held = &mut self.held[worker][cluster];
            self.holders[cluster] += u16::from(*held == 0);
            *held = self.newest[cluster];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::tests::recording;

    #[test]
    fn geometry_comes_once_light_when_it_changed_and_links_from_who_solved_last() {
        // Groups 0 and 1 of a cluster each, of 100 bytes of geometry, 10 of light and 1 of links; each sees both.
        let two = recording(&[&[1.0, 1.0]]);
        let first = &two.iterations[0];
        let mut fleet = Fleet::new(&two, 2);
        assert_eq!(fleet.download(0, first, 0), 2 * 110 + 1, "everything");
        assert_eq!(fleet.download(0, first, 1), 1, "the links alone");
        assert_eq!(fleet.shares(0, &two.groups[0]), (1.0, 0.0));
        assert_eq!(fleet.shares(1, &two.groups[0]), (0.0, 1.0));
        fleet.publish(0, 0);
        assert_eq!(fleet.download(0, first, 0), 0, "who solves a cluster holds its newest version");
        assert_eq!(fleet.download(1, first, 0), 2 * 110 + 1);
        fleet.publish(1, 0);
        assert_eq!(fleet.download(0, first, 0), 10 + 1, "light that changed, links that another made");
    }
}
