//! `audit`: stored light against light measured anew at places drawn at random.
//!
//! Two passes: over all clusters for what places are drawn by (some numbers a cluster stay in memory), then over those
//! that places were drawn in. It writes what it found into the catalogue, and nothing reads that but who reports it.

mod places;
pub mod words;

use serde::Serialize;

use self::places::{Drawing, Found, Place};
use super::entry;
use super::lamps::LampsInSight;
use super::ray_scene::with_scene;
use super::working_set::WorkingSet;
use crate::base::memory::MemoryBudget;
use crate::base::parallel::{Crew, Turns};
use crate::base::{ClusterId, Error, Progress, Result};
use crate::geom::sequence::mix;
use crate::model::audit::{Audit, AuditFigures, WorstPlace};
use crate::store::Store;
use crate::transport::measure::audit::{Known, Sums};
use crate::transport::norm::Norm;

/// How to audit.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// `--places`.
    pub places: u64,
    /// `--seed`.
    pub seed: u64,
    /// `--version`; the newest end of an iteration if none.
    pub version: Option<u64>,
    /// Threads, as far as memory allows: never change the result.
    pub threads: usize,
    /// `--memory`.
    pub memory: MemoryBudget,
}

/// What is going to be audited.
pub struct Plan<'s> {
    store: &'s Store,
    options: Options,
    norm: Norm,
    estimated_nrms: Option<f64>,
    /// The tolerance that the version is said to meet.
    promised: Option<f64>,
    /// The version.
    pub version: u64,
}

/// What was found.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// The version.
    pub version: u64,
    /// Places measured.
    pub points: u64,
    /// The error and the bias.
    #[serde(flatten)]
    pub figures: AuditFigures,
    /// What the version estimated.
    pub estimated_nrms: Option<f64>,
    /// Places whose light is farthest off, the worst first.
    pub worst: Vec<WorstPlace>,
    #[serde(skip)]
    promised: Option<f64>,
}

impl super::summary::Summary for Summary {
    fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!("version {}, {} places measured anew", self.version, self.points)];
        lines.extend(words::error_line(self.estimated_nrms, &self.figures));
        lines.extend(self.worst.first().map(words::worst_line));
        lines
    }

    fn shortfall(&self) -> Option<Error> {
        let promised = self.promised.filter(|tolerance| self.figures.contradicts(*tolerance))?;
        Some(words::contradicted(&self.figures, promised))
    }
}

/// Finds the version to audit.
pub fn plan<'s>(store: &'s Store, options: &Options) -> Result<Plan<'s>> {
    let needed = options.places.saturating_mul(PLACE_BYTES) + THREAD_BYTES / 4;
    options.memory.require(&format!("an audit of {} places", options.places), needed, ", or fewer `--places`")?;
    let version = entry::version_to_read(store, options.version)?;
    let end = store.version_figures(store.iteration_end_before(version)?)?.map(|f| f.steering).unwrap_or_default();
    let figures = store.version_figures(version)?;
    let promised = figures.as_ref().filter(|f| f.converged).map(|f| f.tolerance);
    Ok(Plan {
        store,
        options: options.clone(),
        norm: Norm::of_mean(end.lit_mean_w_m2),
        estimated_nrms: figures.map(|f| f.steering.estimated_nrms),
        promised,
        version,
    })
}

/// Measures, and keeps what came of it where the store may be written.
pub fn execute(plan: &Plan<'_>, progress: &dyn Progress) -> Result<Summary> {
    let Options { places, seed, .. } = plan.options;
    let (Found { tally, points, worst }, norm) = plan.look(progress)?;
    let mut figures = AuditFigures::default();
    if let Some((error, bias)) = tally.verdict(norm, places) {
        let known = |known: Known| (Some(known.value), Some(known.error));
        (figures.audited_nrms, figures.audited_se) = known(error);
        (figures.audited_bias, figures.bias_se) = known(bias);
    }
    let worst = worst.iter().map(|place| plan.named(place)).collect::<Result<Vec<_>>>()?;
    let audit = Audit { version: plan.version, places, seed, points, figures, worst };
    plan.store.put_audit(&audit)?;
    let Plan { version, estimated_nrms, promised, .. } = *plan;
    Ok(Summary { version, points, figures, estimated_nrms, worst: audit.worst, promised })
}

