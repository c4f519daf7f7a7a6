//! Rows as a link extent, and back. They go to the segment array by array, straight from the rows: those of one cluster
//! may be most of what a task holds, and need not be held twice.

use std::collections::BTreeSet;

use bytemuck::Pod;

use crate::base::{ClusterId, NodeName, Result};
use crate::model::ExtentKind;
use crate::model::layout::{padding, table};
use crate::model::links::{LinksHead, LinksView, RowHead, StoredHit, StoredShare, for_each_row};
use crate::store::{ExtentRef, SegmentWriter};
use crate::transport::row::{Found, Hit, Kept, Part, Row, Share};

/// The newest rows of a chain of extents, in order.
pub struct ChainRows<'a> {
    views: &'a [LinksView<'a>],
    /// Each with the number of its extent.
    heads: Vec<(usize, &'a RowHead)>,
}

impl<'a> ChainRows<'a> {
    /// Of a chain, base first.
    #[must_use]
    pub fn of(views: &'a [LinksView<'a>]) -> Self {
        let mut heads = Vec::new();
        for_each_row(views, |of, head| heads.push((of, head)));
        Self { views, heads }
    }

    /// The same without rows that are no more or that were made anew.
    #[must_use]
    pub fn without(mut self, gone: &[(NodeName, Part)], made: &[Row]) -> Self {
        let dead: BTreeSet<(NodeName, Part)> = gone.iter().copied().chain(made.iter().map(Row::key)).collect();
        self.heads.retain(|(_, head)| !dead.contains(&name_of(head)));
        self
    }

    /// Entries of all rows.
    #[must_use]
    pub fn entries(&self) -> u64 {
        self.heads.iter().map(|(_, head)| u64::from(head.count)).sum()
    }
}

fn name_of(head: &RowHead) -> (NodeName, Part) {
    (NodeName(head.element), Part::ALL[usize::from(head.part)])
}

impl Kept for ChainRows<'_> {
    fn keys(&self) -> Vec<(NodeName, Part)> {
        self.heads.iter().map(|(_, head)| name_of(head)).collect()
    }

    fn row(&self, number: usize) -> Row {
        let (of, head) = self.heads[number];
        let view = &self.views[of];
        let (shares, hits) = view.entries(head);
        let name = |side: usize| NodeName(view.sides[side]);
        let (element, part) = name_of(head);
        let found = match part {
            Part::Direct => {
                let share = |s: &StoredShare| Share {
                    lamp: name(s.lamp()),
                    slot: s.slot(),
                    round: s.round(),
                    factor: s.factor,
                };
                Found::Shares(shares.iter().map(share).collect())
            }
            Part::Indirect => Found::Hits(hits.iter().map(|h| Hit { side: name(h.side as usize), at: h.at }).collect()),
        };
        Row { element, part, rounds: head.rounds, open: head.open, found }
    }
}

/// A row to be written: as a chain has it, or made anew.
#[derive(Clone, Copy)]
enum Source<'a> {
    Kept(usize, &'a RowHead),
    Made(&'a Row),
}

impl Source<'_> {
    fn head(&self) -> RowHead {
        match *self {
            Self::Kept(_, head) => *head,
            Self::Made(row) => RowHead {
                element: row.element.0,
                first: 0,
                count: row.len() as u32,
                part: row.part as u16,
                rounds: row.rounds,
                open: row.open,
                reserved: [0; 3],
            },
        }
    }
}

/// Rows to be written.
pub struct LinkExtent<'a> {
    delta: bool,
    heads: Vec<RowHead>,
    rows: Vec<Source<'a>>,
    views: &'a [LinksView<'a>],
    /// Distinct names of the sides, ascending.
    sides: Vec<u64>,
    /// Where those of each extent of the chain are among them.
    renumbered: Vec<Vec<u32>>,
    shares: usize,
    hits: usize,
}

