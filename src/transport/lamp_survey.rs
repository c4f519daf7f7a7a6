//! Surveys of lamps: where many are in sight, all that a node gets from them, measured by rays from the node that
//! are drawn by what each lamp would bring if nothing stood in between.
//!
//! A link to each lamp would cost rays for each, and shadows of each would be told apart: a row of all of them costs
//! the same for ten lamps and for a thousand, and where hundreds are in sight the shadow of one is nothing. What
//! holds for surveys holds here: the rays that decide do not count, and are kept beside those that do.

use std::rc::Rc;

use glam::DVec3;

use super::bundle::Starts;
use super::lamp_list::{Aim, LampTree, Lamps, Place, is_close_lamp, target};
use super::link_rows::Link;
use super::refine::{Context, Receiver, node as node_of};
use super::sight::Mean;
use super::source_memo::KnownSource;
use super::survey::{self, FINAL, Lit, PILOT, RAYS};
use super::survey_row::{Worth, pack_quarters, worth};
use super::survey_verdict::{Verdict, can_divide, verdict};
use crate::base::{ClusterId, Error, NodeName, Result, Rgb};
use crate::geom::sequence::{Sequence, cosine_direction, mix};
use crate::model::links::Visibility;
use crate::rays::node::Node;
use crate::rays::traverse::Nearest;

/// Share of the smallest element's edge down to which elements near lamps are divided.
const BRIGHT_FLOOR: f64 = 0.125;

/// Rays that would be enough for an element beyond which it is divided instead.
const MOST_WANTED: u64 = 16 * RAYS.1;

/// Keeps these rays apart from others of the same node.
const SALT: u64 = 0x6c61_6d70_7300_0000;

/// What rays to lamps found.
struct Found {
    row: Lit,
    /// Standard error of what arrives, relative to it.
    error: f64,
    /// Standard error that as many rays as are cast at most would leave if nothing stood in between, relative.
    unevenness: f64,
}

/// One ray that arrived.
struct Arrival {
    lamp: NodeName,
    quarter: usize,
    form_factor: f64,
}

