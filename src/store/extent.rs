//! Reading extents: mapped, checked once per load, never copied unless compressed.

use std::io::Read;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

use lru::LruCache;
use rusqlite::OptionalExtension;
use xxhash_rust::xxh3::xxh3_64;

use super::extent_header::{CODEC_RAW, ExtentHeader, HEADER_BYTES};
use super::segment::Mapping;
use super::{Store, files, segment};
use crate::base::{Error, Result};
use crate::model::rays::TOP;
use crate::model::{ExtentKind, invariants};

/// Segment files kept mapped.
const MAPPED_FILES: NonZeroUsize = NonZeroUsize::new(64).expect("not 0");
/// Extents remembered as checked: about 1 MiB.
const CHECKED_EXTENTS: NonZeroUsize = NonZeroUsize::new(16_384).expect("not 0");

/// Most that an extent unpacks to, bytes: what is known of one cluster's corners and faces is far less.
const MOST_UNPACKED: u64 = 64 << 20;

/// Where an extent lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ExtentRef {
    /// Number of the segment.
    pub segment: u32,
    /// Byte of the header in the segment file.
    pub offset: u64,
    /// Bytes of the payload as stored.
    pub bytes: u64,
}

impl ExtentRef {
    /// Byte of the payload in the segment file.
    #[must_use]
    pub fn payload_at(self) -> u64 {
        self.offset + HEADER_BYTES
    }

    /// From three neighbouring columns.
    pub(super) fn from_row(row: &rusqlite::Row<'_>, first: usize) -> rusqlite::Result<Self> {
        Ok(Self { segment: row.get(first)?, offset: row.get(first + 1)?, bytes: row.get(first + 2)? })
    }

    /// From three neighbouring columns that may be null.
    pub(super) fn from_row_if_any(row: &rusqlite::Row<'_>, first: usize) -> rusqlite::Result<Option<Self>> {
        match row.get(first)? {
            Some(segment) => Ok(Some(Self { segment, offset: row.get(first + 1)?, bytes: row.get(first + 2)? })),
            None => Ok(None),
        }
    }
}

#[derive(Clone)]
enum Bytes {
    Mapped { map: Arc<Mapping>, start: usize, end: usize },
    // u64s, for alignment; the payload's last word may be padded.
    Unpacked { words: Arc<[u128]>, bytes: usize },
}

/// A checked extent. Cheap to clone; keeps its bytes alive.
#[derive(Clone)]
pub struct Extent {
    header: ExtentHeader,
    bytes: Bytes,
    path: Arc<PathBuf>,
    offset: u64,
}

impl Extent {
    /// The payload, at least 16-byte aligned.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        match &self.bytes {
            Bytes::Mapped { map, start, end } => &map[*start..*end],
            Bytes::Unpacked { words, bytes } => &bytemuck::cast_slice(words)[..*bytes],
        }
    }

    /// Its header.
    #[must_use]
    pub fn header(&self) -> &ExtentHeader {
        &self.header
    }

    /// Parses the payload with a record view's `parse`.
    pub fn parse<'a, V>(&'a self, view: impl FnOnce(&'a [u8]) -> std::result::Result<V, String>) -> Result<V> {
        view(self.payload()).map_err(|detail| self.damage(detail))
    }

    /// An error that names this extent.
    pub fn damage(&self, detail: impl std::fmt::Display) -> Error {
        Error::damaged(
            &self.path,
            format!("extent at byte {} (cluster {}): {detail}", self.offset, self.header.cluster),
        )
    }
}

/// Mapped files and what of them has been checked, both bounded.
pub(super) struct Mappings {
    maps: LruCache<u32, (Arc<Mapping>, Arc<PathBuf>)>,
    checked: LruCache<(u32, u64), ()>,
    /// Patches of clusters, which never change.
    patches: LruCache<u32, u32>,
}

impl Mappings {
    pub(super) fn new() -> Self {
        Self {
            maps: LruCache::new(MAPPED_FILES),
            checked: LruCache::new(CHECKED_EXTENTS),
            patches: LruCache::new(CHECKED_EXTENTS),
        }
    }

    /// Whether what lies at a place (segment, byte) has been checked lately.
    pub(super) fn has_checked(&mut self, place: (u32, u64)) -> bool {
        self.checked.get(&place).is_some()
    }

    /// Remembers that it has.
    pub(super) fn remember(&mut self, place: (u32, u64)) {
        self.checked.put(place, ());
    }

