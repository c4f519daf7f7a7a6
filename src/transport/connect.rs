//! Links of the upper hierarchy: between sector nodes, and between sector nodes and elements.
//!
//! Pairs begin at the tops of two clusters that may exchange light and go down only where the oracle asks
//! for it: far and dim pairs end where they began. A pair of elements goes on in [`super::refine`].

use std::collections::HashSet;

use super::bundle::Bundle;
use super::bundle_sight::{self, Estimate};
use super::link_rows::Link;
use super::oracle::{self, NEGLIGIBLE, SOURCE_SIGN};
use super::refine::{Context, Receiver, Scope, sight_of};
use super::sight::Known;
use super::source::{ClusterView, SourceLight};
use crate::base::{ClusterId, Error, NodeName, Result, Rgb};
use crate::model::links::Visibility;

/// Which end of a pair is split.
#[derive(Clone, Copy, PartialEq, Eq)]
enum End {
    Receiver,
    Source,
}

/// What becomes of a pair.
enum Outcome {
    Keep(super::sight::Sight),
    Split(End),
}

impl Receiver<'_> {
    /// Links what is not linked yet: lit sources, then dark ones where anything lights the receiver.
    pub(super) fn link_sources(&mut self, context: &Context<'_>, visible: &[ClusterId]) -> Result<()> {
        let tops: Vec<NodeName> = self.mesh.sectors.iter().filter(|s| s.tree_node == 0).map(|s| s.name).collect();
        let mut marks: HashSet<(NodeName, NodeName)> = HashSet::new();
        for (sector, row) in self.mesh.sectors.iter().zip(&self.rows) {
            let is_top = |name: NodeName| name.is_sector() && name.tree_node() == 0;
            if sector.tree_node == 0 {
                marks.extend(row.iter().filter(|l| is_top(l.source)).map(|l| (sector.name, l.source)));
            }
        }
        self.link_tops(context, visible, &tops, &mut marks, true)?;
        if context.scope == Scope::Everything {
            let matter = self.tops_that_matter(&tops);
            self.link_tops(context, visible, &matter, &mut marks, false)?;
        }
        Ok(())
    }

    /// Those that anything lights or that emit: whole rows tell emitters what escapes.
    fn tops_that_matter(&self, tops: &[NodeName]) -> Vec<NodeName> {
        let mut matters = [false; 6];
        for (row, position) in self.rows.iter().zip(0..) {
            if row.iter().any(|l| l.form_factor > 0.0) {
                let name = self.mesh.name_at(position);
                let sector = if name.is_sector() { Some(name) } else { self.top_of_side(name) };
                if let Some(sector) = sector {
                    matters[usize::from(sector.sector_digit())] = true;
                }
            }
        }
        for (side, material) in self.view.materials.iter().enumerate() {
            let above = self.mesh.side_sector[side];
            if material.exitance != [0.0; 3] && above != crate::model::geometry::NONE {
                matters[usize::from(self.mesh.sectors[above as usize].name.sector_digit())] = true;
            }
        }
        tops.iter().copied().filter(|t| matters[usize::from(t.sector_digit())]).collect()
    }

    fn top_of_side(&self, element: NodeName) -> Option<NodeName> {
        let above = self.mesh.side_sector[element.patch_side().index()];
        self.mesh.sectors.get(above as usize).map(|s| s.name)
    }

    fn link_tops(
        &mut self,
        context: &Context<'_>,
        visible: &[ClusterId],
        tops: &[NodeName],
        marks: &mut HashSet<(NodeName, NodeName)>,
        lit: bool,
    ) -> Result<()> {
        let own = self.view;
        let receivers: Vec<Bundle> = tops.iter().map(|t| Bundle::of(context.sides, &own, *t)).collect();
        if receivers.is_empty() {
            return Ok(());
        }
        for &id in visible {
            if context.progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let loaded = context.clusters.cluster(id)?;
            let view = loaded.view();
            for head in view.geometry.sectors.iter().filter(|s| s.tree_node == 0) {
                let name = head.node();
                if view.source(name).radiosity.is_black() == lit {
                    continue;
                }
                let mut source = None;
                for (top, r) in tops.iter().zip(&receivers) {
                    if !marks.insert((*top, name)) {
                        continue;
                    }
                    let s = source.get_or_insert_with(|| Bundle::of(context.sides, &view, name));
                    let position = self.mesh.position(*top);
                    let before = self.rows[position].len();
                    self.connect(context, &view, r, s, Visibility::Partial);
                    let is_kept = self.rows[position][before..].iter().any(|l| l.source == name);
                    if !is_kept {
                        self.rows[position].push(bundle_sight::mark(name));
                        self.changed[position] = true;
                    }
                }
            }
        }
        Ok(())
    }

    /// Links two nodes as finely as the oracle asks for.
    pub(super) fn connect(
        &mut self,
        context: &Context<'_>,
        view: &ClusterView<'_>,
        r: &Bundle,
        s: &Bundle,
        known: Visibility,
    ) {
        if let (Some(rn), Some(sn)) = (r.as_element(), s.as_element()) {
            if rn.end.key != sn.end.key {
                let at = self.mesh.nearest(r.name);
                self.link(context, view, at, rn, sn, &Known::stored(known));
            }
            return;
        }
        // Links with emitters are believed when leaves are sealed: they are made between elements alone.
        if s.sides().iter().any(|side| view.emits(side.node.name)) {
            let end = if s.as_element().is_some() { End::Receiver } else { End::Source };
            self.connect_below(context, view, r, s, end);
            return;
        }
        let Some(estimate) = bundle_sight::estimate(r, s, context.cuts.scene().snap_m() * 1e-3) else { return };
        self.counts.evaluated += 1;
        let source = view.source(s.name);
        match self.judge(context, r, s, &source, &estimate) {
            Outcome::Keep(sight) => {
                self.keep(self.mesh.position(r.name), s.name, &sight);
                if sight.form_factor > 0.0 {
                    for side in r.sides() {
                        self.split_along_cuts(context, self.mesh.nearest(side.node.name), &side.node);
                    }
                }
            }
            Outcome::Split(end) => self.connect_below(context, view, r, s, end),
        }
    }

    fn connect_below(&mut self, context: &Context<'_>, view: &ClusterView<'_>, r: &Bundle, s: &Bundle, end: End) {
        if end == End::Source {
            for name in s.children(view) {
                let child = Bundle::of(context.sides, view, name);
                self.connect(context, view, r, &child, Visibility::Partial);
            }
            return;
        }
        let own = self.view;
        if r.as_element().is_some() {
            self.split(self.mesh.nearest(r.name));
        }
        for name in r.children(&own) {
            let child = Bundle::of(context.sides, &own, name);
            self.connect(context, view, &child, s, Visibility::Partial);
        }
    }

    fn judge(
        &mut self,
        context: &Context<'_>,
        r: &Bundle,
        s: &Bundle,
        source: &SourceLight,
        estimate: &Estimate,
    ) -> Outcome {
        let tolerances = &context.tolerances;
        let light = self.light_of(r);
        let strength = oracle::strength(source.radiosity, light.irradiance, light.spread);
        let distance = r.centre.distance(s.centre);
        let larger = if r.radius_m >= s.radius_m { End::Receiver } else { End::Source };
        if distance <= r.radius_m + s.radius_m {
            return Outcome::Split(self.splittable(context, r, s, larger));
        }
        let source_error = source_error(estimate.form_factor, source, s, distance);
        let receiver_error = 0.5 * estimate.spread * strength;
        let allowed = tolerances.of_link(estimate.form_factor);
        if source_error + receiver_error > allowed {
            let end = if source_error >= receiver_error { End::Source } else { End::Receiver };
            return Outcome::Split(self.splittable(context, r, s, end));
        }
        let enough = allowed / strength.max(f64::MIN_POSITIVE);
        let scene = context.cuts.scene();
        let sight = bundle_sight::look(scene, r, s, estimate, enough, context.seed, &mut self.counts.rays);
        let error = (0.5 * sight.spread + sight.uncertainty) * strength + source_error;
        if error > tolerances.of_link(sight.form_factor + sight.uncertainty)
            && error > negligible_error(tolerances.row_w_m2)
        {
            return Outcome::Split(self.splittable(context, r, s, larger));
        }
        Outcome::Keep(sight)
    }

    /// The end that is wanted, or the other where it has no more levels. A pair that comes here has a sector
    /// node at one end.
    fn splittable(&self, context: &Context<'_>, r: &Bundle, s: &Bundle, wanted: End) -> End {
        match wanted {
            End::Source if s.as_element().is_none() => End::Source,
            End::Source => End::Receiver,
            End::Receiver => {
                let floor = context.tolerances.min_element_m;
                let too_small = |node: &crate::rays::node::Node| {
                    0.5 * node.shape.longest_edge() < floor || node.name.depth() >= crate::base::name::MAX_DEPTH
                };
                if r.as_element().is_some_and(too_small) { End::Source } else { End::Receiver }
            }
        }
    }

    fn light_of(&self, r: &Bundle) -> Light {
        if r.as_element().is_some() {
            let element = &self.mesh.elements[self.mesh.nearest(r.name)];
            return Light { irradiance: element.irradiance, spread: element.spread() };
        }
        let sector = &self.mesh.sectors[self.mesh.position(r.name)];
        Light { irradiance: sector.irradiance, spread: sector.spread() }
    }

    /// Tests a stored link with a sector node at either end; one that does not hold is replaced.
    pub(super) fn test_bundles(
        &mut self,
        context: &Context<'_>,
        view: &ClusterView<'_>,
        position: usize,
        link: &Link,
    ) -> bool {
        let own = self.view;
        let source = view.source(link.source);
        let sight = sight_of(link);
        let (irradiance, spread) = match position.checked_sub(self.mesh.sectors.len()) {
            Some(at) => (self.mesh.elements[at].irradiance, self.mesh.elements[at].spread()),
            None => (self.mesh.sectors[position].irradiance, self.mesh.sectors[position].spread()),
        };
        let strength = oracle::strength(source.radiosity, irradiance, spread);
        let receiver_error = (0.5 * sight.spread + sight.uncertainty) * strength;
        let allowed = context.tolerances.of_link(sight.form_factor + sight.uncertainty);
        if receiver_error + SOURCE_SIGN * sight.form_factor * source.spread <= allowed {
            return true;
        }
        let r = Bundle::of(context.sides, &own, self.mesh.name_at(position));
        let s = Bundle::of(context.sides, view, link.source);
        let error = source_error(sight.form_factor, &source, &s, r.centre.distance(s.centre));
        if receiver_error + error <= allowed {
            return true;
        }
        let wanted = if error >= receiver_error { End::Source } else { End::Receiver };
        let end = self.splittable(context, &r, &s, wanted);
        self.connect_below(context, view, &r, &s, end);
        false
    }
}

struct Light {
    irradiance: Rgb,
    spread: f64,
}

/// Error from the light of a source that is not the same all over.
fn source_error(form_factor: f64, source: &SourceLight, s: &Bundle, distance: f64) -> f64 {
    let variation = (3.0 * s.radius_m / distance.max(f64::MIN_POSITIVE)).min(1.0);
    SOURCE_SIGN * form_factor * source.spread * variation
}

/// An error of one link that no split is worth, W/m2.
fn negligible_error(row_w_m2: f64) -> f64 {
    NEGLIGIBLE * row_w_m2
}
