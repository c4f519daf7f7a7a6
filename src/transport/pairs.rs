//! Pairs of patch sides: where few are in sight each receiver is linked to each of them.

use std::collections::HashSet;

use super::bundle::Bundle;
use super::refine::{Context, Receiver, side_key};
use super::sight::Known;
use super::source::ClusterView;
use crate::base::{ClusterId, Error, NodeName, PatchSide, Result};
use crate::model::links::Visibility;
use crate::rays::node::Node;

/// Patch sides to be linked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sources {
    /// Those that emit.
    Emitting,
    /// Those that light leaves now.
    Lit,
    /// All others.
    Dark,
}

impl Sources {
    fn hold(self, view: &ClusterView<'_>, root: NodeName) -> bool {
        match self {
            Self::Emitting => view.emits(root),
            Self::Lit => !view.source(root).radiosity.is_black(),
            Self::Dark => view.source(root).radiosity.is_black(),
        }
    }
}

impl Receiver<'_> {
    /// Patch sides that any link of each receiver side leads to, surveyed ones left out: (receiver side index, source
    /// side).
    pub(super) fn linked_sides(&self, context: &Context<'_>) -> Result<HashSet<(usize, u64)>> {
        let mut linked = HashSet::new();
        for (element, row) in self.mesh.elements.iter().zip(&self.rows[self.mesh.sectors.len()..]) {
            let at = element.name.patch_side().index();
            for link in row.iter().filter(|link| link.class != Visibility::Surveyed) {
                if link.source.is_sector() {
                    let loaded = context.clusters.cluster(link.source.cluster())?;
                    let lamp = Bundle::of(context.sides, &loaded.view(), link.source);
                    linked.extend(lamp.sides().iter().map(|s| (at, side_key(s.node.name))));
                } else {
                    linked.insert((at, side_key(link.source)));
                }
            }
        }
        Ok(linked)
    }

    /// Patch sides that light reaches or leaves.
    pub(super) fn sides_that_matter(&self) -> Vec<bool> {
        // Emitters need whole rows even where nothing lights them: what they see tells what escapes.
        let mut lit: Vec<bool> = self.view.materials.iter().map(|m| m.exitance != [0.0; 3]).collect();
        for (element, row) in self.mesh.elements.iter().zip(&self.rows[self.mesh.sectors.len()..]) {
            if row.iter().any(|l| l.form_factor > 0.0) {
                lit[element.name.patch_side().index()] = true;
            }
        }
        lit
    }

    /// Links the `chosen` of a cluster's `sides` to what they are not linked to yet.
    pub(super) fn link_sources(
        &mut self,
        context: &Context<'_>,
        visible: &[ClusterId],
        sides: &[Node],
        chosen: &[usize],
        linked: &mut HashSet<(usize, u64)>,
        which: Sources,
    ) -> Result<()> {
        if chosen.is_empty() {
            return Ok(());
        }
        let slack = context.scene.snap_m();
        for &id in visible {
            if context.progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let loaded = context.clusters.cluster(id)?;
            let view = loaded.view();
            for index in 0..2 * view.geometry.patches.len() {
                let at = PatchSide::from_index(index);
                let name = NodeName::root(id, at);
                if !view.takes_part(index) || !which.hold(&view, name) {
                    continue;
                }
                let s = Node::root(id, &view.geometry.patches[usize::from(at.patch)], at);
                for &i in chosen {
                    let r = &sides[i];
                    let r_side = r.name.patch_side().index();
                    if r.end.face.key == s.end.face.key
                        || !r.faces(&s, slack)
                        || !linked.insert((r_side, side_key(name)))
                    {
                        continue;
                    }
                    self.link(context, &view, r_side, r, &s, &Known::stored(Visibility::Partial));
                }
            }
        }
        Ok(())
    }
}
