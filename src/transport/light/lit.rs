//! The light that leaves the places of a cluster, ready to be looked up by rays that met them.

use std::rc::Rc;

use glam::DVec3;

use crate::base::{ClusterId, NodeName, PatchSide, Result, Rgb};
use crate::geom::polygon::Polygon;
use crate::geom::quadtree::{self, Parting, UnitCut, parting};
use crate::model::geometry::{NONE, PatchRecord, SideMaterial};
use crate::transport::nodes::frame::{Frame, Plane};
use crate::transport::nodes::mesh::Mesh;
use crate::transport::row::Hit;

/// An element: a leaf with its light, or lines that part its children.
#[derive(Clone, Copy)]
struct LitNode {
    /// A leaf: radiosity at its centroid and its two slopes. Others: three lines (a, b, c), `a x + b y + c >= 0` on the left.
    numbers: [f32; 9],
    /// A leaf's centroid in its patch's frame, m.
    centroid: [f32; 2],
    parting: Parting,
}

/// How the numbers of a place in a patch that is a triangle or a parallelogram (see [`UnitCut`]) follow from where it lies
/// in its frame: three factors each, for x, y and 1.
type ToUnit = [[f32; 3]; 2];

/// A cluster's light. Nodes are numbered as the elements of its mesh are.
pub struct LitCluster {
    frames: Vec<Frame>,
    /// By patch; none where lines part the children.
    to_unit: Vec<Option<ToUnit>>,
    /// Four times the first child plus the number of the cut, or [`NONE`] for a leaf: little memory to go through.
    steps: Vec<u32>,
    nodes: Vec<LitNode>,
}

/// Gives the light of clusters.
pub trait Lights {
    /// That of a cluster, in the version that is read.
    fn lit(&self, id: ClusterId) -> Result<Rc<LitCluster>>;
}

impl LitCluster {
    /// Of a mesh.
    #[must_use]
    pub fn of(mesh: &Mesh, patches: &[PatchRecord], materials: &[SideMaterial]) -> Self {
        let frames: Vec<Frame> = patches.iter().map(Frame::of).collect();
        let to_unit = patches.iter().zip(&frames).map(|(patch, frame)| to_unit(frame, &quadtree::patch_polygon(patch)));
        let blank = LitNode { numbers: [0.0; 9], centroid: [0.0; 2], parting: Parting::Crossed };
        let (to_unit, count) = (to_unit.collect(), mesh.elements.len());
        let mut lit = Self { frames, to_unit, steps: vec![NONE; count], nodes: vec![blank; count] };
        mesh.for_each_shape(patches, |at, shape| {
            let element = &mesh.elements[at];
            let patch = usize::from(element.name.patch_side().patch);
            lit.nodes[at].centroid = element.centroid.map(|x| x as f32);
            if element.is_leaf() {
                return;
            }
            lit.steps[at] = 4 * element.first_child;
            (lit.nodes[at].parting, lit.nodes[at].numbers) = lines(&lit.frames[patch], shape);
            match UnitCut::of(shape) {
                Some(cut) => lit.steps[at] |= cut as u32,
                None => lit.to_unit[patch] = None,
            }
        });
        lit.relight(mesh, materials);
        lit
    }

    /// Takes over the light of a mesh whose elements are the same.
    pub fn relight(&mut self, mesh: &Mesh, materials: &[SideMaterial]) {
        for (node, element) in self.nodes.iter_mut().zip(&mesh.elements) {
            if element.is_leaf() {
                let rho = Rgb::from_f32(materials[element.name.patch_side().index()].rho);
                let line = &element.line;
                let values = [line.mean, line.along[0], line.along[1]].map(|c| rho.times(c).to_f32());
                node.numbers.copy_from_slice(values.as_flattened());
            }
        }
    }

