//! An audit: the error of stored light by places drawn at random and measured there anew, in two independent halves whose
//! product leaves out their own noise; and its bias, by paths that never read what is stored.

use std::rc::Rc;

use super::check::{Arrives, Check, Met};
use super::path::{InSight, Paths};
use crate::base::{ClusterId, NodeName, PatchSide, Result, Rgb};
use crate::geom::sequence::mix;
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::transport::light::lit::Lights;
use crate::transport::nodes::mesh::Mesh;
use crate::transport::norm::Norm;
use crate::transport::numbers;
use crate::transport::source::{ClusterView, Clusters, exitance};
use glam::DVec3;

/// What light of a place counts; what is dark counts nothing.
fn factor(norm: &Norm, bright_w_m2: f64) -> f64 {
    if norm.is_dark(bright_w_m2) { 0.0 } else { norm.counts(bright_w_m2) }
}

/// A leaf that places are drawn from.
#[derive(Clone, Copy, Debug)]
pub struct Leaf {
    /// The element in its mesh.
    pub element: usize,
    /// Its area, m2.
    pub area_m2: f64,
    /// Squared error that is expected there, times area, (W/m2)2 m2; never 0 where there is light.
    pub expected: f64,
    /// Square of what its light counts, (W/m2)2.
    pub norm: f64,
}

/// The leaves of a cluster's lit sides that do not emit, in the order of its mesh.
#[must_use]
pub fn leaves(view: &ClusterView<'_>, mesh: &Mesh, norm: &Norm) -> Vec<Leaf> {
    let above = mesh.rows_above();
    let mut leaves = Vec::new();
    let mut is_lit = vec![false; 2 * view.geometry.patches.len()];
    for (at, element) in mesh.elements.iter().enumerate().filter(|(_, element)| element.is_leaf()) {
        let side = element.name.patch_side().index();
        if !view.takes_part(side) || view.emits(element.name) {
            continue;
        }
        let squared = element.line.mean.norm_squared();
        let factor = factor(norm, squared.sqrt());
        is_lit[side] |= factor > 0.0;
        leaves.push(Leaf {
            element: at,
            area_m2: element.area_m2,
            expected: element.area_m2 * factor * factor * mesh.expected_error(at, &above[at]),
            norm: factor * factor * squared,
        });
    }
    leaves.retain(|leaf| is_lit[mesh.elements[leaf.element].name.patch_side().index()]);
    leaves
}

/// Leaves summed up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Area, m2, and expected squared error times area: what the two halves of the places are drawn by.
    pub weights: [f64; 2],
    /// Squares of what light counts, times area, (W/m2)2 m2.
    pub norm: f64,
}

impl Sums {
    /// Of some leaves.
    #[must_use]
    pub fn of(leaves: &[Leaf]) -> Self {
        leaves.iter().fold(Self::default(), |sums, leaf| {
            sums.plus(&Self { weights: leaf.weights(), norm: leaf.norm * leaf.area_m2 })
        })
    }

    /// The sum of both.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self { weights: [0, 1].map(|i| self.weights[i] + other.weights[i]), norm: self.norm + other.norm }
    }
}

impl Leaf {
    /// What it is drawn by: area, expected error.
    #[must_use]
    pub fn weights(&self) -> [f64; 2] {
        [self.area_m2, self.expected]
    }

    /// How often a place of it is drawn, per m2 and place drawn; `counts`: places drawn by each weight.
    #[must_use]
    pub fn density(&self, sums: &Sums, counts: [u64; 2]) -> f64 {
        let all = (counts[0] + counts[1]) as f64;
        let by = |i: usize| match sums.weights[i] > 0.0 {
            true => counts[i] as f64 / all * self.weights()[i] / sums.weights[i],
            false => 0.0,
        };
        (by(0) + by(1)) / self.area_m2
    }
}

/// What places are measured with.
pub struct Audit<'a> {
    /// What rays can meet.
    pub scene: RayScene<'a>,
    /// The version.
    pub clusters: &'a dyn Clusters,
    /// Its light.
    pub lights: &'a dyn Lights,
    /// The lamps in sight of a cluster.
    pub lamps: &'a dyn Fn(ClusterId) -> Result<Rc<InSight>>,
}

