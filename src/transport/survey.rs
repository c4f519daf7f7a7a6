//! Surveys: all that a node sees of what does not emit, measured at the node itself.
//!
//! A receiver casts cosine-weighted rays from all over its sides, and what they meet are its sources: the
//! share of the rays that meet one is its form factor, visibility included. So a row costs the same in an
//! empty room and among a thousand books, and nothing is linked that is not seen. A source is the smallest
//! element at the place that was met, named whether stored or not: what is divided later is seen where it was
//! met. Sides that are seen whole are linked pair by pair instead.
//!
//! A survey begins at patch sides. An element is split where what arrives differs from quarter to quarter, and more rays
//! are cast while noise matters. The rays that decide so do not count: see
//! [`super::sight::look`].

use std::collections::HashSet;

use glam::DVec3;

use super::bundle::Starts;
use super::lamp_survey;
use super::link_rows::Link;
use super::refine::{Context, Receiver, node as node_of};
use super::sight::{Known, sees_whole};
use super::survey_row::{counted_error, mean, pack_quarters, worth};
use super::survey_verdict::{Verdict, can_resolve, verdict};
use crate::base::{ClusterId, Error, NodeName, PatchSide, Result, Rgb};
use crate::geom::sequence::{Sequence, cosine_direction, mix};
use crate::model::geometry::NONE;
use crate::model::links::Visibility;
use crate::rays::node::Node;
use crate::rays::traverse::Nearest;

/// Rays of a node, first and at most.
pub(super) const RAYS: (u64, u64) = (64, 1024);

/// Sides, of those that a node's first rays meet most, that are tried for being seen whole.
const TRIED: usize = 16;

/// A place that a ray met.
struct Met {
    cluster: ClusterId,
    side: PatchSide,
    point: DVec3,
    /// Whether it is closer than half of the receiver's size.
    is_near: bool,
    quarter: usize,
}

/// Rays cast so far from a node.
struct Cast {
    met: Vec<Met>,
    /// Rays that began in the open, by quarter.
    open: [u64; 4],
    /// Rays that began below another face.
    covered: [u64; 4],
}

/// Links with the radiosities of their sources, W/m2.
pub(super) type Lit = Vec<(Link, Rgb)>;

