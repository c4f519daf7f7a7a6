//! A link extent in the making. It goes to the segment array by array, straight from the rows: the
//! links of one cluster may be most of what a task holds, and need not be held twice.

use bytemuck::Pod;

use crate::base::{ClusterId, NodeName, Result};
use crate::model::ExtentKind;
use crate::model::layout::{padding, table};
use crate::model::links::{self, LeafClosure, LinksHead};
use crate::store::segment::ExtentStream;
use crate::store::{ExtentRef, SegmentWriter};
use crate::transport::link_rows::Link;

/// Rows of links, ascending by receiver, and what closes the leaves.
pub struct LinkExtent<'a> {
    delta: bool,
    rows: Vec<(NodeName, &'a [Link])>,
    /// Distinct names of the sources, ascending.
    sources: Vec<u64>,
    links: usize,
    closure: &'a [LeafClosure],
}

impl<'a> LinkExtent<'a> {
    /// Over rows, ascending by receiver.
    #[must_use]
    pub fn new(delta: bool, rows: Vec<(NodeName, &'a [Link])>, closure: &'a [LeafClosure]) -> Self {
        let (mut sources, mut known) = (Vec::new(), 0);
        for (_, row) in &rows {
            sources.extend(row.iter().map(|l| l.source.0));
            // What is held stays below a few times what is distinct.
            if sources.len() > 2 * known + 4096 {
                sources.sort_unstable();
                sources.dedup();
                known = sources.len();
            }
        }
        sources.sort_unstable();
        sources.dedup();
        let links = rows.iter().map(|(_, row)| row.len()).sum();
        Self { delta, rows, sources, links, closure }
    }

    /// Bytes of each array.
    fn arrays(&self) -> [usize; 9] {
        let (receivers, link) = (size_of::<u64>() * self.rows.len(), size_of::<u32>() * self.links);
        [
            size_of::<LinksHead>(),
            receivers,
            receivers + size_of::<u64>(),
            size_of_val(self.sources.as_slice()),
            link,
            link,
            link,
            link,
            size_of_val(self.closure),
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
        let head = LinksHead {
            delta: u32::from(self.delta),
            reserved: 0,
            receivers: self.rows.len() as u64,
            links: self.links as u64,
            reserved2: 0,
        };
        let index =
            |link: &Link| self.sources.binary_search(&link.source.0).expect("the dictionary holds every source");
        let mut end = 0u64;
        let ends = self.rows.iter().map(|(_, row)| {
            end += row.len() as u64;
            end
        });
        let mut stream = writer.begin(ExtentKind::Links, id.0)?;
        stream.write(&table(&self.arrays()))?;
        array(&mut stream, [head])?;
        array(&mut stream, self.rows.iter().map(|(receiver, _)| receiver.0))?;
        array(&mut stream, std::iter::once(0).chain(ends))?;
        array(&mut stream, self.sources.iter().copied())?;
        array(&mut stream, self.each().map(|l| links::pack(l.class, index(l) as u32)))?;
        array(&mut stream, self.each().map(|l| l.form_factor))?;
        array(&mut stream, self.each().map(|l| l.spread))?;
        array(&mut stream, self.each().map(|l| l.uncertainty))?;
        array(&mut stream, self.closure.iter().copied())?;
        stream.finish()
    }

    fn each(&self) -> impl Iterator<Item = &'a Link> {
        self.rows.iter().flat_map(|(_, row)| *row)
    }
}

/// Writes an array and its padding, piece by piece.
fn array<T: Pod>(stream: &mut ExtentStream<'_>, records: impl IntoIterator<Item = T>) -> Result<()> {
    const RECORDS: usize = 1024;
    let mut piece: Vec<T> = Vec::with_capacity(RECORDS);
    let mut bytes = 0;
    for record in records {
        piece.push(record);
        bytes += size_of::<T>();
        if piece.len() == RECORDS {
            stream.write(bytemuck::cast_slice(&piece))?;
            piece.clear();
        }
    }
    stream.write(bytemuck::cast_slice(&piece))?;
    stream.write(padding(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::links::{LinksView, Visibility};
    use crate::store::Store;
    use crate::transport::link_rows;

    fn link(source: u64, form_factor: f32) -> Link {
        let class = if source.is_multiple_of(2) { Visibility::Visible } else { Visibility::Partial };
        Link { source: NodeName(source), form_factor, spread: 0.25, uncertainty: 0.125, class }
    }

    #[test]
    fn what_is_written_in_pieces_is_read_back_and_as_long_as_was_said() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), std::time::Duration::ZERO).unwrap();
        let mut writer = SegmentWriter::create(&store, "test").unwrap();
        // More links than a piece holds, an empty row, sources that rows share.
        let long: Vec<Link> = (0..5000).map(|i| link(9000 - i, i as f32)).collect();
        let short = [link(7, 0.5), link(8999, 0.75)];
        let closure = [LeafClosure { own_scale: 0.5, ..bytemuck::Zeroable::zeroed() }; 3];
        let rows = vec![(NodeName(1), long.as_slice()), (NodeName(2), &[][..]), (NodeName(5), &short)];
        let extent = LinkExtent::new(true, rows, &closure);
        let at = extent.write(ClusterId(4), &mut writer).unwrap();
        assert_eq!(at.bytes, extent.bytes());
        writer.sync().unwrap();
        let read = store.extent(at, ExtentKind::Links).unwrap();
        let view = read.parse(LinksView::parse).unwrap();
        assert_eq!((view.head.delta, view.head.links, view.sources.len()), (1, 5002, 5001));
        assert_eq!((view.receivers, view.row_start), (&[1, 2, 5][..], &[0, 5000, 5000, 5002][..]));
        let all: Vec<Link> = (0..5002).map(|at| link_rows::link_at(&view, at)).collect();
        assert_eq!(all, [long.as_slice(), &short].concat());
        assert_eq!(view.closure, closure);
    }
}
