//! Clusters of one version, as the solver reads them.

use std::rc::Rc;

use glam::DVec3;

use crate::base::{ClusterId, NodeName, PatchSide, Result};
use crate::geom::quadtree;
use crate::model::geometry::{GeometryView, SideMaterial};
use crate::model::light::LightView;
use crate::rays::node::Node;

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
    /// The stored leaf of a patch side that holds a point of it.
    #[must_use]
    pub fn leaf_at(&self, at: PatchSide, point: DVec3) -> Node {
        let mut node = Node::root(self.id, &self.geometry.patches[usize::from(at.patch)], at);
        while self.light.has_children(node.name) {
            node = node.child(quadtree::child_at(&node.shape, point));
        }
        node
    }

    /// Whether the side that an element lies on emits.
    #[must_use]
    pub fn emits(&self, element: NodeName) -> bool {
        self.materials[element.patch_side().index()].exitance != [0.0; 3]
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

/// Exitance of a side, W/m2; none of what is no side.
pub fn exitance(clusters: &dyn Clusters, side: NodeName) -> Result<[f32; 3]> {
    if side == NodeName::ESCAPE {
        return Ok([0.0; 3]);
    }
    let loaded = clusters.cluster(side.cluster())?;
    Ok(loaded.view().materials[side.patch_side().index()].exitance)
}

/// Clusters of one version, fetched as needed; implemented over a store, and in memory by tests.
pub trait Clusters {
    /// A cluster, from a bounded cache or the disk.
    fn cluster(&self, id: ClusterId) -> Result<Rc<dyn Loaded>>;
}
