//! Cut trees: how a face that others stand on or pass through falls into parts.
//!
//! A face's nodes lie one after the other, the root first; numbers in them count from the face's first node and
//! first part. A face without nodes is one part.

use bytemuck::{Pod, Zeroable};

/// A node of a face's cut tree: the line that parts what is below it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct CutNode {
    /// a, b, c of a p.i + b p.j + c, m from the store's origin, where i < j are the axes that are left when the axis
    /// along which the face's normal is longest is dropped.
    pub line: [f64; 3],
    /// What lies where that is at least 0, and where it is below: a node's number, or a part's with [`Self::PART`].
    pub children: [u32; 2],
}

impl CutNode {
    /// Marks a child that is a part.
    pub const PART: u32 = 1 << 31;
}
