//! External merge sort: records beyond the memory given go to sorted runs on disk.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};

use bytemuck::Pod;

use crate::base::{Error, Result};
use crate::formats::spool::unnamed;

/// Runs merged at once; more are merged in rounds.
const FAN_IN: usize = 64;
const READ_BYTES: usize = 64 << 10;

/// Collects records, then gives them back in order. Equal records come in any order: they are equal.
pub struct Sorter<T> {
    dir: PathBuf,
    capacity: usize,
    held: Vec<T>,
    runs: Vec<File>,
}

impl<T: Pod + Ord> Sorter<T> {
    /// An empty one; runs are unnamed files in `dir`, `memory_bytes` bounds what is held.
    #[must_use]
    pub fn new(dir: &Path, memory_bytes: u64) -> Self {
        let capacity = (memory_bytes as usize / size_of::<T>()).max(2);
        Self { dir: dir.to_path_buf(), capacity, held: Vec::new(), runs: Vec::new() }
    }

    /// Adds a record.
    pub fn push(&mut self, record: T) -> Result<()> {
        if self.held.len() == self.capacity {
            self.spill()?;
        }
        self.held.push(record);
        Ok(())
    }

    fn spill(&mut self) -> Result<()> {
        self.held.sort_unstable();
        let held = std::mem::take(&mut self.held);
        let run = self.write_run(held.iter().map(|r| Ok(*r)))?;
        self.held = held;
        self.held.clear();
        self.runs.push(run);
        Ok(())
    }

    fn write_run(&self, records: impl Iterator<Item = Result<T>>) -> Result<File> {
        let io = |e: std::io::Error| Error::io(&self.dir, &e);
        let file = unnamed(&self.dir.join("run")).map_err(io)?;
        let mut out = BufWriter::with_capacity(READ_BYTES, file);
        for record in records {
            out.write_all(bytemuck::bytes_of(&record?)).map_err(io)?;
        }
        let mut file = out.into_inner().map_err(|e| io(e.into_error()))?;
        file.rewind().map_err(io)?;
        Ok(file)
    }

    /// All records in ascending order.
    pub fn finish(mut self) -> Result<Sorted<T>> {
        if self.runs.is_empty() {
            self.held.sort_unstable();
            return Ok(Sorted::Held(self.held.into_iter()));
        }
        self.spill()?;
        self.held = Vec::new();
        while self.runs.len() > FAN_IN {
            let batch: Vec<File> = self.runs.drain(..FAN_IN).collect();
            let merged = Merge::new(batch, &self.dir)?;
            let run = self.write_run(merged)?;
            self.runs.push(run);
        }
        let runs = std::mem::take(&mut self.runs);
        Ok(Sorted::Merged(Merge::new(runs, &self.dir)?))
    }
}

/// Records in ascending order.
pub enum Sorted<T> {
    /// They fitted.
    Held(std::vec::IntoIter<T>),
    /// From runs.
    Merged(Merge<T>),
}

impl<T: Pod + Ord> Iterator for Sorted<T> {
    type Item = Result<T>;

    fn next(&mut self) -> Option<Result<T>> {
        match self {
            Self::Held(records) => records.next().map(Ok),
            Self::Merged(merge) => merge.next(),
        }
    }
}

/// Merges sorted runs.
pub struct Merge<T> {
    dir: PathBuf,
    runs: Vec<BufReader<File>>,
    heads: BinaryHeap<Reverse<(T, usize)>>,
}

impl<T: Pod + Ord> Merge<T> {
    fn new(runs: Vec<File>, dir: &Path) -> Result<Self> {
        let runs = runs.into_iter().map(|f| BufReader::with_capacity(READ_BYTES, f)).collect();
        let mut merge = Self { dir: dir.to_path_buf(), runs, heads: BinaryHeap::new() };
        for run in 0..merge.runs.len() {
            merge.advance(run)?;
        }
        Ok(merge)
    }

    fn advance(&mut self, run: usize) -> Result<()> {
        let mut record = T::zeroed();
        match self.runs[run].read_exact(bytemuck::bytes_of_mut(&mut record)) {
            Ok(()) => self.heads.push(Reverse((record, run))),
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {}
            Err(e) => return Err(Error::io(&self.dir, &e)),
        }
        Ok(())
    }
}

impl<T: Pod + Ord> Iterator for Merge<T> {
    type Item = Result<T>;

    fn next(&mut self) -> Option<Result<T>> {
        let Reverse((record, run)) = self.heads.pop()?;
        Some(self.advance(run).map(|()| record))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::sequence::mix;

    #[test]
    fn runs_on_disk_and_rounds_of_merging_give_the_order_that_memory_gives() {
        let dir = tempfile::tempdir().unwrap();
        let mut expected: Vec<u64> = (0..3000).map(|i| mix(i) % 1000).collect();
        for memory_bytes in [16, 800, 1 << 20] {
            let mut sorter = Sorter::<u64>::new(dir.path(), memory_bytes);
            for i in 0..3000 {
                sorter.push(mix(i) % 1000).unwrap();
            }
            let sorted: Vec<u64> = sorter.finish().unwrap().map(|r| r.unwrap()).collect();
            expected.sort_unstable();
            assert_eq!(sorted, expected, "{memory_bytes} bytes");
        }
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}
