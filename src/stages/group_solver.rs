//! One visit to a group: refine its clusters' links, gather what comes from outside once, iterate
//! what stays inside, and write what changed. A function of the version read, the group and the
//! options alone.

use super::group_links::{GroupLinks, LinkStore, SourceTable, Wanted};
use super::link_extent::LinkExtent;
use super::working_set::WorkingSet;
use crate::base::{ClusterId, NodeName, PatchSide, Progress, Result, Rgb};
use crate::model::ExtentKind;
use crate::model::links::LeafClosure;
use crate::model::report::TaskReport;
use crate::rays::RayScene;
use crate::rays::locate::Covering;
use crate::rays::node::Node;
use crate::store::tasks::UpdateRow;
use crate::store::{SegmentWriter, segment};
use crate::transport::bundle::SideCache;
use crate::transport::link_rows::{self, Link};
use crate::transport::oracle::Tolerances;
use crate::transport::push_pull::Gathered;
use crate::transport::records;
use crate::transport::refine::{Context, Scope};
use crate::transport::relax::{self, Inner, Member};
use crate::transport::row_parts;
use crate::transport::solve_cluster::{SolvedCluster, StoredLinks, Unsolved, solve_cluster};
use crate::transport::source::Loaded;
use crate::transport::source_memo::SourceMemo;

/// What shapes a visit's result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Errors that matter.
    pub tolerances: Tolerances,
    /// When to stop within the group.
    pub inner: Inner,
    /// From `--seed`.
    pub seed: u64,
    /// Which sources to link.
    pub scope: Scope,
    /// Whether nothing in the model emits: then there is nothing to link.
    pub is_dark: bool,
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
    /// Sides of clusters, as sector nodes bundle them.
    pub sides: SideCache,
    /// Sources that links lead to.
    pub sources: SourceMemo,
    /// Where to report.
    pub progress: &'a dyn Progress,
}

impl<'a, 's> GroupSolver<'a, 's> {
    /// Solves the group of these clusters (ascending) and appends what changed to `writer`.
    pub fn solve(&self, clusters: &[ClusterId], writer: &mut SegmentWriter) -> Result<Solved> {
        let mut report = TaskReport { complete: self.settings.scope == Scope::Everything, ..TaskReport::default() };
        let mut rows = Vec::new();
        let (mut members, mut closures) = (Vec::new(), Vec::new());
        let mut first = 0;
        self.progress.begin("refine", "clusters", Some(clusters.len() as u64));
        for (done, &id) in clusters.iter().enumerate() {
            let stored = if self.settings.keep_links { self.stored(id)? } else { StoredLinks::default() };
            let refined = self.refine(id, stored)?;
            report.work.links_evaluated += refined.counts.evaluated;
            report.work.links_reused += refined.counts.reused;
            report.work.rays += refined.counts.rays;
            let links: usize = refined.rows.iter().map(Vec::len).sum();
            report.work.links_stored += links as u64;
            if self.settings.keep_links && refined.stored_changed {
                rows.push(self.write_links(&refined, writer)?);
            }
            let SolvedCluster { mesh, rows: written, closure, factors, .. } = refined;
            let materials = self.set.mapped(id)?.view().materials.to_vec();
            let member = Member { mesh, materials, external: Vec::new(), factors, first };
            first += member.mesh.node_count();
            members.push(member);
            closures.push(closure);
            drop(written);
            if links * size_of::<Link>() > MANY_LINKS_BYTES {
                segment::give_back_freed_memory();
            }
            self.progress.at(done as u64 + 1);
        }
        // New links are read back through the mapping, like old ones.
        writer.sync()?;
        self.gather_and_relax(clusters, &mut members, &rows, &mut report)?;
        self.write_light(clusters, &members, writer, &mut rows)?;
        for (member, closure) in members.iter().zip(&closures) {
            self.count_energy(member, closure, &mut report)?;
        }
        report.work.elements = members.iter().map(|m| m.mesh.elements.len() as u64).sum();
        Ok(Solved { rows, report })
    }

    /// Refines one cluster from these links against the light of the version.
    fn refine(&self, id: ClusterId, stored: StoredLinks) -> Result<SolvedCluster> {
        let context = Context {
            scene: self.scene,
            clusters: self.set,
            tolerances: self.settings.tolerances,
            seed: self.settings.seed,
            scope: self.settings.scope,
            sides: &self.sides,
            sources: &self.sources,
            progress: self.progress,
        };
        let loaded = self.set.mapped(id)?;
        let (mut visible, found) = self.set.visible(id)?;
        if self.settings.is_dark {
            visible.clear();
        }
        solve_cluster(&context, Unsolved { view: loaded.view(), visible, found, stored })
    }

    /// A cluster's links in the version that is read.
    fn stored(&self, id: ClusterId) -> Result<StoredLinks> {
        let chain = LinkStore::chain(self.set, id, None)?;
        let views = chain.views()?;
        let mut rows = Vec::new();
        link_rows::for_each_row(&views, |name, view, range| {
            rows.push((name, range.map(|at| link_rows::link_at(view, at)).collect()));
        });
        Ok(StoredLinks { rows, closure: views.last().map_or_else(Vec::new, |newest| newest.closure.to_vec()) })
    }