impl Receiver<'_> {
    /// Surveys the lamps in sight, where that has not been done.
    pub(super) fn survey_lamps(&mut self, context: &Context<'_>, lamps: &LampTree) -> Result<()> {
        let mut lamps = Lamps::new(context.clusters, context.sides, lamps);
        for name in self.sides_without(is_mark) {
            self.survey_lamps_of(context, &node_of(&self.view, name), &mut lamps)?;
        }
        Ok(())
    }

    fn survey_lamps_of(&mut self, context: &Context<'_>, r: &Node, lamps: &mut Lamps<'_>) -> Result<()> {
        if context.progress.interrupted() {
            return Err(Error::Interrupted);
        }
        let pilot = self.draw(context, r, lamps, RAYS.0, PILOT)?;
        let mut worth = worth(&pilot.row, self.irradiance_of(r.name));
        // Near a lamp what would arrive changes so much from place to place that no number of rays tells the mean.
        worth.gradient = worth.gradient.max(worth.irradiance * pilot.unevenness);
        match lamp_verdict(context, r, &worth) {
            Verdict::Keep(rays) => {
                let rays = rays.min(RAYS.1);
                let counted = self.draw(context, r, lamps, rays, FINAL)?;
                self.counts.evaluated += counted.row.len() as u64;
                self.keep_row(mark(r.name, rays, pilot.error), counted.row, &pilot.row);
                Ok(())
            }
            Verdict::Split => {
                self.split(self.mesh.nearest(r.name));
                (0..4).try_for_each(|quarter| self.survey_lamps_of(context, &r.child(quarter), lamps))
            }
        }
    }

    /// Whether a stored row still holds; one that does not is made anew.
    pub(super) fn lamp_survey_holds(
        &mut self,
        context: &Context<'_>,
        lamps: &LampTree,
        position: usize,
        row: &[Link],
    ) -> Result<bool> {
        let (mut pilot, mut rays, mut error) = (Lit::new(), 0, 0.0);
        for link in row.iter().filter(|link| link.form_factor == 0.0) {
            if is_mark(link) {
                (rays, error) = (link.uncertainty as u64, f64::from(link.spread));
                continue;
            }
            let source = context.sources.source(context.clusters, link.source)?;
            if link.class == Visibility::Surveyed && holds(&source, link) {
                pilot.push((Link { form_factor: link.uncertainty, ..*link }, source.light.radiosity));
            }
        }
        set_errors(&mut pilot, error);
        let r = node_of(&self.view, self.mesh.name_at(position));
        let worth = worth(&pilot, self.irradiance_of(r.name));
        let verdict = lamp_verdict(context, &r, &worth);
        if matches!(verdict, Verdict::Keep(wanted) if wanted.min(RAYS.1) <= rays) {
            return Ok(true);
        }
        self.survey_lamps_of(context, &r, &mut Lamps::new(context.clusters, context.sides, lamps))?;
        Ok(false)
    }

    /// What arrives at an element now, W/m2.
    fn irradiance_of(&self, name: NodeName) -> Rgb {
        self.mesh.elements[self.mesh.nearest(name)].irradiance
    }

    /// Casts `count` rays from a node to lamps.
    fn draw(&mut self, context: &Context<'_>, r: &Node, lamps: &mut Lamps<'_>, count: u64, salt: u64) -> Result<Found> {
        let sequence = Sequence::new(mix(context.seed ^ mix(r.name.0)) ^ salt ^ SALT);
        let mut aims = Aims::new(r);
        let mut tally = Tally::default();
        let mut arrivals = Vec::new();
        for index in 0..4 * count {
            if tally.rays == count {
                break;
            }
            let [a, b, c, d] = sequence.point(index);
            let quarter = (index % 4) as usize;
            let from = aims.starts.draw(quarter, [a, b]);
            let normal = r.normal;
            let Some(aim) = aims.aim(lamps, quarter, normal, from) else {
                tally.add(quarter, 0.0, 0.0);
                continue;
            };
            let (mut arrives, mut expected) = (0.0, 0.0);
            let mut arrive = |arrives: &mut f64, lamp: NodeName, form_factor: f64, exitance: f64| {
                *arrives += form_factor * exitance;
                arrivals.push(Arrival { lamp, quarter, form_factor });
            };
            if let Some(drawn) = lamps.draw(&aim, from, normal, c)?
                && let Some(target) = target(&drawn.bundle, from, normal, [drawn.rest, d])
            {
                let (form_factor, exitance) = (target.form_factor / drawn.share, drawn.lamp.exitance);
                self.counts.rays += 1;
                expected += form_factor * exitance;
                if !context.scene.blocked(from, target.to, &r.end, &target.on.end, &None) {
                    arrive(&mut arrives, drawn.lamp.name, form_factor, exitance);
                }
            }
            if aim.may_be_close {
                self.counts.rays += 1;
                if let Some((lamp, exitance)) = close_lamp(context, r, from, cosine_direction(normal, c, d))? {
                    expected += exitance;
                    arrive(&mut arrives, lamp, 1.0, exitance);
                }
            }
            tally.add(quarter, arrives, expected);
        }
        let row = to_links(context, arrivals, &tally)?;
        let mut found = Found {
            row,
            error: relative_error(&tally.arrives),
            unevenness: relative_error(&tally.expected) * (count as f64 / RAYS.1 as f64).sqrt(),
        };
        set_errors(&mut found.row, found.error);
        Ok(found)
    }
}

/// As for other surveys, where much light is with smaller elements; noise that rays do not get rid of hides that few
/// places see a lamp, whose light would be spread over all.
fn lamp_verdict(context: &Context<'_>, r: &Node, worth: &Worth) -> Verdict {
    let smallest_m = BRIGHT_FLOOR * context.tolerances.min_element_m;
    match verdict(context, r, worth, smallest_m) {
        Verdict::Keep(rays) if rays > MOST_WANTED && can_divide(r, smallest_m) => Verdict::Split,
        verdict => verdict,
    }
}

/// The side of a close lamp that a ray meets, and its exitance, W/m2 (norm over RGB).
fn close_lamp(context: &Context<'_>, r: &Node, from: DVec3, along: DVec3) -> Result<Option<(NodeName, f64)>> {
    let Nearest::Met(hit) = context.scene.nearest(from, along, Some(&r.end)) else { return Ok(None) };
    let name = NodeName::root(ClusterId(hit.key.cluster), hit.side());
    let loaded = context.clusters.cluster(name.cluster())?;
    let view = loaded.view();
    let is_lamp = view.takes_part(hit.side().index()) && is_close_lamp(&view, name, from, from + along * hit.t);
    Ok(is_lamp.then(|| (name, view.exitance(name))))
}

