//! One visit to a group: make and refine its rows, gather what comes from outside once, iterate what stays inside, and
//! write what changed. A function of the version read, the group and the options alone.

use std::cell::RefCell;
use std::num::NonZeroUsize;
use std::rc::Rc;

use lru::LruCache;

use super::cluster_rows::RowsNow;
use super::group_links::{GroupLinks, RowStore};
use super::working_set::WorkingSet;
use glam::DVec3;

use crate::base::{ClusterId, NodeName, PatchSide, Progress, Result, Rgb};
use crate::geom::sequence::{mix, unit};
use crate::model::ExtentKind;
use crate::model::report::TaskReport;
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::store::SegmentWriter;
use crate::store::tasks::UpdateRow;
use crate::transport::iterate::relax::{self, Inner, Member, Shapes};
use crate::transport::light::at::SideLights;
use crate::transport::light::lit::Lights;
use crate::transport::light::lit::LitCluster;
use crate::transport::measure::check::Check;
use crate::transport::measure::lamps::LightTree;
use crate::transport::nodes::mesh::Mesh;
use crate::transport::norm::Norm;
use crate::transport::numbers;
use crate::transport::records;
use crate::transport::refine::{self, Context, Sides};
use crate::transport::row::Part;
use crate::transport::source::{ClusterView, Loaded, exitance};

/// What shapes a visit's result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// What is done about rows promises at least so much a ray; infinite where nothing is to be done.
    pub threshold: f64,
    /// What light counts.
    pub norm: Norm,
    /// Iterations that the version read has behind it on its branch.
    pub iteration: u64,
    /// `--min-element`, m, or 0.
    pub min_element_m: f64,
    /// When to stop within the group.
    pub inner: Inner,
    /// From `--seed`.
    pub seed: u64,
    /// What all lamps of the model emit, W (norm over RGB).
    pub emitted_w: f64,
    /// What gathers are multiplied by.
    pub gain: [f32; 3],
    /// Whether light can come from everywhere; in the first iteration only lamps send.
    pub is_complete: bool,
    /// Whether nothing in the model emits: then there is nothing to measure.
    pub is_dark: bool,
    /// Places that are measured anew, at least.
    pub least_places: f64,
    /// Whether links are kept in the store.
    pub keep_links: bool,
    /// Bytes of decoded links held in memory: never changes the result.
    pub link_cache_bytes: u64,
}

/// A visit's result: rows to publish and figures.
pub struct Solved {
    /// New extents, in the worker's segment.
    pub rows: Vec<UpdateRow>,
    /// Figures.
    pub report: TaskReport,
}

/// Solves a group.
pub struct GroupSolver<'a, 's> {
    /// The version that is read.
    pub set: &'a WorkingSet<'s>,
    /// What rays can meet.
    pub scene: RayScene<'a>,
    /// What shapes the result.
    pub settings: Settings,
    /// Sides of clusters.
    pub sides: &'a SidesCache,
    /// Where to report.
    pub progress: &'a dyn Progress,
}

/// Clusters whose sides are held: about 16 KiB each.
const HELD: NonZeroUsize = NonZeroUsize::new(1024).expect("not 0");

/// Sides of clusters, which no version changes: looked for once.
pub struct SidesCache(RefCell<LruCache<u32, Rc<Sides>>>);

impl Default for SidesCache {
    fn default() -> Self {
        Self(RefCell::new(LruCache::new(HELD)))
    }
}

impl SidesCache {
    fn of(&self, view: &ClusterView<'_>, scene: &RayScene<'_>) -> Rc<Sides> {
        self.0.borrow_mut().get_or_insert(view.id.0, || Rc::new(Sides::of(view, scene))).clone()
    }
}

/// The sides of a group's clusters, looked for once.
struct GroupShapes<'a, 's> {
    set: &'a WorkingSet<'s>,
    clusters: &'a [ClusterId],
    sides: Vec<Rc<Sides>>,
}

