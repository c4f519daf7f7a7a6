//! Builds the ray structures: one hierarchy over the faces of a cluster, one over all clusters.
//!
//! The only place that knows obvhs, and it is used as a builder only: its traversal leaks at edges.

use std::time::Duration;

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::{Boundable, BvhBuildParams};

use crate::geom::bounds::Bounds;
use crate::model::geometry::PatchRecord;
use crate::model::rays::{ClusterRef, RayNode, RayPatch, WHOLE};

struct Item(Aabb);

impl Boundable for Item {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

/// Hierarchy over boxes: nodes, and the order in which leaves run over the boxes.
fn hierarchy(boxes: impl Iterator<Item = ([f32; 3], [f32; 3])>) -> (Vec<RayNode>, Vec<u32>) {
    let (binary, order) = binary(boxes);
    (collapsed(&binary), order)
}

/// Binary hierarchy over boxes, one a leaf.
fn binary(boxes: impl Iterator<Item = ([f32; 3], [f32; 3])>) -> (Vec<Bvh2Node>, Vec<u32>) {
    let items: Vec<Item> = boxes.map(|(min, max)| Item(Aabb::new(Vec3A::from(min), Vec3A::from(max)))).collect();
    if items.len() <= 1 {
        let whole = items.iter().fold(Aabb::empty(), |a, b| a.union(&b.0));
        return (vec![Bvh2Node::new(whole, items.len() as u32, 0)], (0..items.len() as u32).collect());
    }
    let mut params = BvhBuildParams::medium_build();
    params.max_prims_per_leaf = 1;
    let bvh = build_bvh2(&items, params, &mut Duration::default());
    (bvh.nodes, bvh.primitive_indices)
}

/// The largest boxes of a binary hierarchy opened, eight to a node.
fn collapsed(binary: &[Bvh2Node]) -> Vec<RayNode> {
    let mut nodes = vec![RayNode::EMPTY];
    let mut waiting = vec![(0, 0)];
    while let Some((top, into)) = waiting.pop() {
        let mut within: Vec<u32> = vec![top];
        let area = |at: u32| binary[at as usize].aabb().half_area();
        while within.len() < 8
            && let Some(largest) = (0..within.len())
                .filter(|&i| binary[within[i] as usize].prim_count == 0)
                .max_by(|&i, &j| area(within[i]).total_cmp(&area(within[j])))
        {
            let first = binary[within[largest] as usize].first_index;
            within[largest] = first;
            within.push(first + 1);
        }
        for (slot, &at) in within.iter().enumerate() {
            let node = &binary[at as usize];
            let (bounds_m, items) = ((node.min.into(), node.max.into()), node.prim_count);
            let first = if items > 0 { node.first_index } else { nodes.len() as u32 };
            nodes[into] = nodes[into].with(slot, bounds_m, first, items);
            if items == 0 {
                waiting.push((at, nodes.len()));
                nodes.push(RayNode::EMPTY);
            }
        }
    }
    nodes
}

/// A face that is one patch, of that number in its cluster.
#[must_use]
pub fn whole(patch: &PatchRecord, number: u32) -> RayPatch {
    RayPatch {
        corners_m: patch.corners_m,
        patch: number,
        corner_count: u32::from(patch.corner_count),
        area_m2: patch.area_m2,
        cut: WHOLE,
    }
}

/// The ray structure of one cluster of one face at least: nodes and faces in leaf order.
#[must_use]
pub fn cluster(faces: &[RayPatch]) -> (Vec<RayNode>, Vec<RayPatch>) {
    let boxes = faces.iter().map(|face| {
        let b = Bounds::of(&face.corners_m.map(|c| DVec3::from_array(c.map(f64::from))));
        (b.min.as_vec3().to_array(), b.max.as_vec3().to_array())
    });
    let (nodes, order) = hierarchy(boxes);
    (nodes, order.iter().map(|&i| faces[i as usize]).collect())
}

/// The structure over all clusters: nodes, and the clusters in leaf order. Grows with the number of
/// clusters (about 150 bytes each), the one thing in a store's making that does.
#[must_use]
pub fn top(clusters: &[(ClusterRef, [f32; 3], [f32; 3])]) -> (Vec<RayNode>, Vec<ClusterRef>) {
    let (nodes, order) = hierarchy(clusters.iter().map(|c| (c.1, c.2)));
    (nodes, order.iter().map(|&i| clusters[i as usize].0).collect())
}
