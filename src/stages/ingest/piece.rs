//! What ingest works on between a face and a patch.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// "No vertex, texture coordinate, normal or material".
pub const NONE: u32 = u32::MAX;

/// A corner as the files name it: rows of the spilled `v`, `vt` and `vn`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct FaceCorner {
    /// `v`; [`NONE`] for a corner that a split made.
    pub vertex: u32,
    /// `vt` or [`NONE`].
    pub uv: u32,
    /// `vn` or [`NONE`].
    pub normal: u32,
}

impl FaceCorner {
    /// Of a corner that a split or a cut made.
    pub const MADE: Self = Self { vertex: NONE, uv: NONE, normal: NONE };
}

/// An `f` record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Source {
    /// Input file, in order of the command line.
    pub file: u32,
    /// Its line.
    pub line: u32,
    /// Its number within the file, from 0.
    pub face: u32,
}

/// A triangle or convex planar quad on its way to be a patch.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Piece {
    /// Corners in winding order, m from the store's origin.
    pub corners_m: [[f32; 3]; 4],
    /// Where they came from.
    pub named: [FaceCorner; 4],
    /// Input faces; the first `source_count` count.
    pub sources: [Source; 4],
    /// How many sources.
    pub source_count: u32,
    /// 3 or 4.
    pub corner_count: u32,
    /// The OBJ object.
    pub object: u32,
    /// Materials of front and back; the back is [`NONE`] where the front's shows through.
    pub material: [u32; 2],
    /// 1 once another piece stands for this one.
    pub gone: u32,
}

impl Piece {
    /// Corners in winding order, m from the store's origin, in f64: the count that is used, and all.
    #[must_use]
    pub fn points(&self) -> ([DVec3; 4], usize) {
        (self.corners_m.map(|c| DVec3::from_array(c.map(f64::from))), self.corner_count as usize)
    }

    /// Adds input faces that are not there yet, as far as there is room.
    pub fn add_sources(&mut self, other: &Self) {
        for source in &other.sources[..other.source_count as usize] {
            let known = self.source_count as usize;
            if known < self.sources.len() && !self.sources[..known].contains(source) {
                self.sources[known] = *source;
                self.source_count += 1;
            }
        }
    }
}