    /// Writes a cluster's links: the rows that changed behind the chain they came from, or all rows anew
    /// where there is no chain or more than half of it would be garbage.
    fn write_links(&self, refined: &SolvedCluster, writer: &mut SegmentWriter) -> Result<UpdateRow> {
        let id = refined.mesh.cluster;
        let chain_bytes = self.set.snapshot().links_bytes(id)?;
        let mut order: Vec<usize> = (0..refined.rows.len()).collect();
        order.sort_unstable_by_key(|&at| refined.mesh.name_at(at));
        let extent = |delta: bool| {
            let keep = |at: usize| if delta { refined.changed[at] } else { !refined.rows[at].is_empty() };
            let rows = (order.iter().filter(|&&at| keep(at)))
                .map(|&at| (refined.mesh.name_at(at), refined.rows[at].as_slice()))
                .collect();
            LinkExtent::new(delta, rows, &refined.closure)
        };
        let links = refined.rows.iter().map(Vec::len).sum();
        let room = 2 * link_rows::live_bytes(links, refined.closure.len());
        let behind = (0 < chain_bytes && chain_bytes < room)
            .then(|| extent(true))
            .filter(|delta| chain_bytes + delta.bytes() <= room);
        let delta = behind.is_some();
        let at = behind.unwrap_or_else(|| extent(false)).write(id, writer)?;
        Ok(UpdateRow { cluster: id, kind: ExtentKind::Links, delta, at })
    }

    fn gather_and_relax(
        &self,
        clusters: &[ClusterId],
        members: &mut [Member],
        new: &[UpdateRow],
        report: &mut TaskReport,
    ) -> Result<()> {
        let recompute = |index: usize| -> Result<Vec<(NodeName, Vec<Link>)>> {
            let refined = self.refine(clusters[index], StoredLinks::default())?;
            Ok(refined.rows.into_iter().enumerate().map(|(at, row)| (refined.mesh.name_at(at), row)).collect())
        };
        let keep = self.settings.keep_links;
        let store = LinkStore { set: self.set, sources: &self.sources, clusters, new, recompute: &recompute, keep };
        self.progress.begin("gather", "clusters", Some(clusters.len() as u64));
        for index in 0..members.len() {
            let mesh = &members[index].mesh;
            let mut external = vec![Gathered::default(); mesh.node_count()];
            store.visit(index, members, Wanted::Outside, |table: &SourceTable, receiver, source, link| {
                if let Some(radiosity) = table.outside(source) {
                    let error = row_parts::error(link, mesh.is_leaf_at(receiver));
                    external[receiver].add(radiosity, f64::from(link.form_factor), error);
                }
            })?;
            members[index].external = external;
            self.progress.at(index as u64 + 1);
        }
        let mut links = GroupLinks::new(&store, self.settings.link_cache_bytes);
        let relaxed = relax::relax(members, &mut links, self.settings.inner, self.progress)?;
        report.inner_sweeps = relaxed.sweeps;
        report.work.links_reused += links.reused();
        report.work.links_evaluated += links.recomputed();
        report.q_max =
            members.iter().flat_map(|m| &m.materials).flat_map(|m| m.rho).fold(0.0, |q, r| q.max(f64::from(r)));
        Ok(())
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
            let view = loaded.view();
            let payload = records::encode(&member.mesh, &view.geometry, view.materials);
            if payload != loaded.light_payload() {
                let at = writer.append(ExtentKind::Radiosity, id.0, &payload)?;
                rows.push(UpdateRow { cluster: id, kind: ExtentKind::Radiosity, delta: false, at });
            }
        }
        Ok(())
    }

    /// Adds a cluster's power to the report: what its sides emit and absorb, and what leaves the model.
    fn count_energy(&self, member: &Member, closure: &[LeafClosure], report: &mut TaskReport) -> Result<()> {
        let loaded = self.set.mapped(member.mesh.cluster)?;
        let view = loaded.view();
        let add = |sum: &mut [f64; 3], power: Rgb| {
            for (s, p) in sum.iter_mut().zip(power.0) {
                *s += p;
            }
        };
        let patches = view.geometry.patches;
        let side = |i: usize| Node::root(view.id, &patches[i / 2], PatchSide::from_index(i));
        let mut covering: Vec<Option<Covering>> = (0..2 * patches.len()).map(|_| None).collect();
        for element in member.mesh.elements.iter().filter(|e| e.is_leaf()) {
            let at = element.name.patch_side();
            let material = &member.materials[at.index()];
            let exitance = Rgb::from_f32(material.exitance);
            if exitance.is_black() && element.irradiance.is_black() {
                continue;
            }
            let leaf = Node::at(view.id, &patches[usize::from(at.patch)], element.name);
            let covering = covering[at.index()].get_or_insert_with(|| self.scene.covering(&side(at.index())));
            let shown = covering.shown_share(&leaf);
            add(&mut report.power.emitted_w, exitance * (element.area_m2 * shown));
            if element.irradiance.is_black() {
                continue;
            }
            let absorbed = (Rgb::grey(1.0) - Rgb::from_f32(material.rho)).times(element.irradiance);
            add(&mut report.power.absorbed_w, absorbed * (element.area_m2 * shown));
        }
        for c in closure {
            let at = member.mesh.nearest(NodeName(c.leaf));
            let area = member.mesh.elements[at].area_m2;
            add(&mut report.power.escaped_w, member.radiosity(at) * (area * f64::from(c.escape)));
            if !member.mesh.elements[at].irradiance.is_black() {
                report.unlinked_area_m2 += area * f64::from(c.unlinked);
                report.lit_area_m2 += area;
            }
        }
        Ok(())
    }
}

/// Links of one cluster that are worth giving back at once.
const MANY_LINKS_BYTES: usize = 4 << 20;
