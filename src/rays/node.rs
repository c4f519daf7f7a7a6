//! Nodes as geometry: an element's shape, the side that takes part, and how rays know it; places that rays start from.

use glam::DVec3;

use super::traverse::Face;
use super::{PatchKey, RayEnd};
use crate::base::{ClusterId, NodeName, PatchSide};
use crate::geom::polygon::Polygon;
use crate::geom::quadtree;
use crate::model::geometry::PatchRecord;

/// An element with its shape.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// Its name.
    pub name: NodeName,
    /// Its shape, winding towards the patch's front, m.
    pub shape: Polygon,
    /// Unit normal of its side.
    pub normal: DVec3,
    /// Its patch, as a ray's end.
    pub end: RayEnd,
}

/// Where light arrives: a place with the way that it faces.
#[derive(Clone, Copy, Debug)]
pub struct Facet<'a> {
    /// The place, m.
    pub place: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// The patch that it lies on; none in the open.
    pub on: Option<&'a RayEnd>,
}

impl Node {
    /// A place of its side.
    #[must_use]
    pub fn facet(&self, place: DVec3) -> Facet<'_> {
        Facet { place, normal: self.normal, on: Some(&self.end) }
    }

    /// The whole of a patch side.
    #[must_use]
    pub fn root(cluster: ClusterId, patch: &PatchRecord, at: PatchSide) -> Self {
        let shape = quadtree::patch_polygon(patch);
        let front = shape.normal();
        let face = Face { key: PatchKey::of_packed(patch.face), front: at.side == 0, area_m2: patch.face_area_m2 };
        let end = RayEnd { normal: front, face };
        let normal = if at.side == 0 { front } else { -front };
        Self { name: NodeName::root(cluster, at), shape, normal, end }
    }

    /// The element at `path` of a patch side.
    #[must_use]
    pub fn at(cluster: ClusterId, patch: &PatchRecord, name: NodeName) -> Self {
        let mut node = Self::root(cluster, patch, name.patch_side());
        node.shape = quadtree::element_polygon(patch, name.path());
        node.name = name;
        node
    }

    /// One of its four children.
    #[must_use]
    pub fn child(&self, quarter: u32) -> Self {
        Self { name: self.name.child(quarter), shape: quadtree::child(&self.shape, quarter), ..*self }
    }

    /// Whether it is too short to be split.
    #[must_use]
    pub fn is_smallest(&self, min_element_m: f64) -> bool {
        quadtree::child_edge_m(&self.shape) < min_element_m
    }

    /// Height of a point over the plane of the node's side, m.
    #[must_use]
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point - self.shape.corners()[0])
    }
}
