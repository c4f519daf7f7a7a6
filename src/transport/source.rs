//! What the solver asks of a source: its light now, and its shape.

use std::rc::Rc;

use glam::DVec3;

use crate::base::name::MAX_DEPTH;
use crate::base::{ClusterId, NodeName, PatchSide, Result, Rgb};
use crate::geom::quadtree;
use crate::model::geometry::{GeometryView, SideMaterial};
use crate::model::light::LightView;
use crate::rays::node::Node;

/// Light that leaves a node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SourceLight {
    /// Radiosity, W/m2.
    pub radiosity: Rgb,
    /// Largest deviation of the radiosity of any leaf below, in any channel, W/m2.
    pub spread: f64,
    /// Whether elements below are stored.
    pub divided: bool,
}

/// One cluster of one version.
#[derive(Clone, Copy)]
pub struct ClusterView<'a> {
    /// Its number.
    pub id: ClusterId,
    /// Its patches.
    pub geometry: GeometryView<'a>,
    /// Two per patch: front, back.
    pub materials: &'a [SideMaterial],
    /// What arrives at its nodes.
    pub light: LightView<'a>,
}

impl ClusterView<'_> {
    /// Light that leaves the node `name`: an element's by its nearest stored ancestor (exact, since
    /// nothing finer is known).
    #[must_use]
    pub fn source(&self, name: NodeName) -> SourceLight {
        if name.is_sector() {
            let Ok(at) = self.light.sectors.binary_search_by_key(&name.0, |s| s.name) else {
                return SourceLight::default();
            };
            let found = &self.light.sectors[at];
            let radiosity = Rgb::from_f32(found.radiosity);
            return SourceLight { radiosity, spread: f64::from(found.spread), divided: true };
        }
        let material = &self.materials[name.patch_side().index()];
        let Some(found) = self.light.nearest(name) else { return SourceLight::default() };
        let rho = Rgb::from_f32(material.rho);
        let radiosity = Rgb::from_f32(material.exitance) + rho.times(Rgb::from_f32(found.irradiance));
        let exact = found.name == name.0;
        let spread = if exact { f64::from(found.spread) * rho.max() } else { 0.0 };
        SourceLight { radiosity, spread, divided: exact && self.light.has_children(name) }
    }

    /// The stored leaf of a patch side that holds a point of it.
    #[must_use]
    pub fn leaf_at(&self, at: PatchSide, point: DVec3) -> Node {
        let mut node = Node::root(self.id, &self.geometry.patches[usize::from(at.patch)], at);
        while self.light.has_children(node.name) {
            node = node.child(quadtree::child_at(&node.shape, point));
        }
        node
    }

    /// The element at a place of a patch side that is as small as elements get, `min_element_m` or as stored: what is
    /// divided later is seen where it was met.
    #[must_use]
    pub fn smallest_at(&self, at: PatchSide, place: DVec3, min_element_m: f64) -> Node {
        let mut element = Node::root(self.id, &self.geometry.patches[usize::from(at.patch)], at);
        while element.name.depth() < MAX_DEPTH
            && (!element.is_smallest(min_element_m) || self.light.has_children(element.name))
        {
            element = element.child(quadtree::child_at(&element.shape, place));
        }
        element
    }

    /// Whether the side that an element lies on emits; sector nodes are sources where all of their sides do.
    #[must_use]
    pub fn emits(&self, element: NodeName) -> bool {
        element.is_sector() || self.materials[element.patch_side().index()].exitance != [0.0; 3]
    }

    /// Exitance of the side that an element lies on, W/m2 (norm over RGB).
    #[must_use]
    pub fn exitance(&self, element: NodeName) -> f64 {
        Rgb::from_f32(self.materials[element.patch_side().index()].exitance).norm_squared().sqrt()
    }

    /// Whether a patch side takes part at all.
    #[must_use]
    pub fn takes_part(&self, side_index: usize) -> bool {
        self.geometry.patches[side_index / 2].sides & (1 << (side_index % 2)) != 0
    }
}

/// A cluster held in memory or mapped.
pub trait Loaded {
    /// Borrows its records.
    fn view(&self) -> ClusterView<'_>;
}

/// Clusters of one version, fetched as needed; implemented over a store, and in memory by tests.
pub trait Clusters {
    /// A cluster, from a bounded cache or the disk.
    fn cluster(&self, id: ClusterId) -> Result<Rc<dyn Loaded>>;
}
