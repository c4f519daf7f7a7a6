//! Surveys of lamps: where many are in sight, all that a node gets from them, measured by rays from the node that
//! are drawn by what each lamp would bring if nothing stood in between.
//!
//! A link to each lamp would cost rays for each, and shadows of each would be told apart: a row of all of them costs
//! the same for ten lamps and for a thousand, and where hundreds are in sight the shadow of one is nothing. What
//! holds for surveys holds here: the rays that decide do not count, and are kept beside those that do.

use std::rc::Rc;

use glam::DVec3;

use super::bundle::{Bundle, Starts};
use super::lamp_list::{Aim, LampTree, Lamps, Place, is_close_lamp, target};
use super::link_rows::Link;
use super::refine::{Context, Receiver};
use super::sight::{Mean, smallest_region};
use super::source_memo::KnownSource;
use super::survey::{self, FINAL, Lit, PILOT, RAYS};
use super::survey_row::{Worth, pack_quarters, worth};
use super::survey_verdict::{DARK, Verdict, can_divide, is_uneven};
use crate::base::{ClusterId, Error, NodeName, Result, Rgb};
use crate::geom::sequence::{Sequence, cosine_direction, mix};
use crate::model::links::Visibility;
use crate::rays::node::Node;
use crate::rays::region::Region;
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
    /// What would arrive if nothing stood in between, W/m2, and the share of it that does.
    unoccluded_w_m2: f64,
    visible: f64,
    /// Standard error that as many rays as are cast at most would leave if nothing stood in between, relative.
    unevenness: f64,
    /// How much what arrives at the part of the receiver that its row does not stand for changes its mean, W/m2.
    elsewhere_w_m2: f64,
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
        for name in self.tops_without(is_mark) {
            let r = Bundle::of(context.sides, &self.view, name);
            self.survey_lamps_of(context, &r, &mut lamps)?;
        }
        Ok(())
    }

    fn survey_lamps_of(&mut self, context: &Context<'_>, r: &Bundle, lamps: &mut Lamps<'_>) -> Result<()> {
        if context.progress.interrupted() {
            return Err(Error::Interrupted);
        }
        if is_uneven(r, context.tolerances.min_element_m) {
            return self.survey_lamps_below(context, r, lamps);
        }
        let region = r.as_element().and_then(|n| smallest_region(context.cuts, n));
        let pilot = self.draw(context, r, region.as_ref(), lamps, RAYS.0, PILOT)?;
        let mut worth = worth(&pilot.row, self.irradiance_of(r.name));
        // Near a lamp what would arrive changes so much from place to place that no number of rays tells the mean.
        worth.gradient = worth.gradient.max(worth.irradiance * pilot.unevenness).max(pilot.elsewhere_w_m2);
        let verdict = self.lamp_verdict(context, r, &worth);
        let may_come = pilot.unoccluded_w_m2 > DARK * context.tolerances.row_w_m2;
        let straddles = r.as_element().is_none() && pilot.visible < 0.5 && may_come;
        match verdict {
            Verdict::Keep(rays) if !straddles => {
                let rays = rays.min(RAYS.1);
                let counted = self.draw(context, r, region.as_ref(), lamps, rays, FINAL)?;
                self.counts.evaluated += counted.row.len() as u64;
                self.keep_row(context, r, mark(r.name, rays, pilot.error), counted.row, &pilot.row);
            }
            _ => self.survey_lamps_below(context, r, lamps)?,
        }
        Ok(())
    }

    fn survey_lamps_below(&mut self, context: &Context<'_>, r: &Bundle, lamps: &mut Lamps<'_>) -> Result<()> {
        for name in self.divide(r) {
            self.survey_lamps_of(context, &Bundle::of(context.sides, &self.view, name), lamps)?;
        }
        Ok(())
    }

    /// As for other surveys, where much light is with smaller elements. But sides below a sector node face different
    /// ways, which no number of rays mends; and noise that rays do not get rid of hides that few places see a lamp,
    /// whose light would be spread over all.
    fn lamp_verdict(&self, context: &Context<'_>, r: &Bundle, worth: &Worth) -> Verdict {
        let smallest_m = BRIGHT_FLOOR * context.tolerances.min_element_m;
        let most = if r.as_element().is_some() { MOST_WANTED } else { RAYS.0 };
        match self.verdict(context, r, worth, smallest_m) {
            Verdict::Keep(rays) if rays > most && can_divide(r, smallest_m) => Verdict::Split,
            verdict => verdict,
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
        let own = self.view;
        let r = Bundle::of(context.sides, &own, self.mesh.name_at(position));
        let worth = worth(&pilot, self.irradiance_of(r.name));
        let verdict = self.lamp_verdict(context, &r, &worth);
        if matches!(verdict, Verdict::Keep(wanted) if wanted.min(RAYS.1) <= rays) {
            return Ok(true);
        }
        self.survey_lamps_of(context, &r, &mut Lamps::new(context.clusters, context.sides, lamps))?;
        Ok(false)
    }

    /// What arrives at a node now, W/m2.
    fn irradiance_of(&self, name: NodeName) -> Rgb {
        if name.is_sector() {
            let found = self.view.light.sectors.binary_search_by_key(&name.0, |s| s.name);
            return found.map_or(Rgb::BLACK, |at| Rgb::from_f32(self.view.light.sectors[at].irradiance));
        }
        self.mesh.elements[self.mesh.nearest(name)].irradiance
    }

    /// Casts `count` rays from a node to lamps.
    fn draw(
        &mut self,
        context: &Context<'_>,
        r: &Bundle,
        region: Option<&Region>,
        lamps: &mut Lamps<'_>,
        count: u64,
        salt: u64,
    ) -> Result<Found> {
        let scene = context.cuts.scene();
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
            let (polygon, side, from) = aims.starts.draw(quarter, [a, b]);
            let is_here = region.is_none_or(|region| region.holds(scene, from));
            if !is_here && salt != PILOT {
                continue;
            }
            let here = is_here.then_some(quarter);
            let (normal, end) = (side.node.normal, &side.node.end);
            let Some(aim) = aims.aim(lamps, polygon, normal, from) else {
                tally.add(here, 0.0, 0.0);
                continue;
            };
            let (mut arrives, mut expected) = (0.0, 0.0);
            let mut arrive = |arrives: &mut f64, lamp: NodeName, form_factor: f64, exitance: f64| {
                *arrives += form_factor * exitance;
                if is_here {
                    arrivals.push(Arrival { lamp, quarter, form_factor });
                }
            };
            if let Some(drawn) = lamps.draw(&aim, from, normal, c)?
                && let Some(target) = target(&drawn.bundle, from, normal, [drawn.rest, d])
            {
                let (form_factor, exitance) = (target.form_factor / drawn.share, drawn.lamp.exitance);
                self.counts.rays += 1;
                expected += form_factor * exitance;
                if !scene.blocked(from, target.to, end, &target.on.end, &None) {
                    arrive(&mut arrives, drawn.lamp.name, form_factor, exitance);
                }
            }
            if aim.may_be_close {
                self.counts.rays += 1;
                if let Some((lamp, exitance)) = close_lamp(context, &side.node, from, cosine_direction(normal, c, d))? {
                    expected += exitance;
                    arrive(&mut arrives, lamp, 1.0, exitance);
                }
            }
            tally.add(here, arrives, expected);
        }
        let row = to_links(context, arrivals, &tally)?;
        let unoccluded_w_m2 = tally.mean_expected_w_m2();
        let mut found = Found {
            row,
            error: relative_error(&tally.arrives),
            unoccluded_w_m2,
            visible: tally.visible_share(),
            unevenness: relative_error(&tally.expected) * (count as f64 / RAYS.1 as f64).sqrt(),
            elsewhere_w_m2: tally.difference_w_m2(),
        };
        set_errors(&mut found.row, found.error);
        Ok(found)
    }
}