impl Shapes for GroupShapes<'_, '_> {
    fn with(&self, index: usize, with: &mut dyn FnMut(&ClusterView<'_>, &Sides)) -> Result<()> {
        let loaded = self.set.mapped(self.clusters[index])?;
        with(&loaded.view(), &self.sides[index]);
        Ok(())
    }
}

impl GroupSolver<'_, '_> {
    pub(super) fn context(&self) -> Context<'_> {
        Context {
            scene: self.scene,
            clusters: self.set,
            lights: self.set,
            seed: self.settings.seed,
            threshold: self.settings.threshold,
            norm: self.settings.norm,
            gain: self.settings.gain,
            min_element_m: self.settings.min_element_m,
            // Links that are kept nowhere are held.
            made_bytes: if self.settings.keep_links { self.settings.link_cache_bytes } else { u64::MAX },
            progress: self.progress,
        }
    }

    /// Solves the group of these clusters (ascending) and appends what changed to `writer`.
    pub fn solve(&self, clusters: &[ClusterId], writer: &mut SegmentWriter) -> Result<Solved> {
        let mut report = TaskReport { complete: self.settings.is_complete, ..TaskReport::default() };
        let mut rows = Vec::new();
        let (mut members, mut in_memory) = (Vec::new(), Vec::new());
        let mut shapes = GroupShapes { set: self.set, clusters, sides: Vec::with_capacity(clusters.len()) };
        self.progress.begin("refine", "clusters", Some(clusters.len() as u64));
        for (done, &id) in clusters.iter().enumerate() {
            let loaded = self.set.mapped(id)?;
            let view = loaded.view();
            let sides = self.sides.of(&view, &self.scene);
            let RowsNow { mesh, written, in_memory: held } = self.rows(id, &view, &sides, writer, &mut report.work)?;
            rows.extend(written);
            in_memory.extend(held);
            self.add_member(mesh, &view, sides, (&mut members, &mut shapes));
            self.progress.at(done as u64 + 1);
        }
        // New rows are read back through the mapping, like old ones.
        writer.sync()?;
        let store = RowStore { set: self.set, clusters, new: &rows, in_memory: &in_memory };
        self.progress.begin("gather", "clusters", Some(clusters.len() as u64));
        let Settings { inner, seed, gain, .. } = self.settings;
        relax::take_over(&mut members, &shapes, &store, (seed, gain), self.progress)?;
        let mut links = GroupLinks::new(&store, self.settings.link_cache_bytes);
        report.inner_sweeps = relax::relax(&mut members, &shapes, &mut links, inner, (seed, gain), self.progress)?;
        report.q_max =
            members.iter().flat_map(|m| &m.materials).flat_map(|m| m.rho).fold(0.0, |q, r| q.max(f64::from(r)));
        self.write_light(clusters, &members, writer, &mut rows)?;
        for (member, sides) in members.iter().zip(&shapes.sides) {
            self.count_energy(member, sides, &mut report)?;
            self.count_error(member, &mut report)?;
        }
        if !self.settings.is_dark {
            self.check(clusters, &members, &shapes.sides, &mut report)?;
        }
        report.work.elements = members.iter().map(|m| m.mesh.elements.len() as u64).sum();
        Ok(Solved { rows, report })
    }

    fn add_member(
        &self,
        mesh: Mesh,
        view: &ClusterView<'_>,
        sides: Rc<Sides>,
        (members, shapes): (&mut Vec<Member>, &mut GroupShapes<'_, '_>),
    ) {
        let materials = view.materials.to_vec();
        let lit = LitCluster::of(&mesh, view.geometry.patches, &materials);
        let above = mesh.rows_above();
        members.push(Member { mesh, materials, lit, above, external: Vec::new(), escapes: Vec::new() });
        shapes.sides.push(sides);
    }

