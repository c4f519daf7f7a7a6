//! Where nodes and parts of faces go as they are made.

use bytemuck::Zeroable;

use super::super::piece::FaceCorner;
use super::super::record_file::RecordFile;
use super::cell::{Border, Cell};
use super::joined::CHAIN_M;
use super::plane::{Line, Plane};
use super::seams::{PartEdge, PartSeam, seams};
use super::segments::{ABOVE, BELOW, CROSSING, Segment, UPRIGHT};
use super::{FaceCuts, Part, Tally};
use crate::base::Result;
use crate::model::cut::CutNode;

/// The files that parts and nodes go to.
pub struct Sink {
    /// Of all faces.
    pub parts: RecordFile<Part>,
    /// Of all faces.
    pub nodes: RecordFile<CutNode>,
    /// Of all faces.
    pub seams: RecordFile<PartSeam>,
    /// What was made.
    pub tally: Tally,
}

/// One face on its way there.
pub struct FaceSink<'a> {
    sink: &'a mut Sink,
    plane: Plane,
    named: [FaceCorner; 4],
    cuts: FaceCuts,
    /// Edges of parts that lie on lines of nodes.
    edges: Vec<PartEdge>,
    /// By node: what stands along its line.
    contact: Vec<Vec<Segment>>,
}

impl Sink {
    /// A new face's.
    pub fn face(&mut self, plane: Plane, named: [FaceCorner; 4]) -> FaceSink<'_> {
        let (first_part, first_node, first_seam) = (self.parts.len(), self.nodes.len(), self.seams.len());
        let cuts = FaceCuts { first_part, first_node, first_seam, ..FaceCuts::zeroed() };
        FaceSink { sink: self, plane, named, cuts, edges: Vec::new(), contact: Vec::new() }
    }
}

impl FaceSink<'_> {
    /// Makes room for a node; its number. `contact`: what stands along its line.
    pub fn node(&mut self, contact: Vec<Segment>) -> Result<u32> {
        self.contact.push(contact);
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
    pub fn part(&mut self, cell: &Cell) -> Result<u32> {
        // Lines within a centimetre of each other let no light pass between them: what is narrower (a triangle
        // below twice that) joins nothing.
        let (corners, joins) = (&cell.corners, cell.width_m() > 2.0 * CHAIN_M);
        let mut part = Part { corner_count: corners.len() as u32, ..Part::zeroed() };
        for (i, corner) in corners.iter().enumerate() {
            part.corners_m[i..].fill(corner.at.as_vec3().to_array());
            part.named[i] = corner.of_face.map_or(FaceCorner::MADE, |k| self.named[usize::from(k)]);
            if let (true, Border::Node(node)) = (joins, corner.edge) {
                let ends = [corner.flat, corners[(i + 1) % corners.len()].flat];
                self.edges.push(PartEdge { node, part: self.cuts.parts, edge: i as u32, ends });
            }
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

    /// What the face became. Seams shorter than `near_m` are none.
    pub fn finish(mut self, near_m: f64) -> Result<FaceCuts> {
        let seams = seams(self.edges, &self.contact, near_m);
        self.cuts.seams = seams.len() as u64;
        seams.into_iter().try_for_each(|seam| self.sink.seams.push(seam))?;
        Ok(self.cuts)
    }
}