/// The side of a close lamp that a ray meets, and its exitance, W/m2 (norm over RGB).
fn close_lamp(context: &Context<'_>, r: &Node, from: DVec3, along: DVec3) -> Result<Option<(NodeName, f64)>> {
    let Nearest::Met(hit) = context.cuts.scene().nearest(from, along, Some(&r.end)) else { return Ok(None) };
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

/// Where rays to lamps go from each polygon of a receiver, once that was asked: `None` where no lamp can be seen.
struct Aims<'a> {
    starts: Starts<'a>,
    known: Vec<Option<Option<Rc<Aim>>>>,
}

impl<'a> Aims<'a> {
    fn new(r: &'a Bundle) -> Self {
        let starts = Starts::new(r);
        let known = vec![None; starts.count()];
        Self { starts, known }
    }

    /// From a place of polygon `index`.
    fn aim(&mut self, lamps: &Lamps<'_>, index: usize, normal: DVec3, from: DVec3) -> Option<Rc<Aim>> {
        let all_over = || lamps.aim(&Place::polygon(self.starts.shape(index), normal)).map(Rc::new);
        let aim = self.known[index].get_or_insert_with(all_over).clone()?;
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
    /// What arrives at the part of the receiver that the row does not stand for.
    elsewhere: Mean,
}

impl Tally {
    /// Adds what arrived at a quarter of the receiver, or elsewhere.
    fn add(&mut self, quarter: Option<usize>, arrives: f64, expected: f64) {
        let Some(quarter) = quarter else { return self.elsewhere.add(arrives) };
        self.arrives[quarter].add(arrives);
        self.expected[quarter].add(expected);
        self.rays += 1;
    }

    fn mean_expected_w_m2(&self) -> f64 {
        sum(&self.expected) / self.rays.max(1) as f64
    }

    /// How much what arrives elsewhere changes the mean of all, beyond noise.
    fn difference_w_m2(&self) -> f64 {
        let elsewhere = &self.elsewhere;
        let here = sum(&self.arrives) / self.rays.max(1) as f64;
        let noise = (here * relative_error(&self.arrives)).hypot(elsewhere.error());
        let share = elsewhere.count / (elsewhere.count + self.rays as f64).max(1.0);
        share * ((elsewhere.mean() - here).abs() - 2.0 * noise).max(0.0)
    }

    fn visible_share(&self) -> f64 {
        let expected = sum(&self.expected);
        if expected > 0.0 { sum(&self.arrives) / expected } else { 1.0 }
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