/// Links of what arrived, their errors not known yet.
fn to_links(context: &Context<'_>, mut arrivals: Vec<Arrival>, tally: &Tally) -> Result<Lit> {
    arrivals.sort_by_key(|a| (a.lamp, a.quarter));
    let rays = tally.rays as f64;
    let mut row = Lit::new();
    for run in arrivals.chunk_by(|a, b| a.lamp == b.lamp) {
        let source = run[0].lamp;
        let share = run.iter().map(|a| a.form_factor).sum::<f64>() / rays;
        let relative = std::array::from_fn(|q| {
            let here: f64 = run.iter().filter(|a| a.quarter == q).map(|a| a.form_factor).sum();
            here / tally.arrives[q].count.max(1.0) / share
        });
        let (form_factor, spread) = (share.min(1.0) as f32, pack_quarters(relative));
        let link = Link { source, form_factor, spread, uncertainty: 0.0, class: Visibility::Surveyed };
        row.push((link, context.clusters.cluster(source.cluster())?.view().source(source).radiosity));
    }
    Ok(row)
}

/// Shares the error of all that arrives among links, as if each erred for itself.
fn set_errors(row: &mut Lit, error: f64) {
    let sum: f64 = row.iter().map(|(link, _)| f64::from(link.form_factor)).sum();
    for (link, _) in row {
        link.uncertainty = (error * (f64::from(link.form_factor) * sum).sqrt()) as f32;
    }
}

/// A link that carries nothing: tells that the lamps have been surveyed, by how many rays, and how far off, relative
/// to what arrives, those are that decided.
fn mark(name: NodeName, rays: u64, error: f64) -> Link {
    let spread = error.min(1.0) as f32;
    Link { source: name, form_factor: 0.0, spread, uncertainty: rays as f32, class: Visibility::Surveyed }
}

/// Whether a link is such a mark: those of other surveys have quarters in `spread`, which come to more than 1.
#[must_use]
pub fn is_mark(link: &Link) -> bool {
    link.class == Visibility::Surveyed
        && link.form_factor == 0.0
        && link.uncertainty >= RAYS.0 as f32
        && link.spread <= 1.0
}

/// Whether a surveyed link to a source is part of a survey of lamps: its mark, or to an emitter.
pub(super) fn holds(source: &KnownSource, link: &Link) -> bool {
    is_mark(link) || (!survey::is_mark(link) && source.emits)
}

/// Where rays to lamps go from each quarter of a receiver, once that was asked: `None` where no lamp can be seen.
struct Aims {
    starts: Starts,
    known: [Option<Option<Rc<Aim>>>; 4],
}

impl Aims {
    fn new(r: &Node) -> Self {
        Self { starts: Starts::new(r), known: [const { None }; 4] }
    }

    /// From a place of a quarter.
    fn aim(&mut self, lamps: &Lamps<'_>, quarter: usize, normal: DVec3, from: DVec3) -> Option<Rc<Aim>> {
        let all_over = || lamps.aim(&Place::polygon(self.starts.shape(quarter), normal)).map(Rc::new);
        let aim = self.known[quarter].get_or_insert_with(all_over).clone()?;
        if aim.holds_all_over {
            return Some(aim);
        }
        lamps.aim(&Place::point(from, normal)).map(Rc::new)
    }
}

/// What rays brought, by quarter, and would have if nothing stood in between, W/m2.
#[derive(Default)]
struct Tally {
    arrives: [Mean; 4],
    expected: [Mean; 4],
    rays: u64,
}

impl Tally {
    /// Adds what arrived at a quarter of the receiver.
    fn add(&mut self, quarter: usize, arrives: f64, expected: f64) {
        self.arrives[quarter].add(arrives);
        self.expected[quarter].add(expected);
        self.rays += 1;
    }
}

fn sum(quarters: &[Mean; 4]) -> f64 {
    quarters.iter().map(|q| q.sum).sum()
}

/// Standard error of the sum, relative to it.
fn relative_error(quarters: &[Mean; 4]) -> f64 {
    let sum = sum(quarters);
    if sum > 0.0 { quarters.iter().map(Mean::sum_variance).sum::<f64>().sqrt() / sum } else { 0.0 }
}
