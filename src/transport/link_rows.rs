//! Rows of links: in memory while a cluster is refined, and from extents.

use crate::base::NodeName;
use crate::model::links::{LeafClosure, LinksView, Visibility, class_of, index_of};

/// A link of a known receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// Its source.
    pub source: NodeName,
    /// Form factor, visibility included.
    pub form_factor: f32,
    /// Largest deviation of that over the receiver.
    pub spread: f32,
    /// Standard error from sampled visibility.
    pub uncertainty: f32,
    /// What is known of the visibility.
    pub class: Visibility,
}

/// Calls `visit` with the newest row of every receiver of a chain of extents (base first), by name.
pub fn for_each_row(chain: &[LinksView<'_>], mut visit: impl FnMut(NodeName, &LinksView<'_>, std::ops::Range<usize>)) {
    let mut next = vec![0usize; chain.len()];
    loop {
        let least = chain.iter().zip(&next).filter_map(|(view, &n)| view.receivers.get(n)).min();
        let Some(&receiver) = least else { return };
        let mut newest = None;
        for (view, n) in chain.iter().zip(&mut next) {
            if view.receivers.get(*n) == Some(&receiver) {
                newest = Some((view, view.row(*n)));
                *n += 1;
            }
        }
        if let Some((view, row)) = newest
            && !row.is_empty()
        {
            visit(NodeName(receiver), view, row);
        }
    }
}

/// One link of a view.
#[must_use]
pub fn link_at(view: &LinksView<'_>, at: usize) -> Link {
    Link {
        source: NodeName(view.sources[index_of(view.packed[at])]),
        form_factor: view.form_factor[at],
        spread: view.spread[at],
        uncertainty: view.uncertainty[at],
        class: class_of(view.packed[at]),
    }
}

/// Least bytes of an extent with so many links and closures: names of receivers and sources not counted.
#[must_use]
pub fn live_bytes(links: usize, closures: usize) -> u64 {
    const LINK: usize = size_of::<u32>() + 3 * size_of::<f32>();
    (links * LINK + closures * size_of::<LeafClosure>()) as u64
}
