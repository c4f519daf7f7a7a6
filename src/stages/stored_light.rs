//! The light of a version at places of surfaces, as it is stored: no rays, no links.

use std::rc::Rc;

use glam::DVec3;
use lru::LruCache;

use super::leaves;
use super::working_set::WorkingSet;
use crate::base::{ClusterId, PatchSide, Result, Rgb};
use crate::transport::light::at::SideLight;
use crate::transport::source::{ClusterView, Loaded};

/// Bytes that a corner of leaves takes while its side is held: a place in a table that is half empty.
const CORNER_BYTES: usize = 80;

/// Reads a version's light; sides are held as far as there is room.
pub struct StoredLight<'a, 's> {
    set: &'a WorkingSet<'s>,
    held: LruCache<(u32, usize), (Rc<SideLight>, usize)>,
    bytes: usize,
    limit_bytes: usize,
}

impl<'a, 's> StoredLight<'a, 's> {
    /// Of a version, with so many bytes for what is held.
    #[must_use]
    pub fn new(set: &'a WorkingSet<'s>, limit_bytes: usize) -> Self {
        Self { set, held: LruCache::unbounded(), bytes: 0, limit_bytes }
    }

    /// What arrives at a point (m from the store's origin) of a patch side, W/m2.
    pub fn irradiance(&mut self, id: ClusterId, at: PatchSide, point: DVec3) -> Result<Rgb> {
        let cluster = self.set.mapped(id)?;
        let view = cluster.view();
        if !view.takes_part(at.index()) {
            return Ok(Rgb::BLACK);
        }
        let leaf = view.leaf_at(at, point);
        Ok(self.side(&view, at).at(leaf.name, &leaf.shape, point))
    }

    /// What leaves it, W/m2.
    pub fn radiosity(&mut self, id: ClusterId, at: PatchSide, point: DVec3) -> Result<Rgb> {
        let cluster = self.set.mapped(id)?;
        let material = cluster.view().materials[at.index()];
        let arrives = self.irradiance(id, at, point)?;
        Ok(Rgb::from_f32(material.exitance) + Rgb::from_f32(material.rho).times(arrives))
    }

    fn side(&mut self, view: &ClusterView<'_>, at: PatchSide) -> &SideLight {
        let key = |side: PatchSide| (view.id.0, side.index());
        if !self.held.contains(&key(at)) {
            let light = Rc::new(SideLight::new(&view.geometry, at, |side| leaves::lines_of_side(view, side)));
            for side in light.sides(at) {
                let bytes = light.corners_of(side) * CORNER_BYTES;
                if let Some((_, replaced)) = self.held.put(key(side), (Rc::clone(&light), bytes)) {
                    self.bytes -= replaced;
                }
                self.bytes += bytes;
            }
            self.held.promote(&key(at));
            while self.bytes > self.limit_bytes && self.held.len() > 1 {
                if let Some((_, (_, freed))) = self.held.pop_lru() {
                    self.bytes -= freed;
                }
            }
        }
        &self.held.get(&key(at)).expect("just put there").0
    }
}
