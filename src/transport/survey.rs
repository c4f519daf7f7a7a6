//! Surveys: all that a node sees of what does not emit, measured at the node itself.
//!
//! A receiver casts cosine-weighted rays from all over its sides, and what they meet are its sources: the
//! share of the rays that meet one is its form factor, visibility included. So a row costs the same in an
//! empty room and among a thousand books, it sums to 1 as it stands, and nothing is linked that is not
//! seen. A source is the node whose size is that of the part which one ray stands for: far off a sector node,
//! near by an element, to be refined by name alone. A side that fills much of the view and is seen whole has
//! the closed form instead.
//!
//! A survey begins at the sector nodes at the top of a cluster. More rays are cast while noise matters, and a
//! node is split where what arrives differs from quarter to quarter.

use glam::DVec3;

use super::bundle::Bundle;
use super::form_factor;
use super::link_rows::Link;
use super::oracle::{SOURCE_SIGN, Tolerances};
use super::refine::{Context, Receiver, node as node_of, variation};
use super::sight::{is_smallest, sees_whole};
use super::source::ClusterView;
use super::survey_row::{Worth, pack_quarters, worth};
use crate::base::name::MAX_DEPTH;
use crate::base::{ClusterId, Error, NodeName, PatchSide, Result, Rgb};
use crate::geom::quadtree;
use crate::geom::sequence::{Sequence, cosine_direction, mix};
use crate::model::geometry::NONE;
use crate::model::links::Visibility;
use crate::rays::node::Node;
use crate::rays::region::Region;
use crate::rays::traverse::Nearest;

/// Rays of a node, first and at most.
const RAYS: (u64, u64) = (64, 1024);

/// Share of the error that a row may carry which noise may make up.
const NOISE_SHARE: f64 = 0.5;

/// By how much a stored row may be off more than a new one before it is surveyed again.
const STALE: f64 = 1.5;

/// Share of a row's error below which what arrives does not matter, though all of it may go to few sides.
const DARK: f64 = 1e-3;

/// Share of the smallest element's edge down to which what is close by is resolved.
const NEAR_FLOOR: f64 = 0.25;

/// Rays of a first batch that must meet a side before the closed form is tried.
const MANY: usize = 4;

/// Parts of the view that one ray stands for and a source may fill.
const CELL: f64 = 2.0;

/// Coarsest tolerance of a closed form.
const FORM_FACTOR_TOLERANCE: f64 = 2e-4;

/// A place that a ray met.
struct Met {
    cluster: ClusterId,
    side: PatchSide,
    point: DVec3,
    /// Area that the whole view would fill there, m2.
    view_m2: f64,
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
    index: u64,
}

/// What is to be done with a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    /// Keep a row of so many rays.
    Keep(u64),
    Split,
}

/// Links with the radiosities of their sources, W/m2.
type Lit = Vec<(Link, Rgb)>;

