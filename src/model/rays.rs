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

/// A node: eight slots for children.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RayNode {
    /// By axis, the children's least coordinates, then their greatest, m from the store's origin.
    pub planes_m: [[[f32; 8]; 2]; 3],
    /// First item of a leaf, node of an inner child; 0 in an empty slot.
    pub first: [u32; 8],
    /// Items of a leaf, else 0.
    pub items: [u32; 8],
}

impl RayNode {
    /// Empty slots, which no ray enters.
    pub const EMPTY: Self =
        Self { planes_m: [[[f32::INFINITY; 8], [f32::NEG_INFINITY; 8]]; 3], first: [0; 8], items: [0; 8] };

    /// With a child in a slot.
    #[must_use]
    pub fn with(mut self, slot: usize, (min_m, max_m): ([f32; 3], [f32; 3]), first: u32, items: u32) -> Self {
        for (axis, planes) in self.planes_m.iter_mut().enumerate() {
            (planes[0][slot], planes[1][slot]) = (min_m[axis], max_m[axis]);
        }
        (self.first[slot], self.items[slot]) = (first, items);
        self
    }

    /// Slots that hold a child.
    pub fn used(&self) -> impl Iterator<Item = usize> {
        (0..8).filter(|&slot| self.items[slot] > 0 || self.first[slot] > 0)
    }

    /// The box round a child: its smallest and its largest corner.
    #[must_use]
    pub fn bounds_m(&self, slot: usize) -> ([f32; 3], [f32; 3]) {
        (self.planes_m.map(|planes| planes[0][slot]), self.planes_m.map(|planes| planes[1][slot]))
    }

    /// The box round all children.
    #[must_use]
    pub fn whole_m(&self) -> ([f32; 3], [f32; 3]) {
        let [mins, maxs] = [0, 1].map(|of| self.planes_m.map(|planes| planes[of]));
        (
            mins.map(|of| of.into_iter().fold(f32::INFINITY, f32::min)),
            maxs.map(|of| of.into_iter().fold(f32::NEG_INFINITY, f32::max)),
        )
    }

    /// The largest coordinate of all children, without its sign.
    #[must_use]
    pub fn largest_m(&self) -> f32 {
        let (min_m, max_m) = self.whole_m();
        min_m.into_iter().chain(max_m).map(f32::abs).fold(0.0, f32::max)
    }
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

/// Whether every node refers to what is there, among so many items, and a walk from the root ends; what is
/// wrong otherwise.
pub fn hierarchy(nodes: &[RayNode], items: usize) -> Result<(), String> {
    let mut waiting = vec![0];
    let mut visited = 0;
    while let Some(at) = waiting.pop() {
        let node: &RayNode = nodes.get(at as usize).ok_or_else(|| format!("there is no ray node {at}"))?;
        visited += 1;
        // More visits than nodes: some node is below itself or below two others.
        if visited > nodes.len() {
            return Err("the ray nodes are no tree".to_owned());
        }
        if node.used().next().is_none() {
            return Err(format!("ray node {at} leads nowhere"));
        }
        for slot in node.used() {
            let (first, count) = (node.first[slot], node.items[slot]);
            if count == 0 {
                waiting.push(first);
            } else if first as usize + count as usize > items {
                return Err(format!("ray node {at} refers to items {first} and on, beyond the last of {items}"));
            }
        }
    }
    Ok(())
}
