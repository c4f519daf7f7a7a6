//! Sealed leaves: those that see nothing lit.
//!
//! Links between coarse nodes carry means, also over what lies inside and outside of a closed place. So no
//! light gets to a leaf that sees none itself: its rays meet dark surfaces alone, and no emitter is linked
//! to it. Links with emitters are exact enough to be believed: see [`super::oracle`].

use std::collections::HashSet;

use super::link_rows::Link;
use super::mesh::Mesh;
use super::refine::{Context, Receiver, Scope};
use super::sectors::{bring_down, sum_up};
use super::sight::smallest_region;
use super::source::{ClusterView, Clusters};
use crate::base::name::MAX_DEPTH;
use crate::base::{ClusterId, NodeName, Result};
use crate::geom::sequence::{Sequence, cosine_direction, mix};
use crate::model::geometry::NONE;
use crate::model::light::NEVER;
use crate::model::links::Visibility;
use crate::rays::node::Node;
use crate::rays::region::Cuts;
use crate::rays::traverse::{Hit, Nearest};

/// Rays of a leaf that seems to be sealed. One that sees as little as a thirtieth of what is lit is found out
/// with 9 of 10; the others when what they see is lit in turn.
const RAYS: u64 = 64;

/// Keeps these rays apart from others of the same leaf.
const SALT: u64 = 0x5ea1;
const OPEN_SALT: u64 = 0x09e4;

/// Leaves that see nothing lit.
pub struct Sealed {
    /// Their names.
    pub leaves: HashSet<NodeName>,
    /// What was lit when they were asked, or [`NEVER`]: see [`crate::model::light::LightHead`].
    pub seen: u32,
}

impl Receiver<'_> {
    /// The leaves that light is linked to and that see none of it. Those that `was_sealed` before see none as long as
    /// no other place in sight is lit.
    pub fn sealed_leaves(
        &mut self,
        context: &Context<'_>,
        visible: &[ClusterId],
        was_sealed: impl Fn(NodeName) -> bool,
    ) -> Result<Sealed> {
        let mut sealed = HashSet::new();
        // Where lights alone are sources, other links may be there from before: after a lamp has changed.
        let by_rays = context.scope == Scope::Everything || self.surveys;
        let seen = if by_rays { lit_in_sight(context.clusters, visible)? } else { NEVER };
        let is_known = by_rays && seen == self.view.light.head.seen;
        let sectors = self.mesh.sectors.len();
        let has_links = |rows: &[Vec<Link>], at: usize, surveys_too: bool| {
            let counts = |link: &Link| link.form_factor > 0.0 && (surveys_too || link.class != Visibility::Surveyed);
            rows[at].iter().any(counts)
        };
        // Whether light arrives at anything above.
        let by_sectors = (0..sectors).map(|at| has_links(&self.rows, at, true)).collect();
        let mut linked = bring_down(&self.mesh, by_sectors, |own, above| own || above);
        let mut lit_by_emitters = vec![None; self.mesh.elements.len()];
        for at in 0..self.mesh.elements.len() {
            let element = self.mesh.elements[at];
            // A leaf's own survey meets what the leaf sees.
            linked[at] |= has_links(&self.rows, sectors + at, !element.is_leaf() || !by_rays);
            if !linked[at] {
                continue;
            }
            if !element.is_leaf() {
                let first = element.first_child as usize;
                linked[first..first + 4].fill(true);
                continue;
            }
            let was_lit = self.view.light.find(element.name).is_some_and(|e| e.irradiance != [0.0; 3]);
            if by_rays && was_lit {
                continue;
            }
            let patch = &self.view.geometry.patches[usize::from(element.name.patch_side().patch)];
            let leaf = Node::at(self.view.id, patch, element.name);
            let may_see = by_rays && !(is_known && was_sealed(element.name));
            let sees_light = may_see && sees_light(context, &leaf, &mut self.counts.rays)?;
            if !sees_light && !self.is_lit_by_an_emitter(context, at, &mut lit_by_emitters)? {
                sealed.insert(element.name);
            }
        }
        Ok(Sealed { leaves: sealed, seen })
    }

    /// Splits a cut element that light reaches down to elements that lie on one side of what cuts it, so that
    /// each can be told whether it is sealed.
    pub(super) fn split_along_cuts(&mut self, context: &Context<'_>, at: usize, r: &Node) {
        if std::mem::replace(&mut self.followed[at], true) {
            return;
        }
        self.find_out_whether_cut(context, at, r);
        let has_levels = r.name.depth() < MAX_DEPTH && !r.is_smallest(context.tolerances.min_element_m);
        if self.cut[at] != Some(true) || !has_levels {
            return;
        }
        self.split(at);
        let first = self.mesh.elements[at].first_child as usize;
        for quarter in 0..4u32 {
            self.split_along_cuts(context, first + quarter as usize, &r.child(quarter));
        }
    }

    /// Whether an element or one above it is linked to an emitter; what has been asked is in `known`.
    fn is_lit_by_an_emitter(&mut self, context: &Context<'_>, at: usize, known: &mut [Option<bool>]) -> Result<bool> {
        if let Some(is_lit) = known[at] {
            return Ok(is_lit);
        }
        let parent = self.mesh.elements[at].parent;
        // Links of elements that do not follow cuts tell nothing of the parts.
        let above_tells = parent != NONE && !self.surveys;
        let position = self.position(at);
        let mut is_lit = above_tells && self.is_lit_by_an_emitter(context, parent as usize, known)?;
        for link in self.rows[position].iter().filter(|link| link.form_factor > 0.0) {
            if is_lit {
                break;
            }
            is_lit = context.sources.source(context.clusters, link.source)?.emits;
        }
        known[at] = Some(is_lit);
        Ok(is_lit)
    }
}