impl Receiver<'_> {
    /// Surveys what has not been.
    pub(super) fn survey_all(&mut self, context: &Context<'_>) -> Result<()> {
        let mut done = vec![false; self.mesh.sectors.len()];
        for position in 0..self.mesh.node_count() {
            if self.rows[position].iter().any(|link| link.class == Visibility::Surveyed) {
                let mut at = match position.checked_sub(self.mesh.sectors.len()) {
                    Some(element) => self.mesh.side_sector[self.mesh.elements[element].name.patch_side().index()],
                    None => position as u32,
                };
                while at != NONE && !std::mem::replace(&mut done[at as usize], true) {
                    at = self.mesh.sectors[at as usize].parent;
                }
            }
        }
        for (at, done) in done.into_iter().enumerate() {
            let sector = self.mesh.sectors[at];
            if !done && sector.parent == NONE {
                let r = Bundle::of(context.sides, &self.view, sector.name);
                self.survey(context, &r, &[])?;
            }
        }
        Ok(())
    }

    /// Surveys a node, or those below it; `whole` are patch sides that it is known to see whole.
    fn survey(&mut self, context: &Context<'_>, r: &Bundle, whole: &[NodeName]) -> Result<()> {
        if context.progress.interrupted() {
            return Err(Error::Interrupted);
        }
        let region = r.as_element().filter(|n| is_smallest(n, context.cuts.min_element_m()));
        let region = region.and_then(|n| context.cuts.region(n));
        let mut whole = whole.to_vec();
        let pilot = self.cast(context, r, region.as_ref(), RAYS.0, PILOT);
        if let (Some(node), None) = (r.as_element(), &region) {
            find_whole(context, node, &pilot, &mut whole)?;
        }
        let (looked, near) = self.row(context, r, &pilot, &whole)?;
        let closed = looked.len() - near.len();
        let mut worth = worth(&looked);
        let unresolved = unresolved(&looked[closed..], &near, &worth);
        worth.gradient = worth.gradient.max(worth.irradiance * pilot.uneven_cover());
        if unresolved > context.tolerances.row_w_m2 && self.can_resolve(context, r) {
            return self.survey_below(context, r, &whole);
        }
        let straddles = r.as_element().is_none() && is_partly_dark(&looked, &pilot, &context.tolerances);
        match self.verdict(context, r, &worth, !near.is_empty()) {
            Verdict::Keep(_) if straddles => self.survey_below(context, r, &whole),
            Verdict::Split => self.survey_below(context, r, &whole),
            Verdict::Keep(rays) => {
                let cast = self.cast(context, r, region.as_ref(), rays, FINAL);
                let (row, _) = self.row(context, r, &cast, &whole)?;
                self.counts.evaluated += row.len() as u64;
                self.keep_row(context, r, rays, row, &looked[closed..]);
                Ok(())
            }
        }
    }

    /// A row by closed form for sides in `whole`, by what rays met for the others; how much of each of these is near.
    fn row(&self, context: &Context<'_>, r: &Bundle, cast: &Cast, whole: &[NodeName]) -> Result<(Lit, Vec<f64>)> {
        let mut row = Vec::new();
        if let Some(node) = r.as_element() {
            for root in whole {
                let loaded = context.clusters.cluster(root.cluster())?;
                let view = loaded.view();
                add_closed(context, &view, node, &node_of(&view, *root), &mut row);
            }
        }
        let near = add_counted(context, cast, whole, &mut row)?;
        Ok((row, near))
    }

    /// Keeps a row of `rays` rays, and with it, carrying nothing, what the rays met that decided.
    fn keep_row(&mut self, context: &Context<'_>, r: &Bundle, rays: u64, row: Lit, pilot: &[(Link, Rgb)]) {
        let position = self.mesh.position(r.name);
        self.changed[position] = true;
        let is_empty = row.is_empty();
        self.rows[position].push(mark(r.name, rays));
        self.rows[position].extend(row.into_iter().map(|(link, _)| link));
        self.rows[position].extend(pilot.iter().map(|(link, _)| as_pilot(link)));
        if is_empty {
            return;
        }
        for side in r.sides() {
            self.split_along_cuts(context, self.mesh.nearest(side.node.name), &side.node);
        }
    }

    fn survey_below(&mut self, context: &Context<'_>, r: &Bundle, whole: &[NodeName]) -> Result<()> {
        if r.as_element().is_some() {
            self.split(self.mesh.nearest(r.name));
        }
        let own = self.view;
        for name in r.children(&own) {
            self.survey(context, &Bundle::of(context.sides, &own, name), whole)?;
        }
        Ok(())
    }

    /// Whether a stored row still holds; one that does not is made anew.
    pub(super) fn survey_holds(&mut self, context: &Context<'_>, position: usize, row: &[Link]) -> Result<bool> {
        let mut lit = Vec::with_capacity(row.len());
        let (mut stale, mut rays, mut has_counted) = (false, 0, false);
        for link in row.iter().filter(|link| link.class == Visibility::Surveyed) {
            if link.uncertainty >= RAYS.0 as f32 {
                rays = link.uncertainty as u64;
                continue;
            }
            let is_pilot = link.form_factor == 0.0;
            if !is_pilot && f64::from(link.uncertainty) > FORM_FACTOR_TOLERANCE {
                continue;
            }
            let source = context.clusters.cluster(link.source.cluster())?.view().source(link.source);
            has_counted |= is_pilot;
            if !is_pilot {
                let form_factor = f64::from(link.form_factor);
                let bound = SOURCE_SIGN * form_factor * source.spread;
                stale |= source.divided && bound > STALE * context.tolerances.of_link(form_factor);
            }
            lit.push((if is_pilot { of_pilot(link) } else { *link }, source.radiosity));
        }
        let own = self.view;
        let r = Bundle::of(context.sides, &own, self.mesh.name_at(position));
        if stale && let Some(node) = r.as_element() {
            stale = false;
            for (link, _) in lit.iter().filter(|(l, _)| f64::from(l.uncertainty) <= FORM_FACTOR_TOLERANCE) {
                let loaded = context.clusters.cluster(link.source.cluster())?;
                let view = loaded.view();
                let source = view.source(link.source);
                let s = node_of(&view, link.source);
                let form_factor = f64::from(link.form_factor);
                let error = closed_error(node, &s, form_factor, source.spread);
                stale |= source.divided && error > STALE * context.tolerances.of_link(form_factor);
            }
        }
        // Those that met a row's sources do not decide about it: rows that happen to have met little of what has become
        // bright would stay as they are, and all would be too dark.
        let verdict = self.verdict(context, &r, &worth(&lit), has_counted);
        if stale || !matches!(verdict, Verdict::Keep(wanted) if wanted <= rays) {
            self.survey(context, &r, &[])?;
            return Ok(false);
        }
        Ok(true)
    }

    /// Whether a node may be split for what is close by.
    fn can_resolve(&self, context: &Context<'_>, r: &Bundle) -> bool {
        let floor_m = NEAR_FLOOR * context.tolerances.min_element_m;
        r.as_element().is_none_or(|n| n.name.depth() < MAX_DEPTH && !is_smallest(n, floor_m))
    }

    fn verdict(
        &self,
        context: &Context<'_>,
        r: &Bundle,
        worth: &Worth,
        has_counted: bool,
    ) -> Verdict {
        let tolerances = &context.tolerances;
        let floor_m2 = tolerances.min_element_m * tolerances.min_element_m;
        let matters = |error: f64| {
            let excess = error / tolerances.row_w_m2;
            excess > 1.0 && excess * r.area_m2 > floor_m2
        };
        let can_split = r.as_element().is_none_or(|n| n.name.depth() < MAX_DEPTH && !is_smallest(n, tolerances.min_element_m));
        if can_split && matters(worth.gradient) {
            return Verdict::Split;
        }
        if !has_counted || !matters(worth.noise / NOISE_SHARE) {
            return Verdict::Keep(RAYS.0);
        }
        let excess = worth.noise / (NOISE_SHARE * tolerances.row_w_m2);
        Verdict::Keep(((RAYS.0 as f64 * excess * excess).ceil() as u64).next_power_of_two().min(RAYS.1))
    }

    /// Casts `target` rays from a node.
    fn cast(&mut self, context: &Context<'_>, r: &Bundle, region: Option<&Region>, target: u64, salt: u64) -> Cast {
        let mut cast = Cast { met: Vec::new(), open: [0; 4], covered: [0; 4], index: 0 };
        let scene = context.cuts.scene();
        let sequence = Sequence::new(mix(context.seed ^ mix(r.name.0)) ^ salt);
        let size_m = r.as_element().map_or(r.radius_m, |n| n.shape.longest_edge());
        let quarters = r.as_element().map(|n| std::array::from_fn::<_, 4, _>(|q| quadtree::child(&n.shape, q as u32)));
        while cast.rays() < target && cast.index < 4 * target {
            let [a, b, c, d] = sequence.point(cast.index);
            let quarter = (cast.index % 4) as usize;
            cast.index += 1;
            let (side, from) = match &quarters {
                Some(shapes) => (&r.sides()[0], shapes[quarter].point(a, b)),
                None => {
                    let (side, along) = r.draw((quarter as f64 + a) / 4.0);
                    (side, side.node.shape.point(along, b))
                }
            };
            if region.is_some_and(|region| !region.holds(scene, from)) {
                continue;
            }
            let direction = cosine_direction(side.node.normal, c, d);
            self.counts.rays += 1;
            let hit = match scene.nearest(from, direction, Some(&side.node.end)) {
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
            let cosine = direction.dot(hit.normal).abs().max(0.05);
            cast.met.push(Met {
                cluster: ClusterId(hit.key.cluster),
                side: PatchSide { patch: hit.key.patch as u8, side: u8::from(!hit.front) },
                point: from + direction * hit.t,
                view_m2: std::f64::consts::PI * hit.t * hit.t / cosine,
                is_near: hit.t < 0.5 * size_m,
                quarter,
            });
        }
        cast
    }
}

