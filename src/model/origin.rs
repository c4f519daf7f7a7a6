//! Where patches came from: input faces, and what baking needs of their corners.

use bytemuck::{Pod, Zeroable};

/// One input face of a patch; a patch joined from two triangles, or with a face on each side, has
/// several, and a face that was split is the source of several patches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct PatchSource {
    /// Patch number within the cluster.
    pub patch: u32,
    /// Row of the input file in the catalogue.
    pub file: u32,
    /// Line of the `f` record, from 1.
    pub line: u32,
    /// `f` record within the file, from 0.
    pub face: u32,
}

/// A corner of a patch as the modeller wrote it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct BakeCorner {
    /// Position in model coordinates and units.
    pub position: [f64; 3],
    /// Texture coordinate `vt`; NaN where none.
    pub uv: [f32; 2],
    /// Shading normal `vn`; NaN where none.
    pub normal: [f32; 3],
    /// Patch number within the cluster * 4 + corner.
    pub corner: u32,
}
