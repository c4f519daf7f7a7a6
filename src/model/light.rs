//! Radiosity extents: what arrives at every element of a cluster in one version.
//!
//! Rows by name and part; then both roots of every patch, then level by level, each by name. An element has all four children or none. `B = E + rho H` with the materials extent.

use bytemuck::{Pod, Zeroable};

use super::Arrays;
use crate::base::NodeName;
use crate::base::name::MAX_DEPTH;

/// One per radiosity extent.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct LightHead {
    /// Channels: 3.
    pub channels: u32,
    /// Light layer: 0.
    pub layer: u32,
    /// First element of each depth 0..=14, then the number of elements.
    pub level_start: [u32; 16],
    /// 0.
    pub reserved: [u32; 2],
}

/// Light of an element: `irradiance + slope_u u + slope_v v`, with u and v in m from its centroid along the axes of its
/// patch's frame.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ElementLight {
    /// Its name.
    pub name: u64,
    /// Mean irradiance, W/m2.
    pub irradiance: [f32; 3],
    /// Change of irradiance along the frame's first axis, W/m3; 0 unless a leaf.
    pub slope_u: [f32; 3],
    /// Along the second.
    pub slope_v: [f32; 3],
    /// 0.
    pub reserved: u32,
}

/// A row, as it was measured last: the line through what arrives, of one part of the light, and how good it is. It holds
/// for all leaves below its element.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RowLight {
    /// Its element.
    pub name: u64,
    /// Mean irradiance, W/m2.
    pub irradiance: [f32; 3],
    /// See [`ElementLight`].
    pub slope_u: [f32; 3],
    /// See [`ElementLight`].
    pub slope_v: [f32; 3],
    /// Mean squared deviation of the light from any line, signed, (W/m2)2.
    pub structure: f32,
    /// Standard error of that, (W/m2)2.
    pub structure_error: f32,
    /// What of the structure stands out from the noise, (W/m2)2.
    pub found: f32,
    /// Mean squared error of the line for want of rays, (W/m2)2.
    pub noise: f32,
    /// Rays of each half from each place.
    pub rounds: u16,
    /// 0 direct, 1 indirect.
    pub part: u16,
}

/// A radiosity extent's arrays.
#[derive(Clone, Copy)]
pub struct LightView<'a> {
    /// Where levels start.
    pub head: &'a LightHead,
    /// Rows, by name and part.
    pub rows: &'a [RowLight],
    /// Elements, level by level, each by name.
    pub elements: &'a [ElementLight],
}

impl<'a> LightView<'a> {
    /// Borrows the arrays of a payload.
    pub fn parse(payload: &'a [u8]) -> Result<Self, String> {
        let arrays = Arrays::new(payload);
        let view = Self { head: arrays.one(0)?, rows: arrays.get(1)?, elements: arrays.get(2)? };
        let starts = &view.head.level_start;
        if starts[0] != 0 || starts.windows(2).any(|w| w[0] > w[1]) || starts[15] as usize != view.elements.len() {
            return Err("levels do not cover the elements".to_owned());
        }
        Ok(view)
    }

    /// The elements of one depth; none below the greatest, whatever a damaged name says.
    #[must_use]
    pub fn level(&self, depth: u32) -> &'a [ElementLight] {
        let depth = depth as usize;
        match self.head.level_start.get(depth..depth + 2) {
            Some(ends) => &self.elements[ends[0] as usize..ends[1] as usize],
            None => &[],
        }
    }

    /// The element of that name, if stored.
    #[must_use]
    pub fn find(&self, name: NodeName) -> Option<&'a ElementLight> {
        if name.depth() == 0 {
            return self.level(0).get(name.patch_side().index());
        }
        let level = self.level(name.depth());
        level.binary_search_by_key(&name.0, |e| e.name).ok().map(|i| &level[i])
    }

    /// The stored element of that name or the nearest one above it.
    #[must_use]
    pub fn nearest(&self, name: NodeName) -> Option<&'a ElementLight> {
        let mut at = Some(name);
        while let Some(name) = at {
            if let Some(found) = self.find(name) {
                return Some(found);
            }
            at = name.parent();
        }
        None
    }

    /// Whether the stored element of that name has children.
    #[must_use]
    pub fn has_children(&self, name: NodeName) -> bool {
        name.depth() < MAX_DEPTH && self.find(name.child(0)).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, PatchSide};
    use crate::model::layout::ArraysBuilder;

    #[test]
    fn a_name_that_no_element_has_is_found_nowhere() {
        let root = NodeName::root(ClusterId(7), PatchSide::from_index(0));
        let head =
            LightHead { channels: 3, level_start: std::array::from_fn(|i| u32::from(i > 0)), ..LightHead::zeroed() };
        let element = ElementLight { name: root.0, ..ElementLight::zeroed() };
        let payload = ArraysBuilder::default().with(&[head]).with::<RowLight>(&[]).with(&[element]).finish();
        let mut words = vec![0u128; payload.len().div_ceil(16)];
        bytemuck::cast_slice_mut::<u128, u8>(&mut words)[..payload.len()].copy_from_slice(&payload);
        let view = LightView::parse(&bytemuck::cast_slice(&words)[..payload.len()]).unwrap();
        assert!(view.find(root).is_some());
        // No path at all, and one level more than there can be.
        for name in [NodeName(root.0 - 1), NodeName((root.0 - 1) | 1 << 28)] {
            assert!(name.depth() >= MAX_DEPTH, "{}", name.depth());
            assert!(view.find(name).is_none() && !view.has_children(name), "{name:?}");
        }
    }
}