/// Rays that decide what is done tell nothing of the light: kept where few bright places were met and cast anew
/// where many were, they would make all rows too dark.
const PILOT: u64 = 0x7069_6c6f_7400_0000;
const FINAL: u64 = 0x7375_7276_6579_0000;

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

/// A link of the rays that decide, as it is stored: it carries nothing.
fn as_pilot(link: &Link) -> Link {
    Link { form_factor: 0.0, uncertainty: link.form_factor, ..*link }
}

/// What [`as_pilot`] stored.
fn of_pilot(link: &Link) -> Link {
    let share = f64::from(link.uncertainty);
    Link { form_factor: link.uncertainty, uncertainty: counted_error(share, RAYS.0 as f64) as f32, ..*link }
}

/// Standard error of a share of `rays` rays: one of all may as well have been none or two.
fn counted_error(share: f64, rays: f64) -> f64 {
    (share * (1.0 - share).max(1.0 / rays) / rays).sqrt()
}

/// Adds sides that many rays met and that the node sees whole.
fn find_whole(context: &Context<'_>, r: &Node, cast: &Cast, whole: &mut Vec<NodeName>) -> Result<()> {
    let mut met: Vec<NodeName> = cast.met.iter().map(|m| NodeName::root(m.cluster, m.side)).collect();
    met.sort_unstable();
    for run in met.chunk_by(|a, b| a == b).filter(|run| run.len() >= MANY) {
        let root = run[0];
        let loaded = context.clusters.cluster(root.cluster())?;
        let view = loaded.view();
        if !view.takes_part(root.patch_side().index()) || view.emits(root) || whole.contains(&root) {
            continue;
        }
        if sees_whole(context.cuts, r, &node_of(&view, root)) {
            whole.push(root);
        }
    }
    whole.sort_unstable();
    Ok(())
}