/// What light that reaches each node (by position) is multiplied by on its way down, since none of it goes to
/// the sealed leaves below: area over area that is not sealed.
#[must_use]
pub fn lift(mesh: &Mesh, is_sealed: impl Fn(NodeName) -> bool) -> Vec<f64> {
    let mut open_m2: Vec<f64> =
        (mesh.elements.iter()).map(|e| if e.is_leaf() && !is_sealed(e.name) { e.area_m2 } else { 0.0 }).collect();
    let mut lift = vec![1.0; open_m2.len()];
    for at in (0..open_m2.len()).rev() {
        let element = &mesh.elements[at];
        if !element.is_leaf() {
            let first = element.first_child as usize;
            let (open, area) = (first..first + 4)
                .fold((0.0, 0.0), |(open, area), child| (open + open_m2[child], area + mesh.elements[child].area_m2));
            open_m2[at] = open;
            lift[at] = if open > 0.0 { area / open } else { 1.0 };
        }
    }
    let open_sectors_m2 = sum_up(mesh, |root| open_m2[root]);
    let above = mesh.sectors.iter().zip(open_sectors_m2);
    above.map(|(s, open)| if open > 0.0 { s.area_m2 / open } else { 1.0 }).chain(lift).collect()
}

/// Tells which places light leaves that a cluster may see: see [`crate::model::light::LightHead`].
fn lit_in_sight(clusters: &dyn Clusters, visible: &[ClusterId]) -> Result<u32> {
    let mut sum = 0;
    for &id in visible {
        sum = mix(sum ^ u64::from(clusters.cluster(id)?.view().light.head.lit));
    }
    Ok((sum as u32).max(NEVER + 1))
}

