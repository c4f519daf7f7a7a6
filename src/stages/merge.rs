//! `merge`: finished updates become solution versions; says whether the branch converged.
//!
//! Jacobi publishes once per iteration; replace and sequential make a version of each update. The
//! figures of an iteration (residual, contraction, energy) are taken at its end, cluster by cluster.

use serde::ser::Error as _;
use serde::{Serialize, Serializer};
use serde_json::Value;

use super::audit::words;
use crate::base::text::for_shell;
use crate::base::{Error, Progress, Result};
use crate::model::Arrays;
use crate::model::ExtentKind;
use crate::model::audit::{AuditFigures, WorstPlace};
use crate::model::figures::{IterationFigures, Phase, Steering, Work};
use crate::model::geometry::{GeometryView, SideMaterial};
use crate::model::light::LightView;
use crate::model::order::UpdateOrder;
use crate::model::report::{ErrorSums, TaskReport};
use crate::store::branches::VersionRow;
use crate::store::merging::{TaskRow, TaskState, VersionFigures};
use crate::store::{Snapshot, Stage, Store};
use crate::transport::iterate::residual::{self, Change};
use crate::transport::numbers;
use crate::transport::steer::{self, Marking, Settling};

/// Which updates become versions.
pub struct Plan {
    /// Newest version of the branch.
    base: VersionRow,
    branch: u64,
    /// All tasks of the iteration, by group; empty if there is nothing to merge.
    tasks: Vec<TaskRow>,
    tolerance: f64,
}

/// What `merge` did.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Newest version.
    pub version: u64,
    /// Its branch.
    pub branch: u64,
    /// Iterations of the branch that have ended.
    pub iterations: u64,
    /// Updates merged now.
    pub updates: u64,
    /// Whether the branch converged.
    pub converged: bool,
    /// Change of irradiance between the last two ends of iterations.
    pub residual: Option<f64>,
    /// Factor by which the error falls per iteration.
    pub contraction: Option<f64>,
    /// Relative error left by stopping here.
    pub predicted_error: Option<f64>,
    /// Estimated error of the stored light.
    pub estimated_nrms: Option<f64>,
    /// The same as an audit found it, if there was one.
    #[serde(flatten)]
    pub audited: AuditFigures,
    /// Where it found the light farthest off.
    #[serde(skip)]
    pub worst: Option<WorstPlace>,
    #[serde(skip)]
    tolerance: f64,
    /// Groups.
    pub groups: u64,
    /// Figures of the last iteration; none before the first, and null in JSON.
    #[serde(flatten, serialize_with = "figures_or_nulls")]
    pub figures: Option<IterationFigures>,
    /// Why the branch has ended without having converged.
    #[serde(skip)]
    pub unmet: Option<Unmet>,
    /// The command to type next.
    pub next: Option<String>,
}

/// The figures, or null for each.
fn figures_or_nulls<S: Serializer>(figures: &Option<IterationFigures>, to: S) -> std::result::Result<S::Ok, S::Error> {
    let mut value = serde_json::to_value(figures.unwrap_or_default()).map_err(S::Error::custom)?;
    if let (None, Some(keys)) = (figures, value.as_object_mut()) {
        keys.values_mut().for_each(|value| *value = Value::Null);
    }
    value.serialize(to)
}

/// The first few groups, as text.
pub(super) fn names(groups: &[u32]) -> String {
    const SHOWN: usize = 10;
    let shown: Vec<String> = groups.iter().take(SHOWN).map(ToString::to_string).collect();
    let more = groups.len().saturating_sub(SHOWN);
    if more > 0 { format!("{} and {more} more", shown.join(", ")) } else { shown.join(", ") }
}

impl Summary {
    /// As a run ends that has had the version audited. To the branch itself an audit is nothing: more iterations of it do
    /// not mend what they do not see.
    #[must_use]
    pub fn heeding_the_audit(self, store: &Store) -> Self {
        if !self.converged || !self.audited.contradicts(self.tolerance) {
            return self;
        }
        let next = Some(format!("clerestory audit {}", for_shell(store.dir())));
        Self { converged: false, unmet: Some(Unmet::Audit(self.tolerance)), next, ..self }
    }
}