    /// Forgets everything, as before truncating.
    pub(super) fn clear(&mut self) {
        self.maps.clear();
        self.checked.clear();
        self.patches.clear();
    }
}

impl Store {
    /// The whole of a segment file, at least `end` bytes of it.
    fn mapping(&self, segment: u32, end: u64) -> Result<(Arc<Mapping>, Arc<PathBuf>)> {
        let mut mappings = self.mappings.borrow_mut();
        if let Some((map, path)) = mappings.maps.get(&segment)
            && map.len() as u64 >= end
        {
            return Ok((map.clone(), path.clone()));
        }
        let file: Option<String> = self
            .connection()
            .prepare_cached("SELECT file FROM segments WHERE id = ?1")?
            .query_row([segment], |r| r.get(0))
            .optional()?;
        let Some(file) = file else {
            return Err(Error::damaged(self.dir(), format!("no segment has the number {segment}")));
        };
        let path = files::segment_path(self.dir(), &file)?;
        let map = segment::map(&path, self.readers())?;
        if (map.len() as u64) < end {
            return Err(Error::damaged(&path, format!("cut off: {} bytes where {end} are needed", map.len())));
        }
        let entry = (map, Arc::new(path));
        mappings.maps.put(segment, entry.clone());
        Ok(entry)
    }

    /// The extent at a place, checked against its checksums, and for what must be true of its kind, if this
    /// process has not done so lately.
    pub fn extent(&self, at: ExtentRef, kind: ExtentKind) -> Result<Extent> {
        let end = at.payload_at().checked_add(at.bytes);
        let end = end.ok_or_else(|| Error::damaged(self.dir(), format!("impossible place {at:?}")))?;
        let (map, path) = self.mapping(at.segment, end)?;
        let wrong = |detail: String| Error::damaged(&path, format!("extent at byte {}: {detail}", at.offset));
        let header = ExtentHeader::parse(&map[at.offset as usize..]).map_err(wrong)?;
        if header.kind != kind as u16 || header.payload_bytes != at.bytes {
            return Err(wrong(format!(
                "{} bytes of kind {} where the catalogue says {} of kind {}",
                header.payload_bytes, header.kind, at.bytes, kind as u16
            )));
        }
        let (start, end) = (at.payload_at() as usize, end as usize);
        let key = (at.segment, at.offset);
        let is_known = self.mappings.borrow_mut().has_checked(key);
        if !is_known && xxh3_64(&map[start..end]) != header.payload_xxh3 {
            return Err(wrong("the payload's checksum is wrong".to_owned()));
        }
        let bytes = match (header.codec, kind) {
            (CODEC_RAW, _) => Bytes::Mapped { map, start, end },
            (_, ExtentKind::Bake | ExtentKind::Provenance) => {
                unpack(&map[start..end]).map_err(|e| wrong(e.to_string()))?
            }
            (codec, _) => return Err(wrong(format!("codec {codec}, which its kind does not have"))),
        };
        let extent = Extent { header, bytes, path, offset: at.offset };
        if !is_known {
            self.believe(kind, &extent)?;
            self.mappings.borrow_mut().remember(key);
        }
        Ok(extent)
    }

    /// Whether a right checksum covers something that may be walked through.
    fn believe(&self, kind: ExtentKind, extent: &Extent) -> Result<()> {
        let cluster = extent.header.cluster;
        // What can't be asked is not there.
        let patches_of = |cluster| self.patches_of(cluster).unwrap_or_default();
        let verdict = match (kind, cluster) {
            (ExtentKind::Rays, TOP) => invariants::rays_top(extent.payload()),
            // Nobody can ask for it by name.
            _ if patches_of(cluster).is_none() => Ok(()),
            _ => invariants::of(kind, extent.payload(), cluster, &patches_of),
        };
        verdict.map_err(|detail| extent.damage(detail))
    }

    /// Patches of a cluster, by the catalogue.
    pub(super) fn patches_of(&self, cluster: u32) -> Result<Option<u32>> {
        if let Some(patches) = self.mappings.borrow_mut().patches.get(&cluster) {
            return Ok(Some(*patches));
        }
        let mut query = self.connection().prepare_cached("SELECT patches FROM clusters WHERE id = ?1")?;
        let patches = query.query_row([cluster], |row| row.get(0)).optional()?;
        if let Some(patches) = patches {
            self.mappings.borrow_mut().patches.put(cluster, patches);
        }
        Ok(patches)
    }

