//! The elements of one receiving cluster while a task works on it: an arena of quadtrees.

use super::sectors::{self, Sector};
use crate::base::{ClusterId, NodeName, PatchSide, Rgb};
use crate::geom::quadtree;
use crate::model::geometry::{GeometryView, NONE};
use crate::model::light::LightView;

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
    /// Irradiance, W/m2.
    pub irradiance: Rgb,
    /// Smallest and largest leaf below, per channel, W/m2: what `spread` follows from.
    pub leaf_low: [f64; 3],
    /// See `leaf_low`.
    pub leaf_high: [f64; 3],
}

impl Element {
    fn new(name: NodeName, parent: u32, area_m2: f64, irradiance: Rgb) -> Self {
        Self { name, first_child: NONE, parent, area_m2, irradiance, leaf_low: irradiance.0, leaf_high: irradiance.0 }
    }

    /// Sets the irradiance of a leaf, W/m2.
    pub fn set_irradiance(&mut self, irradiance: Rgb) {
        self.irradiance = irradiance;
        self.leaf_low = irradiance.0;
        self.leaf_high = irradiance.0;
    }

    /// Whether nothing lies below.
    #[must_use]
    pub fn is_leaf(&self) -> bool {
        self.first_child == NONE
    }

    /// Largest deviation, in any channel, of any leaf below, W/m2.
    #[must_use]
    pub fn spread(&self) -> f64 {
        let h = self.irradiance.0;
        (0..3).map(|i| (self.leaf_high[i] - h[i]).max(h[i] - self.leaf_low[i])).fold(0.0, f64::max)
    }
}

/// All nodes of a cluster. Positions count sector nodes first, then elements.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// The cluster.
    pub cluster: ClusterId,
    /// Sector nodes, by name: those above come earlier.
    pub sectors: Vec<Sector>,
    /// The lowest sector node above each patch side, [`NONE`] where a side takes no part.
    pub side_sector: Vec<u32>,
    /// Elements; the first two per patch are the roots of its sides.
    /// The arena: children lie behind their parents.
    pub elements: Vec<Element>,
}

impl Mesh {
    /// Sector nodes without elements below.
    #[must_use]
    pub fn empty(cluster: ClusterId, geometry: &GeometryView<'_>) -> Self {
        let of = NodeName::root(cluster, PatchSide { patch: 0, side: 0 });
        let side_sector = sectors::above_sides(geometry, of);
        Self { cluster, sectors: sectors::load(geometry), side_sector, elements: Vec::new() }
    }

    /// Number of nodes.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.sectors.len() + self.elements.len()
    }

    /// Position of the node of that name, or of the nearest one above it.
    #[must_use]
    pub fn position(&self, name: NodeName) -> usize {
        if name.is_sector() {
            return self.sectors.partition_point(|s| s.name < name);
        }
        self.sectors.len() + self.nearest(name)
    }

    /// Name of the node at a position.
    #[must_use]
    pub fn name_at(&self, position: usize) -> NodeName {
        match position.checked_sub(self.sectors.len()) {
            Some(element) => self.elements[element].name,
            None => self.sectors[position].name,
        }
    }

    /// Whether the node at a position is a leaf.
    #[must_use]
    pub fn is_leaf_at(&self, position: usize) -> bool {
        position.checked_sub(self.sectors.len()).is_some_and(|element| self.elements[element].is_leaf())
    }

    /// As stored in a version.
    #[must_use]
    pub fn load(cluster: ClusterId, geometry: &GeometryView<'_>, light: &LightView<'_>) -> Self {
        let mut mesh = Self::empty(cluster, geometry);
        mesh.elements.reserve(light.elements.len());
        for (index, stored) in light.level(0).iter().enumerate() {
            let at = PatchSide::from_index(index);
            let area = quadtree::patch_polygon(&geometry.patches[usize::from(at.patch)]).area();
            mesh.elements.push(Element::new(NodeName::root(cluster, at), NONE, area, Rgb::from_f32(stored.irradiance)));
        }
        let mut next = 0;
        while next < mesh.elements.len() {
            let name = mesh.elements[next].name;
            if light.has_children(name) {
                mesh.split(next, &geometry.patches[usize::from(name.patch_side().patch)]);
                let first = mesh.elements[next].first_child as usize;
                for quarter in 0..4 {
                    if let Some(stored) = light.find(name.child(quarter)) {
                        mesh.elements[first + quarter as usize].set_irradiance(Rgb::from_f32(stored.irradiance));
                    }
                }
            }
            next += 1;
        }
        super::push_pull::pull(&mut mesh);
        sectors::measure(&mut mesh);
        mesh
    }

    /// Appends the root of a patch side, unlit; roots come first, in order.
    pub fn add_root(&mut self, geometry: &GeometryView<'_>, at: PatchSide) {
        let area = quadtree::patch_polygon(&geometry.patches[usize::from(at.patch)]).area();
        self.elements.push(Element::new(NodeName::root(self.cluster, at), NONE, area, Rgb::BLACK));
    }

    /// Gives a leaf four children with its light.
    pub fn split(&mut self, index: usize, patch: &crate::model::geometry::PatchRecord) {
        let parent = self.elements[index];
        debug_assert!(parent.is_leaf());
        let shape = quadtree::element_polygon(patch, parent.name.path());
        self.elements[index].first_child = u32::try_from(self.elements.len()).expect("fewer than 2^32 elements");
        for quarter in 0..4 {
            let area = quadtree::child(&shape, quarter).area();
            self.elements.push(Element::new(parent.name.child(quarter), index as u32, area, parent.irradiance));
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
}