impl super::summary::Summary for Summary {
    fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "version {}, {} iterations on branch {}, {}",
            self.version,
            self.iterations,
            self.branch,
            if self.converged { "converged" } else { "not converged" }
        )];
        lines.extend(words::error_line(self.estimated_nrms, &self.audited));
        lines.extend(self.worst.as_ref().map(words::worst_line));
        if let (Some(residual), Some(error)) = (self.residual, self.predicted_error) {
            lines.push(format!("residual {residual:.2e}, error left by stopping here {error:.2e}"));
        }
        if let Some(IterationFigures { work, power, energy_balance, .. }) = self.figures {
            let Work { elements, links_stored, rays, .. } = work;
            lines.push(format!("{elements} elements, {links_stored} links, {rays} rays in the last iteration"));
            let [r, g, b] = power.emitted_w;
            lines.push(format!("emitted {r:.4} {g:.4} {b:.4} W, energy balance {energy_balance:.2e}"));
        }
        lines
    }

    fn shortfall(&self) -> Option<Error> {
        let (message, help) = match self.unmet? {
            Unmet::Balance => (
                format!(
                    "not converged: the light no longer changes, but {:.1} % of what is emitted is neither absorbed nor gone",
                    100.0 * self.figures?.energy_balance
                ),
                "run again with a smaller `--tolerance`, or a finer `--quality`",
            ),
            Unmet::Tolerance => (
                format!(
                    "not converged: the estimated error of the stored light stays at {:.2} %, whatever is refined",
                    100.0 * self.estimated_nrms?
                ),
                "the light is stored and may be used; for what is asked, run with a larger `--tolerance`",
            ),
            Unmet::Audit(tolerance) => return Some(words::contradicted(&self.audited, tolerance)),
        };
        Some(Error::NotConverged { message, help: help.to_owned() })
    }
}

/// Finds what can be merged; tolerance and order are the tasks'. Exit code 13 names groups that are missing or do not fit.
pub fn plan(store: &Store) -> Result<Plan> {
    let waiting = store.branches_to_merge()?;
    let number = waiting.last().copied().map_or_else(|| store.newest_branch(), Ok)?;
    let missing_row = || Error::damaged(store.dir(), format!("branch {number} has no row"));
    let branch = store.branch(number)?.ok_or_else(missing_row)?;
    let base = store.newest_of_branch(number)?;
    let dir = for_shell(store.dir());
    let refuse = |message: String| Error::StageMissing {
        message: format!("{dir}: {message}"),
        help: format!("run `clerestory solve-group {dir} --until-done`, then merge again"),
    };
    if let [others @ .., _] = waiting.as_slice()
        && !others.is_empty()
    {
        let others: Vec<String> = others.iter().map(ToString::to_string).collect();
        return Err(refuse(format!("updates of branch {number} wait, but also of branch {}", others.join(", "))));
    }
    let tasks = match store.iteration_under_way(branch.id)? {
        Some(iteration) => store.tasks(branch.id, iteration)?,
        None => Vec::new(),
    };
    let partition = store.require_stage(Stage::Partition).map(|record| record.chain_hash());
    let groups_where =
        |wrong: &dyn Fn(&TaskRow) -> bool| -> Vec<u32> { tasks.iter().filter(|t| wrong(t)).map(|t| t.group).collect() };
    let done = groups_where(&|t| t.state == TaskState::Done);
    if done.is_empty() {
        return Ok(Plan { base, branch: number, tasks: Vec::new(), tolerance: 0.0 });
    }
    let partition = partition?;
    let is_jacobi = |t: &TaskRow| t.order == UpdateOrder::Jacobi;
    let unfit = [
        ("another partition", groups_where(&|t| t.state == TaskState::Done && t.partition_hash != partition)),
        (
            "other options",
            groups_where(&|t| t.state == TaskState::Done && Some(&t.options_hash) != branch.options_hash.as_ref()),
        ),
        (
            "another base version",
            groups_where(&|t| is_jacobi(t) && t.state == TaskState::Done && t.base_version != base.id),
        ),
    ];
    for (what, groups) in unfit {
        if !groups.is_empty() {
            return Err(refuse(format!("updates made with {what}: groups {}", names(&groups))));
        }
    }
    let missing =
        groups_where(&|t| is_jacobi(t) && matches!(t.state, TaskState::Free | TaskState::Running | TaskState::Failed));
    if !missing.is_empty() {
        let iteration = tasks[0].iteration;
        return Err(refuse(format!("iteration {iteration} lacks groups {}", names(&missing))));
    }
    Ok(Plan { base, branch: number, tasks, tolerance: branch.tolerance.unwrap_or(0.0) })
}

