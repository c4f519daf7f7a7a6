//! `partition`: clusters to groups.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::Serialize;

use super::working_set::WorkingSet;
use crate::base::memory::MemoryBudget;
use crate::base::{ClusterId, Progress, Result};
use crate::geom::bounds::Bounds;
use crate::geom::quadtree::patch_polygon;
use crate::model::ExtentKind;
use crate::model::visibility::VisibilityView;
use crate::partition::graph::{Edge, Graph, Grouping, Place, predicted_contraction, split_into, split_oversized};
use crate::partition::split::{Occluder, split};
use crate::partition::{merge, plain};
use crate::store::partition_rows::GroupRow;
use crate::store::stage_rows::hash;
use crate::store::{Stage, StageRecord, Store};
use crate::transport::source::Loaded;

/// The paper's methods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Greedy on the form-factor graph.
    #[default]
    Merge,
    /// Recursive cuts along major occluders.
    Split,
    /// A square grid.
    Region,
    /// By chance.
    Random,
}

impl Method {
    /// As typed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Merge => "merge",
            Self::Split => "split",
            Self::Region => "region",
            Self::Random => "random",
        }
    }
}

/// How to group.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// `--method`; `None` keeps the store's groups, or else merges.
    pub method: Option<Method>,
    /// `--groups`: MinGroups; `None` keeps the store's, or else follows from model and memory.
    pub groups: Option<u32>,
    /// `--memory`.
    pub memory: MemoryBudget,
}

/// What is going to be done.
pub struct Plan<'s> {
    store: &'s Store,
    method: Method,
    /// MinGroups.
    pub groups: usize,
    record: StageRecord,
    /// Whether the store's groups stay.
    pub done: bool,
}

/// What came out.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Groups.
    pub groups: u64,
    /// Share of all exchange that stays within groups.
    pub intra_group_share: f64,
    /// Predicted ratio of successive errors.
    pub predicted_contraction: f64,
    /// Bytes of everything the largest group can see, geometry and first light.
    pub largest_working_set_bytes: u64,
}

/// Elements that a patch comes to have, and bytes of one in a task, for the default number of groups.
const ELEMENTS_PER_PATCH: u64 = 100;
const ELEMENT_BYTES: u64 = 300;

/// Fewest groups by default: enough to schedule well on a few workers (N > 8 P in the paper), unless each would have
/// fewer patches than in the paper's best granularity (256 groups of 6,418 patches): a task has costs of its own.
const LEAST_GROUPS: u64 = 16;
const LEAST_PATCHES: u64 = 25;

/// Bytes that grouping takes whatever the model, and for a pair of clusters that see each other.
const BASE_BYTES: u64 = 16 << 20;
const PAIR_BYTES: u64 = 100;

/// Refuses a form-factor graph that would not fit in memory.
fn require_memory(store: &Store, memory: MemoryBudget) -> Result<()> {
    let pairs = store.visibility_figures()?.pairs;
    memory.require(&format!("grouping by {pairs} pairs of clusters"), BASE_BYTES + pairs * PAIR_BYTES, "")
}

/// Decides on method and number, and whether there is anything to do.
pub fn plan<'s>(store: &'s Store, options: &Options) -> Result<Plan<'s>> {
    let visibility = store.require_stage(Stage::Visibility)?;
    require_memory(store, options.memory)?;
    let facts = store.facts()?;
    let elements_bytes = facts.patches * ELEMENTS_PER_PATCH * ELEMENT_BYTES;
    let least = facts.patches.div_ceil(LEAST_PATCHES).min(LEAST_GROUPS);
    let default = elements_bytes.div_ceil(options.memory.limit_bytes / 4).max(least).min(facts.clusters);
    let groups = options.groups.map_or(default, u64::from).clamp(1, facts.clusters.max(1)) as usize;
    let method = options.method.unwrap_or_default();
    let text = format!("{{\"method\":\"{}\",\"groups\":{groups}}}", method.name());
    let record = StageRecord {
        stage: Stage::Partition,
        input_hash: String::new(),
        materials_hash: String::new(),
        options_hash: hash([text.as_bytes()]),
        previous_hash: visibility.chain_hash(),
        options: text,
    };
    let keep = options.method.is_none() && options.groups.is_none();
    let done = store.stage(Stage::Partition)?.is_some_and(|known| {
        known.previous_hash == record.previous_hash && (keep || known.options_hash == record.options_hash)
    });
    Ok(Plan { store, method, groups, record, done })
}

/// Groups the clusters.
pub fn execute(plan: &Plan<'_>, progress: &dyn Progress) -> Result<Summary> {
    let store = plan.store;
    let set = WorkingSet::open(store, store.newest_version()?)?;
    progress.begin("graph", "clusters", Some(store.facts()?.clusters));
    let graph = graph(&set, progress)?;
    if !plan.done {
        progress.begin("partition", "groups", Some(plan.groups as u64));
        let grouping = match plan.method {
            Method::Merge => merge::merge(&graph, plan.groups),
            Method::Split => split(&graph, &occluders(&set)?, plan.groups),
            Method::Region => plain::region(&graph, plan.groups, up_axis(store)?),
            Method::Random => plain::random(&graph, plan.groups, 1),
        };
        let grouping = split_into(&graph, split_oversized(&graph, grouping), plan.groups);
        let rows = rows(&set, &graph, &grouping)?;
        let mut pairs = graph.places.iter().zip(&grouping).map(|(p, g)| (ClusterId(p.cluster), *g));
        store.publish_partition(&plan.record, &rows, &mut pairs)?;
    }
    summary(store, &graph)
}

