//! The oracle: is a link good enough, and if not, which end is to be split.

use super::sight::Sight;
use super::source::SourceLight;
use crate::base::Rgb;

/// What error matters, the same for a whole task.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// Irradiance error that a whole row may carry, W/m2.
    pub row_w_m2: f64,
    /// No element edge below this, m.
    pub min_element_m: f64,
}

impl Tolerances {
    /// Irradiance error that one link may carry, W/m2: the square root of its form factor's share, so
    /// that the errors of a row's links, adding as variances, come to the row's.
    #[must_use]
    pub fn of_link(&self, form_factor: f64) -> f64 {
        self.row_w_m2 * form_factor.max(1e-8).sqrt()
    }
}

/// What to do with a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Keep it.
    Keep,
    /// Link the receiver's children instead.
    SplitReceiver,
    /// Link to the source's children instead.
    SplitSource,
}

/// One link's error and what could be done about it.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Receiver's area, m2.
    pub receiver_area_m2: f64,
    /// Longest edge of the receiver's children, m.
    pub child_edge_m: f64,
    /// Whether the receiver has levels left.
    pub receiver_has_levels: bool,
    /// How much the kernel may vary over the source, 0..=1.
    pub source_variation: f64,
}

/// How strongly errors of a link's form factor act, W/m2.
///
/// A closed row sums to 1, so an error in one form factor is made up by all others: what counts is
/// how much the source differs from what the receiver gets, anywhere in it (`receiver_spread`).
#[must_use]
pub fn strength(source: Rgb, receiver_irradiance: Rgb, receiver_spread: f64) -> f64 {
    (source - receiver_irradiance).norm_squared().sqrt() + receiver_spread
}

/// Whether a receiver may be split for a link whose error is `excess` times what it may be.
#[must_use]
pub fn can_split(case: &Case, tolerances: &Tolerances, excess: f64) -> bool {
    let floor = tolerances.min_element_m;
    case.receiver_has_levels && case.child_edge_m >= floor && excess * case.receiver_area_m2 > floor * floor
}

/// Factor on errors from a source's spread, which do not average out over a row as others do: what is near
/// is linked finely and lies in dim corners, what is far coarsely and misses the bright middles.
pub const SOURCE_SIGN: f64 = 8.0;

/// Judges a link: errors in radiosity and in flux must both exceed what is allowed before it is split.
#[must_use]
pub fn judge(sight: &Sight, strength: f64, source: &SourceLight, case: &Case, tolerances: &Tolerances) -> Verdict {
    let allowed = tolerances.of_link(sight.form_factor + sight.uncertainty);
    // Over a receiver the deviation from the mean is about half its largest on average.
    let receiver_error = (0.5 * sight.spread + sight.uncertainty) * strength;
    let source_error = SOURCE_SIGN * sight.form_factor * source.spread * case.source_variation;
    if receiver_error + source_error <= allowed {
        return Verdict::Keep;
    }
    if source.divided && source_error >= receiver_error {
        return Verdict::SplitSource;
    }
    if can_split(case, tolerances, receiver_error / allowed) {
        return Verdict::SplitReceiver;
    }
    if source.divided && source_error > allowed { Verdict::SplitSource } else { Verdict::Keep }
}
