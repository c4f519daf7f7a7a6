//! Cutting of faces along contact lines: where others cross their plane, stand on them or lie on them.

use std::path::Path;

use bytemuck::{Pod, Zeroable};

use super::piece::{FaceCorner, Piece, Source};
use super::record_file::RecordFile;
use crate::base::{Progress, Result};
use crate::model::cut::CutNode;

/// What counts as contact.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    /// What is no farther than this from a face's plane stands on it, m.
    pub contact_m: f64,
    /// Chains of contact whose extent is shorter are left out, m.
    pub least_m: f64,
    /// Lines nearer to each other than this are one, m.
    pub snap_m: f64,
}

/// A part of a face: a triangle or convex quad in the face's winding and plane.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Part {
    /// Corners in winding order, m from the store's origin; a triangle repeats its third.
    pub corners_m: [[f32; 3]; 4],
    /// The face's names of them; `NONE` throughout for a corner that a cut made.
    pub named: [FaceCorner; 4],
    /// 3 or 4.
    pub corner_count: u32,
}

/// What a face became.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FaceCuts {
    /// Row of its first part.
    pub first_part: u64,
    /// Row of its cut tree's root.
    pub first_node: u64,
    /// How many parts; 0 for a face that is gone, 1 for one that nothing cuts.
    pub parts: u32,
    /// How many nodes.
    pub nodes: u32,
}

/// What all faces became.
pub struct Cuts {
    /// By row of the faces.
    pub faces: RecordFile<FaceCuts>,
    /// Of all faces, each face's together.
    pub parts: RecordFile<Part>,
    /// Of all faces, each face's together.
    pub nodes: RecordFile<CutNode>,
    /// How many of what.
    pub tally: Tally,
}

/// Cuts by cause, and the face with most parts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// Where another face passes through.
    pub crossings: u64,
    /// Where one stands.
    pub contacts: u64,
    /// Where one lies.
    pub outlines: u64,
    /// The face with most parts, and how many, if any was cut.
    pub most: Option<(Source, u32)>,
    /// All parts.
    pub parts: u64,
    /// Faces that are not gone.
    pub faces: u64,
}

/// Cuts all faces. `dir`: for files of the result and of the work; `memory_bytes` bounds what is held.
pub fn cut(
    pieces: &mut RecordFile<Piece>,
    _rules: &Rules,
    dir: &Path,
    memory_bytes: u64,
    _progress: &dyn Progress,
) -> Result<Cuts> {
    let mut faces = RecordFile::create(dir, "cut-faces", memory_bytes / 8)?;
    let mut parts = RecordFile::create(dir, "cut-parts", memory_bytes / 8)?;
    let nodes = RecordFile::create(dir, "cut-nodes", memory_bytes / 8)?;
    let mut tally = Tally::default();
    for i in 0..pieces.len() {
        let piece = pieces.get(i)?;
        let count = u32::from(piece.gone == 0);
        faces.push(FaceCuts { first_part: parts.len(), parts: count, ..FaceCuts::zeroed() })?;
        if piece.gone == 0 {
            let Piece { corners_m, named, corner_count, .. } = piece;
            parts.push(Part { corners_m, named, corner_count })?;
            tally.faces += 1;
            tally.parts += 1;
        }
    }
    Ok(Cuts { faces, parts, nodes, tally })
}
