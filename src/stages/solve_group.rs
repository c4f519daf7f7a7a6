//! `solve-group`: solves one group, the next free one, or goes on while one is free (a worker).

use std::time::{Duration, Instant};

use serde::Serialize;

use super::group_solver::{GroupSolver, Settings, SidesCache};
use super::ray_scene::with_scene;
use super::working_set::WorkingSet;
use crate::base::memory::MemoryBudget;
use crate::base::text::shown;
use crate::base::{ClusterId, Error, Progress, Result, Rgb};
use crate::model::ExtentKind;
pub use crate::model::figures::Resources;
use crate::model::figures::Work;
use crate::model::light::{ElementLight, RowLight};
use crate::model::report::TaskReport;
pub use crate::model::solve_options::{InnerOption, LinkStorage, SolveOptions};
pub use crate::partition::schedule::Policy;
use crate::partition::schedule::choose;
use crate::store::iterations::Iteration;
pub use crate::store::iterations::SolveSettings;
use crate::store::tasks::{GroupClaim, Lease};
use crate::store::workers::Worker;
use crate::store::{ModelFacts, Stage, Store};
use crate::transport::iterate::relax::Inner;
use crate::transport::norm::Norm;
use crate::transport::numbers;

/// Which groups to solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// This one.
    Group(u32),
    /// The next free one.
    Next,
    /// One after the other while one is free.
    UntilDone,
}

/// How to solve.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Which groups.
    pub which: Which,
    /// `--version`: go on from there.
    pub version: Option<u64>,
    /// What shapes the solution (tasks of other options are another branch's), and `--order`.
    pub settings: SolveSettings,
    /// `--link-cache`, bytes; never changes the result.
    pub link_cache_bytes: u64,
    /// `--schedule`.
    pub schedule: Policy,
    /// `--memory`; never changes the result.
    pub memory: MemoryBudget,
}

/// What is going to be done.
pub struct Plan<'s> {
    store: &'s Store,
    options: Options,
    facts: ModelFacts,
    /// Groups of the partition.
    pub groups: u64,
}

/// What was done.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// The last group solved; none if nothing was free.
    pub group: Option<u32>,
    /// Groups solved by this call.
    pub groups_solved: u64,
    /// Whether the branch had converged already.
    pub converged: bool,
    /// The branch.
    pub branch: u64,
    /// The iteration.
    pub iteration: u64,
    /// What was done in the groups solved.
    #[serde(flatten)]
    pub work: Work,
}

/// Bytes that a task needs whatever the group: code, caches of places, SQLite.
const BASE_BYTES: u64 = 32 << 20;

/// Bytes of an element and its rows as light is stored: three rows to two elements.
const STORED_BYTES: u64 = (size_of::<ElementLight>() + 3 * size_of::<RowLight>() / 2) as u64;

/// The same while its group is solved, what they receive from outside included.
const ELEMENT_BYTES: u64 = 1100;

/// What is added to that while its cluster is refined.
const REFINED_BYTES: u64 = 1250;

/// Checks that there are groups and that the least a task needs fits in memory.
pub fn plan<'s>(store: &'s Store, options: &Options) -> Result<Plan<'s>> {
    store.require_stage(Stage::Partition)?;
    let facts = store.facts()?;
    let groups = store.groups()?.len() as u64;
    if let Which::Group(group) = options.which
        && u64::from(group) >= groups
    {
        return Err(Error::Usage {
            message: format!("{}: there is no group {group} among {groups}", shown(store.dir())),
            help: format!("give a number below {groups}, or `--next`"),
        });
    }
    require_least_memory(options)?;
    Ok(Plan { store, options: options.clone(), facts, groups })
}

/// Refuses what does not suffice for any group.
pub fn require_least_memory(options: &Options) -> Result<()> {
    options.memory.require("solving", BASE_BYTES + options.link_cache_bytes, ", or a smaller `--link-cache`")
}

/// Refuses to open another branch under a run that goes on.
fn require_no_other_run(store: &Store, settings: &SolveSettings) -> Result<()> {
    let branch = store.branch(store.newest_branch()?)?;
    let opens_another = branch.and_then(|b| b.options_hash).is_some_and(|hash| hash != settings.options_hash());
    if opens_another && !store.is_coordinated()? && store.processes()?.iter().any(|p| p.holds_run_lock) {
        return Err(Error::Busy { store: store.dir().to_path_buf(), holder: store.holder() });
    }
    Ok(())
}

/// Solves. `resources`: what the process has used so far, measured by the caller, which may look at clocks.
pub fn execute(plan: &Plan<'_>, resources: &dyn Fn() -> Resources, progress: &dyn Progress) -> Result<Summary> {
    let (store, options) = (plan.store, &plan.options);
    let settings = &options.settings;
    require_no_other_run(store, settings)?;
    let iteration = store.open_iteration(options.version, settings)?;
    let mut summary = Summary {
        converged: iteration.converged,
        branch: iteration.branch,
        iteration: iteration.number,
        ..Summary::default()
    };
    if iteration.converged {
        return Ok(summary);
    }
    let mut worker = Worker::start(store)?;
    // Groups of one base version share what is mapped.
    let mut set: Option<WorkingSet<'_>> = None;
    let sides = SidesCache::default();
    loop {
        let Some(lease) = claim(plan, &iteration, &worker)? else { return Ok(summary) };
        if set.as_ref().is_none_or(|s| s.snapshot().version() != lease.base_version) {
            set = Some(WorkingSet::open(store, lease.base_version)?);
        }
        let current = set.as_ref().expect("just opened");
        match solve(plan, (current, &sides), &lease, &mut worker, resources, progress) {
            Ok(Some(report)) => {
                summary.group = Some(lease.group);
                summary.groups_solved += 1;
                summary.work += report.work;
                worker.holds(&current.remembered())?;
            }
            Ok(None) => progress.warn(&format!("group {} was solved by another process meanwhile", lease.group)),
            Err(error) => {
                store.give_back(&lease, &worker)?;
                return Err(error);
            }
        }
        if options.which != Which::UntilDone {
            return Ok(summary);
        }
    }
}

