//! What the next iteration is to do about the error of the light: sweep while light still comes in, mark while the estimate
//! is over the tolerance, close.

use super::oracle;
use crate::model::figures::{IterationFigures, Phase, Steering};
use crate::model::report::ErrorSums;

/// A branch has converged when what is left is below this part of the tolerance. Sweeps over stored links are
/// cheap, and where reflectance is high the rest is a bias of everything alike.
pub const STOP: f64 = 25.0;

/// Share of the tolerance that rows may use up. What few of them have wrong together goes round, and no place tells: it
/// falls with the root of their number and grows by 1 / (1 - rho), and is to stay below a quarter of the tolerance.
#[must_use]
pub fn of_rows(figures: &IterationFigures, mean_reflectance: f64) -> f64 {
    (0.25 * (figures.work.elements as f64).sqrt() * (1.0 - mean_reflectance)).min(1.0)
}

/// How far the light of an iteration has settled.
#[derive(Clone, Copy, Default)]
pub struct Settling {
    /// By how much it changed.
    pub residual: f64,
    /// Relative error left by stopping here.
    pub predicted_error: f64,
    /// Share of what is emitted that is neither absorbed nor gone.
    pub balance: f64,
    /// Whether markings no longer help: [`has_stalled`].
    pub has_stalled: bool,
}

/// Energy balance up to which light adds up.
const ADDS_UP: f64 = 0.005;

/// What the next iteration is to do; `before`: what the last one said.
#[must_use]
pub fn steer(error: &ErrorSums, before: &Steering, settling: Settling, tolerance: f64) -> Steering {
    let [lit, area] = error.lit;
    let lit_mean_w_m2 = if area > 0.0 { lit / area } else { 0.0 };
    let (correction, correction_error) = corrected(error, before);
    let relative = |squared: f64| if error.norm > 0.0 { squared / error.norm } else { 0.0 };
    let squared = relative(error.rough * correction.max(LEAST_CORRECTION));
    let most = relative(error.rough * (correction + 2.0 * correction_error).max(LEAST_CORRECTION)).sqrt();
    let estimated_nrms = squared.sqrt();
    let estimated_nrms_error = 0.5 * (most - estimated_nrms);
    // Once it is good enough, a worse estimate has to be more than chance.
    let doubt = if before.phase == Phase::Close { estimated_nrms_error } else { 0.0 };
    let mut excess = (estimated_nrms - doubt).max(0.0).powi(2) - tolerance * tolerance;
    // Light that does not add up is not good enough, whatever its places say.
    let is_still = settling.predicted_error <= tolerance / STOP;
    if is_still && settling.balance > ADDS_UP && estimated_nrms > LEAST_OF_TOLERANCE * tolerance {
        excess = excess.max(0.5 * squared);
    }
    // What changes while rows are made better is their doing: no sweep has to come between markings.
    let is_settled = before.phase == Phase::Mark
        || settling.residual <= SETTLED * estimated_nrms.max(LEAST_OF_TOLERANCE * tolerance);
    let is_known = correction != 0.0 || error.norm == 0.0;
    let (phase, threshold) = if !is_settled || (excess <= 0.0 && before.phase == Phase::Mark) || !is_known {
        (Phase::Sweep, None)
    } else if excess <= 0.0 || settling.has_stalled {
        (Phase::Close, None)
    } else {
        // Where nothing is left to be done, that is it.
        let threshold = oracle::threshold(&error.bins, excess * error.norm, error.rays);
        (if threshold.is_some() { Phase::Mark } else { Phase::Close }, threshold)
    };
    Steering { phase, threshold, lit_mean_w_m2, estimated_nrms, estimated_nrms_error, correction, correction_error }
}

/// An iteration that made rows better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marking {
    /// The estimated error after it.
    pub estimate: f64,
    /// Entries in all rows.
    pub entries: u64,
}

/// Markings, one after another, that must have made the estimate fall; where each does little, so many.
const PATIENCE: (usize, usize) = (3, 12);

/// Whether the estimate no longer falls, though rows hold twice as much as when it was lowest. `markings`: those of a
/// branch, newest first.
#[must_use]
pub fn has_stalled(markings: &[Marking]) -> bool {
    let Some(newest) = markings.first() else { return false };
    let of_half = markings.partition_point(|marking| 2 * marking.entries > newest.entries);
    let recent = of_half.max(PATIENCE.0).min(PATIENCE.1);
    let least = |of: &[Marking]| of.iter().map(|marking| marking.estimate).fold(f64::INFINITY, f64::min);
    markings.len() > recent && least(&markings[..recent]) >= least(&markings[recent..])
}

