//! Cutting of faces along contact lines: where others cross their plane, stand on them or lie on them.

mod cell;
mod choice;
mod doubles;
mod face;
mod joined;
mod neighbours;
mod plane;
mod seams;
mod segments;
mod simple;
mod sink;
mod tree;
mod weld;

use std::path::Path;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use self::face::cut_face;
use self::neighbours::Neighbours;
pub use self::seams::PartSeam;
use self::sink::Sink;
use super::piece::{FaceCorner, Piece, Source};
use super::record_file::RecordFile;
use super::sorter::Sorter;
use crate::base::{Progress, Result};
use crate::geom::bounds::Bounds;
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

impl Part {
    /// Box round it, m from the store's origin.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        Bounds::of(&self.corners_m.map(|c| DVec3::from_array(c.map(f64::from))))
    }
}

/// What a face became.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FaceCuts {
    /// Row of its first part.
    pub first_part: u64,
    /// Row of its cut tree's root.
    pub first_node: u64,
    /// Row of the first seam between its parts.
    pub first_seam: u64,
    /// How many seams.
    pub seams: u64,
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
    /// Of all faces, each face's together.
    pub seams: RecordFile<PartSeam>,
    /// How many of what.
    pub tally: Tally,
}

#[cfg(test)]
impl Cuts {
    /// Of faces that nothing cuts.
    pub fn none(pieces: &mut RecordFile<Piece>, dir: &Path) -> Result<Self> {
        let rules = Rules { contact_m: 0.0, least_m: f64::INFINITY, snap_m: 0.0 };
        cut(pieces, &rules, dir, 1 << 20, &crate::base::Quiet)
    }
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

/// Cuts all faces. `dir`: for files of the result and of the work; `memory_bytes` bounds what is held. What a face
/// becomes depends on the shapes of all faces alone, not on their order or the memory.
pub fn cut(
    pieces: &mut RecordFile<Piece>,
    rules: &Rules,
    dir: &Path,
    memory_bytes: u64,
    progress: &dyn Progress,
) -> Result<Cuts> {
    progress.begin("cut", "faces", Some(pieces.len()));
    let mut neighbours = Neighbours::of(pieces, dir, memory_bytes / 4 * 3, progress)?;
    let mut sink = Sink {
        parts: RecordFile::create(dir, "cut-parts", memory_bytes / 32)?,
        nodes: RecordFile::create(dir, "cut-nodes", memory_bytes / 32)?,
        seams: RecordFile::create(dir, "cut-seams", memory_bytes / 32)?,
        tally: Tally { faces: neighbours.len(), ..Tally::default() },
    };
    let mut most = (1, 0);
    let mut by_row = Sorter::new(dir, memory_bytes / 8);
    for i in 0..neighbours.len() {
        let face = neighbours.face(i)?;
        let cuts = cut_face(&face, &mut neighbours, rules, &mut sink)?;
        // Of faces with as many parts the first is told, in whatever order they come.
        if (cuts.parts, most.1) > (most.0, face.row) {
            most = (cuts.parts, face.row);
        }
        by_row.push(RowCuts::new(face.row, cuts))?;
        if i % 4096 == 0 {
            progress.step(i)?;
        }
    }
    drop(neighbours);
    let mut faces = RecordFile::create(dir, "cut-faces", memory_bytes / 32)?;
    for row in by_row.finish()? {
        let row = row?;
        while faces.len() < row.row {
            faces.push(FaceCuts::zeroed())?;
        }
        faces.push(row.cuts())?;
    }
    while faces.len() < pieces.len() {
        faces.push(FaceCuts::zeroed())?;
    }
    let Sink { parts, nodes, seams, mut tally } = sink;
    tally.parts = parts.len();
    if most.0 > 1 {
        tally.most = Some((pieces.get(most.1)?.sources[0], most.0));
    }
    Ok(Cuts { faces, parts, nodes, seams, tally })
}

/// [`FaceCuts`] on their way into the order of rows.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
struct RowCuts {
    row: u64,
    firsts: [u64; 3],
    seams: u64,
    counts: [u32; 2],
}

impl RowCuts {
    fn new(row: u64, cuts: FaceCuts) -> Self {
        let FaceCuts { first_part, first_node, first_seam, seams, parts, nodes } = cuts;
        Self { row, firsts: [first_part, first_node, first_seam], seams, counts: [parts, nodes] }
    }

    fn cuts(&self) -> FaceCuts {
        let ([first_part, first_node, first_seam], [parts, nodes]) = (self.firsts, self.counts);
        FaceCuts { first_part, first_node, first_seam, seams: self.seams, parts, nodes }
    }
}

#[cfg(test)]
mod tests;
