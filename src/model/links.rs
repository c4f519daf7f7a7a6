//! Link extents: the rows of a cluster, by name of their element and part, with what their rays found (CSR).
//!
//! A base holds all rows; a delta holds whole rows that changed (one without rounds deletes). The newest row along the
//! version's chain wins.

use bytemuck::{Pod, Zeroable};

use super::Arrays;

/// One per link extent.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct LinksHead {
    /// 0 base, 1 delta.
    pub delta: u32,
    /// 0.
    pub reserved: u32,
    /// Rows.
    pub rows: u64,
    /// Lamps that rays reached.
    pub shares: u64,
    /// Places that rays met.
    pub hits: u64,
}

/// A row.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RowHead {
    /// Its element.
    pub element: u64,
    /// First entry, among shares for direct light, among hits for indirect.
    pub first: u64,
    /// Entries.
    pub count: u32,
    /// 0 direct, 1 indirect.
    pub part: u16,
    /// Rays of each half from each place; 0: there is no such row any more.
    pub rounds: u16,
    /// Bit i: place i is open.
    pub open: u16,
    /// 0.
    pub reserved: [u16; 3],
}

/// A lamp that a ray from a place reached.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct StoredShare {
    /// Lamp, round and slot: see [`StoredShare::new`].
    pub packed: u32,
    /// Irradiance at the place for an exitance of 1, were it the half's only ray from there.
    pub factor: f32,
}

impl StoredShare {
    /// Packs the index of the lamp in the dictionary (below [`MOST_LAMPS`]), round (0..64) and slot: twice the place,
    /// plus the half.
    #[must_use]
    pub fn new(lamp: u32, round: u8, slot: u8, factor: f32) -> Self {
        assert!((lamp as usize) < MOST_LAMPS, "a dictionary of {lamp} sides");
        Self { packed: lamp << 11 | u32::from(round & 63) << 5 | u32::from(slot & 31), factor }
    }

    /// Index of the lamp in the dictionary.
    #[must_use]
    pub fn lamp(&self) -> usize {
        (self.packed >> 11) as usize
    }

    /// Round.
    #[must_use]
    pub fn round(&self) -> u8 {
        (self.packed >> 5 & 63) as u8
    }

    /// Twice the place, plus the half.
    #[must_use]
    pub fn slot(&self) -> u8 {
        (self.packed & 31) as u8
    }
}

/// Where a ray over the hemisphere ended.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct StoredHit {
    /// Index of the side in the dictionary.
    pub side: u32,
    /// The place, in 65,535ths of what the patch reaches along the axes of its frame.
    pub at: [u16; 2],
}

/// A link extent's arrays.
#[derive(Clone, Copy)]
pub struct LinksView<'a> {
    /// Base or delta.
    pub head: &'a LinksHead,
    /// Rows, ascending by element and part.
    pub rows: &'a [RowHead],
    /// Distinct names of whole sides, ascending; the last may be the escape.
    pub sides: &'a [u64],
    /// Of direct rows.
    pub shares: &'a [StoredShare],
    /// Of indirect rows: round by round, place by place, half by half.
    pub hits: &'a [StoredHit],
}

/// Entries of the dictionary that shares can name.
pub const MOST_LAMPS: usize = 1 << 21;

impl<'a> LinksView<'a> {
    /// Borrows the arrays of a payload.
    pub fn parse(payload: &'a [u8]) -> Result<Self, String> {
        let a = Arrays::new(payload);
        let view = Self { head: a.one(0)?, rows: a.get(1)?, sides: a.get(2)?, shares: a.get(3)?, hits: a.get(4)? };
        let (mut shares, mut hits) = (0u64, 0u64);
        for row in view.rows {
            let next = if row.part == 0 { &mut shares } else { &mut hits };
            if row.part > 1 || row.first != *next {
                return Err("rows do not cover the entries".to_owned());
            }
            *next += u64::from(row.count);
        }
        if shares != view.shares.len() as u64 || hits != view.hits.len() as u64 {
            return Err("rows do not cover the entries".to_owned());
        }
        let sides = view.sides.len();
        if view.shares.iter().any(|s| s.lamp() >= sides) || view.hits.iter().any(|h| h.side as usize >= sides) {
            return Err("an entry names a side that is not in the dictionary".to_owned());
        }
        Ok(view)
    }

    /// What the rays of a row met, of the two kinds the one that it has.
    #[must_use]
    pub fn entries(&self, row: &RowHead) -> (&'a [StoredShare], &'a [StoredHit]) {
        let range = row.first as usize..row.first as usize + row.count as usize;
        if row.part == 0 { (&self.shares[range], &[]) } else { (&[], &self.hits[range]) }
    }
}

/// Calls `visit` with the newest row of every element and part of a chain of extents (base first), in order.
pub fn for_each_row<'a>(chain: &[LinksView<'a>], mut visit: impl FnMut(usize, &'a RowHead)) {
    let key = |row: &RowHead| (row.element, row.part);
    let mut next = vec![0usize; chain.len()];
    loop {
        let least = chain.iter().zip(&next).filter_map(|(view, &n)| view.rows.get(n)).map(key).min();
        let Some(least) = least else { return };
        let mut newest = None;
        for (index, (view, n)) in chain.iter().zip(&mut next).enumerate() {
            if let Some(row) = view.rows.get(*n).filter(|row| key(row) == least) {
                newest = Some((index, row));
                *n += 1;
            }
        }
        if let Some((index, row)) = newest
            && row.rounds > 0
        {
            visit(index, row);
        }
    }
}
