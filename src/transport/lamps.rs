//! Many emitters as one source: a sector node all of whose sides emit alike.
//!
//! A tube of forty facets, or a ceiling of tubes, would else be looked at facet by facet by every receiver. Form
//! factors are exact, summed over the sides; rays go to all of them in proportion to area.

use std::collections::HashSet;

use super::bundle::{Bundle, SideCache};
use super::form_factor;
use super::oracle::{self, Verdict};
use super::refine::{Context, PARTIAL_VARIATION, Receiver, side_key};
use super::sight::{self, Care, Sight};
use super::source::ClusterView;
use crate::base::{ClusterId, Error, NodeName, Result};
use crate::geom::quadtree;
use crate::geom::sequence::{Sequence, mix};
use crate::model::links::Visibility;
use crate::rays::node::Node;

/// The largest sector nodes of a cluster all of whose sides emit alike, and emitting sides that have none.
#[must_use]
pub fn of(sides: &SideCache, view: &ClusterView<'_>) -> Vec<Bundle> {
    let mut lamps = Vec::new();
    let tops = view.geometry.sectors.iter().filter(|s| s.tree_node == 0);
    let mut open: Vec<NodeName> = tops.map(|s| s.node()).collect();
    while let Some(name) = open.pop() {
        let bundle = Bundle::of(sides, view, name);
        let exitance = |side: &NodeName| view.materials[side.patch_side().index()].exitance;
        let first = exitance(&bundle.sides()[0].node.name);
        if bundle.sides().iter().all(|side| exitance(&side.node.name) == first) {
            if first != [0.0; 3] {
                lamps.push(bundle);
            }
        } else {
            open.extend(bundle.children(view));
        }
    }
    lamps.sort_by_key(|lamp| lamp.name);
    lamps
}

impl Receiver<'_> {
    /// Links every side to the lamps that are not among its `linked`.
    pub(super) fn link_lamps(
        &mut self,
        context: &Context<'_>,
        visible: &[ClusterId],
        sides: &[Node],
        linked: &mut HashSet<(usize, u64)>,
    ) -> Result<()> {
        for &id in visible {
            if context.progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let loaded = context.clusters.cluster(id)?;
            let view = loaded.view();
            if view.materials.iter().all(|m| m.exitance == [0.0; 3]) {
                continue;
            }
            for lamp in of(context.sides, &view) {
                for r in sides {
                    self.link_unlinked(context, &view, r, &lamp, linked);
                }
            }
        }
        Ok(())
    }

    /// Links a receiving side to a lamp, or to those parts of it that it is not linked to.
    fn link_unlinked(
        &mut self,
        context: &Context<'_>,
        view: &ClusterView<'_>,
        r: &Node,
        lamp: &Bundle,
        linked: &mut HashSet<(usize, u64)>,
    ) {
        let at = r.name.patch_side().index();
        let known = |linked: &HashSet<(usize, u64)>, s: &Node| linked.contains(&(at, side_key(s.name)));
        let count = lamp.sides().iter().filter(|s| known(linked, &s.node)).count();
        if count == 0 {
            linked.extend(lamp.sides().iter().map(|s| (at, side_key(s.node.name))));
            self.link_lamp(context, view, at, r, lamp);
        } else if count < lamp.sides().len() {
            for name in lamp.children(view) {
                self.link_unlinked(context, view, r, &Bundle::of(context.sides, view, name), linked);
            }
        }
    }

    /// Links `r` (element `at` of the mesh) to a lamp, as finely as the oracle asks for.
    fn link_lamp(&mut self, context: &Context<'_>, view: &ClusterView<'_>, at: usize, r: &Node, lamp: &Bundle) {
        if let Some(s) = lamp.as_element() {
            if r.end.face.key != s.end.face.key {
                self.link(context, view, at, r, s, &sight::Known::stored(Visibility::Partial));
            }
            return;
        }
        if r.shape.centre().distance(lamp.centre) < lamp.radius_m {
            return self.link_parts(context, view, at, r, lamp);
        }
        let source = view.source(lamp.name);
        let strength = self.strength(at, source.radiosity);
        let case = self.case(at, r, PARTIAL_VARIATION);
        let care = Care {
            allowed: context.tolerances.row_w_m2 / strength,
            can_split: oracle::can_split(&case, &context.tolerances, 2.0),
            seed: context.seed,
            tries: None,
        };
        let judge = |found: &Sight| oracle::judge(found, strength, &source, &case, &context.tolerances);
        let Some((found, verdict)) = look(context, r, lamp, care, &judge, &mut self.counts.rays) else { return };
        self.counts.evaluated += 1;
        match verdict {
            Verdict::Keep => self.keep(self.position(at), lamp.name, &found),
            Verdict::SplitReceiver => self.link_quarters(context, view, at, r, lamp),
            Verdict::SplitSource => self.link_parts(context, view, at, r, lamp),
        }
    }

    pub(super) fn link_parts(
        &mut self,
        context: &Context<'_>,
        view: &ClusterView<'_>,
        at: usize,
        r: &Node,
        lamp: &Bundle,
    ) {
        for name in lamp.children(view) {
            self.link_lamp(context, view, at, r, &Bundle::of(context.sides, view, name));
        }
    }

    pub(super) fn link_quarters(
        &mut self,
        context: &Context<'_>,
        view: &ClusterView<'_>,
        at: usize,
        r: &Node,
        lamp: &Bundle,
    ) {
        self.split(at);
        let first = self.mesh.elements[at].first_child as usize;
        for quarter in 0..4u32 {
            self.link_lamp(context, view, first + quarter as usize, &r.child(quarter), lamp);
        }
    }
}

