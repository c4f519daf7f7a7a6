//! From parsed flags to the stage that does the work.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::args::{
    AuditArgs, Cli, Common, Emit, ExportArgs, IngestArgs, IngestFlags, LinkStorage, MergeArgs, PartitionArgs, Quality,
    RenderArgs, RunArgs, SampleArgs, ScheduleFlags, Sides, SolveFlags, SolveGroupArgs, StatusArgs, StoreArgs, Up, Verb,
    VisibilityArgs,
};
use super::report::Report;
use super::resources::Watch;
use super::run_options;
use super::settings::Resolved;
use super::summaries;
use super::{args::GcArgs, pages};
use crate::base::memory::MemoryBudget;
use crate::base::text::{for_shell, shown};
use crate::base::{Error, Progress, Result};
use crate::stages::entry::Store;
use crate::stages::output::{self, Output};
use crate::stages::{
    audit, check, entry, export, gc, ingest, merge, partition, render, run, sample, sample_files, settings,
    solve_group, status, visibility,
};

/// What every verb works with.
pub struct Context<'a> {
    /// Where it reports to.
    pub progress: &'a dyn Progress,
    /// What it uses.
    pub watch: &'a Watch,
    /// All flags, and where they come from.
    pub resolved: &'a Resolved,
}

impl Context<'_> {
    /// The store that a verb works with.
    fn open(&self, dir: &Path, wait: Duration) -> Result<Store> {
        self.resolved.store.take().map_or_else(|| entry::open(dir, wait), Ok)
    }
}

/// What a verb comes back with.
pub enum Done {
    /// A result to report.
    Report(Box<Report>),
    /// A page to print as it is.
    Page(String),
}

impl From<Report> for Done {
    fn from(report: Report) -> Self {
        Self::Report(Box::new(report))
    }
}

/// Does what was asked.
pub fn run(cli: Cli, context: &Context<'_>) -> Result<Done> {
    let common = &cli.common;
    let report = match cli.verb {
        Verb::Ingest(args) => do_ingest(args, common, context),
        Verb::Visibility(args) => do_visibility(args, common, context),
        Verb::Partition(args) => do_partition(args, common, context),
        Verb::SolveGroup(args) => do_solve_group(args, common, context),
        Verb::Merge(args) => do_merge(args, common, context),
        Verb::Status(args) => do_status(args, common, context),
        Verb::Gc(args) => do_gc(args, common, context),
        Verb::Sample(args) => do_sample(args, common, context),
        Verb::Completions { shell } => return Ok(Done::Page(pages::completions(shell))),
        Verb::Man => return pages::manual().map(Done::Page),
        Verb::Help { topic } => return pages::help(topic.as_deref()).map(Done::Page),
        Verb::Run(args) => do_run(&args, common, context),
        Verb::Check(args) => do_check(args, common, context),
        Verb::Audit(args) => do_audit(args, common, context),
        Verb::Render(args) => do_render(args, common, context),
        Verb::Export(args) => do_export(args, common, context),
    }?;
    Ok(report.into())
}

/// Lets the store remember what a stage was run with.
fn remember(context: &Context<'_>, verb: &str, store: &Store) -> Result<()> {
    settings::record(store, verb, &context.resolved.to_remember(verb))
}

/// Options of an ingest from its flags.
fn ingest_options(store: PathBuf, models: Vec<PathBuf>, flags: &IngestFlags, common: &Common) -> ingest::Options {
    ingest::Options {
        store,
        models,
        units: flags.units,
        up: match flags.up {
            Up::Auto => None,
            Up::Y => Some('y'),
            Up::Z => Some('z'),
        },
        both_sides: flags.sides == Sides::Both,
        materials: flags.materials.clone(),
        emit_both: flags.emit == Emit::Both,
        max_cluster_patches: flags.max_cluster_patches,
        snap_m: flags.snap,
        contact_m: flags.contact,
        least_contact_m: flags.least_contact,
        memory: common.memory,
        fresh: false,
        wait: common.wait,
    }
}

