//! Which faces are near a box, found on disk: packed trees of boxes over the faces in Morton order, one tree for each
//! class of size, so that large walls do not widen the boxes of what is small.

use std::ops::ControlFlow;
use std::path::Path;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::super::piece::{FaceCorner, Piece};
use super::super::pieces::{bounds, bounds_of_all};
use super::super::record_file::RecordFile;
use super::super::sorter::Sorter;
use super::plane::Plane;
use crate::base::{Progress, Result};
use crate::geom::bounds::Bounds;
use crate::geom::morton::morton;

/// Children of a node.
const FANOUT: usize = 16;

/// A face, as it is compared with others.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Face {
    /// As [`Piece::corners_m`].
    pub corners_m: [[f32; 3]; 4],
    /// As [`Piece::named`].
    pub named: [FaceCorner; 4],
    /// 3 or 4.
    pub corner_count: u32,
    reserved: u32,
    /// Row of the piece.
    pub row: u64,
}

impl Face {
    /// Corners in winding order, m from the store's origin, in f64: the count that is used, and all.
    #[must_use]
    pub fn points(&self) -> ([DVec3; 4], usize) {
        (self.corners_m.map(|c| DVec3::from_array(c.map(f64::from))), self.corner_count as usize)
    }

    fn bounds(&self) -> Box32 {
        let corners = &self.corners_m[..self.corner_count as usize];
        corners.iter().fold(Box32::EMPTY, |b, c| b.union(Box32 { min: *c, max: *c }))
    }
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
struct Placed {
    class: u64,
    morton: u64,
    row: u64,
    /// Bits of the corners' coordinates.
    corners: [u32; 12],
    named: [u32; 12],
    corner_count: u64,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Box32 {
    min: [f32; 3],
    max: [f32; 3],
}

impl Box32 {
    const EMPTY: Self = Self { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };

    fn union(self, other: Self) -> Self {
        let pick = |a: [f32; 3], b: [f32; 3], f: fn(f32, f32) -> f32| [0, 1, 2].map(|i| f(a[i], b[i]));
        Self { min: pick(self.min, other.min, f32::min), max: pick(self.max, other.max, f32::max) }
    }
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Node {
    boxes: [Box32; FANOUT],
    /// Number of the first child: a face of a leaf, else a node.
    first: u64,
    count: u32,
    is_leaf: u32,
}

impl Node {
    fn new(first: u64, is_leaf: bool) -> Self {
        Self { boxes: [Box32::EMPTY; FANOUT], first, count: 0, is_leaf: u32::from(is_leaf) }
    }

    fn add(&mut self, child: Box32) {
        self.boxes[self.count as usize] = child;
        self.count += 1;
    }

    fn bounds(&self) -> Box32 {
        self.boxes[..self.count as usize].iter().fold(Box32::EMPTY, |a, b| a.union(*b))
    }
}

/// Where faces are looked for: in a box, and near a plane.
pub struct Near {
    /// The box, m.
    pub bounds: Bounds,
    /// The plane.
    pub plane: Plane,
    /// How near it, m.
    pub near_m: f64,
}

impl Near {
    fn meets(&self, of: &Box32) -> bool {
        let other = Bounds::from_f32(of.min, of.max);
        if !self.bounds.meets(other) {
            return false;
        }
        let reach = (other.size() * 0.5).dot(self.plane.normal.abs());
        self.plane.height(other.centre()).abs() <= reach + self.near_m
    }
}

/// All faces that are not gone.
pub struct Neighbours {
    faces: RecordFile<Face>,
    nodes: RecordFile<Node>,
    roots: Vec<u64>,
    stack: Vec<u64>,
}

impl Neighbours {
    /// Of all pieces; `memory_bytes` bounds what is held.
    pub fn of(pieces: &mut RecordFile<Piece>, dir: &Path, memory_bytes: u64, progress: &dyn Progress) -> Result<Self> {
        let whole = bounds_of_all(pieces)?;
        let mut sorter = Sorter::new(dir, memory_bytes / 2);
        for row in 0..pieces.len() {
            let piece = pieces.get(row)?;
            if piece.gone == 0 {
                sorter.push(placed(&piece, row, whole))?;
            }
            if row % 65_536 == 0 {
                progress.go_on()?;
            }
        }
        let mut faces = RecordFile::create(dir, "contact-faces", memory_bytes / 2)?;
        let nodes = RecordFile::create(dir, "contact-boxes", memory_bytes / 2)?;
        let mut classes: Vec<(u64, u64)> = Vec::new();
        for placed in sorter.finish()? {
            let placed = placed?;
            if classes.last().is_none_or(|(class, _)| *class != placed.class) {
                classes.push((placed.class, faces.len()));
            }
            faces.push(Face {
                corners_m: bytemuck::cast(placed.corners),
                named: bytemuck::cast(placed.named),
                corner_count: placed.corner_count as u32,
                reserved: 0,
                row: placed.row,
            })?;
        }
        let mut neighbours = Self { faces, nodes, roots: Vec::new(), stack: Vec::new() };
        for (i, (_, first)) in classes.iter().enumerate() {
            let end = classes.get(i + 1).map_or(neighbours.faces.len(), |(_, next)| *next);
            neighbours.grow(*first, end)?;
        }
        Ok(neighbours)
    }

