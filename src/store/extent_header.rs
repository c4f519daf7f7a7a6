//! The 64 bytes before every extent; `schema/SEGMENTS.md` says the same in words.

use bytemuck::{Pod, Zeroable};
use xxhash_rust::xxh3::xxh3_64;

use crate::model::ExtentKind;
use crate::model::geometry::{PatchRecord, SideMaterial};
use crate::model::layout::Arrays;
use crate::model::light::ElementLight;
use crate::model::links::StoredHit;
use crate::model::origin::{BakeCorner, PatchSource};
use crate::model::rays::{ClusterRef, RayPatch, TOP};
use crate::model::visibility::VisibleCluster;

/// What an extent begins with.
pub const MAGIC: [u8; 8] = *b"CLERSTRY";
/// Version of the bytes described by `schema/SEGMENTS.md`.
pub const FORMAT: u16 = 7;
/// Extents and their payloads begin at multiples of this.
pub const ALIGN: u64 = 64;
/// Bytes of a header.
pub const HEADER_BYTES: u64 = 64;

/// The payload as it is, ready to be mapped.
pub const CODEC_RAW: u16 = 0;
/// The payload compressed by zstd.
pub const CODEC_ZSTD: u16 = 1;

/// The header of an extent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ExtentHeader {
    /// [`MAGIC`].
    pub magic: [u8; 8],
    /// [`FORMAT`].
    pub format: u16,
    /// Number of the [`ExtentKind`].
    pub kind: u16,
    /// Cluster, or `u32::MAX` for what belongs to all.
    pub cluster: u32,
    /// [`CODEC_RAW`] or [`CODEC_ZSTD`].
    pub codec: u16,
    /// Channels of light: 3 for radiosity, else 0.
    pub channels: u16,
    /// Light layer: 0.
    pub layer: u32,
    /// Bytes of a record of the kind's main array.
    pub record_bytes: u32,
    /// 0.
    pub reserved: u32,
    /// Records of that array.
    pub count: u64,
    /// Bytes of the payload as stored.
    pub payload_bytes: u64,
    /// xxh3 (64 bits, seed 0) of the payload as stored.
    pub payload_xxh3: u64,
    /// xxh3 of the 56 bytes before this field.
    pub header_xxh3: u64,
}

const _: () = assert!(size_of::<ExtentHeader>() as u64 == HEADER_BYTES);

/// Which array of a kind's payload is its main one, and the bytes of its records.
#[must_use]
pub fn main_array(kind: ExtentKind, cluster: u32) -> (usize, usize) {
    match kind {
        ExtentKind::Rays if cluster == TOP => (1, size_of::<ClusterRef>()),
        ExtentKind::Geometry => (1, size_of::<PatchRecord>()),
        ExtentKind::Materials => (0, size_of::<SideMaterial>()),
        ExtentKind::Visibility => (1, size_of::<VisibleCluster>()),
        ExtentKind::Radiosity => (2, size_of::<ElementLight>()),
        ExtentKind::Links => (4, size_of::<StoredHit>()),
        ExtentKind::Rays => (1, size_of::<RayPatch>()),
        ExtentKind::Bake => (0, size_of::<BakeCorner>()),
        ExtentKind::Provenance => (0, size_of::<PatchSource>()),
    }
}

impl ExtentHeader {
    /// The header of a payload of `payload_bytes` (as stored) with hash `payload_xxh3`; `table` is
    /// the uncompressed payload or at least its table of arrays.
    #[must_use]
    pub fn new(
        kind: ExtentKind,
        cluster: u32,
        codec: u16,
        table: &[u8],
        payload_bytes: u64,
        payload_xxh3: u64,
    ) -> Self {
        let (array, record_bytes) = main_array(kind, cluster);
        let array_bytes = Arrays::new(table).bytes_of(array).unwrap_or(0);
        let mut header = Self {
            magic: MAGIC,
            format: FORMAT,
            kind: kind as u16,
            cluster,
            codec,
            channels: if kind == ExtentKind::Radiosity { 3 } else { 0 },
            layer: 0,
            record_bytes: record_bytes as u32,
            reserved: 0,
            count: (array_bytes / record_bytes) as u64,
            payload_bytes,
            payload_xxh3,
            header_xxh3: 0,
        };
        header.header_xxh3 = header.own_hash();
        header
    }

    fn own_hash(&self) -> u64 {
        xxh3_64(&bytemuck::bytes_of(self)[..56])
    }

    /// Reads a header; what is wrong with it otherwise.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let header: Self = bytes
            .get(..HEADER_BYTES as usize)
            .map(bytemuck::pod_read_unaligned)
            .ok_or_else(|| "the header is cut off".to_owned())?;
        if header.magic != MAGIC {
            return Err("no extent begins here (wrong magic)".to_owned());
        }
        if header.header_xxh3 != header.own_hash() {
            return Err("the header's checksum is wrong".to_owned());
        }
        if header.format != FORMAT {
            return Err(format!("format {} where this program reads {FORMAT}", header.format));
        }
        if header.extent_kind().is_none() {
            return Err(format!("unknown kind {}", header.kind));
        }
        if header.codec > CODEC_ZSTD {
            return Err(format!("unknown codec {}", header.codec));
        }
        Ok(header)
    }

    /// The kind, if known.
    #[must_use]
    pub fn extent_kind(&self) -> Option<ExtentKind> {
        ExtentKind::from_number(self.kind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flipped_bit_anywhere_in_a_header_is_found() {
        let header = ExtentHeader::new(ExtentKind::Links, 7, CODEC_RAW, &[], 100, 5);
        let bytes = bytemuck::bytes_of(&header).to_vec();
        assert_eq!(ExtentHeader::parse(&bytes).unwrap(), header);
        for at in 0..64 {
            let mut bad = bytes.clone();
            bad[at] ^= 4;
            assert!(ExtentHeader::parse(&bad).is_err(), "byte {at}");
        }
    }
}