fn sees_light(context: &Context<'_>, leaf: &Node, rays: &mut u64) -> Result<bool> {
    let cuts = context.cuts;
    let region = smallest_region(cuts, leaf);
    let sequence = Sequence::new(mix(context.seed ^ mix(leaf.name.0)) ^ SALT);
    let mut cast = 0;
    for i in 0..4 * RAYS {
        let [a, b, c, d] = sequence.point(i);
        let from = leaf.shape.point(a, b);
        if region.is_some_and(|region| !region.holds(cuts.scene(), from)) {
            continue;
        }
        let direction = cosine_direction(leaf.normal, c, d);
        (cast, *rays) = (cast + 1, *rays + 1);
        if let Nearest::Met(hit) = cuts.scene().nearest(from, direction, Some(&leaf.end)) {
            let cluster = context.clusters.cluster(ClusterId(hit.key.cluster))?;
            if is_lit(cuts, &cluster.view(), &hit, from + direction * hit.t) {
                return Ok(true);
            }
        }
        if cast == RAYS {
            break;
        }
    }
    Ok(false)
}

/// Share of a leaf that light reaches, where it stands for its largest part alone: the rest may be hidden in what
/// stands there, and neither gets nor sends any.
pub fn open_share(cuts: &Cuts<'_>, clusters: &dyn Clusters, leaf: &Node, seed: u64) -> Result<f64> {
    if leaf.name.depth() > 0 {
        return Ok(1.0);
    }
    let Some(region) = smallest_region(cuts, leaf) else { return Ok(1.0) };
    let sequence = Sequence::new(mix(seed ^ mix(leaf.name.0)) ^ OPEN_SALT);
    let mut open = 0;
    for i in 0..RAYS {
        let [a, b, c, d] = sequence.point(i);
        let from = leaf.shape.point(a, b);
        let direction = cosine_direction(leaf.normal, c, d);
        let is_open = region.holds(cuts.scene(), from)
            || match cuts.scene().nearest(from, direction, Some(&leaf.end)) {
                Nearest::Escaped => true,
                Nearest::Covered => false,
                Nearest::Met(hit) => {
                    let cluster = clusters.cluster(ClusterId(hit.key.cluster))?;
                    is_lit(cuts, &cluster.view(), &hit, from + direction * hit.t)
                }
            };
        open += u64::from(is_open);
    }
    Ok(open as f64 / RAYS as f64)
}

/// Whether light leaves the place that a ray met: a leaf stands for the part that holds its anchor.
fn is_lit(cuts: &Cuts<'_>, view: &ClusterView<'_>, hit: &Hit, point: glam::DVec3) -> bool {
    let at = hit.side();
    if !view.takes_part(at.index()) {
        return false;
    }
    let leaf = view.leaf_at(at, point);
    if view.source(leaf.name).radiosity.is_black() {
        return false;
    }
    smallest_region(cuts, &leaf).is_none_or(|region| region.holds(cuts.scene(), point))
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;
    use crate::base::Rgb;
    use crate::model::links::LeafClosure;
    use crate::transport::push_pull::{Gathered, factors, push_pull};

    #[test]
    fn light_from_above_goes_to_leaves_that_are_not_sealed_and_keeps_its_power() {
        let (mut mesh, patch) = Mesh::of_square(Rgb::BLACK);
        let root = mesh.elements[0].name;
        mesh.split(0, &patch);
        let open = LeafClosure { own_scale: 1.0, above_scale: 1.0, ..LeafClosure::zeroed() };
        let closure: Vec<LeafClosure> = (0..4)
            .map(|q| LeafClosure { leaf: root.child(q).0, ..if q == 2 { LeafClosure::zeroed() } else { open } })
            .collect();
        let mut gathered = vec![Gathered::default(); 5];
        gathered[0].add(Rgb::grey(0.6), 0.5, 0.0);
        let lift = lift(&mesh, |leaf| leaf == root.child(2));
        let factors = factors(&mesh, lift, &closure);
        push_pull(&mut mesh, &gathered, &factors);
        assert_eq!(mesh.elements[3].irradiance, Rgb::BLACK);
        assert!((mesh.elements[1].irradiance.max() - 0.4).abs() < 1e-12);
        assert!((mesh.elements[0].irradiance.max() - 0.3).abs() < 1e-12, "the mean of all is what arrived");
    }
}
