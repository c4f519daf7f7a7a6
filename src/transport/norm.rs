//! What light counts in the error that `--tolerance` bounds, and what an error is worth where light is dim.

use crate::transport::numbers;

/// The norm, from the mean of what is lit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Norm {
    /// Mean irradiance of what is lit and does not emit, W/m2; infinite while nobody knows it.
    lit_mean_w_m2: f64,
}

impl Norm {
    /// While nobody knows what is bright.
    pub const UNKNOWN: Self = Self { lit_mean_w_m2: f64::INFINITY };

    /// Of a mean, W/m2; 0 if nobody knows it.
    #[must_use]
    pub fn of_mean(lit_mean_w_m2: f64) -> Self {
        if lit_mean_w_m2 > 0.0 { Self { lit_mean_w_m2 } } else { Self::UNKNOWN }
    }

    /// What light of that brightness (norm over RGB, W/m2) is multiplied by.
    #[must_use]
    pub fn counts(&self, bright_w_m2: f64) -> f64 {
        (numbers::BRIGHTEST * self.lit_mean_w_m2 / bright_w_m2.max(f64::MIN_POSITIVE)).min(1.0)
    }

    /// Whether a place is dark, and its error apart.
    #[must_use]
    pub fn is_dark(&self, bright_w_m2: f64) -> bool {
        self.lit_mean_w_m2.is_finite() && bright_w_m2 < numbers::DARK * self.lit_mean_w_m2
    }

    /// What a squared error is worth where it is so bright, beside one where it is as bright as the mean or brighter: an
    /// eye tells apart what differs by the root of the light (de Vries 1943, Rose 1948).
    #[must_use]
    pub fn urgency(&self, bright_w_m2: f64) -> f64 {
        if !self.lit_mean_w_m2.is_finite() {
            return 1.0;
        }
        (self.lit_mean_w_m2 / bright_w_m2).clamp(1.0, 1.0 / numbers::DIM)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_counts_up_to_ten_means_and_is_dark_below_a_thousandth() {
        let norm = Norm::of_mean(2.0);
        assert_eq!([0.0, 0.003, 20.0, 40.0].map(|bright| norm.counts(bright)), [1.0, 1.0, 1.0, 0.5]);
        assert_eq!([0.0, 0.001, 0.003, 40.0].map(|bright| norm.is_dark(bright)), [true, true, false, false]);
        assert_eq!((Norm::of_mean(0.0).counts(1e30), Norm::UNKNOWN.is_dark(0.0)), (1.0, false));
    }

    #[test]
    fn errors_are_more_urgent_the_dimmer_it_is_down_to_a_hundredth() {
        let norm = Norm::of_mean(2.0);
        assert_eq!(
            [0.0, 0.002, 0.02, 0.2, 2.0, 20.0].map(|bright| norm.urgency(bright)),
            [100.0, 100.0, 100.0, 10.0, 1.0, 1.0]
        );
        assert_eq!(Norm::UNKNOWN.urgency(0.001), 1.0);
    }
}
