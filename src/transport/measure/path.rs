//! Light carried along paths to the lamps: what leaves a place, without a look at what is stored. An error that all
//! stored light shares shows here alone.

use std::rc::Rc;

use super::check::Met;
use super::lamps::LightTree;
use crate::base::{ClusterId, Result, Rgb};
use crate::geom::sequence::{cosine_direction, mix, unit};
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::rays::traverse::Nearest;
use crate::transport::numbers;
use crate::transport::source::{Clusters, exitance};

/// The lamps that rays from a cluster are sent to.
pub struct InSight {
    /// Clusters that they lie in, ascending.
    pub clusters: Vec<ClusterId>,
    /// The lamps.
    pub tree: LightTree,
}

impl InSight {
    /// What a side emits of which no ray is sent to its lamps, W/m2: who meets it has found what visibility has missed.
    pub fn missed(&self, clusters: &dyn Clusters, met: &Met) -> Result<Rgb> {
        if self.clusters.binary_search(&met.cluster).is_ok() {
            return Ok(Rgb::BLACK);
        }
        let loaded = clusters.cluster(met.cluster)?;
        Ok(Rgb::from_f32(loaded.view().materials[met.side.index()].exitance))
    }
}

/// What paths go through.
#[derive(Clone, Copy)]
pub struct Paths<'a> {
    /// What rays can meet.
    pub scene: RayScene<'a>,
    /// Materials and shapes.
    pub clusters: &'a dyn Clusters,
    /// The lamps in sight of a cluster.
    pub lamps: &'a dyn Fn(ClusterId) -> Result<Rc<InSight>>,
}

/// Numbers in 0..1 that know nothing of each other: those of sequences do, and places of a path multiply.
struct Numbers(u64);

impl Numbers {
    fn next<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            unit(mix(self.0))
        })
    }
}

impl Paths<'_> {
    /// Reflected light that leaves a place, W/m2, as one path tells it: a ray to a lamp from every place it comes to.
    /// It goes on by reflectance (Russian roulette).
    pub fn leaving(&self, from: Met, seed: u64) -> Result<Rgb> {
        let (mut sum, mut weight, mut at, mut numbers) = (Rgb::BLACK, Rgb::grey(1.0), from, Numbers(seed));
        loop {
            let loaded = self.clusters.cluster(at.cluster)?;
            let view = loaded.view();
            let rho = Rgb::from_f32(view.materials[at.side.index()].rho);
            if rho.is_black() || !view.takes_part(at.side.index()) {
                return Ok(sum);
            }
            weight = weight.times(rho);
            let node = Node::root(at.cluster, &view.geometry.patches[usize::from(at.side.patch)], at.side);
            let place = at.place - node.normal * node.height(at.place);
            let lamps = (self.lamps)(at.cluster)?;
            if let Some(aim) = lamps.tree.aim(place, node.normal)
                && let Some((lamp, factor)) =
                    lamps.tree.reach(&self.scene, &aim, &node.facet(place), numbers.next(), &mut 0)
            {
                sum += weight.times(Rgb::from_f32(exitance(self.clusters, lamp)?)) * factor;
            }
            let [u, v, fate] = numbers.next();
            let goes_on = rho.max().min(numbers::MOST_GO_ON);
            if fate >= goes_on {
                return Ok(sum);
            }
            weight = weight * (1.0 / goes_on);
            let direction = cosine_direction(node.normal, u, v);
            let Nearest::Met(hit) = self.scene.nearest(place, direction, Some(&node.end)) else { return Ok(sum) };
            at = Met { cluster: ClusterId(hit.key.cluster), side: hit.side(), place: place + direction * hit.t, ..at };
            sum += weight.times(lamps.missed(self.clusters, &at)?);
        }
    }
}