    fn write_light(
        &self,
        clusters: &[ClusterId],
        members: &[Member],
        writer: &mut SegmentWriter,
        rows: &mut Vec<UpdateRow>,
    ) -> Result<()> {
        for (&id, member) in clusters.iter().zip(members) {
            let loaded = self.set.mapped(id)?;
            let payload = records::encode(&member.mesh);
            if payload != loaded.light_payload() {
                let at = writer.append(ExtentKind::Radiosity, id.0, &payload)?;
                rows.push(UpdateRow { cluster: id, kind: ExtentKind::Radiosity, delta: false, at });
            }
        }
        Ok(())
    }

    /// Adds a cluster's power to the report: what its sides emit and absorb, and what leaves the model.
    fn count_energy(&self, member: &Member, sides: &Sides, report: &mut TaskReport) -> Result<()> {
        let loaded = self.set.mapped(member.mesh.cluster)?;
        let view = loaded.view();
        let add = |sum: &mut [f64; 3], power: Rgb| {
            for (s, p) in sum.iter_mut().zip(power.0) {
                *s += p;
            }
        };
        let patches = view.geometry.patches;
        for (at, element) in member.mesh.elements.iter().enumerate().filter(|(_, e)| e.is_leaf()) {
            let side = element.name.patch_side();
            let material = &member.materials[side.index()];
            let (exitance, rho) = (Rgb::from_f32(material.exitance), Rgb::from_f32(material.rho));
            let received = element.line.mean;
            if exitance.is_black() && received.is_black() {
                continue;
            }
            let leaf = Node::at(view.id, &patches[usize::from(side.patch)], element.name);
            let area = element.area_m2 * sides.covering(side).shown_share(&leaf);
            add(&mut report.power.emitted_w, exitance * area);
            add(&mut report.received_w, received * area);
            add(&mut report.power.absorbed_w, (Rgb::grey(1.0) - rho).times(received) * area);
            let row = member.above[at][Part::Indirect as usize];
            let escape = member.escapes.get(row as usize).copied().unwrap_or(0.0);
            let escaped = (exitance + rho.times(received)) * (area * f64::from(escape));
            add(&mut report.power.escaped_w, escaped.times(Rgb::from_f32(self.settings.gain)));
        }
        Ok(())
    }

    /// Adds to the report where the error of a cluster's light is.
    fn count_error(&self, member: &Member, report: &mut TaskReport) -> Result<()> {
        let loaded = self.set.mapped(member.mesh.cluster)?;
        let view = loaded.view();
        let context = self.context();
        // Emitters reflect, so they are refined like all others, but their own light counts in no error.
        for row in &member.mesh.rows {
            let counts = !view.emits(member.mesh.elements[row.element as usize].name);
            refine::case(&context, &view, &member.mesh, row.element as usize, row.rounds, row.fit)
                .add_to(&mut report.error, counts);
        }
        let [norm, lit, area] = refine::level(&view, &member.mesh, &self.settings.norm);
        report.error.norm += norm;
        report.error.lit = [report.error.lit[0] + lit, report.error.lit[1] + area];
        Ok(())
    }
}

