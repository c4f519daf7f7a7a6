//! Link extents: for each receiving node of a cluster, in order of name, its links (CSR).
//!
//! A base holds all rows; a delta holds whole rows of the receivers that changed (an empty row
//! deletes). The newest row along the version's chain wins. The closure array is always whole.

use bytemuck::{Pod, Zeroable};

use super::Arrays;

/// How much of a link's source its receiver sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Visibility {
    /// Sampled by rays.
    Partial = 0,
    /// Proved: nothing lies between.
    Visible = 1,
    /// Proved: something blocks all of it.
    Hidden = 2,
    /// Part of a survey: all that a receiver sees of what does not emit, measured by its own rays.
    Surveyed = 3,
}

/// One per link extent.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct LinksHead {
    /// 0 base, 1 delta.
    pub delta: u32,
    /// 0.
    pub reserved: u32,
    /// Rows.
    pub receivers: u64,
    /// Links.
    pub links: u64,
    /// 0.
    pub reserved2: u64,
}

/// What closes the row of one leaf: each link counts as a scale times its form factor plus a correction
/// times its standard error. See `transport::closure`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LeafClosure {
    /// The leaf's name.
    pub leaf: u64,
    /// What the form factors of the leaf's own links are multiplied by.
    pub own_scale: f32,
    /// What their standard errors are multiplied by, to be added.
    pub own_correction: f32,
    /// What the form factors of links of elements above it are multiplied by.
    pub above_scale: f32,
    /// What their standard errors are multiplied by, to be added.
    pub above_correction: f32,
    /// Form factor to the escape, after closing.
    pub escape: f32,
    /// Form factor that no link accounts for, after closing.
    pub unlinked: f32,
    /// Sum of the form factors of all links, after closing.
    pub closed_sum: f32,
    /// Form factor to the escape as measured by rays.
    pub measured_escape: f32,
}

/// A link extent's arrays.
#[derive(Clone, Copy)]
pub struct LinksView<'a> {
    /// Base or delta.
    pub head: &'a LinksHead,
    /// Names of the receivers, ascending.
    pub receivers: &'a [u64],
    /// First link of each row, then the number of links.
    pub row_start: &'a [u64],
    /// Distinct names of the sources, ascending.
    pub sources: &'a [u64],
    /// Per link: visibility class in the top 2 bits, index into `sources` below.
    pub packed: &'a [u32],
    /// Per link: form factor, visibility included.
    pub form_factor: &'a [f32],
    /// Per link: largest deviation of the form factor over the receiver; of a surveyed link the bits of four
    /// bytes, what each quarter of the receiver sees relative to the whole, in 64ths.
    pub spread: &'a [f32],
    /// Per link: standard error of the form factor from sampled visibility.
    pub uncertainty: &'a [f32],
    /// Per leaf with closed rows, ascending.
    pub closure: &'a [LeafClosure],
}

/// Bits of a packed link that hold the index.
pub const INDEX_BITS: u32 = 30;

/// Packs class and dictionary index.
#[must_use]
pub fn pack(class: Visibility, index: u32) -> u32 {
    debug_assert!(index < 1 << INDEX_BITS);
    (class as u32) << INDEX_BITS | index
}

/// The class of a packed link.
#[must_use]
pub fn class_of(packed: u32) -> Visibility {
    match packed >> INDEX_BITS {
        1 => Visibility::Visible,
        2 => Visibility::Hidden,
        3 => Visibility::Surveyed,
        _ => Visibility::Partial,
    }
}

/// The dictionary index of a packed link.
#[must_use]
pub fn index_of(packed: u32) -> usize {
    (packed & ((1 << INDEX_BITS) - 1)) as usize
}

impl<'a> LinksView<'a> {
    /// Borrows the arrays of a payload.
    pub fn parse(payload: &'a [u8]) -> Result<Self, String> {
        let a = Arrays::new(payload);
        let view = Self {
            head: a.one(0)?,
            receivers: a.get(1)?,
            row_start: a.get(2)?,
            sources: a.get(3)?,
            packed: a.get(4)?,
            form_factor: a.get(5)?,
            spread: a.get(6)?,
            uncertainty: a.get(7)?,
            closure: a.get(8)?,
        };
        let links = view.packed.len();
        let lengths_agree = view.row_start.len() == view.receivers.len() + 1
            && view.row_start.last() == Some(&(links as u64))
            && view.row_start.windows(2).all(|w| w[0] <= w[1])
            && [view.form_factor.len(), view.spread.len(), view.uncertainty.len()] == [links; 3];
        if !lengths_agree {
            return Err("rows do not cover the links".to_owned());
        }
        if view.packed.iter().any(|&p| index_of(p) >= view.sources.len()) {
            return Err("a link names a source that is not in the dictionary".to_owned());
        }
        Ok(view)
    }

    /// The links of row `row`.
    #[must_use]
    pub fn row(&self, row: usize) -> std::ops::Range<usize> {
        self.row_start[row] as usize..self.row_start[row + 1] as usize
    }
}
