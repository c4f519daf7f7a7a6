//! The light at a point of a surface or in the open, measured anew: rays to lamps, and rays over the hemisphere that read the stored
//! light where they end.

use super::check::Met;
use super::path::InSight;
use crate::base::{ClusterId, Result, Rgb};
use crate::geom::sequence::{Sequence, cosine_direction, mix, mix_point};
use crate::rays::RayScene;
use crate::rays::node::Facet;
use crate::rays::traverse::Nearest;
use crate::transport::light::lit::Lights;
use crate::transport::numbers;
use crate::transport::source::{Clusters, exitance};

/// What a point is measured with.
pub struct Gather<'a> {
    /// What rays can meet.
    pub scene: RayScene<'a>,
    /// The version that is read.
    pub clusters: &'a dyn Clusters,
    /// Its light.
    pub lights: &'a dyn Lights,
    /// Error that is good enough, relative to what arrives.
    pub tolerance: f64,
}

/// Sums over batches of rays, to tell how much their mean is worth: rays of a batch are spread evenly, so that batches differ
/// by far less than rays do.
#[derive(Default)]
struct Sum {
    light: Rgb,
    squares: f64,
    batches: u64,
}

impl Sum {
    /// Adds the mean of a batch.
    fn add(&mut self, light: Rgb) {
        self.light += light;
        self.squares += light.norm_squared();
        self.batches += 1;
    }

    /// Numbers of the next batch's rays.
    fn next(&self) -> std::ops::Range<u64> {
        self.batches * numbers::BATCH..(self.batches + 1) * numbers::BATCH
    }

    fn mean(&self) -> Rgb {
        self.light * (1.0 / self.batches.max(1) as f64)
    }

    /// Variance of the mean, (W/m2)2; it is no more than this, since batches complement each other.
    fn variance(&self) -> f64 {
        let n = self.batches as f64;
        ((self.squares / n - self.mean().norm_squared()) / (n - 1.0)).max(0.0)
    }
}

impl Gather<'_> {
    /// Irradiance, W/m2; rays are sent to `lamps`. Counts rays.
    pub fn at(&self, facet: &Facet<'_>, lamps: &InSight, rays: &mut u64) -> Result<Rgb> {
        let seed = mix(mix_point(facet.place));
        let (to_lamps, over) = (Sequence::new(seed), Sequence::new(mix(seed ^ 1)));
        let (mut direct, mut indirect) = (Sum::default(), Sum::default());
        let aim = lamps.tree.aim(facet.place, facet.normal);
        for batch in 0..numbers::MOST_BATCHES {
            let enough = (self.tolerance / numbers::SURELY).powi(2) * (direct.mean() + indirect.mean()).norm_squared();
            let is_early = batch < numbers::LEAST_BATCHES;
            if let Some(aim) = aim.as_ref().filter(|_| is_early || direct.variance() > 0.5 * enough) {
                let mut light = Rgb::BLACK;
                for index in direct.next() {
                    if let Some((lamp, factor)) = lamps.tree.reach(&self.scene, aim, facet, to_lamps.point(index), rays)
                    {
                        light += Rgb::from_f32(exitance(self.clusters, lamp)?) * factor;
                    }
                }
                direct.add(light * (1.0 / numbers::BATCH as f64));
            }
            if is_early || indirect.variance() > 0.5 * enough {
                let mut light = Rgb::BLACK;
                for index in indirect.next() {
                    *rays += 1;
                    if let Some(met) = self.met(facet, over.point(index), index) {
                        light += self.leaving(facet, lamps, &met)?;
                    }
                }
                indirect.add(light * (1.0 / numbers::BATCH as f64));
            }
        }
        Ok(direct.mean() + indirect.mean())
    }

    /// Where a ray over the hemisphere ends, by numbers in 0..1.
    fn met(&self, facet: &Facet<'_>, [u, v, ..]: [f64; 4], index: u64) -> Option<Met> {
        let direction = cosine_direction(facet.normal, u, v);
        match self.scene.nearest(facet.place, direction, facet.on) {
            Nearest::Met(hit) => {
                let place = facet.place + direction * hit.t;
                Some(Met { index, cluster: ClusterId(hit.key.cluster), side: hit.side(), place })
            }
            Nearest::Escaped | Nearest::Covered => None,
        }
    }

    /// What leaves there that rays to lamps do not bring, W/m2.
    fn leaving(&self, facet: &Facet<'_>, lamps: &InSight, met: &Met) -> Result<Rgb> {
        let stored = Rgb::from_f32(self.lights.lit(met.cluster)?.leaving_at(met.side, met.place));
        // A surface has a list of its own, as the stored light has; a point in the open has those of others.
        Ok(if facet.on.is_some() { stored } else { stored + lamps.missed(self.clusters, met)? })
    }

    /// Clusters around a point in the open, ascending: those that a batch of rays meets, in front and behind. Behind it
    /// lies what sees its lamps past it.
    #[must_use]
    pub fn around(&self, facet: &Facet<'_>, rays: &mut u64) -> Vec<ClusterId> {
        let ways = Sequence::new(mix(mix(mix_point(facet.place)) ^ 2));
        let behind = Facet { normal: -facet.normal, ..*facet };
        *rays += numbers::BATCH;
        let met = (0..numbers::BATCH).filter_map(|index| {
            let half = if index < numbers::BATCH / 2 { facet } else { &behind };
            self.met(half, ways.point(index), index)
        });
        let mut clusters: Vec<ClusterId> = met.map(|met| met.cluster).collect();
        clusters.sort_unstable();
        clusters.dedup();
        clusters
    }
}