/// Adds links by the closed form to a source that is seen whole, child by child where its light varies.
fn add_closed(context: &Context<'_>, view: &ClusterView<'_>, r: &Node, s: &Node, row: &mut Lit) {
    if !r.faces(s, context.cuts.scene().snap_m() * 1e-3) {
        return;
    }
    let source = view.source(s.name);
    let allowed = context.tolerances.row_w_m2 / source.radiosity.max().max(context.tolerances.row_w_m2);
    let tolerance = (0.1 * allowed).clamp(1e-6, FORM_FACTOR_TOLERANCE);
    let open = form_factor::average(&r.shape, r.normal, &s.shape, s.normal, tolerance);
    if open.mean <= 0.0 {
        return;
    }
    let error = closed_error(r, s, open.mean, source.spread);
    if source.divided && error > context.tolerances.of_link(open.mean) {
        for quarter in 0..4 {
            add_closed(context, view, r, &s.child(quarter), row);
        }
        return;
    }
    let seen: [f64; 4] = std::array::from_fn(|q| {
        form_factor::at_point(quadtree::child(&r.shape, q as u32).centroid(), r.normal, &s.shape, s.normal)
    });
    let mean = seen.iter().sum::<f64>() / 4.0;
    let spread = pack_quarters(seen.map(|x| if mean > 0.0 { x / mean } else { 1.0 }));
    let (form_factor, uncertainty) = (open.mean as f32, open.error as f32);
    row.push((Link { source: s.name, form_factor, spread, uncertainty, class: Visibility::Surveyed }, source.radiosity));
}

