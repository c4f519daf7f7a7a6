//! Links of the newest version, counted by the level of both ends.

use serde::Serialize;

use crate::base::{NodeName, Result};
use crate::model::links::LinksView;
use crate::store::{Snapshot, Store};
use crate::transport::link_rows;

/// Where a node lies in the hierarchy.
const LEVELS: [&str; 3] = ["sector_node", "patch", "element"];

/// Links between nodes of two levels.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LevelCount {
    /// `sector_node`, `patch` (one of its sides) or `element` (below that).
    pub receiver: &'static str,
    /// The same.
    pub source: &'static str,
    /// Links that carry light.
    pub links: u64,
}

impl LevelCount {
    /// In words.
    #[must_use]
    pub fn line(&self) -> String {
        let word = |level: &str| level.replace('_', " ");
        format!("links from {} to {}: {}", word(self.source), word(self.receiver), self.links)
    }
}

/// Counts the links of the newest version that carry light; levels between which there are none are left out.
pub fn count(store: &Store) -> Result<Vec<LevelCount>> {
    let mut counts = [[0u64; 3]; 3];
    let snapshot = Snapshot::at(store, store.newest_version()?)?;
    for cluster in snapshot.clusters() {
        let chain = snapshot.links(cluster?.id)?;
        let views = chain.iter().map(|extent| extent.parse(LinksView::parse)).collect::<Result<Vec<_>>>()?;
        link_rows::for_each_row(&views, |receiver, view, row| {
            let counts = &mut counts[level(receiver)];
            for link in row.map(|at| link_rows::link_at(view, at)).filter(|link| link.form_factor > 0.0) {
                counts[level(link.source)] += 1;
            }
        });
    }
    let all = (0..3).flat_map(|r| (0..3).map(move |s| (r, s)));
    let counted = all.map(|(r, s)| LevelCount { receiver: LEVELS[r], source: LEVELS[s], links: counts[r][s] });
    Ok(counted.filter(|count| count.links > 0).collect())
}

fn level(name: NodeName) -> usize {
    if name.is_sector() { 0 } else { 1 + usize::from(name.depth() > 0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, PatchSide};

    #[test]
    fn a_side_is_a_patch_and_what_lies_below_it_an_element() {
        let side = NodeName::root(ClusterId(3), PatchSide { patch: 2, side: 1 });
        let levels = [NodeName::sector(ClusterId(3), 5, 1), side, side.child(0), side.child(3).child(2)].map(level);
        assert_eq!(levels, [0, 1, 2, 2]);
    }
}
