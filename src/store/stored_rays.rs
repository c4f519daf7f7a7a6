//! The ray structures of a model: the top level, and the clusters' in the same segment file, each of which is
//! checked when rays first come to it.

use std::path::PathBuf;
use std::sync::Arc;

use rusqlite::OptionalExtension;
use xxhash_rust::xxh3::xxh3_64;

use super::extent_header::{CODEC_RAW, ExtentHeader, HEADER_BYTES};
use super::segment::Mapping;
use super::{Extent, ExtentRef, Store};
use crate::base::{Error, Result};
use crate::model::rays::{ClusterRaysView, ClusterRef, TopRaysView};
use crate::model::{ExtentKind, invariants};

/// The top level, and the file that it and the clusters' structures lie in.
pub struct StoredRays<'s> {
    store: &'s Store,
    top: Extent,
    segment: u32,
    file: Arc<Mapping>,
    path: Arc<PathBuf>,
}

impl Store {
    /// The model's ray structures; exit code 12 without any.
    pub fn rays(&self) -> Result<StoredRays<'_>> {
        let at = self
            .connection()
            .prepare_cached("SELECT rays_top_segment, rays_top_offset, rays_top_bytes FROM model")?
            .query_row([], |row| ExtentRef::from_row(row, 0))
            .optional()?;
        let at = at.ok_or_else(|| Error::damaged(self.dir(), "the model has no ray structure"))?;
        let top = self.extent(at, ExtentKind::Rays)?;
        let (file, path) = self.file_of(at)?;
        Ok(StoredRays { store: self, top, segment: at.segment, file, path })
    }
}

impl StoredRays<'_> {
    /// The top level.
    pub fn top(&self) -> Result<TopRaysView<'_>> {
        self.top.parse(TopRaysView::parse)
    }

    /// The segment file.
    #[must_use]
    pub fn file(&self) -> &[u8] {
        &self.file
    }

    /// An error that names the top level.
    pub fn damage(&self, detail: impl std::fmt::Display) -> Error {
        self.top.damage(detail)
    }

    /// Verifies the checksum of a cluster's structure, and that rays can walk through it, if this process has
    /// not done so lately.
    pub fn check(&self, at: &ClusterRef) -> Result<()> {
        let key = (self.segment, at.nodes_at);
        if self.store.mappings.borrow_mut().has_checked(key) {
            return Ok(());
        }
        self.verify(at).map_err(|detail| {
            Error::damaged(&self.path, format!("ray structure of cluster {}: {detail}", at.cluster))
        })?;
        self.store.mappings.borrow_mut().remember(key);
        Ok(())
    }

    fn verify(&self, at: &ClusterRef) -> std::result::Result<(), String> {
        let lost = || "no extent begins where the top level says".to_owned();
        let start = at.nodes_at.checked_sub(ClusterRaysView::NODES_AT).ok_or_else(lost)?;
        let head = usize::try_from(start.checked_sub(HEADER_BYTES).ok_or_else(lost)?).map_err(|_| lost())?;
        let header = ExtentHeader::parse(self.file.get(head..).ok_or_else(lost)?)?;
        if header.kind != ExtentKind::Rays as u16 || header.cluster != at.cluster || header.codec != CODEC_RAW {
            return Err(lost());
        }
        let start = start as usize;
        let end = usize::try_from(header.payload_bytes).ok().and_then(|bytes| start.checked_add(bytes));
        let payload = end.and_then(|end| self.file.get(start..end)).ok_or("it is cut off")?;
        if xxh3_64(payload) != header.payload_xxh3 {
            return Err("the checksum is wrong".to_owned());
        }
        Self::matches(at, payload, start as u64)?;
        invariants::rays(payload, at.cluster, &|cluster| self.store.patches_of(cluster).ok().flatten())
    }

    /// Whether the top level names a structure's arrays, all of them.
    fn matches(at: &ClusterRef, payload: &[u8], start: u64) -> std::result::Result<(), String> {
        let own = ClusterRef::to(at.cluster, payload, start)?;
        if bytemuck::bytes_of(&own) == bytemuck::bytes_of(at) {
            Ok(())
        } else {
            Err("the top level names other bytes".to_owned())
        }
    }
}
