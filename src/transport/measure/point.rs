//! The light at a point of a surface, measured anew: rays to lamps, and rays over the hemisphere that read the stored
//! light where they end.

use glam::DVec3;

use super::lamps::LightTree;
use crate::base::{ClusterId, Result, Rgb};
use crate::geom::sequence::{Sequence, cosine_direction, mix, mix_point};
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::rays::traverse::Nearest;
use crate::transport::light::lit::Lights;
use crate::transport::source::{Clusters, exitance};

/// Rays of a batch.
const BATCH: u64 = 64;

/// Batches, at least and at most.
const BATCHES: (u64, u64) = (4, 64);

/// What a point is measured with.
pub struct Gather<'a> {
    /// What rays can meet.
    pub scene: RayScene<'a>,
    /// The version that is read.
    pub clusters: &'a dyn Clusters,
    /// Its light.
    pub lights: &'a dyn Lights,
    /// Standard error that is good enough, relative to what arrives.
    pub tolerance: f64,
}

/// Sums over rays, to tell how much their mean is worth.
#[derive(Default)]
struct Sum {
    light: Rgb,
    squares: f64,
    rays: u64,
}

impl Sum {
    fn add(&mut self, light: Rgb) {
        self.light += light;
        self.squares += light.norm_squared();
        self.rays += 1;
    }

    fn mean(&self) -> Rgb {
        self.light * (1.0 / self.rays.max(1) as f64)
    }

    /// Variance of the mean, (W/m2)2.
    fn variance(&self) -> f64 {
        let n = self.rays.max(1) as f64;
        ((self.squares / n - self.mean().norm_squared()) / n).max(0.0)
    }
}

impl Gather<'_> {
    /// Irradiance at a point of an element's side, W/m2; `lamps` are those that it may see. Counts rays.
    pub fn at(&self, node: &Node, point: DVec3, lamps: &LightTree, rays: &mut u64) -> Result<Rgb> {
        let seed = mix(mix_point(point));
        let (to_lamps, over) = (Sequence::new(seed), Sequence::new(mix(seed ^ 1)));
        let (mut direct, mut indirect) = (Sum::default(), Sum::default());
        let aim = lamps.aim(point, node.normal);
        for batch in 0..BATCHES.1 {
            let enough = self.tolerance.powi(2) * (direct.mean() + indirect.mean()).norm_squared();
            let is_early = batch < BATCHES.0;
            if aim.is_some() && (is_early || direct.variance() > 0.5 * enough) {
                for index in direct.rays..direct.rays + BATCH {
                    let reached = aim
                        .as_ref()
                        .and_then(|aim| lamps.reach(&self.scene, aim, (node, point), to_lamps.point(index), rays));
                    let Some((lamp, factor)) = reached else {
                        direct.add(Rgb::BLACK);
                        continue;
                    };
                    direct.add(Rgb::from_f32(exitance(self.clusters, lamp)?) * factor);
                }
            }
            if is_early || indirect.variance() > 0.5 * enough {
                for index in indirect.rays..indirect.rays + BATCH {
                    let [u, v, ..] = over.point(index);
                    let direction = cosine_direction(node.normal, u, v);
                    *rays += 1;
                    indirect.add(match self.scene.nearest(point, direction, Some(&node.end)) {
                        Nearest::Met(hit) => {
                            let lit = self.lights.lit(ClusterId(hit.key.cluster))?;
                            Rgb::from_f32(lit.leaving_at(hit.side(), point + direction * hit.t))
                        }
                        Nearest::Escaped | Nearest::Covered => Rgb::BLACK,
                    });
                }
            }
        }
        Ok(direct.mean() + indirect.mean())
    }
}