impl<'a> LinkExtent<'a> {
    /// Rows made, in order, beside those of a chain, which has none of them. `gone`: names of rows that are no more, if this
    /// comes behind a chain that has them.
    #[must_use]
    pub fn new(chain: &ChainRows<'a>, made: &'a [Row], gone: Option<&[(NodeName, Part)]>) -> Self {
        let (delta, gone, views) = (gone.is_some(), gone.unwrap_or_default(), chain.views);
        let stay = chain.heads.iter().map(|&(of, head)| Source::Kept(of, head));
        let mut rows: Vec<Source<'a>> = stay.chain(made.iter().map(Source::Made)).collect();
        rows.sort_by_key(|row| key(&row.head()));
        let (mut sides, mut known) = (Vec::new(), 0);
        let mut used: Vec<Vec<bool>> = views.iter().map(|view| vec![false; view.sides.len()]).collect();
        let mut heads: Vec<RowHead> = rows.iter().map(Source::head).collect();
        for row in &rows {
            match *row {
                Source::Kept(of, head) => {
                    let (shares, hits) = views[of].entries(head);
                    shares.iter().for_each(|share| used[of][share.lamp()] = true);
                    hits.iter().for_each(|hit| used[of][hit.side as usize] = true);
                }
                Source::Made(Row { found: Found::Shares(found), .. }) => sides.extend(found.iter().map(|s| s.lamp.0)),
                Source::Made(Row { found: Found::Hits(found), .. }) => sides.extend(found.iter().map(|h| h.side.0)),
            }
            // What is held stays below a few times what is distinct.
            if sides.len() > 2 * known + 4096 {
                sides.sort_unstable();
                sides.dedup();
                known = sides.len();
            }
        }
        for (view, used) in views.iter().zip(&used) {
            sides.extend(view.sides.iter().zip(used).filter(|(_, used)| **used).map(|(name, _)| *name));
        }
        sides.sort_unstable();
        sides.dedup();
        let number = |name: &u64| sides.binary_search(name).map_or(u32::MAX, |at| at as u32);
        let renumbered = views.iter().map(|view| view.sides.iter().map(number).collect()).collect();
        // Rows that are no more have no entries.
        let dead = |(name, part): &(NodeName, Part)| RowHead {
            element: name.0,
            part: *part as u16,
            ..bytemuck::Zeroable::zeroed()
        };
        heads.extend(gone.iter().map(dead));
        heads.sort_by_key(key);
        let mut next = [0u64; 2];
        for head in &mut heads {
            head.first = next[usize::from(head.part)];
            next[usize::from(head.part)] += u64::from(head.count);
        }
        let [shares, hits] = next.map(|count| count as usize);
        Self { delta, heads, rows, views, sides, renumbered, shares, hits }
    }

    /// Bytes of each array.
    fn arrays(&self) -> [usize; 5] {
        [
            size_of::<LinksHead>(),
            size_of_val(self.heads.as_slice()),
            size_of_val(self.sides.as_slice()),
            size_of::<StoredShare>() * self.shares,
            size_of::<StoredHit>() * self.hits,
        ]
    }

    /// Bytes of the payload.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let arrays = self.arrays();
        let padded = arrays.iter().map(|bytes| bytes + padding(*bytes).len()).sum::<usize>();
        (table(&arrays).len() + padded) as u64
    }

    /// Appends it to a segment.
    pub fn write(&self, id: ClusterId, writer: &mut SegmentWriter) -> Result<ExtentRef> {
        let mut stream = writer.begin(ExtentKind::Links, id.0)?;
        self.each_piece(&mut |bytes| stream.write(bytes))?;
        stream.finish()
    }

    /// The payload, aligned as a mapped one is.
    pub fn in_memory(&self) -> Result<Vec<u64>> {
        let mut bytes = Vec::with_capacity(self.bytes() as usize);
        self.each_piece(&mut |piece| {
            bytes.extend_from_slice(piece);
            Ok(())
        })?;
        let mut words = vec![0u64; bytes.len().div_ceil(size_of::<u64>())];
        bytemuck::cast_slice_mut::<u64, u8>(&mut words)[..bytes.len()].copy_from_slice(&bytes);
        Ok(words)
    }

    /// Hands out the payload piece by piece.
    fn each_piece(&self, write: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let head = LinksHead {
            delta: u32::from(self.delta),
            reserved: 0,
            rows: self.heads.len() as u64,
            shares: self.shares as u64,
            hits: self.hits as u64,
        };
        let index = |side: NodeName| self.sides.binary_search(&side.0).expect("the dictionary holds every side") as u32;
        let of_part = |part: Part| self.rows.iter().filter(move |row| row.head().part == part as u16);
        write(&table(&self.arrays()))?;
        array(write, [head])?;
        array(write, self.heads.iter().copied())?;
        array(write, self.sides.iter().copied())?;
        array(write, of_part(Part::Direct).flat_map(|row| self.shares_of(row, &index)))?;
        array(write, of_part(Part::Indirect).flat_map(|row| self.hits_of(row, &index)))
    }

    fn shares_of(&self, row: &Source<'a>, index: &dyn Fn(NodeName) -> u32) -> Vec<StoredShare> {
        match *row {
            Source::Kept(of, head) => {
                let renumber =
                    |s: &StoredShare| StoredShare::new(self.renumbered[of][s.lamp()], s.round(), s.slot(), s.factor);
                self.views[of].entries(head).0.iter().map(renumber).collect()
            }
            Source::Made(Row { found: Found::Shares(found), .. }) => {
                found.iter().map(|s| StoredShare::new(index(s.lamp), s.round, s.slot, s.factor)).collect()
            }
            Source::Made(_) => Vec::new(),
        }
    }

    fn hits_of(&self, row: &Source<'a>, index: &dyn Fn(NodeName) -> u32) -> Vec<StoredHit> {
        match *row {
            Source::Kept(of, head) => {
                let renumber = |h: &StoredHit| StoredHit { side: self.renumbered[of][h.side as usize], at: h.at };
                self.views[of].entries(head).1.iter().map(renumber).collect()
            }
            Source::Made(Row { found: Found::Hits(found), .. }) => {
                found.iter().map(|h| StoredHit { side: index(h.side), at: h.at }).collect()
            }
            Source::Made(_) => Vec::new(),
        }
    }
}