    /// Bytes that it takes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(self.frames.as_slice()) + size_of_val(self.nodes.as_slice()) + size_of_val(self.steps.as_slice())
    }

    /// The plane of a patch.
    #[must_use]
    pub fn frame(&self, patch: u8) -> &Frame {
        &self.frames[usize::from(patch)]
    }

    /// The leaf at a place of a side, and the place relative to its centroid.
    #[inline]
    #[must_use]
    pub fn leaf_at(&self, side: PatchSide, at: [f32; 2]) -> (u32, [f32; 2]) {
        let mut index = side.index() as u32;
        if let Some(to_unit) = &self.to_unit[usize::from(side.patch)] {
            // A float beyond what an integer holds becomes the nearest one.
            let mut unit = to_unit.map(|[a, b, c]| ((a * at[0] + b * at[1] + c) * (1u64 << u32::BITS) as f32) as u32);
            while self.steps[index as usize] != NONE {
                let step = self.steps[index as usize];
                let (child, next) = UnitCut::ALL[(step & 3) as usize].child(unit);
                (index, unit) = (step / 4 + child, next);
            }
        }
        while self.steps[index as usize] != NONE {
            let node = &self.nodes[index as usize];
            let n = &node.numbers;
            let is_left = |line: usize| n[3 * line] * at[0] + n[3 * line + 1] * at[1] + n[3 * line + 2] >= 0.0;
            index = self.steps[index as usize] / 4 + node.parting.child(is_left);
        }
        let centroid = self.nodes[index as usize].centroid;
        (index, [at[0] - centroid[0], at[1] - centroid[1]])
    }

    /// Reflected light that leaves a leaf at a place relative to its centroid, W/m2.
    #[inline]
    #[must_use]
    pub fn leaving(&self, leaf: u32, [x, y]: [f32; 2]) -> [f32; 3] {
        let n = &self.nodes[leaf as usize].numbers;
        std::array::from_fn(|c| (n[c] + n[3 + c] * x + n[6 + c] * y).max(0.0))
    }

    /// Reflected light that leaves a place of a side, W/m2.
    #[must_use]
    pub fn leaving_at(&self, side: PatchSide, place: DVec3) -> [f32; 3] {
        let (leaf, at) = self.leaf_at(side, self.frame(side.patch).plane(place).map(|x| x as f32));
        self.leaving(leaf, at)
    }

    /// Reflected light that leaves a stored place of a side, W/m2.
    #[inline]
    #[must_use]
    pub fn leaving_from(&self, side: PatchSide, stored: [u16; 2]) -> [f32; 3] {
        let (leaf, at) = self.leaf_at(side, self.frames[usize::from(side.patch)].unpack(stored));
        self.leaving(leaf, at)
    }
}

/// The numbers of places in a patch; `None` if one of its elements is a needle or no parallelogram.
fn to_unit(frame: &Frame, patch: &Polygon) -> Option<ToUnit> {
    UnitCut::of(patch)?;
    let corners = frame.corners(patch);
    let (o, p, q) = (corners[0], corners[1], corners[corners.len() - 1]);
    let (a, b) = ([p[0] - o[0], p[1] - o[1]], [q[0] - o[0], q[1] - o[1]]);
    let determinant = a[0] * b[1] - a[1] * b[0];
    let factors = |x: f64, y: f64| [x, y, -(x * o[0] + y * o[1])].map(|f| (f / determinant) as f32);
    (determinant != 0.0).then(|| [factors(b[1], -b[0]), factors(-a[1], a[0])])
}

/// The lines between a shape's children in its patch's frame.
fn lines(frame: &Frame, shape: &Polygon) -> (Parting, [f32; 9]) {
    let (parting, between) = parting(shape);
    let mut numbers = [0.0; 9];
    for (line, (from, to)) in between.into_iter().enumerate() {
        let ([x, y], [u, v]): (Plane, Plane) = (frame.plane(from), frame.plane(to));
        let (a, b) = (y - v, u - x);
        numbers[3 * line..3 * line + 3].copy_from_slice(&[a as f32, b as f32, -(a * x + b * y) as f32]);
    }
    (parting, numbers)
}

/// A place that a ray met, as rows name it.
#[must_use]
pub fn met(lit: &LitCluster, cluster: ClusterId, side: PatchSide, place: DVec3) -> Hit {
    let frame = lit.frame(side.patch);
    Hit { side: NodeName::root(cluster, side), at: frame.pack(frame.plane(place)) }
}