/// How far what rows know is off: from places measured anew in this iteration, and in those before at half the weight.
fn corrected(error: &ErrorSums, before: &Steering) -> (f64, f64) {
    let [squared, variance] = error.checked;
    if error.places == 0 {
        return (before.correction, before.correction_error);
    }
    // Rows that know of no error at all are not off: there is nothing to be known.
    let rough = error.rough.max(f64::MIN_POSITIVE);
    let now = if error.rough > 0.0 { (squared / rough, variance.sqrt() / rough) } else { (1.0, 0.0) };
    if before.correction == 0.0 || now.1 == 0.0 {
        return now;
    }
    // As worth as they are precise, those before half as much: light has changed since.
    let weights = [1.0 / (now.1 * now.1), 0.5 / before.correction_error.powi(2).max(f64::MIN_POSITIVE)];
    let sum = weights[0] + weights[1];
    ((now.0 * weights[0] + before.correction * weights[1]) / sum, (1.0 / sum).sqrt())
}

/// Share of the tolerance below which nothing more is done about light that does not add up.
const LEAST_OF_TOLERANCE: f64 = 0.5;

/// Below this a correction is luck.
const LEAST_CORRECTION: f64 = 0.05;

/// Share of the estimated error below which what light still changes no longer hides what promises most.
const SETTLED: f64 = 0.5;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_marked_once_the_light_has_settled_and_until_the_estimate_with_its_doubt_meets_the_tolerance() {
        let with_change = |residual: f64, balance: f64| Settling {
            residual,
            balance,
            predicted_error: 0.1 * residual,
            has_stalled: false,
        };
        // Rows know of an error of 5 % or 10 % of a norm of 2; places measured anew find `correction` times that squared.
        let with = |rough: f64, correction: f64, deviation: f64| {
            let checked = [rough * correction, (rough * deviation).powi(2)];
            let mut error =
                ErrorSums { rough, checked, places: 1, norm: 4.0, lit: [6.0, 2.0], rays: 1e6, ..Default::default() };
            error.add(5, 1.0, 10.0);
            error
        };
        let none = Steering::default();
        let (small, large) = (with(0.01, 1.0, 1e-9), with(0.04, 1.0, 1e-9));
        let steering = steer(&small, &none, with_change(0.01, 0.0), 0.06);
        assert_eq!((steering.phase, steering.threshold, steering.lit_mean_w_m2), (Phase::Close, None, 3.0));
        assert!((steering.estimated_nrms - 0.05).abs() < 1e-12, "{}", steering.estimated_nrms);
        assert_eq!(steer(&small, &none, with_change(0.5, 0.0), 0.06).phase, Phase::Sweep, "light still comes in");
        let marking = steer(&large, &none, with_change(0.04, 0.0), 0.06);
        assert!(marking.phase == Phase::Mark && marking.threshold.is_some());
        assert_eq!(
            steer(&small, &marking, with_change(0.01, 0.0), 0.06).phase,
            Phase::Sweep,
            "what was just marked is measured once more"
        );
        // What rows do not know of is found where places are measured anew, and remembered.
        let wrong = steer(&with(0.01, 4.0, 0.1), &none, with_change(0.01, 0.0), 0.06);
        assert!(wrong.phase == Phase::Mark && (wrong.estimated_nrms - 0.1).abs() < 1e-12, "{wrong:?}");
        let later = steer(&with(0.01, 1.0, 0.1), &wrong, with_change(0.01, 0.0), 0.06);
        assert!((later.correction - 2.0).abs() < 1e-9, "a third of what was found before: {later:?}");
        assert_eq!(steer(&small, &none, with_change(0.01, 0.02), 0.06).phase, Phase::Mark, "it does not add up");
        assert_eq!(
            steer(&ErrorSums::default(), &none, with_change(0.0, 0.0), 0.06).phase,
            Phase::Close,
            "nothing is lit"
        );
    }

    #[test]
    fn a_branch_has_stalled_when_markings_that_did_much_have_not_made_the_estimate_fall() {
        let stalled = |of: &[(f64, u64)]| {
            has_stalled(&of.iter().map(|&(estimate, entries)| Marking { estimate, entries }).collect::<Vec<_>>())
        };
        assert!(!stalled(&[(0.3, 8), (0.3, 4), (0.3, 2)]), "the first markings");
        assert!(!stalled(&[(0.29, 16), (0.31, 8), (0.33, 4), (0.3, 2), (0.5, 1)]), "one of three helped");
        assert!(stalled(&[(0.31, 16), (0.30, 8), (0.33, 4), (0.3, 2), (0.5, 1)]));
        assert!(!stalled(&[(0.31, 104), (0.30, 103), (0.33, 102), (0.3, 101), (0.5, 100)]), "they did little");
        let little: Vec<(f64, u64)> = (0..13).map(|i| (0.3, 100 - i)).collect();
        assert!(stalled(&little) && !stalled(&little[1..]), "and did it often");
    }
}
