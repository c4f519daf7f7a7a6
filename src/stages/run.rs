//! `run`: everything from model to converged solution, with worker processes; itself restartable.
//!
//! Starts ingest, visibility and partition, each of which knows whether it has anything to do; then,
//! iteration by iteration, workers that solve groups, merging what they publish.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::children::{self, Ended, FIRST_LOOK, LOOK, Running};
use super::{entry, ingest, merge, solve_group};
use crate::base::memory::status_bytes;
use crate::base::text::for_shell;
use crate::base::{Error, Progress, Result};
use crate::model::figures::{ProcessFigures, Resources};
use crate::model::order::UpdateOrder;
use crate::store::merging::TaskState;
use crate::store::{Iteration, RunLock, Store, folder};

/// Deaths of one stage, or of workers in a row without progress, after which the run fails.
const DEATHS: u64 = 3;

/// Workers per process that may end without anything solved meanwhile before the run fails.
const IDLE: usize = 20;

/// How often leases of other processes' workers are looked at.
const LOOK_AT_LEASES: Duration = Duration::from_secs(1);

/// Flags of `run`, and the command lines of its children (verb first, without the program).
#[derive(Clone, Debug)]
pub struct Options {
    /// Store folder.
    pub store: PathBuf,
    /// This program.
    pub program: PathBuf,
    /// `ingest STORE MODEL...`; none if no model is given: the store must be there.
    pub ingest: Option<Vec<OsString>>,
    /// `visibility STORE ...`.
    pub visibility: Vec<OsString>,
    /// `partition STORE ...`.
    pub partition: Vec<OsString>,
    /// `solve-group STORE --until-done ...`, with the options in `solve`.
    pub worker: Vec<OsString>,
    /// `audit STORE ...`, without its version, and its places; 0 leaves it out.
    pub audit: (Vec<OsString>, u64),
    /// What the workers solve with.
    pub solve: solve_group::Options,
    /// `--workers`.
    pub workers: usize,
    /// `--max-iterations`.
    pub max_iterations: u64,
    /// `--keep`.
    pub keep: u64,
    /// `--wait`.
    pub wait: Duration,
}

impl Options {
    /// Whether the store is going to be emptied: its ingest is told so.
    fn is_fresh(&self) -> bool {
        self.ingest.as_ref().is_some_and(|line| line.iter().any(|word| word == "--fresh"))
    }
}

/// What `run` is going to start.
pub struct Plan {
    options: Options,
    /// The children's command lines, in order; that of `solve-group` for each worker.
    pub commands: Vec<Vec<OsString>>,
}

/// What `run` reached.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// The solution's figures.
    #[serde(flatten)]
    pub solution: merge::Summary,
    /// Patches.
    pub patches: u64,
    /// Clusters.
    pub clusters: u64,
    /// Emitting patches.
    pub emitters: u64,
    /// Area, each patch once, m2.
    pub area_m2: f64,
    /// The vertical.
    pub up: char,
    /// Whether what speaks for it is clear, or it was given.
    pub up_is_sure: bool,
    /// Worker processes.
    pub workers: usize,
    /// Largest anonymous memory of the coordinator, bytes.
    pub coordinator_anon_bytes: u64,
    /// Groups whose workers died too often.
    pub failed_groups: Vec<u32>,
    /// What the children used; the command line adds its own.
    #[serde(skip)]
    pub used: ProcessFigures,
}

impl super::summary::Summary for Summary {
    fn lines(&self) -> Vec<String> {
        let model = format!("{} patches in {} clusters, {:.1} m2", self.patches, self.clusters, self.area_m2);
        let mut lines = vec![format!("{model}, {}", ingest::vertical_line(self.up, self.up_is_sure))];
        lines.extend(super::summary::Summary::lines(&self.solution));
        lines
    }

    fn shortfall(&self) -> Option<Error> {
        if !self.failed_groups.is_empty() {
            return Some(Error::NotConverged {
                message: format!("groups {} failed: their workers died", merge::names(&self.failed_groups)),
                help: "run the same command again; if they fail again, give more `--memory`".to_owned(),
            });
        }
        if self.solution.unmet.is_some() {
            return super::summary::Summary::shortfall(&self.solution);
        }
        (!self.solution.converged).then(|| Error::NotConverged {
            message: format!("not converged after {} iterations", self.solution.iterations),
            help: "run the same command with a larger `--max-iterations`: it goes on from here".to_owned(),
        })
    }
}

/// Lists what will be started.
pub fn plan(options: &Options) -> Result<Plan> {
    solve_group::require_least_memory(&options.solve)?;
    if let Some(version) = options.solve.version {
        let help = "leave out `--version`: there is nothing to go on from in a new store".to_owned();
        let none = || Error::Usage { message: format!("there is no version {version} yet"), help };
        match Store::open(&options.store, options.wait) {
            Ok(store) if !options.is_fresh() => drop(entry::version_to_read(&store, Some(version))?),
            Ok(_) => return Err(none()),
            Err(Error::NoStore { .. }) if options.ingest.is_some() => return Err(none()),
            Err(error) => return Err(error),
        }
    }
    if options.ingest.is_none() {
        Store::open(&options.store, options.wait)?;
    }
    let mut commands: Vec<Vec<OsString>> = options.ingest.iter().cloned().collect();
    commands.extend([options.visibility.clone(), options.partition.clone(), options.worker.clone()]);
    commands.extend((options.audit.1 > 0).then(|| options.audit.0.clone()));
    Ok(Plan { options: options.clone(), commands })
}

