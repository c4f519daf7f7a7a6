//! Rows as a link extent, and back. They go to the segment array by array, straight from the rows: those of one cluster
//! may be most of what a task holds, and need not be held twice.

use bytemuck::Pod;

use crate::base::{ClusterId, NodeName, Result};
use crate::model::ExtentKind;
use crate::model::layout::{padding, table};
use crate::model::links::{LinksHead, LinksView, RowHead, StoredHit, StoredShare, for_each_row};
use crate::store::{ExtentRef, SegmentWriter};
use crate::transport::row::{Found, Hit, Part, Row, Share};

/// Rows to be written.
pub struct LinkExtent<'a> {
    delta: bool,
    heads: Vec<RowHead>,
    rows: Vec<&'a Row>,
    /// Distinct names of the sides, ascending.
    sides: Vec<u64>,
    shares: usize,
    hits: usize,
}

impl<'a> LinkExtent<'a> {
    /// Over rows in order, and names of those that are no more.
    #[must_use]
    pub fn new(delta: bool, rows: Vec<&'a Row>, gone: &[(NodeName, Part)]) -> Self {
        let (mut sides, mut known) = (Vec::new(), 0);
        let mut heads = Vec::with_capacity(rows.len() + gone.len());
        let (mut shares, mut hits) = (0, 0);
        for row in &rows {
            let first = match &row.found {
                Found::Shares(found) => {
                    sides.extend(found.iter().map(|share| share.lamp.0));
                    shares += found.len();
                    shares - found.len()
                }
                Found::Hits(found) => {
                    sides.extend(found.iter().map(|hit| hit.side.0));
                    hits += found.len();
                    hits - found.len()
                }
            };
            heads.push(RowHead {
                element: row.element.0,
                first: first as u64,
                count: row.len() as u32,
                part: row.part as u16,
                rounds: row.rounds,
                open: row.open,
                reserved: [0; 3],
            });
            // What is held stays below a few times what is distinct.
            if sides.len() > 2 * known + 4096 {
                sides.sort_unstable();
                sides.dedup();
                known = sides.len();
            }
        }
        sides.sort_unstable();
        sides.dedup();
        if delta {
            let rows_now = |head: &RowHead| (head.element, head.part);
            let new: Vec<RowHead> = (gone.iter())
                .filter(|(name, part)| heads.binary_search_by_key(&(name.0, *part as u16), rows_now).is_err())
                .map(|(name, part)| RowHead { element: name.0, part: *part as u16, ..bytemuck::Zeroable::zeroed() })
                .collect();
            heads.extend(new);
            heads.sort_by_key(rows_now);
            // Rows that are no more have no entries: where they would begin follows from those before.
            let mut next = [0u64; 2];
            for head in &mut heads {
                head.first = next[usize::from(head.part)];
                next[usize::from(head.part)] += u64::from(head.count);
            }
        }
        Self { delta, heads, rows, sides, shares, hits }
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
        let shares = self.rows.iter().flat_map(|row| match &row.found {
            Found::Shares(shares) => shares.as_slice(),
            Found::Hits(_) => &[],
        });
        let hits = self.rows.iter().flat_map(|row| match &row.found {
            Found::Hits(hits) => hits.as_slice(),
            Found::Shares(_) => &[],
        });
        write(&table(&self.arrays()))?;
        array(write, [head])?;
        array(write, self.heads.iter().copied())?;
        array(write, self.sides.iter().copied())?;
        array(write, shares.map(|s| StoredShare::new(index(s.lamp), s.round, s.slot, s.factor)))?;
        array(write, hits.map(|h| StoredHit { side: index(h.side), at: h.at }))
    }
}

/// Bytes of an extent with so many rows and entries: names of sides not counted.
#[must_use]
pub fn live_bytes(rows: usize, entries: usize) -> u64 {
    (rows * size_of::<RowHead>() + entries * size_of::<StoredHit>()) as u64
}

/// The rows of a chain of extents, in order.
#[must_use]
pub fn rows_of(views: &[LinksView<'_>]) -> Vec<Row> {
    let mut rows = Vec::new();
    for_each_row(views, |index, head| {
        let view = &views[index];
        let (shares, hits) = view.entries(head);
        let name = |side: u32| NodeName(view.sides[side as usize]);
        let (part, found) = if head.part == 0 {
            let share = |s: &StoredShare| Share {
                lamp: NodeName(view.sides[s.lamp()]),
                slot: s.slot(),
                round: s.round(),
                factor: s.factor,
            };
            (Part::Direct, Found::Shares(shares.iter().map(share).collect()))
        } else {
            (Part::Indirect, Found::Hits(hits.iter().map(|h| Hit { side: name(h.side), at: h.at }).collect()))
        };
        let (element, rounds, open) = (NodeName(head.element), head.rounds, head.open);
        rows.push(Row { element, part, rounds, open, found });
    });
    rows
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
        let base = write(LinkExtent::new(false, rows.iter().collect(), &[]));
        let view = base.parse(LinksView::parse).unwrap();
        assert_eq!(rows_of(&[view]), rows);
        let child = indirect(side(4, 1).child(2), 64);
        let delta = write(LinkExtent::new(true, vec![&child], &[(side(4, 1), Part::Indirect)]));
        let later = delta.parse(LinksView::parse).unwrap();
        let [first, second, _] = rows;
        assert_eq!(rows_of(&[view, later]), [first, second, child]);
    }
}
