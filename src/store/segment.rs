//! Segment files: append-only, one writer each, mapped by readers. The only unsafe code of the store.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use memmap2::Mmap;
use rusqlite::Transaction;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::extent_header::{ALIGN, CODEC_RAW, CODEC_ZSTD, ExtentHeader, HEADER_BYTES};
use super::files::{self, For};
use super::{ExtentRef, Store, locks};
use crate::base::{Error, Result};
use crate::model::ExtentKind;

const BUFFER_BYTES: usize = 256 << 10;
const ZSTD_LEVEL: i32 = 1;
/// The table of arrays at a payload's start is never longer than this.
const TABLE_BYTES: usize = 512;

/// Appends extents to a segment file of its own, which it keeps locked until dropped.
pub struct SegmentWriter {
    id: u32,
    path: PathBuf,
    file: BufWriter<File>,
    at: u64,
}

impl SegmentWriter {
    /// Starts a new segment file; `purpose` is a word for its name.
    pub fn create(store: &Store, purpose: &str) -> Result<Self> {
        let (id, path, file) = store.write(|tx| {
            tx.execute("INSERT INTO segments (file, purpose) VALUES (hex(randomblob(8)), ?1)", [purpose])?;
            let id = u32::try_from(tx.last_insert_rowid())
                .map_err(|_| Error::failed("the store has used up its segment numbers", "start a new store"))?;
            let name = format!("{id:06}-{purpose}.seg");
            tx.execute("UPDATE segments SET file = ?1 WHERE id = ?2", (&name, id))?;
            let path = files::segment_path(store.dir(), &name)?;
            // A file of that name can only be left from a creation that was killed before its commit. It goes, rather
            // than being written over: it may have another name somewhere.
            let _ = std::fs::remove_file(&path);
            let file = File::create_new(&path).map_err(|e| Error::io(&path, &e))?;
            if !locks::try_exclusive(&file, &path)? {
                return Err(Error::damaged(&path, "another process writes a segment that has no row"));
            }
            Ok((id, path, file))
        })?;
        let dir = store.dir().join("segments");
        File::open(&dir).and_then(|d| d.sync_all()).map_err(|e| Error::io(&dir, &e))?;
        Ok(Self { id, path, file: BufWriter::with_capacity(BUFFER_BYTES, file), at: 0 })
    }

    /// Number of the segment.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.id
    }

    /// Bytes written so far.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.at
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(|e| Error::io(&self.path, &e))?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    fn pad(&mut self) -> Result<()> {
        const ZEROS: [u8; ALIGN as usize] = [0; ALIGN as usize];
        let over = (self.at % ALIGN) as usize;
        if over == 0 { Ok(()) } else { self.put(&ZEROS[over..]) }
    }

    /// Appends an extent. Bake and provenance are compressed; all others lie as they are.
    pub fn append(&mut self, kind: ExtentKind, cluster: u32, payload: &[u8]) -> Result<ExtentRef> {
        let packed;
        let (codec, stored) = if matches!(kind, ExtentKind::Bake | ExtentKind::Provenance) {
            packed = zstd::bulk::compress(payload, ZSTD_LEVEL).map_err(|e| Error::io(&self.path, &e))?;
            (CODEC_ZSTD, packed.as_slice())
        } else {
            (CODEC_RAW, payload)
        };
        let header = ExtentHeader::new(kind, cluster, codec, payload, stored.len() as u64, xxh3_64(stored));
        let place = ExtentRef { segment: self.id, offset: self.at, bytes: stored.len() as u64 };
        self.put(bytemuck::bytes_of(&header))?;
        self.put(stored)?;
        self.pad()?;
        Ok(place)
    }

    /// Begins an extent (stored raw) whose payload comes in pieces.
    pub fn begin(&mut self, kind: ExtentKind, cluster: u32) -> Result<ExtentStream<'_>> {
        let offset = self.at;
        self.put(&[0; HEADER_BYTES as usize])?;
        Ok(ExtentStream { writer: self, kind, cluster, offset, bytes: 0, hash: Xxh3::new(), table: Vec::new() })
    }

    /// Brings everything written so far to the disk.
    pub fn sync(&mut self) -> Result<()> {
        self.file.flush().and_then(|()| self.file.get_ref().sync_data()).map_err(|e| Error::io(&self.path, &e))
    }

    /// Records in the transaction that makes rows of these extents how far the file is in use.
    pub(super) fn publish(&self, tx: &Transaction<'_>) -> Result<()> {
        tx.execute("UPDATE segments SET published_bytes = ?1 WHERE id = ?2", (self.at, self.id))?;
        Ok(())
    }
}

/// An extent being written in pieces; its header comes last.
pub struct ExtentStream<'w> {
    writer: &'w mut SegmentWriter,
    kind: ExtentKind,
    cluster: u32,
    offset: u64,
    bytes: u64,
    hash: Xxh3,
    table: Vec<u8>,
}

impl ExtentStream<'_> {
    /// Appends a piece of the payload.
    pub fn write(&mut self, piece: &[u8]) -> Result<()> {
        let missing = TABLE_BYTES - self.table.len();
        self.table.extend_from_slice(&piece[..piece.len().min(missing)]);
        self.hash.update(piece);
        self.bytes += piece.len() as u64;
        self.writer.put(piece)
    }

    /// Writes the header and gives the extent's place.
    pub fn finish(self) -> Result<ExtentRef> {
        let Self { writer, kind, cluster, offset, bytes, hash, table } = self;
        writer.pad()?;
        let header = ExtentHeader::new(kind, cluster, CODEC_RAW, &table, bytes, hash.digest());
        let end = writer.at;
        let file = &mut writer.file;
        file.seek(SeekFrom::Start(offset))
            .and_then(|_| file.write_all(bytemuck::bytes_of(&header)))
            .and_then(|()| file.seek(SeekFrom::Start(end)))
            .map_err(|e| Error::io(&writer.path, &e))?;
        Ok(ExtentRef { segment: writer.id, offset, bytes })
    }
}

/// A segment file, mapped. It holds the shared lock of the store for as long as it lives.
pub struct Mapping {
    map: Mmap,
    _readers: Option<Arc<File>>,
}

impl Deref for Mapping {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.map
    }
}

/// Maps a segment file as it is now. `readers`: the lock that keeps it from being cut off.
pub(super) fn map(path: &Path, readers: Option<&Arc<File>>) -> Result<Arc<Mapping>> {
    let file = files::open_segment(path, For::Reading)?;
    // SAFETY: what is read of a mapping are extents that a row names or that this process has written: bytes
    // below `segments.published_bytes`, written before the row and never again (`SegmentWriter`), or our own.
    // The file is cut off behind those bytes only, and only by who holds `readers.lock` exclusively
    // (`Store::alone`), while the mapping itself holds it shared. Where one may only read, and there is no lock
    // file, nobody of our kind has opened the store to write. A program that is not ours and cuts the file
    // under us ends this process with SIGBUS: no lock prevents that.
    let map = unsafe { Mmap::map(&file) }.map_err(|e| Error::io(path, &e))?;
    Ok(Arc::new(Mapping { map, _readers: readers.cloned() }))
}

/// Gives freed memory back to the system: many small blocks leave holes that the allocator would keep, and
/// what a process keeps counts against its limit.
pub fn give_back_freed_memory() {
    // SAFETY: takes no pointer; it touches only what the allocator itself knows to be free.
    #[cfg(target_env = "gnu")]
    unsafe {
        libc::malloc_trim(0);
    }
}