    /// A tree over a run of faces.
    fn grow(&mut self, first: u64, end: u64) -> Result<()> {
        let mut level = self.nodes.len();
        for from in (first..end).step_by(FANOUT) {
            let mut node = Node::new(from, true);
            for i in from..end.min(from + FANOUT as u64) {
                node.add(self.faces.get(i)?.bounds());
            }
            self.nodes.push(node)?;
        }
        while self.nodes.len() - level > 1 {
            let end = self.nodes.len();
            for from in (level..end).step_by(FANOUT) {
                let mut node = Node::new(from, false);
                for i in from..end.min(from + FANOUT as u64) {
                    node.add(self.nodes.get(i)?.bounds());
                }
                self.nodes.push(node)?;
            }
            level = end;
        }
        self.roots.push(level);
        Ok(())
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.faces.len()
    }

    /// One of them, in an order in which those that follow each other are near each other.
    pub fn face(&mut self, index: u64) -> Result<Face> {
        self.faces.get(index)
    }

    /// Visits the faces whose boxes are near, until told to stop.
    pub fn for_each(&mut self, near: &Near, mut visit: impl FnMut(&Face) -> ControlFlow<()>) -> Result<()> {
        self.stack.clear();
        self.stack.extend(&self.roots);
        while let Some(at) = self.stack.pop() {
            let node = self.nodes.get(at)?;
            for i in (0..node.count as usize).filter(|i| near.meets(&node.boxes[*i])) {
                let child = node.first + i as u64;
                if node.is_leaf == 0 {
                    self.stack.push(child);
                } else if visit(&self.faces.get(child)?).is_break() {
                    return Ok(());
                }
            }
        }
        Ok(())
    }
}

fn placed(piece: &Piece, row: u64, whole: Bounds) -> Placed {
    let around = bounds(piece);
    // Sizes of one class differ by up to four times.
    let class = (around.size().max_element().max(1e-9).log2() * 0.5).floor() as i64;
    Placed {
        class: (class + 64) as u64,
        morton: morton(around.centre(), whole),
        row,
        corners: bytemuck::cast(piece.corners_m),
        named: bytemuck::cast(piece.named),
        corner_count: u64::from(piece.corner_count),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Quiet;
    use crate::geom::sequence::{mix, unit};

    #[test]
    fn the_trees_find_what_looking_at_every_face_finds_whatever_memory_they_have() {
        let dir = tempfile::tempdir().unwrap();
        let mut pieces = RecordFile::create(dir.path(), "pieces", 0).unwrap();
        let random = |i: u64| unit(mix(i));
        for i in 0..3000 {
            let at = DVec3::new(random(7 * i), random(7 * i + 1), random(7 * i + 2)) * 10.0;
            let size = 8.0 * random(7 * i + 3).powi(6);
            let (u, v) = (DVec3::new(size, 0.0, 0.2 * size), DVec3::new(0.0, size, random(7 * i + 4) * size));
            let mut piece = Piece { corner_count: 3, gone: u32::from(i % 10 == 0), ..Piece::zeroed() };
            piece.corners_m = [at, at + u, at + v, at + v].map(|p| p.as_vec3().to_array());
            pieces.push(piece).unwrap();
        }
        for memory_bytes in [0, 1 << 24] {
            let mut neighbours = Neighbours::of(&mut pieces, dir.path(), memory_bytes, &Quiet).unwrap();
            assert!(neighbours.roots.len() > 3, "{}", neighbours.roots.len());
            for i in (0..3000).step_by(100) {
                let (points, n) = pieces.get(i).unwrap().points();
                let near = Near { bounds: Bounds::of(&points[..n]), plane: Plane::of(&points[..n]), near_m: 0.01 };
                let mut found = Vec::new();
                neighbours
                    .for_each(&near, |face| {
                        found.push(face.row);
                        ControlFlow::Continue(())
                    })
                    .unwrap();
                found.sort_unstable();
                let expected: Vec<u64> = (0..3000)
                    .filter(|j| {
                        let other = pieces.get(*j).unwrap();
                        let b = bounds(&other);
                        let is_near =
                            near.meets(&Box32 { min: b.min.as_vec3().to_array(), max: b.max.as_vec3().to_array() });
                        other.gone == 0 && is_near
                    })
                    .collect();
                assert_eq!(found, expected);
            }
        }
    }
}
