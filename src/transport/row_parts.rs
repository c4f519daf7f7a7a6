//! Parts of a row that err independently, and what each gives or takes when the row is closed.

use super::link_rows::Link;
use crate::model::links::Visibility;

/// Sums over links.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Of form factors.
    pub form_factor: f64,
    /// Of standard errors.
    pub error: f64,
    /// Of their squares.
    pub variance: f64,
    /// Largest error relative to its form factor: bounds what a correction may take without turning a
    /// link negative.
    pub steepest: f64,
}

impl Sums {
    pub(super) fn with(self, link: &Link, is_leafs: bool) -> Self {
        let (form_factor, error) = (f64::from(link.form_factor), error(link, is_leafs));
        let relative = if error > 0.0 { error / form_factor } else { 0.0 };
        Self {
            form_factor: self.form_factor + form_factor,
            error: self.error + error,
            variance: self.variance + error * error,
            steepest: self.steepest.max(relative),
        }
    }

    pub(super) fn plus(self, other: &Self) -> Self {
        Self {
            form_factor: self.form_factor + other.form_factor,
            error: self.error + other.error,
            variance: self.variance + other.variance,
            steepest: self.steepest.max(other.steepest),
        }
    }
}

/// Error of a form factor's own rounding and averaging.
const FLOOR: f64 = 1e-4;

/// Standard error of a link's form factor at a leaf: from sampled visibility, and for a link of an element
/// above the leaf (`is_leafs` false) from the mean over that element. At most the form factor itself; a
/// link that carries nothing stays so: closing never lights a sealed place.
#[must_use]
pub fn error(link: &Link, is_leafs: bool) -> f64 {
    let form_factor = f64::from(link.form_factor);
    let half_spread = if is_leafs || link.class == Visibility::Surveyed { 0.0 } else { 0.5 * f64::from(link.spread) };
    (f64::from(link.uncertainty) + FLOOR * form_factor + half_spread).min(form_factor)
}

/// A part of a row while it is closed: a form factor becomes `scale` times itself plus `correction` times
/// its own standard error.
#[derive(Clone, Copy)]
pub(super) struct Part {
    sums: Sums,
    /// Variance of the part's sum.
    variance: f64,
    pub(super) scale: f64,
    pub(super) correction: f64,
}

impl Part {
    fn new(sums: Sums, variance: f64) -> Self {
        Self { sums, variance, scale: 1.0, correction: 0.0 }
    }

    /// Adds to the part by errors.
    fn plus(self, amount: f64) -> Self {
        let correction = if self.sums.error > 0.0 { amount / self.sums.error } else { 0.0 };
        Self { correction, ..self }
    }

    /// Takes from the part (no more than it holds): by errors until a link has nothing more to give, the
    /// rest from all alike.
    fn minus(self, amount: f64) -> Self {
        let by_errors = if self.sums.steepest > 0.0 { amount.min(self.sums.error / self.sums.steepest) } else { 0.0 };
        let left = self.sums.form_factor - by_errors;
        let scale = if left > 0.0 { ((self.sums.form_factor - amount) / left).max(0.0) } else { 1.0 };
        Self { scale, ..self.plus(-by_errors * scale) }
    }

    fn sum(&self) -> f64 {
        self.scale * self.sums.form_factor + self.correction * self.sums.error
    }
}

/// What may give and take: the leaf's own links, those above, the escape.
#[derive(Clone, Copy)]
pub(super) struct Parts(pub(super) [Part; 3]);

impl Parts {
    /// Those of a leaf's own links, of links above, and of the escape with its standard error.
    pub(super) fn of(own: Sums, above: Sums, escape: f64, escape_error: f64) -> Self {
        let relative = if escape > 0.0 { escape_error / escape } else { 0.0 };
        let variance = escape_error * escape_error;
        let escape = Sums { form_factor: escape, error: escape_error, variance, steepest: relative };
        Self([Part::new(own, own.variance), Part::new(above, above.error * above.error), Part::new(escape, variance)])
    }

    pub(super) fn map_to_sums(&self) -> [f64; 3] {
        self.0.map(|part| part.sum())
    }

    /// Fills a gap; what lists may miss (`unseen`) counts as an error of all form factors alike.
    pub(super) fn with(self, gap: f64, unseen: f64) -> Self {
        let sum: f64 = self.0.iter().map(|p| p.sums.form_factor).sum();
        let missed = if sum > 0.0 { unseen * unseen } else { 0.0 };
        let total = self.0.iter().map(|p| p.variance).sum::<f64>() + missed;
        if total <= 0.0 {
            return self;
        }
        let scale = 1.0 + gap * missed / total / sum.max(f64::MIN_POSITIVE);
        Self(self.0.map(|part| Part { scale, ..part.plus(gap * part.variance / total) }))
    }

    /// Takes an excess by variances, from no part more than it holds.
    pub(super) fn without(self, excess: f64) -> Self {
        let mut taken = [0.0; 3];
        // A part that runs out leaves its share to the others: at most one more runs out each time.
        for _ in 0..3 {
            let left = excess - taken.iter().sum::<f64>();
            let open = |i: &usize| taken[*i] < self.0[*i].sums.form_factor;
            let total: f64 = (0..3).filter(open).map(|i| self.0[i].variance.max(f64::MIN_POSITIVE)).sum();
            if left <= 0.0 || total <= 0.0 {
                break;
            }
            taken = std::array::from_fn(|i| {
                let part = &self.0[i];
                let share = left * part.variance.max(f64::MIN_POSITIVE) / total;
                if open(&i) { (taken[i] + share).min(part.sums.form_factor) } else { taken[i] }
            });
        }
        Self(std::array::from_fn(|i| self.0[i].minus(taken[i])))
    }
}
