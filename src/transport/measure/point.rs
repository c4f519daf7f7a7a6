//! The light at a point of a surface or in the open, measured anew: rays to lamps, and rays over the hemisphere that read the stored
//! light where they end.

use super::check::{Met, from_lamps, over_hemisphere};
use super::path::InSight;
use crate::base::{ClusterId, Result, Rgb};
use crate::geom::sequence::{Sequence, mix, mix_point};
use crate::rays::RayScene;
use crate::rays::node::Facet;
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

    /// Variance of the mean, (W/m2)2. Batches complement each other: what edges of shadows leave of it falls with the power
    /// 3/2 of their number (Mitchell 1996, "Consequences of stratified sampling in graphics").
    fn variance(&self) -> f64 {
        let n = self.batches as f64;
        ((self.squares / n - self.mean().norm_squared()) / ((n - 1.0) * n.sqrt())).max(0.0)
    }
}

impl Gather<'_> {
    /// Irradiance, W/m2; rays are sent to `lamps`. Counts rays.
    pub fn at(&self, facet: &Facet<'_>, lamps: &InSight, rays: &mut u64) -> Result<Rgb> {
        let seed = mix(mix_point(facet.place));
        let (to_lamps, over) = (Sequence::new(seed), Sequence::new(mix(seed ^ 1)));
        let (mut direct, mut indirect) = (Sum::default(), Sum::default());
        let aim = lamps.tree.aim(facet.place, facet.normal);
        let of_lamp = |lamp| exitance(self.clusters, lamp);
        for batch in 0..numbers::MOST_BATCHES {
            let enough = (self.tolerance / numbers::SURELY).powi(2) * (direct.mean() + indirect.mean()).norm_squared();
            let is_early = batch < numbers::LEAST_BATCHES;
            if let Some(aim) = aim.as_ref().filter(|_| is_early || direct.variance() > 0.5 * enough) {
                let light =
                    from_lamps(&self.scene, (&lamps.tree, aim), facet, (&to_lamps, direct.next()), &of_lamp, rays)?;
                direct.add(light * (1.0 / numbers::BATCH as f64));
            }
            if is_early || indirect.variance() > 0.5 * enough {
                let mut light = Rgb::BLACK;
                over_hemisphere(&self.scene, facet, (&over, indirect.next()), rays, &mut |met| {
                    light += self.leaving(facet, lamps, &met)?;
                    Ok(())
                })?;
                indirect.add(light * (1.0 / numbers::BATCH as f64));
            }
        }
        Ok(direct.mean() + indirect.mean())
    }

    /// What leaves there that rays to lamps do not bring, W/m2.
    fn leaving(&self, facet: &Facet<'_>, lamps: &InSight, met: &Met) -> Result<Rgb> {
        let stored = Rgb::from_f32(self.lights.lit(met.cluster)?.leaving_at(met.side, met.place));
        // A surface has a list of its own, as the stored light has; a point in the open has those of others.
        Ok(if facet.on.is_some() { stored } else { stored + lamps.missed(self.clusters, met)? })
    }

    /// Clusters around a point in the open, ascending: those that a batch of rays meets in front, and one behind. Behind it
    /// lies what sees its lamps past it.
    pub fn around(&self, facet: &Facet<'_>, rays: &mut u64) -> Result<Vec<ClusterId>> {
        let ways = Sequence::new(mix(mix(mix_point(facet.place)) ^ 2));
        let behind = Facet { normal: -facet.normal, ..*facet };
        let mut clusters = Vec::new();
        for (half, range) in [(facet, 0..numbers::BATCH), (&behind, numbers::BATCH..2 * numbers::BATCH)] {
            over_hemisphere(&self.scene, half, (&ways, range), rays, &mut |met| {
                clusters.push(met.cluster);
                Ok(())
            })?;
        }
        clusters.sort_unstable();
        clusters.dedup();
        Ok(clusters)
    }
}
