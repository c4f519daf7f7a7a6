//! The elements of a cluster: an arena of quadtrees, and the rows that they have.

use super::frame::{Frame, Plane};
use crate::base::Rgb;
use crate::base::{ClusterId, NodeName, PatchSide};
use crate::geom::polygon::Polygon;
use crate::geom::quadtree;
use crate::model::geometry::{NONE, PatchRecord};
use crate::model::light::{LightView, RowLight};
use crate::transport::light::line::{Fit, Line};
use crate::transport::light::shrink;
use crate::transport::numbers;
use crate::transport::row::Part;

/// An element of the arena.
#[derive(Clone, Copy, Debug)]
pub struct Element {
    /// Its name.
    pub name: NodeName,
    /// First of four children in the arena, or [`NONE`].
    pub first_child: u32,
    /// Element above, or [`NONE`] for a root.
    pub parent: u32,
    /// Area, m2.
    pub area_m2: f64,
    /// Centroid in its patch's frame, m.
    pub centroid: Plane,
    /// Means over its points of x x, x y and y y, from the centroid, m2.
    pub moments: [f64; 3],
    /// Irradiance; of an element with children the mean alone.
    pub line: Line,
}

impl Element {
    fn new(name: NodeName, parent: u32, shape: &Polygon, frame: &Frame) -> Self {
        let centroid = frame.plane(shape.centroid());
        let moments = frame.moments(shape, centroid);
        Self { name, first_child: NONE, parent, area_m2: shape.area(), centroid, moments, line: Line::default() }
    }

    /// Whether nothing lies below.
    #[must_use]
    pub fn is_leaf(&self) -> bool {
        self.first_child == NONE
    }
}

/// A row as its element knows it: the line through what it measured last, and how good that is.
#[derive(Clone, Copy, Debug)]
pub struct MeshRow {
    /// The element, in the arena.
    pub element: u32,
    /// Which of its light.
    pub part: Part,
    /// Rays of each half from each place.
    pub rounds: u16,
    /// The light, and how good it is.
    pub fit: Fit,
}

/// All elements of a cluster.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// The cluster.
    pub cluster: ClusterId,
    /// Elements; the first two per patch are the roots of its sides. Children lie behind their parents.
    pub elements: Vec<Element>,
    /// Rows, by name of their element, direct ones first. Those of a part cover each side that has any, and none lies
    /// below another.
    pub rows: Vec<MeshRow>,
}

impl Mesh {
    /// Unlit roots, without rows.
    #[must_use]
    pub fn new(cluster: ClusterId, patches: &[PatchRecord]) -> Self {
        let mut mesh = Self { cluster, elements: Vec::new(), rows: Vec::new() };
        for (index, patch) in patches.iter().enumerate() {
            let (shape, frame) = (quadtree::patch_polygon(patch), Frame::of(patch));
            for side in 0..2 {
                let name = NodeName::root(cluster, PatchSide::from_index(2 * index + side));
                mesh.elements.push(Element::new(name, NONE, &shape, &frame));
            }
        }
        mesh
    }

    /// As stored in a version.
    #[must_use]
    pub fn load(cluster: ClusterId, patches: &[PatchRecord], light: &LightView<'_>) -> Self {
        let mut mesh = Self::new(cluster, patches);
        let mut next = 0;
        while next < mesh.elements.len() {
            let name = mesh.elements[next].name;
            if let Some(stored) = light.find(name) {
                let along = [Rgb::from_f32(stored.slope_u), Rgb::from_f32(stored.slope_v)];
                mesh.elements[next].line = Line { mean: Rgb::from_f32(stored.irradiance), along };
            }
            if light.has_children(name) {
                mesh.split(next, &patches[usize::from(name.patch_side().patch)]);
            }
            next += 1;
        }
        mesh.rows = light.rows.iter().map(|row| mesh.row_of(row)).collect();
        mesh
    }

    fn row_of(&self, stored: &RowLight) -> MeshRow {
        let along = [Rgb::from_f32(stored.slope_u), Rgb::from_f32(stored.slope_v)];
        MeshRow {
            element: self.nearest(NodeName(stored.name)) as u32,
            part: if stored.part == 0 { Part::Direct } else { Part::Indirect },
            rounds: stored.rounds,
            fit: Fit {
                line: Line { mean: Rgb::from_f32(stored.irradiance), along },
                structure: f64::from(stored.structure),
                structure_error: f64::from(stored.structure_error),
                found: f64::from(stored.found),
                noise: f64::from(stored.noise),
            },
        }
    }

    /// Gives a leaf four children with its light.
    pub fn split(&mut self, index: usize, patch: &PatchRecord) {
        let parent = self.elements[index];
        debug_assert!(parent.is_leaf());
        let (shape, frame) = (quadtree::element_polygon(patch, parent.name.path()), Frame::of(patch));
        self.elements[index].first_child = u32::try_from(self.elements.len()).expect("fewer than 2^32 elements");
        for quarter in 0..4 {
            let name = parent.name.child(quarter);
            let mut child = Element::new(name, index as u32, &quadtree::child(&shape, quarter), &frame);
            child.line = parent.line.about([0, 1].map(|i| child.centroid[i] - parent.centroid[i]));
            self.elements.push(child);
        }
    }