/// Error from the light of a source that is not the same all over.
fn closed_error(r: &Node, s: &Node, form_factor: f64, spread: f64) -> f64 {
    SOURCE_SIGN * form_factor * spread * variation(r, s, Visibility::Visible)
}

/// Whether most rays of a node meet darkness and the others do not: some of its sides may be sealed, and what
/// arrives at the others would be lost in the mean.
fn is_partly_dark(row: &Lit, cast: &Cast, tolerances: &Tolerances) -> bool {
    let lit: f64 = row.iter().filter(|(_, b)| !b.is_black()).map(|(link, _)| f64::from(link.form_factor)).sum();
    let escaped = 1.0 - cast.met.len() as f64 / cast.rays().max(1) as f64;
    lit > 0.0 && lit < 0.5 * (1.0 - escaped) && worth(row).irradiance > DARK * tolerances.row_w_m2
}

/// What a receiver's mean hides: parts of it that something close by shades from what the others see, W/m2. They
/// may be spread evenly over its quarters.
fn unresolved(row: &[(Link, Rgb)], near: &[f64], worth: &Worth) -> f64 {
    let all: f64 = near.iter().sum();
    let differs = |(near, (_, radiosity)): (&f64, &(Link, Rgb))| near * (*radiosity - worth.mean).norm_squared().sqrt();
    near.iter().zip(row).map(differs).sum::<f64>() * (1.0 - all).max(0.0)
}

/// Adds links to what rays met, but for emitters and sides in `whole`. Returns how much of each is near.
fn add_counted(
    context: &Context<'_>,
    cast: &Cast,
    whole: &[NodeName],
    row: &mut Lit,
) -> Result<Vec<f64>> {
    let rays = cast.rays() as f64;
    let mut near = Vec::new();
    let mut met: Vec<(NodeName, usize, bool)> = Vec::with_capacity(cast.met.len());
    for m in &cast.met {
        let loaded = context.clusters.cluster(m.cluster)?;
        let view = loaded.view();
        let root = NodeName::root(m.cluster, m.side);
        if !view.takes_part(m.side.index()) || view.emits(root) || whole.binary_search(&root).is_ok() {
            continue;
        }
        met.push((cell(&view, m, CELL * m.view_m2 / rays), m.quarter, m.is_near));
    }
    met.sort_unstable();
    for run in met.chunk_by(|a, b| a.0 == b.0) {
        let (source, count) = (run[0].0, run.len() as f64);
        let share = count / rays;
        let relative = std::array::from_fn(|q| {
            let here = run.iter().filter(|m| m.1 == q).count() as f64;
            here / cast.open[q].max(1) as f64 / share
        });
        let uncertainty = counted_error(share, rays) as f32;
        let link = Link {
            source,
            form_factor: share as f32,
            spread: pack_quarters(relative),
            uncertainty,
            class: Visibility::Surveyed,
        };
        near.push(run.iter().filter(|m| m.2).count() as f64 / rays);
        row.push((link, context.clusters.cluster(source.cluster())?.view().source(source).radiosity));
    }
    Ok(near)
}

/// The node round a place that was met whose area is about `cell_m2`.
fn cell(view: &ClusterView<'_>, met: &Met, cell_m2: f64) -> NodeName {
    let patch = &view.geometry.patches[usize::from(met.side.patch)];
    let root = NodeName::root(met.cluster, met.side);
    let mut area_m2 = f64::from(patch.area_m2);
    let mut element = Node::root(view.id, patch, met.side);
    let mut is_divided = view.light.has_children(root);
    while (area_m2 > cell_m2 || is_divided) && element.name.depth() < MAX_DEPTH {
        element = element.child(quadtree::child_at(&element.shape, met.point));
        area_m2 *= 0.25;
        is_divided = is_divided && view.light.has_children(element.name);
    }
    element.name
}