/// Publishes the versions.
pub fn execute(store: &Store, plan: Plan, progress: &dyn Progress) -> Result<Summary> {
    let Plan { mut base, branch, mut tasks, tolerance } = plan;
    let jacobi = tasks.first().is_some_and(|t| t.order == UpdateOrder::Jacobi);
    let mut updates = 0;
    loop {
        let done: Vec<usize> = (0..tasks.len()).filter(|&i| tasks[i].state == TaskState::Done).collect();
        let batch: Vec<usize> = done.into_iter().take(if jacobi { usize::MAX } else { 1 }).collect();
        if batch.is_empty() {
            break;
        }
        let rest_is_merged = (0..tasks.len()).all(|i| batch.contains(&i) || tasks[i].state == TaskState::Merged);
        let now: Vec<TaskRow> = batch.iter().map(|&i| tasks[i].clone()).collect();
        let figures = rest_is_merged.then(|| figures(store, &base, &tasks, &now, tolerance, progress)).transpose()?;
        let Some(version) = store.merge(&base, &now, figures.as_ref())? else { break };
        updates += now.len() as u64;
        for i in batch {
            tasks[i].state = TaskState::Merged;
        }
        base = VersionRow { id: version, ..base };
    }
    summarise(store, branch, updates)
}

/// Where a branch stands, as `merge` and `run` report it.
pub fn summarise(store: &Store, branch: u64, updates: u64) -> Result<Summary> {
    let end = store.newest_end_of_branch(branch)?;
    let row = store.version(end)?.ok_or_else(|| Error::damaged(store.dir(), format!("version {end} is missing")))?;
    let f = store.version_figures(end)?;
    let audit = store.audit(end)?.unwrap_or_default();
    let converged = row.converged && row.branch == branch;
    let dir = for_shell(store.dir());
    let next = if converged {
        format!("clerestory render {dir} -o picture.png")
    } else {
        format!("clerestory solve-group {dir} --until-done")
    };
    Ok(Summary {
        version: store.newest_of_branch(branch)?.id,
        branch,
        iterations: store.iterations_ended(branch)?,
        updates,
        converged,
        residual: row.residual,
        contraction: row.contraction,
        predicted_error: row.predicted_error,
        estimated_nrms: f.as_ref().map(|f| f.steering.estimated_nrms),
        groups: store.group_count()?,
        figures: f.as_ref().map(|f| f.iteration),
        unmet: f.as_ref().and_then(unmet),
        tolerance: f.as_ref().map_or(0.0, |f| f.tolerance),
        audited: audit.figures,
        worst: audit.worst.into_iter().next(),
        next: Some(next),
    })
}

/// Whether the estimated error meets a tolerance as far as one can tell.
fn is_within(steering: &Steering, tolerance: f64) -> bool {
    steering.estimated_nrms - steering.estimated_nrms_error <= tolerance
}

/// Why a branch that no longer changes has not converged: more iterations do not mend that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unmet {
    /// Its balance shows that it is wrong.
    Balance,
    /// Markings no longer make the estimated error fall.
    Tolerance,
    /// An audit found an error that is surely over what this tolerance allows.
    Audit(f64),
}