/// What arrives at a place, W/m2.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// By rays that read the stored light where they end, twice and independently.
    pub halves: [Rgb; 2],
    /// By lamps and paths alone.
    pub carried: Rgb,
}

/// Rays of each half over the hemisphere that go on as paths: the first, which are spread evenly, as all of them are.
const GO_ON: u64 = numbers::CHECK_RAYS[1] / 4;

impl Audit<'_> {
    /// Measures a place of a node's side.
    pub fn measure(&self, node: &Node, place: DVec3, seed: u64) -> Result<Measured> {
        let own = (self.lamps)(node.name.cluster())?;
        let paths = Paths { scene: self.scene, clusters: self.clusters, lamps: self.lamps };
        let exitance = |lamp: NodeName| exitance(self.clusters, lamp);
        let leaving = |cluster: ClusterId, side: PatchSide, place: DVec3| {
            let stored = self.lights.lit(cluster)?.leaving_at(side, place);
            let missed = own.missed(self.clusters, &Met { index: 0, cluster, side, place })?;
            Ok((Rgb::from_f32(stored) + missed).to_f32())
        };
        let check = Check { scene: self.scene, lamps: &own.tree, exitance: &exitance, leaving: &leaving };
        let (mut carried, mut number) = (Rgb::BLACK, 0);
        let mut go_on = |met: Met| {
            number += 1;
            if met.index < GO_ON {
                let from_here = paths.leaving(met, mix(seed ^ mix(number << 32)))?;
                carried += from_here + own.missed(self.clusters, &met)?;
            }
            Ok(())
        };
        let Arrives { halves, direct } = check.measure((node, place), seed, &mut 0, &mut go_on)?;
        Ok(Measured { halves, carried: direct + carried * (1.0 / (2 * GO_ON) as f64) })
    }
}

/// What a place says.
#[derive(Clone, Copy, Debug, Default)]
pub struct Finding {
    /// Product of the halves' errors, as the norm counts it, (W/m2)2.
    pub error: f64,
    /// What the light there counts by the measurement beyond what it counts by its leaf, (W/m2)2.
    pub norm: f64,
    /// Stored light, and what lamps and paths bring: sums over RGB, W/m2.
    pub levels: [f64; 2],
}

impl Finding {
    /// At a place of a leaf; a place that is dark counts nothing.
    #[must_use]
    pub fn new(stored: Rgb, measured: &Measured, leaf: &Leaf, norm: &Norm) -> Self {
        let [a, b] = measured.halves;
        let factor = factor(norm, ((a + b) * 0.5).norm_squared().sqrt());
        let sum = |light: Rgb| factor * light.dot(Rgb::grey(1.0));
        Self {
            error: factor * factor * (a - stored).dot(b - stored),
            norm: factor * factor * a.dot(b) - leaf.norm,
            levels: [sum(stored), sum(measured.carried)],
        }
    }

    /// Under another face: nothing arrives, and nothing counts.
    #[must_use]
    pub fn covered(leaf: &Leaf) -> Self {
        Self { norm: -leaf.norm, ..Self::default() }
    }
}

/// Findings summed up, each over its density, and their products.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    sums: [f64; 4],
    /// Products of error and norm, and of both levels: of the first with itself, of both, of the second with itself.
    products: [[f64; 3]; 2],
}

/// A figure and its standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Known {
    /// The figure.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
}

impl Tally {
    /// Adds a finding at a place of that density, 1/m2.
    pub fn add(&mut self, finding: &Finding, density: f64) {
        let Finding { error, norm, levels } = *finding;
        let values = [error, norm, levels[0], levels[1]].map(|value| value / density);
        for (i, pair) in values.chunks_exact(2).enumerate() {
            let of_pair = [pair[0] * pair[0], pair[0] * pair[1], pair[1] * pair[1]];
            self.products[i] = std::array::from_fn(|k| self.products[i][k] + of_pair[k]);
        }
        self.sums = std::array::from_fn(|i| self.sums[i] + values[i]);
    }