/// Runs. A summary that is not converged, or has failed groups, says so in `shortfall`.
pub fn execute(plan: &Plan, progress: &dyn Progress) -> Result<Summary> {
    let options = &plan.options;
    let is_new = !options.store.exists();
    let done = run(options, progress);
    if done.is_err() && is_new {
        folder::unmake(&options.store);
    }
    done
}

fn run(options: &Options, progress: &dyn Progress) -> Result<Summary> {
    let make = if options.is_fresh() { Store::create_anew } else { Store::create };
    let store = make(&options.store, options.wait)?;
    let _lock = RunLock::take(&store, &format!("clerestory run --store {}", for_shell(&options.store)))?;
    if !options.is_fresh() {
        entry::trust_rows(&store)?;
    }
    let mut coordinator = Coordinator {
        options,
        store: &store,
        progress,
        used: ProcessFigures::default(),
        anon_bytes: 0,
        pause: FIRST_LOOK,
    };
    if let Some(args) = &options.ingest {
        coordinator.stage("ingest", args)?;
    }
    coordinator.stage("visibility", &options.visibility)?;
    coordinator.stage("partition", &options.partition)?;
    store.forgive_deaths()?;
    let (branch, failed_groups) = coordinator.iterate()?;
    if failed_groups.is_empty() {
        coordinator.audit(branch)?;
    }
    let facts = store.facts()?;
    let (up, up_is_sure) = ingest::vertical(&store)?;
    Ok(Summary {
        up,
        up_is_sure,
        solution: merge::summarise(&store, branch, 0)?.heeding_the_audit(&store),
        patches: facts.patches,
        clusters: facts.clusters,
        emitters: facts.emitters,
        area_m2: facts.area_m2,
        workers: options.workers,
        coordinator_anon_bytes: coordinator.anon_bytes,
        failed_groups,
        used: coordinator.used,
    })
}

struct Coordinator<'a> {
    options: &'a Options,
    store: &'a Store,
    progress: &'a dyn Progress,
    used: ProcessFigures,
    anon_bytes: u64,
    /// How long to sleep until children are looked at.
    pause: Duration,
}