fn up_axis(store: &Store) -> Result<usize> {
    Ok(if store.facts()?.up == 'y' { 1 } else { 2 })
}

fn summary(store: &Store, graph: &Graph) -> Result<Summary> {
    let groups = store.groups()?;
    let grouping: Grouping =
        graph.places.iter().map(|p| Ok(store.group_of(ClusterId(p.cluster))?.unwrap_or(0))).collect::<Result<_>>()?;
    let share = graph.intra_group_share(&grouping);
    Ok(Summary {
        groups: groups.len() as u64,
        intra_group_share: share,
        predicted_contraction: predicted_contraction(store.facts()?.max_reflectance, share),
        largest_working_set_bytes: groups.iter().map(|g| g.working_set_bytes).max().unwrap_or(0),
    })
}

/// The form-factor graph, from the visibility lists.
fn graph(set: &WorkingSet<'_>, progress: &dyn Progress) -> Result<Graph> {
    let mut graph = Graph::default();
    let mut area = Vec::new();
    for cluster in set.snapshot().clusters() {
        let c = cluster?;
        let centre = Bounds::from_f32(c.min_m, c.max_m).centre();
        graph.places.push(Place { cluster: c.id.0, centre, patches: c.patches });
        area.push(c.area_m2);
    }
    let position: BTreeMap<u32, u32> = graph.places.iter().enumerate().map(|(i, p)| (p.cluster, i as u32)).collect();
    let mut weights: BTreeMap<(u32, u32), f64> = BTreeMap::new();
    for (at, (place, area_m2)) in graph.places.iter().zip(&area).enumerate() {
        let id = ClusterId(place.cluster);
        let list = set.snapshot().need(ExtentKind::Visibility, id)?;
        for seen in list.parse(VisibilityView::parse)?.clusters {
            let other = position[&seen.cluster];
            let (a, b) = (other.min(at as u32), other.max(at as u32));
            // Half from each side's estimate.
            *weights.entry((a, b)).or_default() += 0.5 * area_m2 * f64::from(seen.form_factor);
        }
        progress.at(at as u64 + 1);
    }
    graph.edges = weights.into_iter().map(|((a, b), weight)| Edge { a, b, weight }).collect();
    Ok(graph)
}

fn rows(set: &WorkingSet<'_>, graph: &Graph, grouping: &[u32]) -> Result<Vec<GroupRow>> {
    let costs = graph.group_costs(grouping);
    let mut inside = vec![0.0; costs.len()];
    let mut seen: Vec<std::collections::BTreeSet<u32>> = vec![std::collections::BTreeSet::new(); costs.len()];
    for e in &graph.edges {
        let (a, b) = (grouping[e.a as usize] as usize, grouping[e.b as usize] as usize);
        if a == b {
            inside[a] += e.weight;
        }
        seen[a].insert(e.b);
        seen[b].insert(e.a);
    }
    let mut bytes = Vec::with_capacity(graph.places.len());
    for place in &graph.places {
        let size = |kind| -> Result<u64> {
            Ok(set.snapshot().place(kind, ClusterId(place.cluster))?.map_or(0, |at| at.bytes))
        };
        bytes.push(size(ExtentKind::Geometry)? + size(ExtentKind::Materials)? + size(ExtentKind::Radiosity)?);
    }
    Ok((0..costs.len())
        .map(|g| {
            let members = || (0..grouping.len()).filter(move |i| grouping[*i] as usize == g);
            GroupRow {
                id: g as u32,
                clusters: members().count() as u64,
                patches: members().map(|i| u64::from(graph.places[i].patches)).sum(),
                predicted_cost: costs[g],
                working_set_bytes: seen[g].iter().map(|i| bytes[*i as usize]).sum(),
                intra_group_share: if costs[g] > 0.0 { inside[g] / costs[g] } else { 1.0 },
            }
        })
        .collect())
}

/// Planes kept for the Split algorithm, the largest.
const OCCLUDERS: usize = 4096;

/// Major occluders: planes by the area of the patches that lie in them.
fn occluders(set: &WorkingSet<'_>) -> Result<Vec<Occluder>> {
    let step = set.snapshot().store().facts()?.diagonal_m() * 1e-4;
    let mut planes: BTreeMap<[i64; 4], Occluder> = BTreeMap::new();
    for cluster in set.snapshot().clusters() {
        let loaded = set.mapped(cluster?.id)?;
        for patch in loaded.view().geometry.patches {
            let shape = patch_polygon(patch);
            let normal = upright(shape.normal());
            let offset = normal.dot(shape.centre());
            let key = [normal.x * 1e3, normal.y * 1e3, normal.z * 1e3, offset / step].map(|x| x.round() as i64);
            let plane = planes.entry(key).or_insert(Occluder { normal, offset, area_m2: 0.0 });
            plane.area_m2 += shape.area();
        }
        if planes.len() > 4 * OCCLUDERS {
            let mut areas: Vec<f64> = planes.values().map(|p| p.area_m2).collect();
            areas.sort_by(f64::total_cmp);
            let least = areas[areas.len() - OCCLUDERS];
            planes.retain(|_, p| p.area_m2 >= least);
        }
    }
    let mut list: Vec<Occluder> = planes.into_values().collect();
    list.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
    list.truncate(OCCLUDERS);
    Ok(list)
}

/// The one of a plane's two normals whose first component that is not 0 is positive.
fn upright(normal: DVec3) -> DVec3 {
    let first = normal.to_array().into_iter().find(|x| x.abs() > 1e-9).unwrap_or(1.0);
    if first < 0.0 { -normal } else { normal }
}