    /// The sum of both.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let both = |i: usize| std::array::from_fn(|k| self.products[i][k] + other.products[i][k]);
        Self { sums: std::array::from_fn(|i| self.sums[i] + other.sums[i]), products: [both(0), both(1)] }
    }

    /// Mean over places of the first of a pair relative to `norm` (which the second is part of), and its standard error by
    /// the delta method.
    fn ratio(&self, pair: usize, norm: f64, places: f64) -> Known {
        let [first, second] = [2 * pair, 2 * pair + 1].map(|i| self.sums[i] / places);
        let value = first / norm;
        let [aa, ab, bb] = self.products[pair].map(|product| product / places);
        let variance = aa - 2.0 * value * ab + value * value * bb - (first - value * second).powi(2);
        Known { value, error: (variance.max(0.0) / places).sqrt() / norm }
    }

    /// The error relative to the light (nRMS), its standard error, and the bias; `None` where nothing is lit. `norm`: that
    /// of all leaves.
    #[must_use]
    pub fn verdict(&self, norm: f64, places: u64) -> Option<(Known, Known)> {
        let n = places as f64;
        let (norm, carried) = (norm + self.sums[1] / n, self.sums[3] / n);
        if places == 0 || norm <= 0.0 {
            return None;
        }
        let squared = self.ratio(0, norm, n);
        // Where the error is small beside its own, this stays finite: one standard error of the square further on.
        let value = squared.value.max(0.0).sqrt();
        let error = (squared.value.max(0.0) + squared.error).sqrt() - value;
        let level = if carried > 0.0 { self.ratio(1, carried, n) } else { Known { value: 1.0, error: 0.0 } };
        Some((Known { value, error }, Known { value: level.value - 1.0, ..level }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::sequence::unit;

    /// A normal number of deviation 1, about, by the sum of twelve even ones.
    fn normal(seed: u64) -> f64 {
        (0..12).map(|i| unit(mix(seed ^ mix(i << 40)))).sum::<f64>() - 6.0
    }

    /// A thousand leaves of 1 m2 with light of 1 W/m2, of which every hundredth is off by a fifth, and known to be so by
    /// half of what it is; the others are off by 2 %.
    fn model() -> Vec<(Leaf, f64)> {
        let leaf = |element: usize| {
            let off = if element.is_multiple_of(100) { 0.2 } else { 0.02 };
            (Leaf { element, area_m2: 1.0, expected: 0.5 * off * off + 1e-4, norm: 1.0 }, off)
        };
        (0..1000).map(leaf).collect()
    }

    #[test]
    fn the_error_of_places_drawn_by_both_weights_lies_within_three_standard_errors_for_most_seeds() {
        let (model, counts) = (model(), [128, 128]);
        let sums = Sums::of(&model.iter().map(|(leaf, _)| *leaf).collect::<Vec<_>>());
        let truth = (model.iter().map(|(_, off)| off * off).sum::<f64>() / 1000.0).sqrt();
        let mut within = 0;
        let mut errors = 0.0;
        for seed in 0..20u64 {
            let mut tally = Tally::default();
            for (by, count) in counts.into_iter().enumerate() {
                for turn in 0..count {
                    let own = mix(mix(seed) ^ mix(2 * turn + by as u64));
                    let mut rest = unit(own) * sums.weights[by];
                    let drawn = model.iter().find(|(leaf, _)| {
                        rest -= leaf.weights()[by];
                        rest <= 0.0
                    });
                    let (leaf, off) = drawn.unwrap_or(&model[999]);
                    let grey = |light: f64| Rgb([light, 0.0, 0.0]);
                    // Each half is off by 5 % of its own.
                    let halves = [1, 2].map(|half| grey(1.0 + 0.05 * normal(own ^ half)));
                    let measured = Measured { halves, carried: grey(1.0 + 0.3 * normal(own ^ 3)) };
                    let norm = Norm::of_mean(1.0);
                    tally.add(&Finding::new(grey(1.0 + off), &measured, leaf, &norm), leaf.density(&sums, counts));
                }
            }
            let (error, bias) = tally.verdict(sums.norm, 256).unwrap();
            within += u32::from((error.value - truth).abs() <= 3.0 * error.error);
            errors += error.error / truth / 20.0;
            assert!((bias.value - 0.022).abs() < 4.0 * bias.error && bias.error < 0.04, "{bias:?}");
        }
        assert!(within >= 17, "{within} of 20");
        assert!((0.02..0.2).contains(&errors), "{errors}");
    }
}