fn do_ingest(args: IngestArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    let store = args.store.clone();
    let mut options = ingest_options(args.store, args.models, &args.flags, common);
    options.fresh = args.writing.fresh;
    let plan = ingest::plan(&options)?;
    if args.writing.dry_run {
        let text = format!("{plan}\n{}", ingest::foresee(&options)?);
        return Ok(Report::plan("ingest", store, &text));
    }
    let summary = ingest::execute(plan, context.progress)?;
    remember(context, "ingest", &entry::open(&store, common.wait)?)?;
    Ok(Report::of("ingest", store, &summary))
}

/// Processor cores that this process may use.
#[must_use]
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get)
}

fn do_visibility(args: VisibilityArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    let store = context.open(&args.store, common.wait)?;
    let workers = args.workers.workers.map_or_else(cores, |n| n as usize);
    let options =
        visibility::Options { missing: args.flags.missing, seed: args.seed.seed, workers, memory: common.memory };
    if args.writing.dry_run {
        let plan = visibility::plan(&store, &options)?;
        let what = if plan.done && !args.writing.fresh { "nothing to do" } else { "rays from every cluster" };
        let text = format!("visibility of {} clusters with {workers} workers: {what}", plan.clusters);
        return Ok(Report::plan("visibility", args.store, &text));
    }
    let _lock = entry::coordinate(&store, "visibility")?;
    if args.writing.fresh {
        entry::forget_visibility(&store)?;
    }
    let summary = visibility::execute(&visibility::plan(&store, &options)?, context.progress)?;
    remember(context, "visibility", &store)?;
    let next = Some(format!("clerestory partition {}", for_shell(&args.store)));
    Ok(Report { next, ..Report::new("visibility", args.store, &summary, summaries::visibility(&summary)) })
}

fn do_partition(args: PartitionArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    let store = context.open(&args.store, common.wait)?;
    let options = partition::Options { method: args.method, groups: args.groups.groups, memory: common.memory };
    if args.writing.dry_run {
        let plan = partition::plan(&store, &options)?;
        let what = if plan.done && !args.writing.fresh {
            "the groups stay as they are".to_owned()
        } else {
            format!("at least {} groups", plan.groups)
        };
        return Ok(Report::plan("partition", args.store, &what));
    }
    let _lock = entry::coordinate(&store, "partition")?;
    if args.writing.fresh {
        entry::forget_partition(&store)?;
    }
    let summary = partition::execute(&partition::plan(&store, &options)?, context.progress)?;
    remember(context, "partition", &store)?;
    let next = Some(format!("clerestory solve-group {} --until-done", for_shell(&args.store)));
    Ok(Report { next, ..Report::new("partition", args.store, &summary, summaries::partition(&summary)) })
}

/// `--tolerance`, or that of `--quality`.
fn tolerance(flags: &SolveFlags) -> f64 {
    flags.tolerance.unwrap_or(match flags.quality {
        Quality::Preview => 0.1,
        Quality::Draft => 0.05,
        Quality::Standard => 0.02,
        Quality::Final => 0.01,
    })
}

/// Options of `solve-group` from its flags; last seed, version and memory.
#[must_use]
pub fn solve_options(
    which: solve_group::Which,
    flags: &SolveFlags,
    schedule: &ScheduleFlags,
    (seed, version, memory): (u64, Option<u64>, MemoryBudget),
) -> solve_group::Options {
    let options = solve_group::SolveOptions {
        tolerance: tolerance(flags),
        min_element_m: flags.min_element,
        inner: flags.inner,
        links: match flags.links {
            LinkStorage::Keep => solve_group::LinkStorage::Keep,
            LinkStorage::Discard => solve_group::LinkStorage::Discard,
        },
        seed,
    };
    solve_group::Options {
        which,
        version,
        settings: solve_group::SolveSettings { options, order: flags.order },
        link_cache_bytes: flags.link_cache,
        schedule: schedule.policy(),
        memory,
    }
}

