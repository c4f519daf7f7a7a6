//! Places measured anew, against the light that is stored there: what the rows themselves cannot tell, since those that
//! came out good by luck are never looked at again.

use std::ops::Range;

use glam::DVec3;

use super::lamps::{Aim, LightTree};
use crate::base::{ClusterId, NodeName, PatchSide, Result, Rgb};
use crate::geom::sequence::{Sequence, cosine_direction, mix};
use crate::rays::RayScene;
use crate::rays::node::{Facet, Node};
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
        let (facet, aim, [to_lamps, over]) =
            (node.facet(place), self.lamps.aim(place, node.normal), numbers::CHECK_RAYS);
        for (half, sum) in arrives.halves.iter_mut().enumerate() {
            let numbers = |of: u64| Sequence::new(mix(seed ^ mix(half as u64 + of)));
            if let Some(aim) = &aim {
                let bring = from_lamps(
                    &self.scene,
                    (self.lamps, aim),
                    &facet,
                    (&numbers(1), 0..to_lamps),
                    self.exitance,
                    rays,
                )?;
                *sum += bring * (1.0 / to_lamps as f64);
            }
            arrives.direct += *sum * 0.5;
            over_hemisphere(&self.scene, &facet, (&numbers(3), 0..over), rays, &mut |end| {
                *sum += Rgb::from_f32((self.leaving)(end.cluster, end.side, end.place)?) * (1.0 / over as f64);
                met(end)
            })?;
        }
        Ok(arrives)
    }
}

/// What rays of those numbers to lamps bring to a facet, summed up, W/m2.
pub fn from_lamps(
    scene: &RayScene<'_>,
    (lamps, aim): (&LightTree, &Aim),
    facet: &Facet<'_>,
    (numbers, range): (&Sequence, Range<u64>),
    exitance: &dyn Fn(NodeName) -> Result<[f32; 3]>,
    rays: &mut u64,
) -> Result<Rgb> {
    let mut sum = Rgb::BLACK;
    for index in range {
        if let Some((lamp, factor)) = lamps.reach(scene, aim, facet, numbers.point(index), rays) {
            sum += Rgb::from_f32(exitance(lamp)?) * factor;
        }
    }
    Ok(sum)
}

/// Visits the ends of cosine-weighted rays of those numbers over a facet.
pub fn over_hemisphere(
    scene: &RayScene<'_>,
    facet: &Facet<'_>,
    (numbers, range): (&Sequence, Range<u64>),
    rays: &mut u64,
    visit: &mut dyn FnMut(Met) -> Result<()>,
) -> Result<()> {
    for index in range {
        let [u, v, ..] = numbers.point(index);
        let direction = cosine_direction(facet.normal, u, v);
        *rays += 1;
        if let Nearest::Met(hit) = scene.nearest(facet.place, direction, facet.on) {
            let place = facet.place + direction * hit.t;
            visit(Met { index, cluster: ClusterId(hit.key.cluster), side: hit.side(), place })?;
        }
    }
    Ok(())
}
