//! Work on numbered items by several threads; its results come in the items' order, whatever thread was first.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Sender, channel};

use super::{Progress, Result};

/// Threads that work together.
#[derive(Clone, Copy)]
pub struct Crew<'a> {
    /// How many; at least one works.
    pub threads: usize,
    /// Counts the items whose results have come, and tells when to stop.
    pub progress: &'a dyn Progress,
}

/// The items that are left, as one thread sees them.
pub struct Turns<'a, T> {
    next: &'a AtomicUsize,
    count: usize,
    done: Sender<Result<(usize, T)>>,
    progress: &'a dyn Progress,
}

impl<T> Turns<'_, T> {
    /// Calls `work` with one item after the other while any are left.
    pub fn each(&self, mut work: impl FnMut(usize) -> Result<T>) -> Result<()> {
        loop {
            let at = self.next.fetch_add(1, Ordering::Relaxed);
            if at >= self.count {
                return Ok(());
            }
            self.progress.go_on()?;
            if self.done.send(Ok((at, work(at)?))).is_err() {
                return Ok(()); // nobody waits for results any more
            }
        }
    }
}

impl Crew<'_> {
    /// Works on items `0..count`. Each thread calls `work` once, which opens what it needs and then takes its turns;
    /// `found` gets every result, in order, on the calling thread. The first failure ends it.
    pub fn in_order<T: Send>(
        self,
        count: usize,
        work: impl Fn(&Turns<'_, T>) -> Result<()> + Sync,
        mut found: impl FnMut(usize, T) -> Result<()>,
    ) -> Result<()> {
        let (next, progress) = (AtomicUsize::new(0), self.progress);
        std::thread::scope(|scope| {
            let (done, results) = channel();
            for _ in 0..self.threads.max(1) {
                let turns = Turns { next: &next, count, done: done.clone(), progress };
                let work = &work;
                scope.spawn(move || {
                    if let Err(error) = work(&turns) {
                        let _ = turns.done.send(Err(error)); // unless another has failed before
                    }
                });
            }
            drop(done);
            let (mut early, mut due) = (BTreeMap::new(), 0);
            let mut take = |(at, item)| {
                early.insert(at, item);
                while let Some(item) = early.remove(&due) {
                    found(due, item)?;
                    due += 1;
                    progress.at(due as u64);
                }
                Ok(())
            };
            let taken = results.into_iter().try_for_each(|result| result.and_then(&mut take));
            next.store(count, Ordering::Relaxed);
            taken
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{Error, Quiet};

    const CREW: Crew<'_> = Crew { threads: 4, progress: &Quiet };

    #[test]
    fn results_come_in_order_whatever_thread_is_first() {
        let mut squares = Vec::new();
        let work = |turns: &Turns<'_, usize>| {
            turns.each(|at| {
                std::thread::sleep(std::time::Duration::from_micros(if at % 4 == 0 { 500 } else { 0 }));
                Ok(at * at)
            })
        };
        let found = |at, square| {
            squares.push((at, square));
            Ok(())
        };
        CREW.in_order(100, work, found).unwrap();
        assert_eq!(squares, (0..100).map(|at| (at, at * at)).collect::<Vec<_>>());
    }

    #[test]
    fn a_failure_of_a_thread_or_of_who_takes_results_ends_the_work() {
        let failure = || Error::failed("7 is bad", "leave it out");
        let failing = |turns: &Turns<'_, usize>| turns.each(|at| if at == 7 { Err(failure()) } else { Ok(at) });
        let error = CREW.in_order(usize::MAX / 2, failing, |_, _| Ok(())).unwrap_err();
        assert_eq!(error.to_string(), "7 is bad");
        let taking = |at, _| if at == 7 { Err(failure()) } else { Ok(()) };
        let error = CREW.in_order(usize::MAX / 2, |turns| turns.each(Ok), taking).unwrap_err();
        assert_eq!(error.to_string(), "7 is bad");
    }
}