/// What rows are in order of.
fn key(head: &RowHead) -> (u64, u16) {
    (head.element, head.part)
}

/// Bytes of an extent with so many rows and entries: names of sides not counted.
#[must_use]
pub fn live_bytes(rows: usize, entries: u64) -> u64 {
    (rows * size_of::<RowHead>()) as u64 + entries * size_of::<StoredHit>() as u64
}

/// Writes an array and its padding, piece by piece.
fn array<T: Pod>(write: &mut dyn FnMut(&[u8]) -> Result<()>, records: impl IntoIterator<Item = T>) -> Result<()> {
    const RECORDS: usize = 1024;
    let mut piece: Vec<T> = Vec::with_capacity(RECORDS);
    let mut bytes = 0;
    for record in records {
        piece.push(record);
        bytes += size_of::<T>();
        if piece.len() == RECORDS {
            write(bytemuck::cast_slice(&piece))?;
            piece.clear();
        }
    }
    write(bytemuck::cast_slice(&piece))?;
    write(padding(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::PatchSide;
    use crate::store::Store;

    fn side(cluster: u32, patch: u8) -> NodeName {
        NodeName::root(ClusterId(cluster), PatchSide { patch, side: 1 })
    }

    fn indirect(element: NodeName, hits: u32) -> Row {
        let hit = |i: u32| Hit { side: side(i % 7 + 1, (i % 200) as u8), at: [i as u16, 7] };
        let (rounds, open) = ((hits / 32) as u16, u16::MAX);
        Row { element, part: Part::Indirect, rounds, open, found: Found::Hits((0..hits).map(hit).collect()) }
    }

    #[test]
    fn what_is_written_in_pieces_is_read_back_and_a_delta_wins_over_its_base() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), std::time::Duration::ZERO).unwrap();
        let mut writer = SegmentWriter::create(&store, "test").unwrap();
        let share = Share { lamp: side(9, 3), slot: 31, round: 5, factor: 0.25 };
        let found = Found::Shares(vec![share; 3]);
        let direct = Row { element: side(4, 0), part: Part::Direct, rounds: 1, open: 0xff, found };
        // More hits than a piece holds.
        let rows = [direct, indirect(side(4, 0), 4096), indirect(side(4, 1), 32)];
        let mut write = |extent: LinkExtent<'_>| {
            let at = extent.write(ClusterId(4), &mut writer).unwrap();
            assert_eq!(at.bytes, extent.bytes());
            writer.sync().unwrap();
            store.extent(at, ExtentKind::Links).unwrap()
        };
        let rows_of = |views: &[LinksView<'_>]| {
            let rows = ChainRows::of(views);
            (0..rows.keys().len()).map(|number| rows.row(number)).collect::<Vec<_>>()
        };
        let none = ChainRows::of(&[]);
        let base = write(LinkExtent::new(&none, &rows, None));
        let view = base.parse(LinksView::parse).unwrap();
        assert_eq!(rows_of(&[view]), rows);
        // One row changes, one is no more, and one comes instead of it.
        let (made, gone) =
            ([indirect(side(4, 0), 8192), indirect(side(4, 1).child(2), 64)], [(side(4, 1), Part::Indirect)]);
        let delta = write(LinkExtent::new(&none, &made, Some(&gone)));
        let later = delta.parse(LinksView::parse).unwrap();
        let [first, ..] = rows;
        let [changed, child] = made;
        let now = [first, changed, child];
        assert_eq!(rows_of(&[view, later]), now);
        // Written anew, what stays is taken from where it lies.
        let views = [view, later];
        let (newest, gone) = ([indirect(side(4, 2), 32)], [(side(4, 0), Part::Indirect)]);
        let chain = ChainRows::of(&views).without(&gone, &newest);
        let anew = write(LinkExtent::new(&chain, &newest, None));
        let [first, _, child] = now;
        let [newest] = newest;
        let anew = anew.parse(LinksView::parse).unwrap();
        assert_eq!(rows_of(&[anew]), [first, child, newest]);
        assert!(anew.sides.len() < views.iter().map(|view| view.sides.len()).sum(), "{}", anew.sides.len());
    }
}
