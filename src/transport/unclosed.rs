//! Rows that do not close.
//!
//! The oracle takes errors of a row's links for independent. Where clutter stands before a receiver they are
//! not: links of nodes above err all by the same shadow, each by what it may, together by most of a row. A
//! leaf whose row stays short of 1 tells so. Links that lead to it from above, as far as something stands in
//! between, then go to children instead, a level each time.

use super::refine::{Context, Receiver, node};
use super::sight::Known;
use crate::base::{Error, Result};
use crate::model::geometry::NONE;
use crate::model::links::Visibility;
use crate::rays::node::Node;

impl Receiver<'_> {
    /// Splits at the receiver what leads from above to leaves whose rows lack `unlinked` (by position in the
    /// mesh, 0..=1) of what they see.
    pub fn split_unclosed(&mut self, context: &Context<'_>, unlinked: &[f64]) -> Result<()> {
        let mut is_short = vec![false; unlinked.len()];
        for (leaf, gap) in unlinked.iter().enumerate().filter(|(_, gap)| **gap > 0.0) {
            let mut light = self.mesh.elements[leaf].irradiance.max();
            let mut above = Vec::new();
            let mut at = self.mesh.elements[leaf].parent;
            while at != NONE {
                light = light.max(self.mesh.elements[at as usize].irradiance.max());
                above.push(at as usize);
                at = self.mesh.elements[at as usize].parent;
            }
            if gap * light > context.tolerances.row_w_m2 {
                above.into_iter().for_each(|at| is_short[at] = true);
            }
        }
        // From below upwards: what goes down a level stays there this time.
        for at in (0..is_short.len()).rev().filter(|at| is_short[*at]) {
            if context.progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let name = self.mesh.elements[at].name;
            let r = Node::at(self.view.id, &self.view.geometry.patches[usize::from(name.patch_side().patch)], name);
            for link in std::mem::take(&mut self.rows[at]) {
                if link.class != Visibility::Partial || super::refine::sight_of(&link).withheld() > 0.0 {
                    self.rows[at].push(link);
                    continue;
                }
                self.changed[at] = true;
                let loaded = context.clusters.cluster(link.source.cluster())?;
                let view = loaded.view();
                let s = node(&view, link.source);
                self.link_children(context, &view, at, &r, &s, &Known::stored(link.class));
            }
        }
        Ok(())
    }
}
