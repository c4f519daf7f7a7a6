//! Visibility extents: which clusters a cluster may exchange light with, and how much.

use bytemuck::{Pod, Zeroable};

use super::Arrays;

/// One per cluster.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct VisibilityHead {
    /// Rays cast from the cluster.
    pub rays: u64,
    /// Share of its rays that left the model.
    pub escape: f32,
    /// Estimate (Good-Turing) of the form factor to clusters not seen.
    pub missing: f32,
}

/// A cluster that is seen; by number, the cluster itself included where it sees itself.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct VisibleCluster {
    /// Its number.
    pub cluster: u32,
    /// Estimated form factor to it, occlusion included; 0 where only the other side saw us.
    pub form_factor: f32,
}

/// A visibility extent's arrays.
#[derive(Clone, Copy)]
pub struct VisibilityView<'a> {
    /// How it was found.
    pub head: &'a VisibilityHead,
    /// The list, by cluster number.
    pub clusters: &'a [VisibleCluster],
}

impl<'a> VisibilityView<'a> {
    /// Borrows the arrays of a payload.
    pub fn parse(payload: &'a [u8]) -> Result<Self, String> {
        let arrays = Arrays::new(payload);
        Ok(Self { head: arrays.one(0)?, clusters: arrays.get(1)? })
    }
}