fn do_solve_group(args: SolveGroupArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    let store = context.open(&args.store, common.wait)?;
    let which = match args.which.group {
        Some(group) => solve_group::Which::Group(group),
        None if args.which.next => solve_group::Which::Next,
        None => solve_group::Which::UntilDone,
    };
    let options = solve_options(which, &args.flags, &args.schedule, (args.seed.seed, args.version, common.memory));
    let plan = solve_group::plan(&store, &options)?;
    if args.dry_run {
        entry::version_to_read(&store, args.version)?;
        let text = format!(
            "solve {} of {} groups, memory at most {} MiB",
            match options.which {
                solve_group::Which::Group(group) => format!("group {group}"),
                solve_group::Which::Next => "the next free one".to_owned(),
                solve_group::Which::UntilDone => "all that are free".to_owned(),
            },
            plan.groups,
            common.memory.limit_bytes >> 20
        );
        return Ok(Report::plan("solve-group", args.store, &text));
    }
    let resources = || context.watch.figures().used;
    let _process = entry::enter(&store, "solve-group", None)?;
    let summary = solve_group::execute(&plan, &resources, context.progress)?;
    remember(context, "solve-group", &store)?;
    let next = status::read(&store)?.next;
    Ok(Report { next, ..Report::new("solve-group", args.store, &summary, summaries::solve_group(&summary)) })
}

fn do_merge(args: MergeArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    let store = context.open(&args.store, common.wait)?;
    let plan = merge::plan(&store)?;
    if args.dry_run {
        return Ok(Report::plan("merge", args.store, "publish the updates that wait"));
    }
    let _process = entry::enter(&store, "merge", None)?;
    let summary = merge::execute(&store, plan, context.progress)?;
    Ok(Report::of("merge", args.store, &summary))
}

fn do_status(args: StatusArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    let store = context.open(&args.store, common.wait)?;
    let summary = status::read(&store)?;
    let mut report = Report::of("status", args.store.clone(), &summary);
    if args.settings {
        let settings = super::settings::of_stages(&args.store)?;
        for s in &settings {
            report.lines.push(format!("{:<12} {:<20} {:<12} {}", s.verb, s.flag, s.value, s.source));
        }
        report.keys.insert("settings".to_owned(), serde_json::to_value(&settings).unwrap_or_default());
    }
    Ok(report)
}

fn do_check(args: StoreArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    let store = context.open(&args.store, common.wait)?;
    let summary = check::execute(&store, context.progress)?;
    Ok(Report::of("check", args.store, &summary))
}

fn do_run(args: &RunArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    let options = run_options::options(args, common, context.resolved)?;
    let store = options.store.clone();
    let plan = run::plan(&options)?;
    if args.writing.dry_run {
        if !args.models.is_empty() {
            let mut options = ingest_options(store.clone(), args.models.clone(), &args.ingest, common);
            options.fresh = args.writing.fresh;
            ingest::plan(&options)?;
            ingest::foresee(&options)?;
        }
        let lines: Vec<String> = plan.commands.iter().map(|c| command_line(c)).collect();
        return Ok(Report::plan("run", store, &lines.join("\n")));
    }
    let summary = run::execute(&plan, context.progress)?;
    let mut report = Report::of("run", store, &summary);
    for (key, value) in
        [("peak_rss_bytes", summary.used.peak_rss_bytes), ("peak_anon_bytes", summary.used.used.peak_anon_bytes)]
    {
        report.keys.insert(key.to_owned(), value.into());
    }
    Ok(report)
}

/// A child's command as a person would type it.
fn command_line(words: &[OsString]) -> String {
    let words: Vec<_> = words.iter().map(for_shell).collect();
    format!("clerestory {}", words.join(" "))
}

fn do_gc(args: GcArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    let open = if args.dry_run { entry::open } else { entry::open_to_make_room };
    let store = open(&args.store, common.wait)?;
    // Refuses a store without a model, also a dry run.
    store.newest_version()?;
    if args.dry_run {
        let text = format!("keep version 0 and the newest {} ends of iterations of each branch", args.keep);
        return Ok(Report::plan("gc", args.store, &text));
    }
    let _process = entry::enter(&store, "gc", None)?;
    let summary = gc::execute(&store, args.keep, context.progress)?;
    Ok(Report::of("gc", args.store, &summary))
}