    /// The element of that name, or the nearest one above it.
    #[must_use]
    pub fn nearest(&self, name: NodeName) -> usize {
        let mut at = name.patch_side().index();
        for level in (0..name.depth()).rev() {
            let element = &self.elements[at];
            if element.is_leaf() {
                break;
            }
            at = element.first_child as usize + ((name.path() >> (2 * level)) & 3) as usize;
        }
        at
    }

    /// The leaves of one side, the elements above them in order.
    #[must_use]
    pub fn leaves(&self, side: PatchSide) -> Vec<usize> {
        let (mut leaves, mut open) = (Vec::new(), vec![side.index()]);
        while let Some(at) = open.pop() {
            let element = &self.elements[at];
            if element.is_leaf() {
                leaves.push(at);
            } else {
                let first = element.first_child as usize;
                open.extend((first..first + 4).rev());
            }
        }
        leaves
    }

    /// The leaves of one side with their light.
    #[must_use]
    pub fn lines(&self, side: PatchSide) -> Vec<(NodeName, Line)> {
        self.leaves(side).into_iter().map(|at| (self.elements[at].name, self.elements[at].line)).collect()
    }

    /// Calls `visit` with every element and its shape, those above before those below.
    pub fn for_each_shape(&self, patches: &[PatchRecord], mut visit: impl FnMut(usize, &Polygon)) {
        let mut open: Vec<(usize, Polygon)> = Vec::new();
        for root in 0..2 * patches.len() {
            open.push((root, quadtree::patch_polygon(&patches[root / 2])));
            while let Some((at, shape)) = open.pop() {
                visit(at, &shape);
                if !self.elements[at].is_leaf() {
                    let first = self.elements[at].first_child as usize;
                    open.extend((0..4).map(|q| (first + q, quadtree::child(&shape, q as u32))));
                }
            }
        }
    }

    /// Rows of each element by part: its own, or that of the element above which it has its light from.
    #[must_use]
    pub fn rows_above(&self) -> Vec<[u32; 2]> {
        let mut above = vec![[NONE; 2]; self.elements.len()];
        for (index, row) in self.rows.iter().enumerate() {
            above[row.element as usize][row.part as usize] = index as u32;
        }
        for at in 0..self.elements.len() {
            if self.elements[at].parent != NONE {
                let parent = above[self.elements[at].parent as usize];
                for part in 0..2 {
                    if above[at][part] == NONE {
                        above[at][part] = parent[part];
                    }
                }
            }
        }
        above
    }

    /// Squared error that is expected at an element with its light from these rows, (W/m2)2: never 0 where there is light,
    /// since rows that came out good by luck are looked at too.
    #[must_use]
    pub fn expected_error(&self, at: usize, above: &[u32; 2]) -> f64 {
        let rows = above.iter().filter_map(|&row| self.rows.get(row as usize));
        let error: f64 = rows.map(|row| row.fit.structure.max(row.fit.found).max(0.0) + row.fit.noise).sum();
        error + numbers::CHECKED_ANYHOW * self.elements[at].line.mean.norm_squared()
    }

    /// Sets the light of all elements from their rows' lines: what a row says holds down to the leaves below, and means
    /// go up again, so that power is kept.
    pub fn push_pull(&mut self, above: &[[u32; 2]]) {
        let lines = shrink::lines(self);
        for (at, of_parts) in above.iter().enumerate() {
            if !self.elements[at].is_leaf() {
                continue;
            }
            let mut line = Line::default();
            for index in of_parts.iter().filter(|row| **row != NONE) {
                let row = &self.rows[*index as usize];
                let from = self.elements[row.element as usize].centroid;
                let to = self.elements[at].centroid;
                line = line.plus(&lines[*index as usize].about([to[0] - from[0], to[1] - from[1]]));
            }
            line.mean = Rgb(line.mean.0.map(|x| x.max(0.0)));
            self.elements[at].line = line;
        }
        self.pull();
    }

    /// Means of the leaves, upwards.
    pub fn pull(&mut self) {
        for at in (0..self.elements.len()).rev() {
            if self.elements[at].is_leaf() {
                continue;
            }
            let first = self.elements[at].first_child as usize;
            let children = &self.elements[first..first + 4];
            let area: f64 = children.iter().map(|c| c.area_m2).sum();
            let sum = children.iter().fold(Rgb::BLACK, |sum, c| sum + c.line.mean * c.area_m2);
            let mean = if area > 0.0 { sum * (1.0 / area) } else { children[0].line.mean };
            self.elements[at].line = Line { mean, ..Line::default() };
        }
    }
}
