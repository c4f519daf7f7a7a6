//! The light at one place of a surface: measured there, by rays that read the stored light where they end.

use std::rc::Rc;

use glam::DVec3;

use super::working_set::WorkingSet;
use crate::base::{ClusterId, PatchSide, Result, Rgb};
use crate::rays::RayScene;
use crate::rays::locate::Place;
use crate::rays::node::Node;
use crate::transport::measure::lamps::LightTree;
use crate::transport::measure::point::Gather;
use crate::transport::source::Loaded;

/// Measures points of surfaces.
pub struct PointLight<'a, 's> {
    set: &'a WorkingSet<'s>,
    gather: Gather<'a>,
    /// The lamps of the last point's cluster: points come in runs.
    lamps: Option<(ClusterId, Rc<LightTree>)>,
    /// Rays cast so far.
    pub rays: u64,
}

impl<'a, 's> PointLight<'a, 's> {
    /// In a version, to a relative error.
    #[must_use]
    pub fn new(set: &'a WorkingSet<'s>, scene: RayScene<'a>, tolerance: f64) -> Self {
        Self { set, gather: Gather { scene, clusters: set, lights: set, tolerance }, lamps: None, rays: 0 }
    }

    /// Irradiance at a point (m from the store's origin) of a patch side, W/m2.
    pub fn irradiance(&mut self, at: Place, point: DVec3) -> Result<Rgb> {
        let id = ClusterId(at.key.cluster);
        let mapped = self.set.mapped(id)?;
        let view = mapped.view();
        let side = PatchSide { patch: at.key.patch as u8, side: at.side };
        let node = Node::root(id, &view.geometry.patches[usize::from(side.patch)], side);
        let lamps = self.lamps_of(id)?;
        // Exactly on the plane: what lies in it must not count as above or below.
        self.gather.at(&node, point - node.normal * node.height(point), &lamps, &mut self.rays)
    }

    fn lamps_of(&mut self, id: ClusterId) -> Result<Rc<LightTree>> {
        if let Some((known, lamps)) = &self.lamps
            && *known == id
        {
            return Ok(lamps.clone());
        }
        let lamps = Rc::new(LightTree::of_clusters(self.set, &self.set.visible(id)?.0)?);
        self.lamps = Some((id, lamps.clone()));
        Ok(lamps)
    }
}