fn do_sample(args: SampleArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    refuse_two_documents(&args.output.output, common)?;
    let store = context.open(&args.store, common.wait)?;
    output::keep_off(&args.output.output, &args.store, &[&args.points])?;
    output::check(&args.output.output, args.output.force)?;
    let version = entry::version_to_read(&store, args.version)?;
    if args.output.dry_run {
        return Ok(Report::plan("sample", args.store, &format!("sample version {version}")));
    }
    let _process = entry::enter(&store, "sample", Some(version))?;
    let SampleArgs { snap: snap_m, stored: is_stored, tolerance, .. } = args;
    let options = sample::Options { version: Some(version), snap_m, is_stored, tolerance };
    let output = Output::create(&args.output.output, args.output.force)?;
    let summary = sample_files::sample(&store, &options, &args.points, output, context.progress)?;
    Ok(Report::new("sample", args.store, &summary, summaries::sample(&summary)).beside(&args.output.output))
}

fn do_audit(args: AuditArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    let store = context.open(&args.store, common.wait)?;
    let options = audit::Options {
        places: args.places,
        seed: args.seed.seed,
        version: args.version,
        threads: cores(),
        memory: common.memory,
    };
    let plan = audit::plan(&store, &options)?;
    if args.dry_run {
        let text = format!("measure {} places of version {}", args.places, plan.version);
        return Ok(Report::plan("audit", args.store, &text));
    }
    let _process = entry::enter(&store, "audit", Some(plan.version))?;
    let summary = audit::execute(&plan, context.progress)?;
    Ok(Report::of("audit", args.store, &summary))
}

fn do_render(args: RenderArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    refuse_two_documents(&args.output.output, common)?;
    let store = context.open(&args.store, common.wait)?;
    let options = render::Options {
        output: args.output.output.clone(),
        force: args.output.force,
        eye_and_look: args.eye.zip(args.look).map(|(eye, look)| [eye.0, look.0]),
        view_up: args.view_up.map(|up| up.0),
        fov_degrees: args.fov,
        size: (args.size.width, args.size.height),
        version: args.version,
        threads: cores(),
        memory: common.memory,
    };
    output::keep_off(&args.output.output, &args.store, &[])?;
    let plan = render::plan(&store, &options)?;
    if args.output.dry_run {
        let text = format!("draw version {} in {}", plan.version, shown(&args.output.output));
        return Ok(Report::plan("render", args.store, &text));
    }
    let _process = entry::enter(&store, "render", Some(plan.version))?;
    let summary = render::execute(&plan, context.progress)?;
    Ok(Report::of("render", args.store, &summary).beside(&args.output.output))
}

fn do_export(args: ExportArgs, common: &Common, context: &Context<'_>) -> Result<Report> {
    refuse_two_documents(&args.output.output, common)?;
    let store = context.open(&args.store, common.wait)?;
    let options =
        export::Options { output: args.output.output.clone(), force: args.output.force, version: args.version };
    output::keep_off(&args.output.output, &args.store, &[])?;
    let plan = export::plan(&store, &options)?;
    if args.output.dry_run {
        let text = format!("write version {} to {}", plan.version, shown(&args.output.output));
        return Ok(Report::plan("export", args.store, &text));
    }
    let _process = entry::enter(&store, "export", Some(plan.version))?;
    let summary = export::execute(&plan, context.progress)?;
    Ok(Report::of("export", args.store, &summary).beside(&args.output.output))
}

/// stdout holds one thing.
fn refuse_two_documents(output: &Path, common: &Common) -> Result<()> {
    if output.as_os_str() == "-" && common.json {
        return Err(Error::Usage {
            message: "`-o -` and `--json` both write to stdout".to_owned(),
            help: "name a file, or leave out `--json`".to_owned(),
        });
    }
    Ok(())
}