fn claim(plan: &Plan<'_>, iteration: &Iteration, worker: &Worker<'_>) -> Result<Option<Lease>> {
    let Which::Group(group) = plan.options.which else {
        return plan.store.claim(iteration, worker, &mut |offer, held| {
            choose(plan.options.schedule, &offer.free, (offer.taken, &offer.by_cost), held)
        });
    };
    let started = Instant::now();
    loop {
        match plan.store.claim_group(iteration, worker, group)? {
            GroupClaim::Granted(lease) => return Ok(Some(lease)),
            GroupClaim::Done => return Ok(None),
            GroupClaim::Held { pid } if started.elapsed() >= plan.store.wait() => {
                return Err(Error::Busy {
                    store: plan.store.dir().to_path_buf(),
                    holder: pid.map_or("a group that comes before".to_owned(), |pid| format!("process {pid}")),
                });
            }
            GroupClaim::Held { .. } => std::thread::sleep(Duration::from_millis(50)),
            GroupClaim::Failed => {
                return Err(Error::failed(
                    format!("group {group} has failed: its workers died again and again"),
                    "rerun `clerestory run`, which tries it anew, or give more memory",
                ));
            }
            GroupClaim::Unknown => {
                return Err(Error::Usage {
                    message: format!("there is no group {group}"),
                    help: "see `clerestory status` for the groups".to_owned(),
                });
            }
        }
    }
}

/// Refuses a group whose elements, as the base version stores them, do not fit in memory. What the visit adds to them is
/// not known before. Links are streamed: those made are put away when they fill the link cache, which is filled only once
/// all clusters are refined.
fn require_memory(plan: &Plan<'_>, set: &WorkingSet<'_>, group: u32, clusters: &[ClusterId]) -> Result<()> {
    let (mut elements, mut largest) = (0, 0);
    for &id in clusters {
        let light = set.snapshot().place(ExtentKind::Radiosity, id)?.map_or(0, |at| at.bytes);
        let of_cluster = light / STORED_BYTES;
        (elements, largest) = (elements + of_cluster, largest.max(of_cluster));
    }
    let needed = BASE_BYTES + plan.options.link_cache_bytes + elements * ELEMENT_BYTES + largest * REFINED_BYTES;
    let what = format!("group {group} with {elements} elements in {} clusters", clusters.len());
    let groups = format!(", or more than {} groups with `--groups`", plan.groups);
    plan.options.memory.require(&what, needed, if clusters.len() > 1 { &groups } else { "" })
}

fn solve(
    plan: &Plan<'_>,
    (set, sides): (&WorkingSet<'_>, &SidesCache),
    lease: &Lease,
    worker: &mut Worker<'_>,
    resources: &dyn Fn() -> Resources,
    progress: &dyn Progress,
) -> Result<Option<TaskReport>> {
    let (store, options) = (plan.store, &plan.options);
    let base = store
        .version(lease.base_version)?
        .ok_or_else(|| Error::damaged(store.dir(), format!("no version {}", lease.base_version)))?;
    let shaping = &options.settings.options;
    let figures = store.version_figures(store.iteration_end_before(base.id)?)?;
    let inner = match shaping.inner {
        InnerOption::Gathers(count) => Inner::Gathers(count),
        InnerOption::Converge => {
            // Light of other groups has not settled either.
            let residual = figures.as_ref().map_or(1.0, |f| f.residual);
            let tolerance = (numbers::STILL * residual).max(shaping.tolerance / 100.0);
            Inner::Converge { tolerance, q: plan.facts.max_reflectance }
        }
    };
    let steering = figures.map(|f| f.steering).unwrap_or_default();
    let settings = |is_dark: bool| Settings {
        threshold: steering.threshold.unwrap_or(f64::INFINITY),
        norm: Norm::of_mean(steering.lit_mean_w_m2),
        iteration: base.iteration,
        min_element_m: shaping.min_element_m.unwrap_or(0.0),
        inner,
        seed: shaping.seed,
        emitted_w: Rgb(plan.facts.emitted_w).norm_squared().sqrt(),
        gain: steering.gain.map(|gain| gain as f32),
        is_complete: base.iteration > 0,
        is_dark,
        least_places: numbers::LEAST_CHECKED / plan.groups as f64,
        keep_links: shaping.links == LinkStorage::Keep,
        link_cache_bytes: options.link_cache_bytes,
    };
    let clusters = store.clusters_of(lease.group)?;
    require_memory(plan, set, lease.group, &clusters)?;
    let before = resources();
    let mut solved = with_scene(set, |open| {
        let settings = settings(open.is_dark);
        let solver = GroupSolver { set, scene: open.scene, settings, sides, progress };
        solver.solve(&clusters, &mut worker.segment)
    })?;
    solved.report.used = resources().since(&before);
    let held = store.publish(lease, worker, &solved.rows, &solved.report)?;
    Ok(held.then_some(solved.report))
}