/// What `r` sees of a lamp, by rays of its own where it is kept (see [`sight::look`]); `None` if no side faces it.
fn look(
    context: &Context<'_>,
    r: &Node,
    lamp: &Bundle,
    care: Care,
    judge: &dyn Fn(&Sight) -> Verdict,
    rays: &mut u64,
) -> Option<(Sight, Verdict)> {
    let slack = context.scene.snap_m();
    let tolerance = care.tolerance(lamp.area_m2, r.shape.centre().distance_squared(lamp.centre));
    let share = tolerance / (lamp.sides().len() as f64).sqrt();
    let mut clear = Sight { form_factor: 0.0, spread: 0.0, uncertainty: 0.0, class: Visibility::Partial };
    let mut is_faced = false;
    for side in lamp.sides().iter().filter(|side| r.faces(&side.node, slack)) {
        is_faced = true;
        let open = form_factor::average(&r.shape, r.normal, &side.node.shape, side.node.normal, share);
        clear.form_factor += open.mean;
        clear.spread += (open.high - open.mean).max(open.mean - open.low);
        clear.uncertainty += open.error;
    }
    if !is_faced {
        return None;
    }
    Some(sight::judged(care, judge, |care| sample(context, r, lamp, &clear, care, rays)))
}

/// A sight by rays, and how many places were tried.
fn sample(context: &Context<'_>, r: &Node, lamp: &Bundle, clear: &Sight, care: Care, rays: &mut u64) -> (Sight, u64) {
    let quarters: [_; 4] = std::array::from_fn(|q| quadtree::quarter(&r.shape, q as u32));
    let sequence = Sequence::new(mix(care.seed ^ mix(r.name.0)) ^ lamp.name.0);
    let softening = 2e-3 * lamp.area_m2 / lamp.sides().len() as f64;
    sight::cast(care, clear, |index, tally| {
        let [a, b, c, d] = sequence.point(index);
        let quarter = (index % 4) as usize;
        let from = quarters[quarter].point(a, b);
        let (side, along) = lamp.draw(c);
        let to = side.node.shape.point(along, d);
        let between = to - from;
        let (cos_r, cos_s) = (r.normal.dot(between), -side.node.normal.dot(between));
        if cos_r <= 0.0 || cos_s <= 0.0 {
            return;
        }
        let distance_squared = between.length_squared();
        let weight = cos_r * cos_s / (distance_squared * (distance_squared + softening));
        *rays += 1;
        tally.add(quarter, weight, !context.scene.blocked(from, to, &r.end, &side.node.end, &None));
    })
}
