//! Rows of links: in memory while a cluster is refined, and to and from extents.

use crate::base::NodeName;
use crate::model::layout::ArraysBuilder;
use crate::model::links::{self, LeafClosure, LinksHead, LinksView, Visibility, class_of, index_of};

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

/// Writes rows, ascending by receiver, as the payload of a link extent.
#[must_use]
pub fn encode(delta: bool, rows: &[(NodeName, &[Link])], closure: &[LeafClosure]) -> Vec<u8> {
    let mut sources: Vec<u64> = rows.iter().flat_map(|(_, row)| row.iter().map(|l| l.source.0)).collect();
    sources.sort_unstable();
    sources.dedup();
    let count: usize = rows.iter().map(|(_, row)| row.len()).sum();
    let mut receivers = Vec::with_capacity(rows.len());
    let mut row_start = Vec::with_capacity(rows.len() + 1);
    let mut packed = Vec::with_capacity(count);
    let (mut form_factor, mut spread, mut uncertainty) = (Vec::new(), Vec::new(), Vec::new());
    row_start.push(0u64);
    for (receiver, row) in rows {
        receivers.push(receiver.0);
        for link in *row {
            let index = sources.binary_search(&link.source.0).expect("the dictionary holds every source");
            packed.push(links::pack(link.class, index as u32));
            form_factor.push(link.form_factor);
            spread.push(link.spread);
            uncertainty.push(link.uncertainty);
        }
        row_start.push(packed.len() as u64);
    }
    let head = LinksHead {
        delta: u32::from(delta),
        reserved: 0,
        receivers: receivers.len() as u64,
        links: packed.len() as u64,
        reserved2: 0,
    };
    ArraysBuilder::default()
        .with(&[head])
        .with(&receivers)
        .with(&row_start)
        .with(&sources)
        .with(&packed)
        .with(&form_factor)
        .with(&spread)
        .with(&uncertainty)
        .with(closure)
        .finish()
}
