//! Visibility by rays: cosine-weighted rays from area-weighted points on a cluster. First hits give
//! the visible set and an unbiased, occluded estimate of its form factors.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::base::{ClusterId, PatchSide};
use crate::geom::sequence::{Sequence, cosine_direction, mix};
use crate::model::geometry::{PatchRecord, SideMaterial};
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::rays::traverse::Nearest;

/// How long to look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Form-factor mass that may stay unseen (Good-Turing estimate), from `--missing`.
    pub missing: f64,
    /// From `--seed`.
    pub seed: u64,
}

/// Rays of the first round, and the most for one cluster: rounds double.
const FIRST_RAYS: u64 = 1 << 10;
const MOST_RAYS: u64 = 1 << 16;

/// What a cluster sees.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Per cluster: rays that ended there; 0 where only rays from emitters did.
    pub hits: BTreeMap<u32, u64>,
    /// Rays that count: those that started uncovered.
    pub rays: u64,
    /// Rays that left the model.
    pub escaped: u64,
    /// Clusters hit exactly once, as a share of the rays: the estimate of the mass not seen.
    pub missing: f64,
    /// Emitting sides nearly all of whose rays were blocked at once: most likely wound the wrong way.
    pub blocked_emitters: u32,
    /// Emitting sides nearly all of whose rays left the model: the same.
    pub lost_emitters: u32,
}

impl Seen {
    /// Estimated form factor to a cluster.
    #[must_use]
    pub fn form_factor(&self, cluster: u32) -> f64 {
        self.hits.get(&cluster).map_or(0.0, |&n| n as f64 / self.rays.max(1) as f64)
    }

    /// Share of the rays that left the model.
    #[must_use]
    pub fn escape(&self) -> f64 {
        self.escaped as f64 / self.rays.max(1) as f64
    }
}

/// Sides with weights, to be drawn from.
struct Sides {
    nodes: Vec<Node>,
    cumulative: Vec<f64>,
}

impl Sides {
    fn new(cluster: ClusterId, patches: &[PatchRecord], weight: impl Fn(usize) -> f64) -> Self {
        let (mut nodes, mut cumulative, mut total) = (Vec::new(), Vec::new(), 0.0);
        for index in 0..2 * patches.len() {
            let patch = &patches[index / 2];
            let weight = weight(index) * f64::from(patch.area_m2);
            if patch.sides & (1 << (index % 2)) != 0 && weight > 0.0 {
                total += weight;
                nodes.push(Node::root(cluster, patch, PatchSide::from_index(index)));
                cumulative.push(total);
            }
        }
        Self { nodes, cumulative }
    }

    /// The side at `x` in [0, 1) of the total weight, and where in its own share.
    fn draw(&self, x: f64) -> Option<(&Node, f64)> {
        let target = x * self.cumulative.last()?;
        let i = self.cumulative.partition_point(|c| *c <= target).min(self.nodes.len() - 1);
        let before = if i == 0 { 0.0 } else { self.cumulative[i - 1] };
        Some((&self.nodes[i], ((target - before) / (self.cumulative[i] - before)).clamp(0.0, 1.0)))
    }
}

fn cast(scene: &RayScene<'_>, from: &Node, within: f64, [b, c, d]: [f64; 3]) -> (Nearest, DVec3) {
    let direction = cosine_direction(from.normal, c, d);
    (scene.nearest(from.shape.point(within, b), direction, Some(&from.end)), direction)
}

/// Looks around from a cluster; `materials` are two per patch.
#[must_use]
pub fn look_around(
    scene: &RayScene<'_>,
    cluster: ClusterId,
    patches: &[PatchRecord],
    materials: &[SideMaterial],
    effort: &Effort,
) -> Seen {
    let mut seen = Seen::default();
    let everywhere = Sides::new(cluster, patches, |_| 1.0);
    let sequence = Sequence::new(mix(effort.seed ^ mix(u64::from(cluster.0))));
    let (mut index, mut target) = (0, FIRST_RAYS);
    loop {
        while index < target {
            let [a, b, c, d] = sequence.point(index);
            index += 1;
            let Some((from, within)) = everywhere.draw(a) else { break };
            match cast(scene, from, within, [b, c, d]).0 {
                Nearest::Met(hit) => {
                    seen.rays += 1;
                    *seen.hits.entry(hit.key.cluster).or_default() += 1;
                }
                Nearest::Escaped => {
                    seen.rays += 1;
                    seen.escaped += 1;
                }
                Nearest::Covered => {}
            }
        }
        let singles = seen.hits.values().filter(|n| **n == 1).count();
        seen.missing = singles as f64 / seen.rays.max(1) as f64;
        if seen.missing <= effort.missing || target >= MOST_RAYS {
            break;
        }
        target *= 2;
    }
    emitter_rays(scene, cluster, patches, materials, effort, &mut seen);
    seen
}

/// Height above an emitter below which what is met blocks it, m.
const NEARBY_M: f64 = 5e-3;

/// What became of an emitting side's rays.
#[derive(Clone, Copy, Default)]
struct Tried {
    all: u32,
    blocked: u32,
    escaped: u32,
}

/// Extra rays from emitting sides by their power: small bright sources are what rays from all over
/// would miss.
fn emitter_rays(
    scene: &RayScene<'_>,
    cluster: ClusterId,
    patches: &[PatchRecord],
    materials: &[SideMaterial],
    effort: &Effort,
    seen: &mut Seen,
) {
    let power = |i: usize| materials[i].exitance.iter().map(|e| f64::from(*e)).sum();
    let emitting = Sides::new(cluster, patches, power);
    if emitting.nodes.is_empty() {
        return;
    }
    let mut tried = vec![Tried::default(); emitting.nodes.len()];
    let sequence = Sequence::new(mix(effort.seed ^ mix(u64::from(cluster.0) | 1 << 40)));
    for index in 0..4 * FIRST_RAYS {
        let [a, b, c, d] = sequence.point(index);
        let Some((from, within)) = emitting.draw(a) else { return };
        let place = emitting.nodes.iter().position(|n| n.name == from.name).unwrap_or(0);
        let (nearest, direction) = cast(scene, from, within, [b, c, d]);
        let tried = &mut tried[place];
        match nearest {
            Nearest::Met(hit) => {
                tried.all += 1;
                tried.blocked += u32::from(hit.t * direction.dot(from.normal) < NEARBY_M.max(scene.snap_m()));
                seen.hits.entry(hit.key.cluster).or_default();
            }
            // What covers an emitter emits itself.
            Nearest::Covered => {}
            Nearest::Escaped => {
                tried.all += 1;
                tried.escaped += 1;
            }
        }
    }
    let count = |of: fn(&Tried) -> u32| tried.iter().filter(|t| t.all > 0 && of(t) * 20 >= t.all * 19).count() as u32;
    (seen.blocked_emitters, seen.lost_emitters) = (count(|t| t.blocked), count(|t| t.escaped));
}
