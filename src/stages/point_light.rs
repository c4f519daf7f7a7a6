//! The light at one point, of a surface or in the open: measured there, by rays that read the stored light where they end.

use glam::DVec3;

use super::lamps::LampsInSight;
use super::working_set::WorkingSet;
use crate::base::{ClusterId, PatchSide, Result, Rgb};
use crate::rays::RayScene;
use crate::rays::locate::Place;
use crate::rays::node::{Facet, Node};
use crate::transport::measure::point::Gather;
use crate::transport::source::Loaded;

/// Measures points.
pub struct PointLight<'a, 's> {
    set: &'a WorkingSet<'s>,
    gather: Gather<'a>,
    lamps: LampsInSight<'a, 's>,
    /// Rays cast so far.
    pub rays: u64,
}

impl<'a, 's> PointLight<'a, 's> {
    /// In a version, to a relative error.
    #[must_use]
    pub fn new(set: &'a WorkingSet<'s>, scene: RayScene<'a>, tolerance: f64) -> Self {
        let gather = Gather { scene, clusters: set, lights: set, tolerance };
        Self { set, gather, lamps: LampsInSight::new(set), rays: 0 }
    }

    /// Irradiance at a point (m from the store's origin) of a patch side, W/m2.
    pub fn on(&mut self, at: Place, point: DVec3) -> Result<Rgb> {
        let id = ClusterId(at.key.cluster);
        let mapped = self.set.mapped(id)?;
        let view = mapped.view();
        let side = PatchSide { patch: at.key.patch as u8, side: at.side };
        let node = Node::root(id, &view.geometry.patches[usize::from(side.patch)], side);
        let lamps = self.lamps.of(id)?;
        // Exactly on the plane: what lies in it must not count as above or below.
        let facet = node.facet(point - node.normal * node.height(point));
        self.gather.at(&facet, &lamps, &mut self.rays)
    }

    /// Irradiance at a point in the open (m from the store's origin) that faces along a unit normal, W/m2.
    pub fn free(&mut self, point: DVec3, normal: DVec3) -> Result<Rgb> {
        let place = self.gather.scene.off_surfaces(point);
        let facet = Facet { place, normal, on: None };
        let lamps = self.lamps.of_any(&self.gather.around(&facet, &mut self.rays)?)?;
        self.gather.at(&facet, &lamps, &mut self.rays)
    }
}
