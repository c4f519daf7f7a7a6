//! The oracle: where the error of the whole model's light is, what would be done about it, and what that promises.
//!
//! Errors are squared, times area, in (W/m2)2 m2. Costs are rays.

use crate::base::name::MAX_DEPTH;
use crate::model::report::{Bin, ErrorSums};
use crate::transport::light::line::{Fit, PLACES};
use crate::transport::numbers;

/// What may be done about a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Act {
    /// Give its element's children rows of their own.
    Split,
    /// Cast as many rays again.
    Cast,
}

/// An act with what it promises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offer {
    /// What to do.
    pub act: Act,
    /// By how much the error would fall, (W/m2)2 m2.
    pub promise: f64,
    /// Rays.
    pub cost: f64,
    /// What the error is worth where the element is.
    pub urgency: f64,
}

impl Offer {
    /// Promise a ray, where it is urgent more.
    #[must_use]
    pub fn rate(&self) -> f64 {
        self.urgency * self.promise / self.cost
    }
}

/// A row, as far as the oracle asks.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Area of its element, m2, times the square of what its brightness counts.
    pub weight_m2: f64,
    /// [`Norm::urgency`](crate::transport::norm::Norm::urgency) of its brightness.
    pub urgency: f64,
    /// Levels of its element below the root.
    pub depth: u32,
    /// Whether `--min-element` keeps the element whole.
    pub is_smallest: bool,
    /// Rays of each half from each place.
    pub rounds: u16,
    /// What was measured.
    pub fit: Fit,
}

/// Rays of a round.
const ROUND: f64 = 2.0 * PLACES as f64;

/// Rounds of the rows of an element's children: as many rays as before in half of them.
#[must_use]
pub fn rounds_of_children(rounds: u16) -> u16 {
    (rounds / 2).max(numbers::LEAST_ROUNDS)
}

impl Case {
    /// Whether its element may have children.
    #[must_use]
    pub fn may_be_split(&self) -> bool {
        self.depth < MAX_DEPTH && !self.is_smallest
    }

    /// What is best done about the row; `None` if nothing is.
    #[must_use]
    pub fn offer(&self) -> Option<Offer> {
        let Fit { found, noise, .. } = self.fit;
        let rays = f64::from(self.rounds) * ROUND;
        let cast = (self.rounds < numbers::MOST_ROUNDS && noise > 0.0).then_some(Offer {
            act: Act::Cast,
            promise: numbers::DOUBLING_MENDS * noise * self.weight_m2,
            cost: rays,
            urgency: self.urgency,
        });
        // Children have less structure, and more noise where they have fewer rays.
        let noisier = noise * (f64::from(self.rounds) / f64::from(rounds_of_children(self.rounds)) - 1.0);
        let mended = if found > 0.0 { numbers::SPLIT_MENDS * found - noisier } else { 0.0 };
        // What casting can no longer mend, smaller elements share.
        let promise = if cast.is_none() { mended.max(numbers::DOUBLING_MENDS * noise) } else { mended };
        let split = (promise > 0.0 && self.may_be_split()).then(|| Offer {
            act: Act::Split,
            promise: promise * self.weight_m2,
            // Children take over what rays within them found.
            cost: 4.0 * ROUND * f64::from(rounds_of_children(self.rounds) - self.rounds / 4),
            urgency: self.urgency,
        });
        match (cast, split) {
            (Some(cast), Some(split)) => Some(if cast.rate() >= split.rate() { cast } else { split }),
            (cast, split) => cast.or(split),
        }
    }

    /// Adds the row to the sums of a task; `counts`: whether its error does.
    pub fn add_to(&self, sums: &mut ErrorSums, counts: bool) {
        let Fit { found, noise, .. } = self.fit;
        if counts {
            sums.rough += self.weight_m2 * (found + noise);
        }
        sums.rays += f64::from(self.rounds) * ROUND;
        if let Some(offer) = self.offer() {
            sums.add(bin_of(offer.rate()), offer.promise, offer.cost);
        }
    }
}

/// Bins of a factor of two in the rate.
const BINS: f64 = 4.0;

/// The bin of a rate.
fn bin_of(rate: f64) -> i32 {
    (libm::log2(rate) * BINS).floor() as i32
}

/// Smallest rate in a bin.
fn rate_of(bin: i32) -> f64 {
    libm::exp2(f64::from(bin) / BINS)
}

/// The rate from which on offers are taken, so that `excess` of the error goes; `None` if nothing is to be done.
#[must_use]
pub fn threshold(bins: &[Bin], excess: f64, rays: f64) -> Option<f64> {
    if excess <= 0.0 {
        return None;
    }
    let (mut promised, mut cost, mut found) = (0.0, 0.0, None);
    for bin in bins.iter().rev() {
        if found.is_some() && cost + bin.cost > numbers::MOST_BUDGET * rays {
            break;
        }
        promised += bin.promise;
        cost += bin.cost;
        found = Some(rate_of(bin.rate));
        if promised >= excess || (promised >= numbers::MARKED * excess && cost >= numbers::LEAST_BUDGET * rays) {
            break;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_threshold_takes_what_promises_most_until_the_share_or_the_budget_is_used_up() {
        let bins: Vec<Bin> = (0..10).map(|i| Bin { rate: i, promise: 1.0, cost: 10.0 }).collect();
        assert_eq!(threshold(&bins, 0.0, 1e9), None);
        assert_eq!(threshold(&bins, 10.0, 400.0), Some(rate_of(6)), "four of ten");
        assert_eq!(threshold(&bins, 10.0, 500.0), Some(rate_of(5)), "a tenth of what was cast");
        assert_eq!(threshold(&bins, 2.0, 1e9), Some(rate_of(8)), "all of the excess");
        assert_eq!(threshold(&bins, 10.0, 40.0), Some(rate_of(8)), "half of what was cast");
        assert_eq!(threshold(&bins, 10.0, 1.0), Some(rate_of(9)), "something always");
        assert!(bin_of(rate_of(7) * 1.0001) == 7 && bin_of(rate_of(-7) * 1.0001) == -7);
    }

    #[test]
    fn structure_is_split_and_noise_cast() {
        let case = |found: f64, noise: f64, rounds: u16| Case {
            weight_m2: 2.0,
            urgency: 1.0,
            depth: 3,
            is_smallest: false,
            rounds,
            fit: Fit { found, noise, ..Fit::default() },
        };
        assert_eq!(case(1.0, 0.1, 4).offer().unwrap().act, Act::Split);
        assert_eq!(case(0.0, 0.1, 4).offer().unwrap().act, Act::Cast, "not found");
        let promise = case(1.0, 0.5, 16).offer().unwrap().promise;
        assert!((promise - 0.6).abs() < 1e-12, "children have half of its rays: {promise}");
        assert_eq!(case(1.0, 0.7, 16).offer().unwrap().act, Act::Cast, "smaller elements would be no better");
        assert_eq!(case(0.0, 0.1, numbers::MOST_ROUNDS).offer().unwrap().act, Act::Split, "casting is used up");
        assert_eq!(case(1.0, 0.0, 1).offer(), Some(Offer { act: Act::Split, promise: 1.6, cost: 512.0, urgency: 1.0 }));
        assert_eq!(Case { depth: MAX_DEPTH, ..case(1.0, 0.0, 4) }.offer(), None);
    }
}
