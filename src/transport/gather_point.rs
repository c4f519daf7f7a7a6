//! Gather at a point: what arrives at one place of a surface, over the links of the elements that
//! hold it. Form factors and visibility are those of the point, not of the element.

use glam::DVec3;

use super::form_factor;
use super::link_rows::Link;
use super::sight::UNANIMOUS;
use super::source::ClusterView;
use crate::base::Rgb;
use crate::geom::polygon::Polygon;
use crate::geom::quadtree;
use crate::geom::sequence::{Sequence, mix, mix_point};
use crate::model::links::Visibility;
use crate::rays::RayScene;
use crate::rays::node::Node;

/// The place: a point on a patch side.
pub struct Place<'a> {
    /// Position, m from the store's origin.
    pub point: DVec3,
    /// The leaf that holds it.
    pub leaf: &'a Node,
    /// Largest channel of the leaf's irradiance, W/m2: rows are closed, so an error in the share of a
    /// dark source is made up by all others.
    pub typical_w_m2: f64,
    /// Share of that which errors of a source's visibility may come to.
    pub relative: f64,
}

/// Sums over links as they are visited.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gathered {
    /// Irradiance before closing, W/m2.
    pub irradiance: Rgb,
    /// Sum of form factors.
    pub row_sum: f64,
    /// The same two with each source's standard error in place of its form factor.
    doubtful_irradiance: Rgb,
    doubt: f64,
    /// Sum of the squares of the standard errors.
    variance: f64,
    /// Largest error relative to its form factor.
    steepest: f64,
}

impl Gathered {
    pub(super) fn add(&mut self, radiosity: Rgb, seen: Seen) {
        self.irradiance += radiosity * seen.form_factor;
        self.row_sum += seen.form_factor;
        if seen.form_factor > 0.0 {
            let error = seen.error.min(seen.form_factor);
            self.doubtful_irradiance += radiosity * error;
            self.doubt += error;
            self.variance += error * error;
            self.steepest = self.steepest.max(error / seen.form_factor);
        }
    }
}

/// Irradiance error of one source's visibility that does not matter, relative to `allowed`.
const POINT_SHARE: f64 = 0.1;

/// Rays to a part of a source whose visibility is partial, and how often it may be quartered.
const RAYS: u64 = 16;
const MOST_DEPTH: u32 = 5;

/// Relative error of a point's form factor to a polygon that it sees whole.
const FLOOR: f64 = 1e-6;

/// What a source that is cut may leave of the error allowed.
const CUT_SHARE: f64 = 0.02;

/// Adds what arrives over one link of an element that holds the place. Sources whose light varies
/// by more than `allowed` W/m2 at the place are taken child by child. Counts rays.
pub fn add_link(
    scene: &RayScene<'_>,
    place: &Place<'_>,
    source_view: &ClusterView<'_>,
    link: &Link,
    allowed: f64,
    gathered: &mut Gathered,
    rays: &mut u64,
) {
    if link.class == Visibility::Hidden {
        return;
    }
    let patch = &source_view.geometry.patches[usize::from(link.source.patch_side().patch)];
    let s = Node::at(source_view.id, patch, link.source);
    add_source(scene, place, source_view, &s, link.class, allowed, gathered, rays);
}

#[allow(clippy::too_many_arguments, reason = "a recursion's state")]
fn add_source(
    scene: &RayScene<'_>,
    place: &Place<'_>,
    view: &ClusterView<'_>,
    s: &Node,
    class: Visibility,
    allowed: f64,
    gathered: &mut Gathered,
    rays: &mut u64,
) {
    if s.height(place.point) <= 0.0 {
        return;
    }
    let open = form_factor::point_to_polygon(place.point, place.leaf.normal, &s.shape);
    if open == 0.0 {
        return;
    }
    let source = view.source(s.name);
    // What hides part of a source hides its dark part: errors of its light count more there.
    let cut = class != Visibility::Visible || s.shape.corners().iter().any(|c| place.leaf.height(*c) < 0.0);
    let limit = if cut { CUT_SHARE * allowed } else { allowed };
    if source.divided && open * source.spread > limit {
        for quarter in 0..4 {
            add_source(scene, place, view, &s.child(quarter), class, allowed, gathered, rays);
        }
        return;
    }
    let seen = if cut {
        // A dim place asks for more than a typical one, to a point.
        let allowed = POINT_SHARE * (place.relative * place.typical_w_m2).clamp(0.1 * allowed, allowed);
        let part = Part { shape: s.shape, open, depth: 0, allowed };
        let strength_w_m2 = source.radiosity.max() + place.typical_w_m2;
        let view = View { scene, place, s, strength_w_m2 };
        view.seen(&part, rays)
    } else {
        Seen { form_factor: open, error: FLOOR * open }
    };
    gathered.add(source.radiosity, seen);
}

/// Form factor of the visible part of a source, and its standard error.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    pub(super) form_factor: f64,
    pub(super) error: f64,
}