    /// Like [`Store::extent`], but checked afresh, for `check`.
    pub fn extent_checked_now(&self, at: ExtentRef, kind: ExtentKind) -> Result<Extent> {
        self.mappings.borrow_mut().checked.pop(&(at.segment, at.offset));
        self.extent(at, kind)
    }

    /// The whole of the segment file that an extent lies in.
    pub(super) fn file_of(&self, at: ExtentRef) -> Result<(Arc<Mapping>, Arc<PathBuf>)> {
        self.mapping(at.segment, 0)
    }
}

fn unpack(packed: &[u8]) -> std::io::Result<Bytes> {
    let mut bytes = Vec::new();
    zstd::Decoder::new(packed)?.take(MOST_UNPACKED + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MOST_UNPACKED {
        return Err(std::io::Error::other(format!("it unpacks to more than {MOST_UNPACKED} bytes")));
    }
    let mut words = vec![0u128; bytes.len().div_ceil(16)];
    bytemuck::cast_slice_mut::<u128, u8>(&mut words)[..bytes.len()].copy_from_slice(&bytes);
    Ok(Bytes::Unpacked { words: words.into(), bytes: bytes.len() })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::FileExt;
    use std::time::Duration;

    use super::*;
    use crate::model::geometry::SideMaterial;
    use crate::model::layout::{Arrays, ArraysBuilder};
    use crate::store::SegmentWriter;

    fn materials(grey: f32) -> Vec<u8> {
        let side = SideMaterial { rho: [grey; 3], exitance: [0.0; 3] };
        ArraysBuilder::default().with(&[side, side]).finish()
    }

    #[test]
    fn extents_come_back_as_written_aligned_whole_or_in_pieces() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), Duration::ZERO).unwrap();
        let mut writer = SegmentWriter::create(&store, "test").unwrap();
        let payload = materials(0.25);
        let first = writer.append(ExtentKind::Materials, 3, &payload).unwrap();
        let mut stream = writer.begin(ExtentKind::Materials, 4).unwrap();
        for piece in payload.chunks(7) {
            stream.write(piece).unwrap();
        }
        let second = stream.finish().unwrap();
        let packed = writer.append(ExtentKind::Bake, 3, &payload).unwrap();
        writer.sync().unwrap();
        assert_eq!(second.offset % 64, 0);
        for (at, kind, cluster) in
            [(first, ExtentKind::Materials, 3), (second, ExtentKind::Materials, 4), (packed, ExtentKind::Bake, 3)]
        {
            let extent = store.extent(at, kind).unwrap();
            assert_eq!(extent.payload(), payload, "{at:?}");
            assert_eq!(extent.header().cluster, cluster);
            assert_eq!(extent.payload().as_ptr() as usize % 16, 0);
            if kind == ExtentKind::Materials {
                assert_eq!(extent.header().count, 2, "two sides");
            }
        }
        // The file grows below an existing mapping.
        let third = writer.append(ExtentKind::Materials, 5, &payload).unwrap();
        writer.sync().unwrap();
        let extent = store.extent(third, ExtentKind::Materials).unwrap();
        assert_eq!(Arrays::new(extent.payload()).get::<SideMaterial>(0).unwrap()[1].rho[0], 0.25);
    }

    #[test]
    fn a_flipped_payload_bit_a_cut_off_file_and_a_missing_file_are_damages_with_their_path() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), Duration::ZERO).unwrap();
        let mut writer = SegmentWriter::create(&store, "test").unwrap();
        let at = writer.append(ExtentKind::Materials, 3, &materials(0.25)).unwrap();
        writer.sync().unwrap();
        drop(store);
        let path = dir.path().join("segments/000001-test.seg");
        let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        let damage = || {
            let store = Store::open(dir.path(), Duration::ZERO).unwrap();
            store.extent(at, ExtentKind::Materials).err().map(|e| (e.exit_code(), e.to_string()))
        };
        assert_eq!(damage(), None);
        file.write_at(&[1], at.payload_at() + 30).unwrap();
        let (code, message) = damage().unwrap();
        assert!(code == 12 && message.contains("000001-test.seg") && message.contains("checksum"), "{message}");
        file.set_len(100).unwrap();
        assert!(damage().unwrap().1.contains("cut off"));
        std::fs::remove_file(&path).unwrap();
        assert!(damage().unwrap().1.contains("missing"));
    }
}