impl GroupSolver<'_, '_> {
    /// Measures places of the group anew, more of them where more error is expected, and adds what their light is off.
    /// What is covered counts nowhere.
    fn check(
        &self,
        clusters: &[ClusterId],
        members: &[Member],
        sides: &[Rc<Sides>],
        report: &mut TaskReport,
    ) -> Result<()> {
        // Error that is expected at a leaf, then all up to it.
        let mut expected: Vec<(f64, usize, usize)> = Vec::new();
        let (mut sum, mut area_m2) = (0.0, 0.0);
        for (index, member) in members.iter().enumerate() {
            let loaded = self.set.mapped(clusters[index])?;
            let view = loaded.view();
            for (at, leaf) in member.mesh.elements.iter().enumerate() {
                if !leaf.is_leaf() || !view.takes_part(leaf.name.patch_side().index()) || view.emits(leaf.name) {
                    continue;
                }
                let counts = self.settings.norm.counts(leaf.line.mean.norm_squared().sqrt()).powi(2);
                let error = leaf.area_m2 * counts * member.mesh.expected_error(at, &member.above[at]);
                (sum, area_m2) = (sum + error, area_m2 + leaf.area_m2);
                expected.push((error, index, at));
            }
        }
        if sum <= 0.0 {
            return Ok(());
        }
        let anywhere = numbers::CHECKED_ANYWHERE * sum / area_m2;
        sum = 0.0;
        for (error, index, at) in &mut expected {
            sum += *error + anywhere * members[*index].mesh.elements[*at].area_m2;
            *error = sum;
        }
        let rays_of_place = 2.0 * (numbers::CHECK_RAYS[0] + numbers::CHECK_RAYS[1]) as f64;
        let count =
            (numbers::CHECKED * report.error.rays / rays_of_place).max(self.settings.least_places).ceil().max(2.0)
                as u64;
        let seed =
            mix(self.settings.seed ^ mix(self.settings.iteration ^ mix(u64::from(clusters[0].0) << 20 | 0xc4ec)));
        let exitance = |lamp: NodeName| exitance(self.set, lamp);
        let leaving = |cluster: ClusterId, side: PatchSide, place: DVec3| {
            Ok(match clusters.binary_search(&cluster) {
                Ok(index) => members[index].lit.leaving_at(side, place),
                Err(_) => self.set.lit(cluster)?.leaving_at(side, place),
            })
        };
        let draw = |turn: u64| {
            let x = (turn as f64 + unit(mix(seed ^ mix(turn)))) / count as f64 * sum;
            let at = expected.partition_point(|(upto, ..)| *upto <= x).min(expected.len() - 1);
            let (upto, index, element) = expected[at];
            let own = upto - if at > 0 { expected[at - 1].0 } else { 0.0 };
            let side = members[index].mesh.elements[element].name.patch_side();
            (index, side.index(), turn, element, own / sum)
        };
        let mut places: Vec<_> = (0..count).map(draw).collect();
        places.sort_unstable_by_key(|(index, side, turn, ..)| (*index, *side, *turn));
        let (mut total, mut squares) = (0.0, 0.0);
        for of_cluster in places.chunk_by(|a, b| a.0 == b.0) {
            let (index, id) = (of_cluster[0].0, clusters[of_cluster[0].0]);
            let loaded = self.set.mapped(id)?;
            let (view, mesh) = (loaded.view(), &members[index].mesh);
            let lamps = LightTree::of_clusters(self.set, &self.set.visible(id)?.0)?;
            let check = Check { scene: self.scene, lamps: &lamps, exitance: &exitance, leaving: &leaving };
            let mut lights = SideLights::default();
            for of_side in of_cluster.chunk_by(|a, b| a.1 == b.1) {
                let side = PatchSide::from_index(of_side[0].1);
                let patch = &view.geometry.patches[usize::from(side.patch)];
                let light = lights.of(&view.geometry, side, |at| mesh.lines(at));
                for &(_, _, turn, element, share) in of_side {
                    let leaf = &mesh.elements[element];
                    let node = Node::at(id, patch, leaf.name);
                    let own_seed = mix(seed ^ mix(turn ^ 1 << 40));
                    let place = node.shape.even_point(unit(mix(own_seed)), unit(mix(own_seed ^ 1)));
                    if sides[index].covering(side).covers(place) {
                        continue;
                    }
                    let halves = check.halves(&node, place, own_seed, &mut report.work.rays)?;
                    let stored = light.at(leaf.name, &node.shape, place);
                    let [a, b] = halves.map(|half| half.times(Rgb::from_f32(self.settings.gain)));
                    // What is bright there, not what the leaf is: next to lamps those are far apart.
                    let counts = self.settings.norm.counts(((a + b) * 0.5).norm_squared().sqrt()).powi(2);
                    let value = (a - stored).dot(b - stored) * counts * leaf.area_m2 / share;
                    total += value;
                    squares += value * value;
                }
            }
        }
        let n = count as f64;
        report.error.places += count;
        report.error.checked[0] += total / n;
        report.error.checked[1] += ((squares / n - (total / n).powi(2)) / (n - 1.0)).max(0.0);
        Ok(())
    }
}