impl Receiver<'_> {
    /// Surveys what has not been.
    pub(super) fn survey_all(&mut self, context: &Context<'_>) -> Result<()> {
        for name in self.sides_without(is_mark) {
            self.survey(context, &node_of(&self.view, name), &[])?;
        }
        Ok(())
    }

    /// Sides none of whose elements holds a row with such a mark.
    pub(super) fn sides_without(&self, is_mark: impl Fn(&Link) -> bool) -> Vec<NodeName> {
        let mut done = vec![false; 2 * self.view.geometry.patches.len()];
        for (element, row) in self.mesh.elements.iter().zip(&self.rows[self.mesh.sectors.len()..]) {
            done[element.name.patch_side().index()] |= row.iter().any(&is_mark);
        }
        let open = (0..done.len()).filter(|&side| !done[side] && self.view.takes_part(side));
        open.map(|side| NodeName::root(self.view.id, PatchSide::from_index(side))).collect()
    }

    /// Surveys an element, or those below it; `whole` are patch sides that it is known to see whole.
    fn survey(&mut self, context: &Context<'_>, r: &Node, whole: &[NodeName]) -> Result<()> {
        if context.progress.interrupted() {
            return Err(Error::Interrupted);
        }
        let mut whole = whole.to_vec();
        let pilot = self.cast(context, r, RAYS.0, PILOT);
        self.link_whole(context, r, &pilot, &mut whole)?;
        let mut looked = Lit::new();
        let near = add_counted(context, &pilot, &whole, &mut looked)?;
        let mean = mean(&looked);
        let mut worth = worth(&looked, mean);
        let unresolved = unresolved(&looked, &near, mean);
        worth.gradient = worth.gradient.max(worth.irradiance * pilot.uneven_cover());
        if can_resolve(context, r, unresolved) {
            return self.survey_below(context, r, &whole);
        }
        match verdict(context, r, &worth, context.tolerances.min_element_m) {
            Verdict::Split => self.survey_below(context, r, &whole),
            Verdict::Keep(rays) => {
                let rays = rays.min(RAYS.1);
                let cast = self.cast(context, r, rays, FINAL);
                let mut row = Lit::new();
                add_counted(context, &cast, &whole, &mut row)?;
                self.counts.evaluated += row.len() as u64;
                self.keep_row(mark(r.name, rays), row, &looked);
                Ok(())
            }
        }
    }

    /// Links an element pair by pair to sides that it sees whole, and adds them to `whole`.
    fn link_whole(&mut self, context: &Context<'_>, r: &Node, cast: &Cast, whole: &mut Vec<NodeName>) -> Result<()> {
        for root in sides_met(cast).into_iter().take(TRIED) {
            let loaded = context.clusters.cluster(root.cluster())?;
            let view = loaded.view();
            if !view.takes_part(root.patch_side().index()) || view.emits(root) || whole.contains(&root) {
                continue;
            }
            let s = node_of(&view, root);
            if sees_whole(&context.scene, r, &s) {
                self.link(context, &view, self.mesh.nearest(r.name), r, &s, &Known::stored(Visibility::Visible));
                whole.push(root);
            }
        }
        whole.sort_unstable();
        Ok(())
    }

    /// Keeps a row with its mark, and with it, carrying nothing, what the rays met that decided.
    pub(super) fn keep_row(&mut self, mark: Link, row: Lit, pilot: &[(Link, Rgb)]) {
        let position = self.mesh.position(mark.source);
        self.changed[position] = true;
        self.rows[position].push(mark);
        self.rows[position].extend(row.into_iter().map(|(link, _)| link));
        self.rows[position].extend(pilot.iter().map(|(link, _)| as_pilot(link)));
    }

    fn survey_below(&mut self, context: &Context<'_>, r: &Node, whole: &[NodeName]) -> Result<()> {
        self.split(self.mesh.nearest(r.name));
        (0..4).try_for_each(|quarter| self.survey(context, &r.child(quarter), whole))
    }

    /// Whether a stored row still holds; one that does not is made anew.
    ///
    /// The rays that decided tell, not those that count: rows that happen to have met little of what has become
    /// bright would stay as they are, and all would be too dark.
    pub(super) fn survey_holds(&mut self, context: &Context<'_>, position: usize, row: &[Link]) -> Result<bool> {
        let (mut pilot, mut rays) = (Lit::new(), 0);
        for link in row.iter().filter(|link| link.class == Visibility::Surveyed && link.form_factor == 0.0) {
            if is_mark(link) {
                rays = link.uncertainty as u64;
                continue;
            }
            let source = context.sources.source(context.clusters, link.source)?;
            if !lamp_survey::holds(&source, link) {
                pilot.push((of_pilot(link), source.light.radiosity));
            }
        }
        let r = node_of(&self.view, self.mesh.name_at(position));
        let worth = worth(&pilot, mean(&pilot));
        let verdict = verdict(context, &r, &worth, context.tolerances.min_element_m);
        if matches!(verdict, Verdict::Keep(wanted) if wanted.min(RAYS.1) <= rays) {
            return Ok(true);
        }
        let whole = self.linked_whole(position, row);
        self.survey(context, &r, &whole)?;
        Ok(false)
    }

    /// Sides that an element with a surveyed row, or those below it, are linked to pair by pair; `row` is its own.
    fn linked_whole(&self, position: usize, row: &[Link]) -> Vec<NodeName> {
        let element = position - self.mesh.sectors.len();
        let mut whole = HashSet::new();
        let mut add = |row: &[Link]| {
            let pairs = row.iter().filter(|link| link.class != Visibility::Surveyed && !link.source.is_sector());
            whole.extend(pairs.map(|link| link.source.whole_side()));
        };
        add(row);
        let mut above = self.mesh.elements[element].parent;
        while above != NONE {
            add(&self.rows[self.position(above as usize)]);
            above = self.mesh.elements[above as usize].parent;
        }
        let mut below = vec![element];
        while let Some(at) = below.pop() {
            add(&self.rows[self.position(at)]);
            if !self.mesh.elements[at].is_leaf() {
                let first = self.mesh.elements[at].first_child as usize;
                below.extend(first..first + 4);
            }
        }
        let mut whole: Vec<NodeName> = whole.into_iter().collect();
        whole.sort_unstable();
        whole
    }

    /// Casts `target` rays from the open part of an element, if there is any.
    fn cast(&mut self, context: &Context<'_>, r: &Node, target: u64, salt: u64) -> Cast {
        let mut cast = Cast { met: Vec::new(), open: [0; 4], covered: [0; 4] };
        let mut index = 0;
        let sequence = Sequence::new(mix(context.seed ^ mix(r.name.0)) ^ salt);
        let size_m = r.shape.longest_edge();
        let starts = Starts::new(r);
        while cast.rays() < target && index < 4 * target {
            let [a, b, c, d] = sequence.point(index);
            let quarter = (index % 4) as usize;
            index += 1;
            let from = starts.draw(quarter, [a, b]);
            let direction = cosine_direction(r.normal, c, d);
            self.counts.rays += 1;
            let hit = match context.scene.nearest(from, direction, Some(&r.end)) {
                Nearest::Met(hit) => hit,
                Nearest::Escaped => {
                    cast.open[quarter] += 1;
                    continue;
                }
                Nearest::Covered => {
                    cast.covered[quarter] += 1;
                    continue;
                }
            };
            cast.open[quarter] += 1;
            cast.met.push(Met {
                cluster: ClusterId(hit.key.cluster),
                side: hit.side(),
                point: from + direction * hit.t,
                is_near: hit.t < 0.5 * size_m,
                quarter,
            });
        }
        cast
    }
}

