//! Geometry extents: patches and the seams between them; and the materials extent beside it.

use bytemuck::{Pod, Zeroable};

use super::Arrays;
use crate::base::PatchSide;

/// "There is none".
pub const NONE: u32 = u32::MAX;

/// One per cluster.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ClusterHead {
    /// Cluster number.
    pub cluster: u32,
    /// Patches, 1..=256.
    pub patches: u32,
    /// Smallest corner of the box round all patches, m from the store's origin.
    pub min_m: [f32; 3],
    /// Largest corner, m from the store's origin.
    pub max_m: [f32; 3],
    /// Row of the OBJ object in the catalogue.
    pub object: u32,
    /// 0.
    pub reserved: [u32; 7],
}

/// A planar triangle or convex quad.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct PatchRecord {
    /// Corners in winding order, m from the store's origin; a triangle repeats its third.
    pub corners_m: [[f32; 3]; 4],
    /// 3 or 4.
    pub corner_count: u8,
    /// Which sides take part: bit 0 the front, bit 1 the back.
    pub sides: u8,
    /// 0.
    pub reserved: u16,
    /// Area, m2.
    pub area_m2: f32,
    /// The face that it is a part of: cluster * 256 + patch of the face's first part.
    pub face: u32,
    /// Area of the whole face, m2.
    pub face_area_m2: f32,
}

/// Where light goes on from an edge of a patch to another patch of its face: nothing stands there.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Seam {
    /// The patch.
    pub patch: u16,
    /// The one beyond.
    pub other: u16,
    /// Which edge of the patch: from its corner of that number to the next.
    pub edge: u8,
    /// Which edge of the other.
    pub other_edge: u8,
    /// On which sides it is open: bit 0 the front, bit 1 the back.
    pub sides: u8,
    /// 0.
    pub reserved: u8,
    /// Where along the edge it begins and ends, shares, ascending.
    pub along: [f32; 2],
    /// The same places along the edge of the other, descending.
    pub other_along: [f32; 2],
}

impl Seam {
    /// As the patch beyond has it.
    #[must_use]
    pub fn turned(self) -> Self {
        let turned = |[a, b]: [f32; 2]| [b, a];
        Self {
            patch: self.other,
            other: self.patch,
            edge: self.other_edge,
            other_edge: self.edge,
            along: turned(self.other_along),
            other_along: turned(self.along),
            ..self
        }
    }
}

/// Material of one patch side; two per patch, front then back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SideMaterial {
    /// Diffuse reflectance, 0..=0.99 per channel.
    pub rho: [f32; 3],
    /// Emitted exitance pi Ke, W/m2.
    pub exitance: [f32; 3],
}

/// A geometry extent's arrays.
#[derive(Clone, Copy)]
pub struct GeometryView<'a> {
    /// The cluster.
    pub head: &'a ClusterHead,
    /// Its patches; those near each other follow each other.
    pub patches: &'a [PatchRecord],
    /// Seams between its patches, each as both have it, by patch.
    pub seams: &'a [Seam],
}

impl<'a> GeometryView<'a> {
    /// Borrows the arrays of a payload.
    pub fn parse(payload: &'a [u8]) -> Result<Self, String> {
        let arrays = Arrays::new(payload);
        let view = Self { head: arrays.one(0)?, patches: arrays.get(1)?, seams: arrays.get(2)? };
        if view.patches.len() != view.head.patches as usize || view.patches.len() > 256 {
            return Err(format!("{} patches where the head says {}", view.patches.len(), view.head.patches));
        }
        Ok(view)
    }

    /// The patches that light goes on to from a side over seams, that of the side among them, ascending.
    #[must_use]
    pub fn joined(&self, at: PatchSide) -> Vec<u8> {
        let mut found = vec![at.patch];
        let mut next = 0;
        while let Some(patch) = found.get(next) {
            next += 1;
            for seam in self.seams_of(u16::from(*patch)).iter().filter(|s| s.sides >> at.side & 1 == 1) {
                let other = seam.other as u8;
                if !found.contains(&other) {
                    found.push(other);
                }
            }
        }
        found.sort_unstable();
        found
    }

    /// The seams of a patch.
    #[must_use]
    pub fn seams_of(&self, patch: u16) -> &'a [Seam] {
        let first = self.seams.partition_point(|s| s.patch < patch);
        &self.seams[first..first + self.seams[first..].partition_point(|s| s.patch == patch)]
    }
}