/// Part of a source.
struct Part {
    shape: Polygon,
    /// Its form factor from the place, occlusion left out.
    open: f64,
    depth: u32,
    /// Irradiance error that does not matter, W/m2.
    allowed: f64,
}

/// A source from a place.
struct View<'a> {
    scene: &'a RayScene<'a>,
    place: &'a Place<'a>,
    s: &'a Node,
    /// How strongly errors of the form factor act, W/m2.
    strength_w_m2: f64,
}

impl View<'_> {
    /// Casts rays to a part; where only some arrive, to its quarters, so that in the end they tell
    /// where the edge of the shadow runs.
    fn seen(&self, part: &Part, rays: &mut u64) -> Seen {
        let (share, error) = self.visible_share(part, rays);
        let doubt = part.open * error * self.strength_w_m2;
        if part.depth == MOST_DEPTH || doubt <= part.allowed {
            return Seen { form_factor: part.open * share, error: part.open * (error + FLOOR) };
        }
        let (mut sum, mut variance) = (0.0, 0.0);
        for quarter in 0..4 {
            let shape = quadtree::child(&part.shape, quarter);
            let open = form_factor::point_to_polygon(self.place.point, self.place.leaf.normal, &shape);
            if open > 0.0 {
                // The edge runs through about twice as many parts a level, whose errors add as variances.
                let allowed = part.allowed * std::f64::consts::FRAC_1_SQRT_2;
                let seen = self.seen(&Part { shape, open, depth: part.depth + 1, allowed }, rays);
                sum += seen.form_factor;
                variance += seen.error * seen.error;
            }
        }
        Seen { form_factor: sum, error: variance.sqrt() }
    }

    /// Share of a part that the place sees, weighted by the kernel, and its standard error.
    fn visible_share(&self, part: &Part, rays: &mut u64) -> (f64, f64) {
        let p = self.place.point;
        let of_part = mix(mix_point(part.shape.corners()[0]));
        let sequence = Sequence::new(mix(self.s.name.0 ^ of_part) ^ mix_point(p));
        let softening = 2e-3 * part.shape.area();
        let (mut all, mut squares, mut visible) = (0.0, 0.0, 0.0);
        for index in 0..RAYS {
            let [_, _, c, d] = sequence.point(index);
            let to = part.shape.point(c, d);
            let along = to - p;
            let (cos_r, cos_s) = (self.place.leaf.normal.dot(along), -self.s.normal.dot(along));
            if cos_r <= 0.0 || cos_s <= 0.0 {
                continue;
            }
            let distance_squared = along.length_squared();
            let weight = cos_r * cos_s / (distance_squared * (distance_squared + softening));
            all += weight;
            squares += weight * weight;
            *rays += 1;
            if !self.scene.blocked(p, to, &self.place.leaf.end, &self.s.end, &None) {
                visible += weight;
            }
        }
        if all == 0.0 {
            return (0.0, 0.0);
        }
        let (share, effective) = (visible / all, all * all / squares);
        (share, (share * (1.0 - share) / effective).sqrt().max(UNANIMOUS / (effective + 1.0)))
    }
}

/// Irradiance at the place, its row closed.
///
/// The point's links are all evaluated at the point: what is off is sampled visibility and what lists
/// miss. Where the leaf's row fills the hemisphere (`is_full`) the point's must too; elsewhere only a row over 1
/// is certainly wrong. What is added or taken goes to each source by its doubt.
#[must_use]
pub fn finish(gathered: &Gathered, is_full: bool) -> Rgb {
    let wrong = gathered.row_sum > 1.0 || (is_full && gathered.row_sum > 0.8);
    if !wrong {
        return gathered.irradiance;
    }
    let gap = 1.0 - gathered.row_sum;
    // No further than three times the doubt, nor so far that a source turns negative.
    let most = if gap < 0.0 { 1.0 / gathered.steepest.max(1.0 / 3.0) } else { 3.0 };
    let correction = if gathered.doubt > 0.0 { (gap / gathered.doubt).clamp(-most, most) } else { 0.0 };
    let row_sum = gathered.row_sum + correction * gathered.doubt;
    let irradiance = gathered.irradiance + gathered.doubtful_irradiance * correction;
    irradiance * (1.0 / row_sum)
}

/// Irradiance at a place that cast its own rays, its row closed to the share of them that met something. What was
/// gathered `before` those were added errs for itself, so variances share what is off: lamps whose form factors are
/// known well do not pay for how many rays happened to meet the others.
#[must_use]
pub fn finish_surveyed(before: &Gathered, all: &Gathered, met_share: f64) -> Rgb {
    let gap = met_share - all.row_sum;
    let by_before = if all.variance > 0.0 { before.variance / all.variance } else { 0.0 };
    let surveyed = all.row_sum - before.row_sum;
    let factor = |gap: f64, sum: f64| if sum > 0.0 { (1.0 + gap / sum).max(0.0) } else { 0.0 };
    before.irradiance * factor(gap * by_before, before.row_sum)
        + (all.irradiance - before.irradiance) * factor(gap * (1.0 - by_before), surveyed)
}