/// Rays that decide what is done tell nothing of the light: kept where few bright places were met and cast anew
/// where many were, they would make all rows too dark.
pub(super) const PILOT: u64 = 0x7069_6c6f_7400_0000;
pub(super) const FINAL: u64 = 0x7375_7276_6579_0000;

impl Cast {
    fn rays(&self) -> u64 {
        self.open.iter().sum()
    }

    /// How much more one quarter is covered than all are.
    fn uneven_cover(&self) -> f64 {
        let share = |covered: u64, open: u64| covered as f64 / (covered + open).max(1) as f64;
        let all = share(self.covered.iter().sum(), self.rays());
        self.covered.iter().zip(self.open).map(|(c, o)| (share(*c, o) - all).abs()).fold(0.0, f64::max)
    }
}

/// A link that carries nothing: tells that a node has been surveyed, and by how many rays.
fn mark(name: NodeName, rays: u64) -> Link {
    let (spread, class) = (pack_quarters([1.0; 4]), Visibility::Surveyed);
    Link { source: name, form_factor: 0.0, spread, uncertainty: rays as f32, class }
}

/// Whether a link is such a mark: others have an uncertainty below 1, and that of a survey of lamps has no quarters.
pub(super) fn is_mark(link: &Link) -> bool {
    link.class == Visibility::Surveyed && link.uncertainty >= RAYS.0 as f32 && !lamp_survey::is_mark(link)
}

/// A link of the rays that decide, as it is stored: it carries nothing.
fn as_pilot(link: &Link) -> Link {
    Link { form_factor: 0.0, uncertainty: link.form_factor, ..*link }
}

/// What [`as_pilot`] stored.
fn of_pilot(link: &Link) -> Link {
    let share = f64::from(link.uncertainty);
    Link { form_factor: link.uncertainty, uncertainty: counted_error(share, RAYS.0 as f64) as f32, ..*link }
}

/// Sides that rays met, those met most first.
fn sides_met(cast: &Cast) -> Vec<NodeName> {
    let mut met: Vec<NodeName> = cast.met.iter().map(|m| NodeName::root(m.cluster, m.side)).collect();
    met.sort_unstable();
    let mut runs: Vec<(usize, NodeName)> = met.chunk_by(|a, b| a == b).map(|run| (run.len(), run[0])).collect();
    runs.sort_unstable_by_key(|(count, root)| (std::cmp::Reverse(*count), *root));
    runs.into_iter().map(|(_, root)| root).collect()
}

/// What a receiver's mean hides: parts of it that something close by shades from what the others see, W/m2. They
/// may be spread evenly over its quarters.
fn unresolved(row: &[(Link, Rgb)], near: &[f64], mean: Rgb) -> f64 {
    let all: f64 = near.iter().sum();
    let differs = |(near, (_, radiosity)): (&f64, &(Link, Rgb))| near * (*radiosity - mean).norm_squared().sqrt();
    near.iter().zip(row).map(differs).sum::<f64>() * (1.0 - all).max(0.0)
}

/// Adds links to what rays met, but for emitters and sides in `whole`. Returns how much of each is near.
fn add_counted(context: &Context<'_>, cast: &Cast, whole: &[NodeName], row: &mut Lit) -> Result<Vec<f64>> {
    let rays = cast.rays() as f64;
    let mut near = Vec::new();
    let mut met: Vec<(NodeName, &Met)> = Vec::new();
    for m in &cast.met {
        let loaded = context.clusters.cluster(m.cluster)?;
        let view = loaded.view();
        let root = NodeName::root(m.cluster, m.side);
        if !view.emits(root) && whole.binary_search(&root).is_err() {
            met.push((view.smallest_at(m.side, m.point, context.tolerances.min_element_m).name, m));
        }
    }
    met.sort_by_key(|(name, _)| *name);
    for run in met.chunk_by(|a, b| a.0 == b.0) {
        let source = run[0].0;
        let count = |counts: &dyn Fn(&Met) -> bool| run.iter().filter(|(_, m)| counts(m)).count() as f64;
        let all = count(&|_| true);
        let share = all / rays;
        let relative = std::array::from_fn(|q| count(&|m| m.quarter == q) * rays / cast.open[q].max(1) as f64 / all);
        let link = Link {
            source,
            form_factor: share as f32,
            spread: pack_quarters(relative),
            uncertainty: counted_error(share, rays) as f32,
            class: Visibility::Surveyed,
        };
        near.push(count(&|m| m.is_near) / rays);
        row.push((link, context.clusters.cluster(source.cluster())?.view().source(source).radiosity));
    }
    Ok(near)
}