/// Anonymous memory of a thread: light and lamps that it holds.
const THREAD_BYTES: u64 = 96 << 20;

/// Clusters that are worth a thread while their light is summed up.
const CLUSTERS_AT_LEAST: usize = 64;

/// Memory that a place takes while it waits to be measured.
const PLACE_BYTES: u64 = 96;

impl Plan<'_> {
    /// Threads for so much work, of which each is to have some before another opens the store.
    fn crew<'p>(&self, progress: &'p dyn Progress, items: usize, each: usize) -> Crew<'p> {
        let room = usize::try_from(self.options.memory.limit_bytes / THREAD_BYTES).unwrap_or(usize::MAX);
        Crew { threads: self.options.threads.min(room).min(items.div_ceil(each)), progress }
    }

    /// Draws and measures places; gives the norm of all leaves besides.
    fn look(&self, progress: &dyn Progress) -> Result<(Found, f64)> {
        let mut found = Found::default();
        if self.norm == Norm::UNKNOWN {
            return Ok((found, 0.0));
        }
        let sums = self.sums(progress)?;
        let total = sums.iter().fold(Sums::default(), |total, (_, sums)| total.plus(sums));
        if total.norm <= 0.0 {
            return Ok((found, 0.0));
        }
        let Options { places, seed, .. } = self.options;
        // Of the version, so that its places are other ones than those before.
        let seed = mix(seed ^ mix(self.version ^ mix(0xa0d1)));
        let drawing = Drawing { norm: self.norm, seed, counts: [places - places / 2, places / 2], total };
        let parts = drawing.draw(&sums);
        drop(sums);
        progress.begin("audit", "parts", Some(parts.len() as u64));
        let (dir, wait, version) = (self.store.dir().to_path_buf(), self.store.wait(), self.version);
        let measure = |turns: &Turns<'_, Found>| {
            let store = Store::open(&dir, wait)?;
            let set = WorkingSet::open(&store, version)?;
            with_scene(&set, |open| {
                let lamps = LampsInSight::new(&set);
                turns.each(|at| drawing.measure((&set, open, &lamps), &parts[at]))
            })
        };
        self.crew(progress, parts.len(), 1).in_order(parts.len(), measure, |_, part| {
            found.add(part);
            Ok(())
        })?;
        Ok((found, total.norm))
    }

    /// What places are drawn by, of every cluster that has any.
    fn sums(&self, progress: &dyn Progress) -> Result<Vec<(ClusterId, Sums)>> {
        let set = WorkingSet::open(self.store, self.version)?;
        let ids: Vec<ClusterId> = set.snapshot().clusters().map(|c| c.map(|c| c.id)).collect::<Result<_>>()?;
        progress.begin("weigh", "clusters", Some(ids.len() as u64));
        let (dir, wait, version, norm) = (self.store.dir().to_path_buf(), self.store.wait(), self.version, self.norm);
        let weigh = |turns: &Turns<'_, Sums>| {
            let store = Store::open(&dir, wait)?;
            let set = WorkingSet::open(&store, version)?;
            turns.each(|at| places::sums(&set, ids[at], &norm))
        };
        let mut sums = Vec::new();
        self.crew(progress, ids.len(), CLUSTERS_AT_LEAST).in_order(ids.len(), weigh, |at, of| {
            if of.weights[0] > 0.0 {
                sums.push((ids[at], of));
            }
            Ok(())
        })?;
        Ok(sums)
    }

    /// A place as it is reported.
    fn named(&self, place: &Place) -> Result<WorstPlace> {
        let facts = self.store.facts()?;
        // To the micrometre: stored coordinates are f32.
        let micro = |x: f64| (x * 1e6).round() / 1e6;
        let point = place.point.to_array();
        Ok(WorstPlace {
            cluster: place.cluster.0,
            object: self.store.object_of(place.cluster)?,
            point_m: std::array::from_fn(|i| micro(point[i] + facts.origin[i] * facts.metres_per_unit)),
            stored_w_m2: place.stored.0,
            gathered_w_m2: place.gathered.0,
        })
    }
}
