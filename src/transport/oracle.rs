//! The oracle: is a link good enough, and if not, which end is to be split.

use super::sight::Sight;
use super::source::SourceLight;
use crate::base::Rgb;

/// What error matters, the same for a whole task.
#[derive(Clone, Copy, Debug)]
pub struct Tolerances {
    /// Irradiance error that one link may carry, W/m2.
    pub link_w_m2: f64,
    /// No element edge below this, m.
    pub min_element_m: f64,
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
    /// Receiver's longest edge, m.
    pub receiver_edge_m: f64,
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

/// Whether a receiver may be split for a link whose error is `error_w_m2`.
#[must_use]
pub fn can_split(case: &Case, tolerances: &Tolerances, error_w_m2: f64) -> bool {
    let floor = tolerances.min_element_m;
    case.receiver_has_levels
        && 0.5 * case.receiver_edge_m >= floor
        && error_w_m2 * case.receiver_area_m2 > tolerances.link_w_m2 * floor * floor
}

/// Judges a link: errors in radiosity and in flux must both exceed what is allowed before it is split.
#[must_use]
pub fn judge(sight: &Sight, strength: f64, source: &SourceLight, case: &Case, tolerances: &Tolerances) -> Verdict {
    // Over a receiver the deviation from the mean is about half its largest on average.
    let receiver_error = (0.5 * sight.spread + sight.uncertainty) * strength;
    let source_error = sight.form_factor * source.spread * case.source_variation;
    if receiver_error + source_error <= tolerances.link_w_m2 {
        return Verdict::Keep;
    }
    if source.divided && source_error >= receiver_error {
        return Verdict::SplitSource;
    }
    if can_split(case, tolerances, receiver_error) {
        return Verdict::SplitReceiver;
    }
    if source.divided && source_error > tolerances.link_w_m2 { Verdict::SplitSource } else { Verdict::Keep }
}
