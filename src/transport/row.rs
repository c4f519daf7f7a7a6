//! A row: what an element receives of one part of its light, as measured by rays. It is linear in the light of others.

use crate::base::NodeName;
use crate::transport::light::line::{Halves, PLACES};

/// Parts of the light of an element. Each has rows at levels of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u16)]
pub enum Part {
    /// Straight from lamps: edges of shadows.
    Direct = 0,
    /// Over other surfaces: smooth.
    Indirect = 1,
}

impl Part {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Direct, Self::Indirect];
}

/// Where a ray of an element's hemisphere ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The whole side that it met, or [`NodeName::ESCAPE`].
    pub side: NodeName,
    /// The place, in steps of the patch's frame.
    pub at: [u16; 2],
}

/// What left the model, or was covered where it began.
pub const GONE: Hit = Hit { side: NodeName::ESCAPE, at: [0; 2] };

/// A lamp that a ray from a place reached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// The lamp: a whole side.
    pub lamp: NodeName,
    /// Place and half: [`slot`].
    pub slot: u8,
    /// Round.
    pub round: u8,
    /// Irradiance at the place for an exitance of 1, were it the half's only ray from there.
    pub factor: f32,
}

/// Number of a place and half.
#[must_use]
pub fn slot(place: usize, half: usize) -> u8 {
    (2 * place + half) as u8
}

/// Slots of a row's hits in their order: place by place, half by half, round after round.
pub fn slots(open: u16) -> impl Iterator<Item = usize> {
    (0..PLACES).filter(move |i| open & (1 << i) != 0).flat_map(|place| [2 * place, 2 * place + 1]).cycle()
}

/// Adds light, W/m2, to a slot.
#[inline]
pub fn add(halves: &mut Halves, slot: usize, light: [f32; 3], weight: f32) {
    for (sum, x) in halves[slot / 2][slot % 2].iter_mut().zip(light) {
        *sum += weight * x;
    }
}

/// What arrives, each channel multiplied by what keeps the power of the whole model.
#[must_use]
pub fn scaled(halves: &Halves, gain: [f32; 3]) -> Halves {
    halves.map(|place| place.map(|half| std::array::from_fn(|channel| half[channel] * gain[channel])))
}

/// What rays of a row found.
#[derive(Clone, Debug, PartialEq)]
pub enum Found {
    /// Of direct light.
    Shares(Vec<Share>),
    /// Of indirect light: round by round, place by place, half by half.
    Hits(Vec<Hit>),
}

/// A row.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The element.
    pub element: NodeName,
    /// Which of its light.
    pub part: Part,
    /// Rays of each half from each place.
    pub rounds: u16,
    /// Bit i: place i is open.
    pub open: u16,
    /// What they found.
    pub found: Found,
}

impl Row {
    /// What rows are in order of.
    #[must_use]
    pub fn key(&self) -> (NodeName, Part) {
        (self.element, self.part)
    }

    /// Entries.
    #[must_use]
    pub fn len(&self) -> usize {
        match &self.found {
            Found::Shares(shares) => shares.len(),
            Found::Hits(hits) => hits.len(),
        }
    }

    /// Whether nothing was found.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Rows that a cluster has from earlier visits, in order of their keys. They may be most of what a task could hold: who
/// works on one asks for it.
pub trait Kept {
    /// Their keys.
    fn keys(&self) -> Vec<(NodeName, Part)>;

    /// One of them, by number.
    fn row(&self, number: usize) -> Row;
}