impl Coordinator<'_> {
    /// Sleeps between looks at the children, longer and longer while nothing happens.
    fn rest(&mut self) {
        std::thread::sleep(self.pause);
        self.pause = (self.pause * 2).min(LOOK);
        self.anon_bytes = self.anon_bytes.max(status_bytes("RssAnon:"));
    }

    /// Runs a stage to its end, again if it dies.
    fn stage(&mut self, name: &str, args: &[OsString]) -> Result<()> {
        self.progress.begin(name, "", None);
        let mut deaths = 0;
        loop {
            let mut child = Running::start(&self.options.program, args)?;
            self.pause = FIRST_LOOK;
            let ended = loop {
                if let Some(ended) = child.ended(&mut self.used, self.progress)? {
                    break ended;
                }
                if self.progress.interrupted() {
                    children::stop(vec![child], &mut self.used, self.progress)?;
                    return Err(Error::Interrupted);
                }
                self.rest();
            };
            match ended {
                Ended::Done => return Ok(()),
                Ended::Failed(error) => return Err(error),
                Ended::Died(how) => {
                    deaths += 1;
                    self.progress.warn(&format!("{name} died ({how}), {deaths} of {DEATHS} times."));
                    if deaths == DEATHS {
                        return Err(died(name, &how));
                    }
                }
            }
        }
    }

    /// Iterates until converged, out of iterations, or stuck on failed groups. Gives the branch and
    /// those groups.
    fn iterate(&mut self) -> Result<(u64, Vec<u32>)> {
        let settings = self.options.solve.settings;
        if let Some(version) = self.options.solve.version
            && !self.store.has_ingested_materials(version)?
        {
            self.progress.warn(&format!(
                "version {version} has other materials than the model has now: what follows from it keeps those"
            ));
        }
        loop {
            let iteration = self.store.open_iteration(self.options.solve.version, &settings)?;
            let branch = iteration.branch;
            let ended = self.store.iterations_ended(branch)?;
            if iteration.converged || ended >= self.options.max_iterations {
                return Ok((branch, Vec::new()));
            }
            let (started, before) = (Instant::now(), self.used.used);
            let failed = self.solve(&iteration)?;
            if !failed.is_empty() {
                return Ok((branch, failed));
            }
            self.record(branch, started.elapsed().as_secs_f64(), before)?;
            self.store.forget_old_versions(self.options.keep)?;
            self.store.drop_unreferenced_segments()?;
            let end = self.store.newest_end_of_branch(branch)?;
            if self.store.version_figures(end)?.as_ref().and_then(merge::unmet).is_some() {
                return Ok((branch, Vec::new()));
            }
        }
    }

    /// Has the end of a branch audited, unless that has been done. What contradicts the estimate is the summary's to say.
    fn audit(&mut self, branch: u64) -> Result<()> {
        let (command, places) = &self.options.audit;
        let version = self.store.newest_end_of_branch(branch)?;
        let is_known = self.store.audit(version)?.is_some_and(|known| known.places >= *places);
        if *places == 0 || is_known {
            return Ok(());
        }
        let mut args = command.clone();
        args.extend(["--version".into(), version.to_string().into()]);
        match self.stage("audit", &args) {
            Err(Error::NotConverged { .. }) => Ok(()),
            done => done,
        }
    }

    /// Records what an iteration took.
    fn record(&self, branch: u64, wall_s: f64, before: Resources) -> Result<()> {
        let version = Some(self.store.newest_of_branch(branch)?.id);
        let used = self.used.used.since(&before);
        let figures = [
            ("iteration_wall", wall_s, "s"),
            ("iteration_cpu", used.cpu_s, "s"),
            ("iteration_read", used.bytes_read as f64, "bytes"),
            ("iteration_written", used.bytes_written as f64, "bytes"),
            ("worker_peak_anon", used.peak_anon_bytes as f64, "bytes"),
        ];
        figures.iter().try_for_each(|(name, value, unit)| self.store.put_metric("run", version, name, *value, unit))
    }

    /// Has all groups of an iteration solved and merged; gives the groups that failed.
    fn solve(&mut self, iteration: &Iteration) -> Result<Vec<u32>> {
        let (branch, number) = (iteration.branch, iteration.number);
        let order = self.store.tasks(branch, number)?.first().map_or(self.options.solve.settings.order, |t| t.order);
        let counts = self.store.task_counts(branch, number)?;
        self.progress.begin(&format!("iteration {number}"), "groups", Some(counts.total()));
        let mut workers: Vec<Running> = Vec::new();
        let (mut deaths, mut idle) = (0, 0);
        let mut solved = counts.done + counts.merged;
        let mut looked = Instant::now();
        loop {
            let mut running = Vec::new();
            for mut worker in std::mem::take(&mut workers) {
                match worker.ended(&mut self.used, self.progress)? {
                    None => running.push(worker),
                    Some(Ended::Done) => idle += 1,
                    Some(Ended::Failed(error)) => return Err(error),
                    Some(Ended::Died(how)) => {
                        deaths += 1;
                        self.progress.warn(&format!("A worker died ({how}); another takes its place."));
                        self.store.release_dead(iteration)?;
                        // Deaths with a group in hand are the group's; these come before any group.
                        if deaths > DEATHS * counts.total() {
                            return Err(died("solve-group", &how));
                        }
                    }
                }
            }
            workers = running;
            if self.progress.interrupted() {
                children::stop(workers, &mut self.used, self.progress)?;
                return Err(Error::Interrupted);
            }
            if looked.elapsed() >= LOOK_AT_LEASES {
                self.store.release_dead(iteration)?;
                looked = Instant::now();
            }
            let counts = self.store.task_counts(branch, number)?;
            if counts.done + counts.merged > solved {
                (solved, deaths, idle) = (counts.done + counts.merged, 0, 0);
                self.pause = FIRST_LOOK;
            }
            if idle > IDLE * self.options.workers {
                return Err(Error::failed(
                    format!("workers find nothing to do, but {} groups of iteration {number} are free", counts.free),
                    format!(
                        "run `clerestory solve-group {} --until-done` by itself to see why",
                        for_shell(self.store.dir())
                    ),
                ));
            }
            self.progress.at(solved);
            let waits_for_all = order == UpdateOrder::Jacobi;
            if counts.done > 0 && (!waits_for_all || counts.done == counts.total()) {
                merge::execute(self.store, merge::plan(self.store)?, self.progress)?;
                continue;
            }
            if counts.merged == counts.total() {
                return Ok(Vec::new());
            }
            if counts.free + counts.running + counts.done == 0 || (waits_for_all && counts.free + counts.running == 0) {
                return self.failed_groups(iteration);
            }
            let useful = match order {
                UpdateOrder::Sequential => u64::from(counts.running == 0 && counts.free > 0),
                _ => counts.free,
            };
            let wanted = (workers.len() as u64 + useful).min(self.options.workers as u64);
            // A worker that has just been started will claim one of the free groups.
            if workers.len() as u64 <= counts.running {
                while (workers.len() as u64) < wanted {
                    workers.push(Running::start(&self.options.program, &self.options.worker)?);
                    self.pause = FIRST_LOOK;
                }
            }
            self.rest();
        }
    }

    fn failed_groups(&self, iteration: &Iteration) -> Result<Vec<u32>> {
        let tasks = self.store.tasks(iteration.branch, iteration.number)?;
        Ok(tasks.iter().filter(|t| t.state == TaskState::Failed).map(|t| t.group).collect())
    }
}

fn died(name: &str, how: &str) -> Error {
    Error::failed(
        format!("{name} died {DEATHS} times, last with {how}"),
        format!("run `clerestory {name}` by itself with -v to see why"),
    )
}
