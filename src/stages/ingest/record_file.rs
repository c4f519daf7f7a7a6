//! Files of fixed-size records, as large as the disk, behind a small cache of blocks.
//!
//! Ingest keeps everything that grows with the model in these.

use std::fs::{File, OpenOptions};
use std::num::NonZeroUsize;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use bytemuck::Pod;
use lru::LruCache;

use crate::base::{Error, Result};

const BLOCK_BYTES: usize = 64 << 10;

struct Block<T> {
    records: Vec<T>,
    changed: bool,
}

/// An array of records on disk.
pub struct RecordFile<T> {
    file: File,
    path: PathBuf,
    len: u64,
    per_block: usize,
    /// The last, growing block.
    tail: Vec<T>,
    blocks: LruCache<u64, Block<T>>,
}

impl<T: Pod> RecordFile<T> {
    /// An empty array in a new file; `cache_bytes` bounds its memory.
    pub fn create(dir: &Path, name: &str, cache_bytes: u64) -> Result<Self> {
        let path = dir.join(name);
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(&path)
            .map_err(|e| Error::io(&path, &e))?;
        let per_block = (BLOCK_BYTES / size_of::<T>()).max(1);
        let blocks = NonZeroUsize::new((cache_bytes as usize / BLOCK_BYTES).max(2)).expect("at least 2");
        Ok(Self { file, path, len: 0, per_block, tail: Vec::with_capacity(per_block), blocks: LruCache::new(blocks) })
    }

    /// How many records there are.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.len
    }

    fn offset(&self, block: u64) -> u64 {
        block * (self.per_block * size_of::<T>()) as u64
    }

    fn write_block(&self, block: u64, records: &[T]) -> Result<()> {
        self.file.write_all_at(bytemuck::cast_slice(records), self.offset(block)).map_err(|e| Error::io(&self.path, &e))
    }

    /// Appends a record.
    pub fn push(&mut self, record: T) -> Result<()> {
        self.tail.push(record);
        self.len += 1;
        if self.tail.len() == self.per_block {
            self.write_block(self.len / self.per_block as u64 - 1, &self.tail)?;
            self.tail.clear();
        }
        Ok(())
    }

    fn place(&self, index: u64) -> (u64, usize) {
        assert!(index < self.len, "record {index} of {}", self.len);
        (index / self.per_block as u64, (index % self.per_block as u64) as usize)
    }

    fn in_tail(&self, block: u64) -> bool {
        block == (self.len - self.tail.len() as u64) / self.per_block as u64 && !self.tail.is_empty()
    }

    fn block(&mut self, block: u64) -> Result<&mut Block<T>> {
        if !self.blocks.contains(&block) {
            let mut records = vec![T::zeroed(); self.per_block];
            self.file
                .read_exact_at(bytemuck::cast_slice_mut(&mut records), self.offset(block))
                .map_err(|e| Error::io(&self.path, &e))?;
            if let Some((old, evicted)) = self.blocks.push(block, Block { records, changed: false })
                && evicted.changed
            {
                self.write_block(old, &evicted.records)?;
            }
        }
        Ok(self.blocks.get_mut(&block).expect("it was put there"))
    }

    /// Record `index`, which must exist.
    pub fn get(&mut self, index: u64) -> Result<T> {
        let (block, at) = self.place(index);
        if self.in_tail(block) {
            return Ok(self.tail[at]);
        }
        Ok(self.block(block)?.records[at])
    }

    /// Replaces record `index`, which must exist.
    pub fn set(&mut self, index: u64, record: T) -> Result<()> {
        let (block, at) = self.place(index);
        if self.in_tail(block) {
            self.tail[at] = record;
        } else {
            let block = self.block(block)?;
            block.records[at] = record;
            block.changed = true;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_come_back_through_a_cache_far_smaller_than_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let mut file = RecordFile::<[u64; 5]>::create(dir.path(), "numbers", 0).unwrap();
        let n = 50_000;
        for i in 0..n {
            file.push([i; 5]).unwrap();
        }
        for i in (0..n).step_by(7) {
            file.set(i, [i + 1; 5]).unwrap();
        }
        for i in (0..n).rev() {
            assert_eq!(file.get(i).unwrap(), [if i % 7 == 0 { i + 1 } else { i }; 5]);
        }
        assert_eq!(file.blocks.len(), 2);
    }
}
