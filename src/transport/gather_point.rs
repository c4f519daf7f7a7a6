//! Gather at a point: what arrives at one place of a surface, over the links of the elements that
//! hold it. Form factors and visibility are those of the point, not of the element.

use glam::DVec3;

use super::form_factor;
use super::link_rows::Link;
use super::source::ClusterView;
use crate::base::Rgb;
use crate::geom::sequence::{Sequence, mix};
use crate::model::links::{LeafClosure, Visibility};
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::rays::region::Region;

/// The place: a point on a patch side.
pub struct Place<'a> {
    /// Position, m from the store's origin.
    pub point: DVec3,
    /// The leaf that holds it.
    pub leaf: &'a Node,
    /// Largest channel of the leaf's irradiance, W/m2: rows are closed, so an error in the share of a
    /// dark source is made up by all others.
    pub typical_w_m2: f64,
    /// How its row was closed.
    pub closure: Option<&'a LeafClosure>,
}

/// Sums over links as they are visited.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gathered {
    /// Irradiance before closing, W/m2.
    pub irradiance: Rgb,
    /// Sum of form factors.
    pub row_sum: f64,
}

/// What a source that is cut may leave of the error allowed.
const CUT_SHARE: f64 = 0.02;

/// Rays from a point to one source whose visibility is partial: at least, at most.
const RAYS: (u64, u64) = (16, 1024);

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
    // A source that the point sees in part may be dark where it does not: see `Region`.
    let cut = class != Visibility::Visible || s.shape.corners().iter().any(|c| place.leaf.height(*c) < 0.0);
    let limit = if cut { CUT_SHARE * allowed } else { allowed };
    if source.divided && open * source.spread > limit {
        for quarter in 0..4 {
            add_source(scene, place, view, &s.child(quarter), class, allowed, gathered, rays);
        }
        return;
    }
    let share = if cut {
        let importance = open * (source.radiosity.max() + place.typical_w_m2) / allowed.max(f64::MIN_POSITIVE);
        visible_share(scene, place, s, importance, rays)
    } else {
        1.0
    };
    gathered.irradiance += source.radiosity * (open * share);
    gathered.row_sum += open * share;
}

/// Share of the source that the point sees, weighted by the kernel.
fn visible_share(scene: &RayScene<'_>, place: &Place<'_>, s: &Node, importance: f64, rays: &mut u64) -> f64 {
    let count = (importance * importance).clamp(RAYS.0 as f64, RAYS.1 as f64) as u64;
    let p = place.point;
    let bits = p.x.to_bits() ^ mix(p.y.to_bits() ^ mix(p.z.to_bits()));
    let sequence = Sequence::new(mix(s.name.0) ^ bits);
    let region = Region::of(scene, s);
    let softening = 2e-3 * s.shape.area();
    let (mut all, mut visible) = (0.0, 0.0);
    for index in 0..count {
        let [_, _, c, d] = sequence.point(index);
        let to = s.shape.point(c, d);
        let along = to - p;
        let (cos_r, cos_s) = (place.leaf.normal.dot(along), -s.normal.dot(along));
        if cos_r <= 0.0 || cos_s <= 0.0 {
            continue;
        }
        let distance_squared = along.length_squared();
        let weight = cos_r * cos_s / (distance_squared * (distance_squared + softening));
        all += weight;
        *rays += 1;
        if region.is_none_or(|g| g.holds(scene, to)) && !scene.blocked(p, to, &place.leaf.end, &s.end) {
            visible += weight;
        }
    }
    if all > 0.0 { visible / all } else { 0.0 }
}

/// Irradiance at the place, its row closed as its leaf's was.
///
/// The point's links are all evaluated at the point: what is off is sampled visibility and what lists
/// miss. Where the leaf's row fills the hemisphere the point's must too; elsewhere only a row over 1
/// is certainly wrong.
#[must_use]
pub fn finish(place: &Place<'_>, gathered: &Gathered) -> Rgb {
    let full = place.closure.is_some_and(|c| c.escape == 0.0 && c.unlinked == 0.0 && c.own_sum + c.above_sum > 0.8);
    if gathered.row_sum > 1.0 || (full && gathered.row_sum > 0.8) {
        return gathered.irradiance * (1.0 / gathered.row_sum);
    }
    gathered.irradiance
}
