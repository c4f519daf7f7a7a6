//! Ray structures: a box hierarchy over the patches of each cluster, and one over the clusters.
//!
//! A cluster's extent holds nodes and patches; the top extent (cluster [`TOP`]) holds nodes whose
//! leaves are runs of [`ClusterRef`]s, which say where each cluster's arrays lie.

use bytemuck::{Pod, Zeroable};

use super::Arrays;

/// "Cluster" number of the top extent.
pub const TOP: u32 = u32::MAX;

/// A node: an inner one (`count` 0) has children `first` and `first + 1`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RayNode {
    /// Smallest corner, m from the store's origin.
    pub min_m: [f32; 3],
    /// First child, or first item of a leaf.
    pub first: u32,
    /// Largest corner.
    pub max_m: [f32; 3],
    /// Items of a leaf, 0 for an inner node.
    pub count: u32,
}

/// A patch as rays meet it: a triangle, or a quad as its triangles 0 1 2 and 0 2 3.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct RayPatch {
    /// Corners in winding order, m from the store's origin; a triangle repeats its third.
    pub corners_m: [[f32; 3]; 4],
    /// Patch number within the cluster.
    pub patch: u32,
    /// 3 or 4.
    pub corner_count: u32,
    /// Area, m2: of coincident patches that face the same way the smallest is seen.
    pub area_m2: f32,
    /// 0.
    pub reserved: u32,
}

/// Where a cluster's ray arrays lie.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ClusterRef {
    /// Byte of the first node in the segment file of the top extent.
    pub nodes_at: u64,
    /// Byte of the first patch.
    pub patches_at: u64,
    /// Cluster number.
    pub cluster: u32,
    /// Nodes.
    pub nodes: u32,
    /// Patches.
    pub patches: u32,
    /// 0.
    pub reserved: u32,
}

/// A cluster's ray structure.
#[derive(Clone, Copy)]
pub struct ClusterRaysView<'a> {
    /// Box hierarchy; node 0 is the root.
    pub nodes: &'a [RayNode],
    /// Patches, in leaf order.
    pub patches: &'a [RayPatch],
}

impl<'a> ClusterRaysView<'a> {
    /// Borrows the arrays of a payload.
    pub fn parse(payload: &'a [u8]) -> Result<Self, String> {
        let arrays = Arrays::new(payload);
        Ok(Self { nodes: arrays.get(0)?, patches: arrays.get(1)? })
    }

    /// Bytes from a payload's start to the first node, which is where the array behind two entries of the table
    /// begins.
    pub const NODES_AT: u64 = 48;
}

/// The structure over all clusters; it lies in the same segment file as every cluster's.
#[derive(Clone, Copy)]
pub struct TopRaysView<'a> {
    /// Box hierarchy; node 0 is the root.
    pub nodes: &'a [RayNode],
    /// Clusters, in leaf order.
    pub clusters: &'a [ClusterRef],
}

impl<'a> TopRaysView<'a> {
    /// Borrows the arrays of a payload.
    pub fn parse(payload: &'a [u8]) -> Result<Self, String> {
        let arrays = Arrays::new(payload);
        Ok(Self { nodes: arrays.get(0)?, clusters: arrays.get(1)? })
    }
}

/// Deepest that a hierarchy may be: a traversal's stack holds as many nodes. obvhs keeps its trees below 96.
pub const DEEPEST: usize = 126;

/// Whether every node refers to what is there, among so many items, and a walk from the root ends; what is
/// wrong otherwise.
pub fn hierarchy(nodes: &[RayNode], items: usize) -> Result<(), String> {
    let mut waiting = vec![(0usize, 0usize)];
    let mut visited = 0;
    while let Some((at, depth)) = waiting.pop() {
        let node = nodes.get(at).ok_or_else(|| format!("there is no ray node {at}"))?;
        visited += 1;
        // More visits than nodes: some node is below itself or below two others.
        if visited > nodes.len() || depth > DEEPEST {
            return Err("the ray nodes are no tree".to_owned());
        }
        let first = node.first as usize;
        if node.count == 0 {
            waiting.extend([(first, depth + 1), (first + 1, depth + 1)]);
        } else if first + node.count as usize > items {
            return Err(format!("ray node {at} refers to items {first} and on, beyond the last of {items}"));
        }
    }
    Ok(())
}
