//! Places measured anew, against the light that is stored there: what the rows themselves cannot tell, since those that
//! came out good by luck are never looked at again.

use glam::DVec3;

use super::lamps::LightTree;
use crate::base::{ClusterId, NodeName, PatchSide, Result, Rgb};
use crate::geom::sequence::{Sequence, cosine_direction, mix};
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::rays::traverse::Nearest;
use crate::transport::numbers;

/// What a place is measured with.
pub struct Check<'a> {
    /// What rays can meet.
    pub scene: RayScene<'a>,
    /// The lamps in sight.
    pub lamps: &'a LightTree,
    /// Exitance of a lamp, W/m2.
    pub exitance: &'a dyn Fn(NodeName) -> Result<[f32; 3]>,
    /// Reflected light that leaves a place, W/m2.
    pub leaving: &'a dyn Fn(ClusterId, PatchSide, DVec3) -> Result<[f32; 3]>,
}

/// Where a ray over the hemisphere ended.
#[derive(Clone, Copy)]
pub struct Met {
    /// The ray's number within its half.
    pub index: u64,
    /// The cluster.
    pub cluster: ClusterId,
    /// The side.
    pub side: PatchSide,
    /// The place, m.
    pub place: DVec3,
}

/// What arrives at a place, W/m2.
pub struct Arrives {
    /// Measured twice and independently.
    pub halves: [Rgb; 2],
    /// What lamps bring of it, by the rays of both halves.
    pub direct: Rgb,
}

impl Check<'_> {
    /// What arrives at a place of a node's side, measured twice and independently. Counts rays.
    pub fn halves(&self, node: &Node, place: DVec3, seed: u64, rays: &mut u64) -> Result<[Rgb; 2]> {
        Ok(self.measure((node, place), seed, rays, &mut |_| Ok(()))?.halves)
    }

    /// The same, with what lamps bring apart; `met` gets the ends of rays over the hemisphere.
    pub fn measure(
        &self,
        (node, place): (&Node, DVec3),
        seed: u64,
        rays: &mut u64,
        met: &mut dyn FnMut(Met) -> Result<()>,
    ) -> Result<Arrives> {
        let mut arrives = Arrives { halves: [Rgb::BLACK; 2], direct: Rgb::BLACK };
        let aim = self.lamps.aim(place, node.normal);
        for (half, sum) in arrives.halves.iter_mut().enumerate() {
            let sequence = Sequence::new(mix(seed ^ mix(half as u64 + 1)));
            if let Some(aim) = &aim {
                for index in 0..numbers::CHECK_RAYS[0] {
                    let numbers = sequence.point(index);
                    if let Some((lamp, factor)) = self.lamps.reach(&self.scene, aim, &node.facet(place), numbers, rays)
                    {
                        *sum += Rgb::from_f32((self.exitance)(lamp)?) * (factor / numbers::CHECK_RAYS[0] as f64);
                    }
                }
            }
            arrives.direct += *sum * 0.5;
            let sequence = Sequence::new(mix(seed ^ mix(half as u64 + 3)));
            for index in 0..numbers::CHECK_RAYS[1] {
                let [u, v, ..] = sequence.point(index);
                let direction = cosine_direction(node.normal, u, v);
                *rays += 1;
                if let Nearest::Met(hit) = self.scene.nearest(place, direction, Some(&node.end)) {
                    let end = place + direction * hit.t;
                    let (cluster, side) = (ClusterId(hit.key.cluster), hit.side());
                    *sum += Rgb::from_f32((self.leaving)(cluster, side, end)?) * (1.0 / numbers::CHECK_RAYS[1] as f64);
                    met(Met { index, cluster, side, place: end })?;
                }
            }
        }
        Ok(arrives)
    }
}
