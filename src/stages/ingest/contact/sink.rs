//! Where nodes and parts of faces go as they are made.

use bytemuck::Zeroable;

use super::super::piece::FaceCorner;
use super::super::record_file::RecordFile;
use super::cell::Corner;
use super::plane::{Line, Plane};
use super::segments::{ABOVE, BELOW, CROSSING, UPRIGHT};
use super::{FaceCuts, Part, Tally};
use crate::base::Result;
use crate::model::cut::CutNode;

/// The files that parts and nodes go to.
pub struct Sink {
    /// Of all faces.
    pub parts: RecordFile<Part>,
    /// Of all faces.
    pub nodes: RecordFile<CutNode>,
    /// What was made.
    pub tally: Tally,
}

/// One face on its way there.
pub struct FaceSink<'a> {
    sink: &'a mut Sink,
    plane: Plane,
    named: [FaceCorner; 4],
    cuts: FaceCuts,
}

impl Sink {
    /// A new face's.
    pub fn face(&mut self, plane: Plane, named: [FaceCorner; 4]) -> FaceSink<'_> {
        let cuts = FaceCuts { first_part: self.parts.len(), first_node: self.nodes.len(), ..FaceCuts::zeroed() };
        FaceSink { sink: self, plane, named, cuts }
    }
}

impl FaceSink<'_> {
    /// Makes room for a node; its number.
    pub fn node(&mut self) -> Result<u32> {
        self.sink.nodes.push(CutNode::zeroed())?;
        self.cuts.nodes += 1;
        Ok(self.cuts.nodes - 1)
    }

    /// Puts a node there. `children`: to the left of the line, and to the right.
    pub fn set(&mut self, node: u32, line: Line, children: [u32; 2]) -> Result<()> {
        let line = self.plane.in_space(line);
        self.sink.nodes.set(self.cuts.first_node + u64::from(node), CutNode { line, children })
    }

    /// Adds a part of three or four corners; it as a node's child.
    pub fn part(&mut self, corners: &[Corner]) -> Result<u32> {
        let mut part = Part { corner_count: corners.len() as u32, ..Part::zeroed() };
        for (i, corner) in corners.iter().enumerate() {
            part.corners_m[i..].fill(corner.at.as_vec3().to_array());
            part.named[i] = corner.of_face.map_or(FaceCorner::MADE, |k| self.named[usize::from(k)]);
        }
        self.sink.parts.push(part)?;
        self.cuts.parts += 1;
        Ok((self.cuts.parts - 1) | CutNode::PART)
    }

    /// Counts a cut along what touches in these ways.
    pub fn count(&mut self, kinds: u8) {
        let tally = &mut self.sink.tally;
        if kinds & CROSSING != 0 {
            tally.crossings += 1;
        } else if kinds & (ABOVE | BELOW | UPRIGHT) != 0 {
            tally.contacts += 1;
        } else {
            tally.outlines += 1;
        }
    }

    /// What the face became.
    #[must_use]
    pub fn finish(self) -> FaceCuts {
        self.cuts
    }
}
