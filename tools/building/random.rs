//! Random numbers that follow from a seed and from what they are for, so that no room depends on another.

use clerestory::geom::sequence::{mix, unit};

/// A stream of numbers (splitmix64).
pub struct Random(u64);

impl Random {
    /// The stream of a seed for one floor and one place on it.
    #[must_use]
    pub fn new(seed: u64, floor: usize, place: usize) -> Self {
        Self(mix(mix(mix(seed) ^ floor as u64) ^ place as u64))
    }

    /// In `[low, high)`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * unit(self.next())
    }

    /// One of these.
    pub fn one_of<T: Copy>(&mut self, of: &[T]) -> T {
        of[(unit(self.next()) * of.len() as f64) as usize]
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }
}
