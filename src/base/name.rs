//! Names: every node that light leaves or reaches has a u64 name that never changes.
//!
//! From the top bit: cluster 24, kind 2, rest 38. Numeric order is cluster order.

use std::fmt;

/// A cluster's number within its store: 24 bits, never reused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClusterId(pub u32);

impl ClusterId {
    /// Largest cluster number; the one above it holds pseudo-sources.
    pub const MAX: u32 = (1 << 24) - 2;
    /// The "cluster" in the names of pseudo-sources.
    pub const PSEUDO: Self = Self((1 << 24) - 1);
}

impl fmt::Display for ClusterId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// One side of a patch: 0 is the front, the side the winding normal points to; 1 the back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PatchSide {
    /// Patch number within its cluster, 0..=255.
    pub patch: u8,
    /// 0 front, 1 back.
    pub side: u8,
}

impl PatchSide {
    /// Position of this side in arrays that hold two entries per patch.
    #[must_use]
    pub fn index(self) -> usize {
        usize::from(self.patch) * 2 + usize::from(self.side)
    }

    /// The patch side at a position in such an array.
    #[must_use]
    pub fn from_index(index: usize) -> Self {
        Self { patch: u8::try_from(index / 2).expect("a cluster has at most 256 patches"), side: (index % 2) as u8 }
    }
}

/// What kind of node a name stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeKind {
    /// A node of the quadtree on one side of a patch.
    Element,
    /// Light from or to nowhere in the model: the escape.
    Pseudo,
}

/// The name of a node: see the module.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeName(pub u64);

/// Deepest level of an element below its root.
pub const MAX_DEPTH: u32 = 14;

const REST_BITS: u32 = 38;
const PATH_BITS: u32 = 29;

impl NodeName {
    /// What leaves the model.
    pub const ESCAPE: Self = Self(((ClusterId::PSEUDO.0 as u64) << 40) | (3 << REST_BITS));

    /// The whole of a patch side: path 1.
    #[must_use]
    pub fn root(cluster: ClusterId, at: PatchSide) -> Self {
        Self::element(cluster, at, 1)
    }

    /// An element by its path: a leading 1, then two bits a level.
    #[must_use]
    pub fn element(cluster: ClusterId, at: PatchSide, path: u32) -> Self {
        debug_assert!((1..1 << PATH_BITS).contains(&path));
        Self(
            (u64::from(cluster.0) << 40)
                | (u64::from(at.patch) << (PATH_BITS + 1))
                | (u64::from(at.side) << PATH_BITS)
                | u64::from(path),
        )
    }

    /// The cluster that the node belongs to.
    #[must_use]
    pub fn cluster(self) -> ClusterId {
        ClusterId((self.0 >> 40) as u32)
    }

    /// What kind of node this is; `None` for the reserved kinds.
    #[must_use]
    pub fn kind(self) -> Option<NodeKind> {
        match (self.0 >> REST_BITS) & 3 {
            0 => Some(NodeKind::Element),
            3 => Some(NodeKind::Pseudo),
            _ => None,
        }
    }

    /// Patch and side of an element.
    #[must_use]
    pub fn patch_side(self) -> PatchSide {
        debug_assert_eq!(self.kind(), Some(NodeKind::Element));
        PatchSide { patch: (self.0 >> (PATH_BITS + 1)) as u8, side: ((self.0 >> PATH_BITS) & 1) as u8 }
    }

    /// Path of an element.
    #[must_use]
    pub fn path(self) -> u32 {
        (self.0 & ((1 << PATH_BITS) - 1)) as u32
    }

    /// Levels below the root, 0 for the root; 31, where nothing is, for path 0, which no element has.
    #[must_use]
    pub fn depth(self) -> u32 {
        (31 ^ self.path().leading_zeros()) / 2
    }

    /// The element one level up; `None` for a root.
    #[must_use]
    pub fn parent(self) -> Option<Self> {
        (self.path() > 1).then(|| Self((self.0 & !((1 << PATH_BITS) - 1)) | u64::from(self.path() >> 2)))
    }

    /// Child `quarter` (0..4) of an element above the greatest depth.
    #[must_use]
    pub fn child(self, quarter: u32) -> Self {
        debug_assert!(quarter < 4 && self.depth() < MAX_DEPTH);
        Self((self.0 & !((1 << PATH_BITS) - 1)) | u64::from(self.path() << 2 | quarter))
    }
}

impl fmt::Debug for NodeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.kind() {
            Some(NodeKind::Element) => {
                let at = self.patch_side();
                write!(f, "element {}/{}/{}/{:b}", self.cluster(), at.patch, at.side, self.path())
            }
            Some(NodeKind::Pseudo) => write!(f, "pseudo {:x}", self.0),
            None => write!(f, "reserved {:x}", self.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_element_name_gives_back_its_parts_and_its_family() {
        let at = PatchSide { patch: 255, side: 1 };
        let root = NodeName::root(ClusterId(ClusterId::MAX), at);
        assert_eq!((root.cluster().0, root.patch_side(), root.path(), root.depth()), (ClusterId::MAX, at, 1, 0));
        let mut deep = root;
        for level in 0..MAX_DEPTH {
            deep = deep.child(level % 4);
        }
        assert_eq!(deep.depth(), MAX_DEPTH);
        assert_eq!(deep.patch_side(), at);
        assert_eq!(deep.parent().map(|p| p.depth()), Some(MAX_DEPTH - 1));
        assert_eq!(root.parent(), None);
    }

    #[test]
    fn names_sort_by_cluster_and_the_escape_comes_last() {
        let root = NodeName::root(ClusterId(3), PatchSide { patch: 255, side: 1 });
        let next = NodeName::root(ClusterId(4), PatchSide { patch: 0, side: 0 });
        assert!(root < next && next < NodeName::ESCAPE);
        assert_eq!(NodeName::ESCAPE.kind(), Some(NodeKind::Pseudo));
    }
}
