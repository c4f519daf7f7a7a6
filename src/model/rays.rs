//! Ray structures: a box hierarchy over the faces of each cluster, and one over the clusters.
//!
//! Rays meet faces as they were before contact lines cut them into patches, so that neighbours share edges to the
//! bit; a face's cut tree tells which of its patches a place lies in. A cluster's extent holds nodes, faces and cuts;
//! the top extent (cluster [`TOP`]) holds nodes whose leaves are runs of [`ClusterRef`]s, which say where each
//! cluster's arrays lie.

use bytemuck::{Pod, Zeroable};

use super::Arrays;
use super::cut::CutNode;
use super::layout::ArraysBuilder;

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

/// A face as rays meet it: a triangle, or a quad as its triangles 0 1 2 and 0 2 3.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct RayPatch {
    /// Corners in winding order, m from the store's origin; a triangle repeats its third.
    pub corners_m: [[f32; 3]; 4],
    /// Patch number, within the cluster, of the face's first part: that of the whole if nothing cuts it.
    pub patch: u32,
    /// 3 or 4.
    pub corner_count: u32,
    /// Area, m2: of coincident faces that face the same way the smallest is seen.
    pub area_m2: f32,
    /// Which of the cluster's [`FaceCut`]s is its own, or [`WHOLE`].
    pub cut: u32,
}

/// The "cut" of a face that is one patch.
pub const WHOLE: u32 = u32::MAX;

/// Where a face's cut tree and the names of its parts lie among the cluster's.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct FaceCut {
    /// First node.
    pub first_node: u32,
    /// Nodes.
    pub nodes: u32,
    /// First part.
    pub first_part: u32,
    /// Parts.
    pub parts: u32,
}

/// Where a cluster's ray arrays lie: bytes in the segment file of the top extent, and how long they are.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ClusterRef {
    /// Byte of the first node.
    pub nodes_at: u64,
    /// Byte of the first face.
    pub patches_at: u64,
    /// Byte of the first cut.
    pub cuts_at: u64,
    /// Byte of the first node of a cut tree.
    pub cut_nodes_at: u64,
    /// Byte of the first part.
    pub parts_at: u64,
    /// Cluster number.
    pub cluster: u32,
    /// Nodes.
    pub nodes: u32,
    /// Faces.
    pub patches: u32,
    /// Cuts.
    pub cuts: u32,
    /// Nodes of cut trees.
    pub cut_nodes: u32,
    /// Parts.
    pub parts: u32,
}

impl ClusterRef {
    /// To a cluster's arrays in a payload that begins at byte `at`; what is wrong with it otherwise.
    pub fn to(cluster: u32, payload: &[u8], at: u64) -> Result<Self, String> {
        let arrays = Arrays::new(payload);
        let place = |index: usize| arrays.place(index).map(|(offset, _)| at + offset as u64);
        let count = |index: usize, size: usize| arrays.place(index).map(|(_, bytes)| (bytes / size) as u32);
        Ok(Self {
            nodes_at: place(0)?,
            patches_at: place(1)?,
            cuts_at: place(2)?,
            cut_nodes_at: place(3)?,
            parts_at: place(4)?,
            cluster,
            nodes: count(0, size_of::<RayNode>())?,
            patches: count(1, size_of::<RayPatch>())?,
            cuts: count(2, size_of::<FaceCut>())?,
            cut_nodes: count(3, size_of::<CutNode>())?,
            parts: count(4, size_of::<u32>())?,
        })
    }
}

/// How the faces of a cluster are cut.
#[derive(Clone, Copy)]
pub struct Cuts<'a> {
    /// Of the faces that are.
    pub faces: &'a [FaceCut],
    /// Their cut trees.
    pub nodes: &'a [CutNode],
    /// Patches that they fell into: cluster * 256 + patch.
    pub parts: &'a [u32],
}

impl<'a> Cuts<'a> {
    /// A face's tree and parts; `None` if they lie outside the arrays.
    #[must_use]
    pub fn of_face(&self, cut: u32) -> Option<(&'a [CutNode], &'a [u32])> {
        let cut = self.faces.get(cut as usize)?;
        let range = |first: u32, count: u32| first as usize..(first as usize).saturating_add(count as usize);
        let nodes = self.nodes.get(range(cut.first_node, cut.nodes))?;
        Some((nodes, self.parts.get(range(cut.first_part, cut.parts))?))
    }
}

/// A cluster's ray structure.
#[derive(Clone, Copy)]
pub struct ClusterRaysView<'a> {
    /// Box hierarchy; node 0 is the root.
    pub nodes: &'a [RayNode],
    /// Faces, in leaf order.
    pub patches: &'a [RayPatch],
    /// How they are cut.
    pub cuts: Cuts<'a>,
}

impl<'a> ClusterRaysView<'a> {
    /// Borrows the arrays of a payload.
    pub fn parse(payload: &'a [u8]) -> Result<Self, String> {
        let arrays = Arrays::new(payload);
        let cuts = Cuts { faces: arrays.get(2)?, nodes: arrays.get(3)?, parts: arrays.get(4)? };
        Ok(Self { nodes: arrays.get(0)?, patches: arrays.get(1)?, cuts })
    }

    /// The payload that holds the arrays.
    #[must_use]
    pub fn payload(&self) -> Vec<u8> {
        let Cuts { faces, nodes, parts } = self.cuts;
        ArraysBuilder::default().with(self.nodes).with(self.patches).with(faces).with(nodes).with(parts).finish()
    }

    /// Bytes from a payload's start to the first node, which is where the array behind five entries of the table
    /// begins.
    pub const NODES_AT: u64 = 96;
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