/// Whether, and why, iterations of a branch lead no further.
#[must_use]
pub fn unmet(figures: &VersionFigures) -> Option<Unmet> {
    let has_ended =
        figures.steering.phase == Phase::Close && figures.predicted_error <= numbers::STILL * figures.tolerance;
    if !has_ended || figures.converged {
        None
    } else if figures.iteration.energy_balance > numbers::BALANCED {
        Some(Unmet::Balance)
    } else {
        (!is_within(&figures.steering, figures.tolerance)).then_some(Unmet::Tolerance)
    }
}

/// Figures of the iteration that ends with the updates `now` on top of `base`.
fn figures(
    store: &Store,
    base: &VersionRow,
    tasks: &[TaskRow],
    now: &[TaskRow],
    tolerance: f64,
    progress: &dyn Progress,
) -> Result<VersionFigures> {
    let reports: Vec<&TaskReport> = tasks.iter().filter_map(|t| t.report.as_ref()).collect();
    let q = reports.iter().map(|r| r.q_max).fold(0.0, f64::max);
    let residual = change(store, base, now, progress)?.residual();
    let mut residuals = vec![residual];
    residuals.extend(store.residuals(tasks[0].branch, 2)?);
    let contraction = residual::contraction(&residuals, q);
    let predicted_error = residual::predicted_error(residual, contraction);
    let complete = reports.len() == tasks.len() && reports.iter().all(|r| r.complete);
    let mut iteration = IterationFigures::default();
    let mut error = ErrorSums::default();
    let mut received_w = [0.0; 3];
    for report in &reports {
        received_w = [0, 1, 2].map(|c| received_w[c] + report.received_w[c]);
        iteration.work += report.work;
        iteration.power += report.power;
        error.plus(&report.error);
    }
    iteration.energy_balance = iteration.power.imbalance();
    let before = store.version_figures(store.iteration_end_before(base.id)?)?;
    let drift =
        before.as_ref().map_or(1.0, |before| (iteration.energy_balance - before.iteration.energy_balance).abs());
    let before = before.map(|f| f.steering).unwrap_or_default();
    let markings = store.markings(tasks[0].branch)?.into_iter();
    let markings: Vec<_> = markings.map(|(estimate, entries)| Marking { estimate, entries }).collect();
    let has_stalled = steer::has_stalled(&markings);
    let settling = Settling { residual, predicted_error, power: iteration.power, drift, received_w, has_stalled };
    let of_rows = steer::of_rows(&iteration, store.facts()?.mean_reflectance);
    let steering = steer::steer(&error, &before, settling, (tolerance, of_rows));
    let converged = complete
        && steering.phase == Phase::Close
        && (!has_stalled || is_within(&steering, tolerance))
        && predicted_error <= numbers::STILL * tolerance
        && iteration.energy_balance <= numbers::BALANCED;
    Ok(VersionFigures { converged, tolerance, residual, contraction, predicted_error, iteration, steering })
}

