//! The places of an audit: what they are drawn by, which are drawn, and what each says.

use glam::DVec3;

use crate::base::{ClusterId, Result, Rgb};
use crate::geom::sequence::{mix, unit};
use crate::rays::node::Node;
use crate::stages::lamps::LampsInSight;
use crate::stages::leaves::lines_of_side;
use crate::stages::ray_scene::OpenScene;
use crate::stages::working_set::WorkingSet;
use crate::transport::light::at::SideLights;
use crate::transport::measure::audit::{self, Finding, Leaf, Sums, Tally};
use crate::transport::nodes::mesh::Mesh;
use crate::transport::norm::Norm;
use crate::transport::source::Loaded;

/// Worst places that are named.
const WORST: usize = 10;

/// Places of a cluster that are measured at a time.
const AT_A_TIME: usize = 64;

/// What places are drawn and measured by.
pub struct Drawing {
    /// What counts.
    pub norm: Norm,
    /// From which all numbers derive.
    pub seed: u64,
    /// Places drawn by area, and by expected error.
    pub counts: [u64; 2],
    /// All leaves.
    pub total: Sums,
}

/// A place that is drawn: by which weight, which of those, and how far into its cluster's sum.
#[derive(Clone, Copy)]
pub struct Draw {
    by: usize,
    turn: u64,
    rest: f64,
}

/// Some places of one cluster.
pub struct Part {
    cluster: ClusterId,
    draws: Vec<Draw>,
}

/// A place that was measured.
#[derive(Clone)]
pub struct Place {
    /// Its cluster.
    pub cluster: ClusterId,
    /// Where it is, m from the store's origin.
    pub point: DVec3,
    /// What is stored there, W/m2.
    pub stored: Rgb,
    /// What a gather finds, W/m2.
    pub gathered: Rgb,
    error: f64,
}

/// What places say together.
#[derive(Default)]
pub struct Found {
    /// Their findings.
    pub tally: Tally,
    /// Those measured.
    pub points: u64,
    /// Those with the largest errors, largest first.
    pub worst: Vec<Place>,
}

impl Found {
    /// Adds what others say.
    pub fn add(&mut self, other: Self) {
        self.tally = self.tally.plus(&other.tally);
        self.points += other.points;
        self.worst.extend(other.worst);
        self.worst.sort_by(|a, b| b.error.total_cmp(&a.error));
        self.worst.truncate(WORST);
    }
}

/// What places of a cluster are drawn by.
pub fn sums(set: &WorkingSet<'_>, id: ClusterId, norm: &Norm) -> Result<Sums> {
    let loaded = set.mapped(id)?;
    let view = loaded.view();
    let mesh = Mesh::load(view.id, view.geometry.patches, &view.light);
    Ok(Sums::of(&audit::leaves(&view, &mesh, norm)))
}

/// The leaf that a draw falls into; there are some.
fn leaf_of(leaves: &[Leaf], upto: &[Vec<f64>; 2], draw: &Draw) -> usize {
    upto[draw.by].partition_point(|upto| *upto <= draw.rest).min(leaves.len() - 1)
}

impl Drawing {
    /// Draws places, evenly along the sums of each weight, of clusters that have any.
    #[must_use]
    pub fn draw(&self, sums: &[(ClusterId, Sums)]) -> Vec<Part> {
        let mut drawn: Vec<(usize, Draw)> = Vec::new();
        for (by, count) in self.counts.into_iter().enumerate() {
            let (mut cluster, mut before) = (0, 0.0);
            for turn in 0..count {
                let along = (turn as f64 + unit(self.seed_of(by, turn))) / count as f64 * self.total.weights[by];
                while cluster + 1 < sums.len() && along >= before + sums[cluster].1.weights[by] {
                    before += sums[cluster].1.weights[by];
                    cluster += 1;
                }
                drawn.push((cluster, Draw { by, turn, rest: along - before }));
            }
        }
        drawn.sort_by_key(|(cluster, draw)| (*cluster, draw.by, draw.turn));
        let part = |part: &[(usize, Draw)]| Part {
            cluster: sums[part[0].0].0,
            draws: part.iter().map(|(_, draw)| *draw).collect(),
        };
        drawn.chunk_by(|a, b| a.0 == b.0).flat_map(|of_one| of_one.chunks(AT_A_TIME)).map(part).collect()
    }

    /// From which all numbers of a place derive.
    fn seed_of(&self, by: usize, turn: u64) -> u64 {
        mix(self.seed ^ mix(2 * turn + by as u64))
    }

    /// Measures some places.
    pub fn measure(
        &self,
        (set, open, lamps): (&WorkingSet<'_>, &OpenScene<'_>, &LampsInSight<'_, '_>),
        Part { cluster, draws }: &Part,
    ) -> Result<Found> {
        let loaded = set.mapped(*cluster)?;
        let view = loaded.view();
        let mesh = Mesh::load(view.id, view.geometry.patches, &view.light);
        let leaves = audit::leaves(&view, &mesh, &self.norm);
        let upto = [0, 1].map(|by| {
            let mut sum = 0.0;
            let add = |leaf: &Leaf| {
                sum += leaf.weights()[by];
                sum
            };
            leaves.iter().map(add).collect::<Vec<f64>>()
        });
        let name_of = |leaf: usize| mesh.elements[leaves[leaf].element].name;
        let mut places: Vec<(usize, &Draw)> = draws.iter().map(|draw| (leaf_of(&leaves, &upto, draw), draw)).collect();
        places.sort_by_key(|(leaf, draw)| (name_of(*leaf).patch_side().index(), draw.by, draw.turn));
        let audit = audit::Audit { scene: open.scene, clusters: set, lights: set, lamps: &|cluster| lamps.of(cluster) };
        let (mut found, mut lights) = (Found::default(), SideLights::default());
        for of_side in places.chunk_by(|a, b| name_of(a.0).patch_side() == name_of(b.0).patch_side()) {
            let side = name_of(of_side[0].0).patch_side();
            let patch = &view.geometry.patches[usize::from(side.patch)];
            let light = lights.of(&view.geometry, side, |at| lines_of_side(&view, at));
            let covering = open.scene.covering(&Node::root(*cluster, patch, side));
            for &(leaf, draw) in of_side {
                let (leaf, node) = (&leaves[leaf], Node::at(*cluster, patch, name_of(leaf)));
                let seed = mix(self.seed_of(draw.by, draw.turn) ^ 1);
                let point = node.shape.even_point(unit(mix(seed)), unit(mix(seed ^ 1)));
                let density = leaf.density(&self.total, self.counts);
                if covering.covers(point) {
                    found.tally.add(&Finding::covered(leaf), density);
                    continue;
                }
                let stored = light.at(node.name, &node.shape, point);
                let arrives = audit.measure(&node, point, seed)?;
                let finding = Finding::new(stored, &arrives, leaf, &self.norm);
                found.tally.add(&finding, density);
                found.points += 1;
                let gathered = (arrives.halves[0] + arrives.halves[1]) * 0.5;
                found.worst.push(Place { cluster: *cluster, point, stored, gathered, error: finding.error });
            }
        }
        open.look.verdict()?;
        Ok(found)
    }
}