/// The change since the last end of an iteration, over all clusters in order.
fn change(store: &Store, base: &VersionRow, now: &[TaskRow], progress: &dyn Progress) -> Result<Change> {
    let old = Snapshot::at(store, store.iteration_end_before(base.id)?)?;
    let new = Snapshot::at(store, base.id)?;
    let total = store.facts()?.clusters;
    progress.begin("compare", "clusters", Some(total));
    let mut sum = Change::default();
    for (done, cluster) in new.clusters().enumerate() {
        let cluster = cluster?;
        let task = cluster.group.and_then(|g| now.binary_search_by_key(&g, |t| t.group).ok()).map(|i| now[i].id);
        let place = task.map(|task| store.updated_light(task, cluster.id)).transpose()?.flatten();
        let after = match place {
            Some(at) => store.extent(at, ExtentKind::Radiosity)?,
            None => new.need(ExtentKind::Radiosity, cluster.id)?,
        };
        let before = old.need(ExtentKind::Radiosity, cluster.id)?;
        let geometry = new.need(ExtentKind::Geometry, cluster.id)?;
        let materials = new.need(ExtentKind::Materials, cluster.id)?;
        let sides = materials.parse(|payload| Arrays::new(payload).get::<SideMaterial>(0))?;
        let view = geometry.parse(GeometryView::parse)?;
        if sides.len() != 2 * view.patches.len() {
            return Err(materials.damage("not two materials per patch"));
        }
        let part =
            residual::of_cluster(&view, sides, &before.parse(LightView::parse)?, &after.parse(LightView::parse)?);
        sum = sum.plus(part);
        progress.step(done as u64 + 1)?;
    }
    Ok(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, Quiet};
    use crate::model::audit::Audit;
    use crate::model::figures::Power;
    use crate::store::{Worker, fixture};

    fn merge(store: &Store) -> Result<Summary> {
        execute(store, plan(store)?, &Quiet)
    }

    fn arrives(store: &Store, version: u64, cluster: u32) -> f32 {
        let extent = Snapshot::at(store, version).unwrap().need(ExtentKind::Radiosity, ClusterId(cluster)).unwrap();
        extent.parse(LightView::parse).unwrap().elements[0].irradiance[0]
    }

    #[test]
    fn jacobi_waits_for_every_group_and_then_makes_one_version() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 6);
        fixture::partition(&store, 3);
        assert_eq!(merge(&store).unwrap().version, 0, "nothing new");
        let iteration = store.open_iteration(None, &fixture::settings(UpdateOrder::Jacobi)).unwrap();
        let mut worker = Worker::start(&store).unwrap();
        let lease = store.claim(&iteration, &worker, &mut fixture::first).unwrap().unwrap();
        assert!(fixture::solve(&store, &lease, &mut worker, 4.0));
        let error = merge(&store).err().unwrap();
        assert!(error.exit_code() == 13 && error.to_string().contains("groups 0, 1"), "{error}");
        fixture::solve_all(&store, UpdateOrder::Jacobi, 4.0);
        let summary = merge(&store).unwrap();
        assert_eq!((summary.version, summary.iterations, summary.updates), (1, 1, 3));
        assert_eq!(summary.residual, Some(1.0), "from dark to lit");
        assert_eq!(summary.figures.unwrap().power.emitted_w, [3.0; 3]);
        assert_eq!((arrives(&store, 1, 5), arrives(&store, 0, 5)), (4.0, 0.0));
        assert_eq!(merge(&store).unwrap().version, 1, "nothing new");
    }

    #[test]
    fn a_cluster_whose_light_did_not_change_gets_no_row_and_the_branch_converges() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 6);
        fixture::partition(&store, 3);
        for (irradiance, version, converged) in [(4.0, 1, false), (4.4, 2, false), (4.4, 3, true)] {
            fixture::solve_all(&store, UpdateOrder::Jacobi, irradiance);
            let summary = merge(&store).unwrap();
            assert_eq!((summary.version, summary.converged), (version, converged));
        }
        // The change from 4 to 4.4 is 1/11 of what arrives; cluster 0 emits and does not count.
        let residual = store.version(2).unwrap().unwrap().residual.unwrap();
        assert!((residual - 0.4f64 / 4.4).abs() < 1e-7, "{residual}");
        assert_eq!(store.version(3).unwrap().unwrap().residual, Some(0.0));
        let place =
            |version| Snapshot::at(&store, version).unwrap().place(ExtentKind::Radiosity, ClusterId(5)).unwrap();
        assert_eq!(place(3), place(2));
        assert_ne!(place(2), place(1));
        let settings = fixture::settings(UpdateOrder::Jacobi);
        assert!(store.open_iteration(None, &settings).unwrap().converged);
        let again = store.open_iteration(Some(1), &settings).unwrap();
        assert_eq!((again.branch, again.number), (1, 2));
    }

    #[test]
    fn light_that_no_longer_changes_and_does_not_add_up_has_not_converged_and_says_so() {
        for (absorbed_w, converged) in [(0.992, true), (0.985, false)] {
            let dir = tempfile::tempdir().unwrap();
            let store = fixture::store(dir.path(), 3);
            fixture::partition(&store, 1);
            let iteration = store.open_iteration(None, &fixture::settings(UpdateOrder::Jacobi)).unwrap();
            let mut worker = Worker::start(&store).unwrap();
            let lease = store.claim(&iteration, &worker, &mut fixture::first).unwrap().unwrap();
            let power = Power { emitted_w: [1.0; 3], absorbed_w: [absorbed_w; 3], ..Power::default() };
            let report = TaskReport { complete: true, q_max: 0.5, power, ..TaskReport::default() };
            assert!(store.publish(&lease, &mut worker, &[], &report).unwrap());
            let summary = merge(&store).unwrap();
            assert_eq!((summary.converged, summary.residual), (converged, Some(0.0)));
            let said = crate::stages::summary::Summary::shortfall(&summary);
            assert_eq!(said.map(|e| e.exit_code()), (!converged).then_some(3));
        }
    }

    #[test]
    fn an_audit_that_contradicts_what_a_branch_promises_is_told_and_nothing_reads_it_but_who_reports() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 3);
        fixture::partition(&store, 1);
        for irradiance in [4.0, 4.0] {
            fixture::solve_all(&store, UpdateOrder::Jacobi, irradiance);
            merge(&store).unwrap();
        }
        let sound = summarise(&store, 0, 0).unwrap();
        let tolerance = store.version_figures(sound.version).unwrap().unwrap().tolerance;
        let put = |places, nrms| {
            let (audited_nrms, audited_se) = (Some(nrms), Some(0.1 * tolerance));
            let figures = AuditFigures { audited_nrms, audited_se, ..AuditFigures::default() };
            store.put_audit(&Audit { version: sound.version, places, figures, ..Audit::default() }).unwrap();
            let told = summarise(&store, 0, 0).unwrap();
            assert!(told.converged && told.audited == figures, "to the branch it is nothing");
            told.heeding_the_audit(&store)
        };
        assert!(sound.converged && put(64, 1.6 * tolerance).converged);
        let wrong = put(256, 1.8 * tolerance);
        assert!(!wrong.converged && wrong.unmet == Some(Unmet::Audit(tolerance)));
        let said = crate::stages::summary::Summary::shortfall(&wrong).unwrap();
        assert!(said.exit_code() == 3 && said.to_string().contains("audited error"), "{said}");
        assert!(store.open_iteration(None, &fixture::settings(UpdateOrder::Jacobi)).unwrap().converged);
    }

    #[test]
    fn replace_makes_a_version_of_each_update_and_sequential_goes_group_by_group() {
        for order in [UpdateOrder::Replace, UpdateOrder::Sequential] {
            let dir = tempfile::tempdir().unwrap();
            let store = fixture::store(dir.path(), 6);
            fixture::partition(&store, 3);
            for round in 0..3u64 {
                let iteration = store.open_iteration(None, &fixture::settings(order)).unwrap();
                assert_eq!(iteration.number, 1);
                let mut worker = Worker::start(&store).unwrap();
                let lease = store.claim(&iteration, &worker, &mut fixture::first).unwrap().unwrap();
                assert_eq!(lease.base_version, round, "reads what was merged before");
                if order == UpdateOrder::Sequential {
                    assert_eq!(u64::from(lease.group), round);
                    assert_eq!(store.claim(&iteration, &worker, &mut fixture::first).unwrap(), None);
                }
                assert!(fixture::solve(&store, &lease, &mut worker, 4.0));
                let summary = merge(&store).unwrap();
                assert_eq!((summary.version, summary.iterations), (round + 1, u64::from(round == 2)));
            }
            assert_eq!(store.version_figures(3).unwrap().unwrap().residual, 1.0, "against version 0");
            assert!(store.version_figures(2).unwrap().is_none());
            assert_eq!(arrives(&store, 3, 4), 4.0);
        }
    }

    #[test]
    fn updates_of_another_partition_or_options_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 4);
        fixture::partition(&store, 2);
        fixture::solve_all(&store, UpdateOrder::Jacobi, 4.0);
        let mut partition = store.stage(Stage::Partition).unwrap().unwrap();
        partition.options_hash = "other".to_owned();
        store.finish_stage(&partition).unwrap();
        let error = merge(&store).err().unwrap();
        assert!(error.exit_code() == 13 && error.to_string().contains("another partition: groups 0, 1"), "{error}");
    }
}
