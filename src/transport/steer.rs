//! What the next iteration is to do about the error of the light: sweep while light still comes in, mark while the estimate
//! is over the tolerance, close.

use super::oracle;
use crate::model::figures::{IterationFigures, Phase, Power, Steering};
use crate::model::report::ErrorSums;
use crate::transport::numbers;

/// Share of the tolerance that rows may use up. What few of them have wrong together goes round, and no place tells: it
/// falls with the root of their number and grows by 1 / (1 - rho), and is to stay below a quarter of the tolerance.
#[must_use]
pub fn of_rows(figures: &IterationFigures, mean_reflectance: f64) -> f64 {
    (numbers::TOGETHER * (figures.work.elements as f64).sqrt() * (1.0 - mean_reflectance)).min(1.0)
}

/// How far the light of an iteration has settled.
#[derive(Clone, Copy, Default)]
pub struct Settling {
    /// By how much it changed.
    pub residual: f64,
    /// Relative error left by stopping here.
    pub predicted_error: f64,
    /// Where power goes.
    pub power: Power,
    /// By how much its imbalance changed.
    pub drift: f64,
    /// What arrives at all sides, W.
    pub received_w: [f64; 3],
    /// Whether markings no longer help: [`has_stalled`].
    pub has_stalled: bool,
}

/// What the next iteration is to do; `before`: what the last one said; the tolerance asked for, and what share of it
/// rows may use up.
#[must_use]
pub fn steer(error: &ErrorSums, before: &Steering, settling: Settling, (asked, of_rows): (f64, f64)) -> Steering {
    let tolerance = asked * of_rows;
    let [lit, area] = error.lit;
    let lit_mean_w_m2 = if area > 0.0 { lit / area } else { 0.0 };
    let Corrected { correction: known, error: known_error, places } = corrected(error, before);
    let relative = |squared: f64| if error.norm > 0.0 { squared / error.norm } else { 0.0 };
    let squared = relative(error.rough * known);
    let most = relative(error.rough * (known + 2.0 * known_error)).sqrt();
    // One place that is far off is all of the correction, and of its error: what the others know is worth casting for.
    let surely = relative(error.rough * (known - known_error));
    let estimated_nrms = squared.sqrt();
    let estimated_nrms_error = 0.5 * (most - estimated_nrms);
    // Once it is good enough, a worse estimate has to be more than chance.
    let was_enough = before.places > 0.0 && before.estimated_nrms <= tolerance;
    let doubt = if was_enough || before.phase == Phase::Close { estimated_nrms_error } else { 0.0 };
    let excess = (estimated_nrms - doubt).max(0.0).powi(2) - tolerance * tolerance;
    // What changes while rows are made better is their doing: no sweep has to come between markings.
    let is_settled =
        before.phase == Phase::Mark || settling.residual <= numbers::SETTLED * estimated_nrms.max(tolerance);
    let is_known = places > 0.0 || error.norm == 0.0;
    let gain = gain(before.gain, settling, asked);
    let is_done = excess <= 0.0 || settling.has_stalled;
    let (phase, threshold) =
        if !is_settled || !is_known || (is_done && (before.phase == Phase::Mark || gain != before.gain)) {
            (Phase::Sweep, None)
        } else if is_done {
            (Phase::Close, None)
        } else {
            // Where nothing is left to be done, that is it.
            let aim = (surely - tolerance * tolerance).max(numbers::LEAST_EXCESS * tolerance * tolerance);
            // Rows promise as they know of their error.
            let of_rows = aim * error.norm / known;
            let threshold = oracle::threshold(&error.bins, of_rows, error.rays);
            (if threshold.is_some() { Phase::Mark } else { Phase::Close }, threshold)
        };
    Steering {
        phase,
        threshold,
        lit_mean_w_m2,
        estimated_nrms,
        estimated_nrms_error,
        correction: known,
        correction_error: known_error,
        places,
        gain,
    }
}

/// What the next iteration multiplies gathers, and what leaves the model, by. All that leaves sides arrives somewhere or
/// leaves the model; what rays miss of both is little, but goes round: light is off by that much over 1 - rho. Once power
/// is still, both are made as much as leaves sides.
fn gain(before: [f64; 3], settling: Settling, tolerance: f64) -> [f64; 3] {
    let Power { emitted_w, absorbed_w, escaped_w } = settling.power;
    let received_w = settling.received_w;
    if settling.drift.min(settling.predicted_error) > numbers::STILL * tolerance {
        return before;
    }
    let gone_w: [f64; 3] = std::array::from_fn(|c| received_w[c] + escaped_w[c]);
    let after = std::array::from_fn(|c| {
        let left_w = emitted_w[c] + received_w[c] - absorbed_w[c];
        if gone_w[c] > 0.0 { before[c] * left_w / gone_w[c] } else { before[c] }
    });
    // Nothing is to be gained where it adds up; what is off by more is wrong, not rough.
    let least = numbers::STILL * numbers::BALANCED;
    let adds_up = |c: usize| (after[c] - before[c]).abs() * gone_w[c] <= least * emitted_w[c];
    let is_rough = after.iter().all(|gain| (gain - 1.0).abs() <= numbers::MOST_MISSED * tolerance);
    if is_rough && !(0..3).all(adds_up) { after } else { before }
}

/// An iteration that made rows better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marking {
    /// The estimated error after it.
    pub estimate: f64,
    /// Entries in all rows.
    pub entries: u64,
}

/// Whether the estimate no longer falls: the middle one since rows held a quarter is that of the markings just before.
/// `markings`: those of a branch, newest first.
#[must_use]
pub fn has_stalled(markings: &[Marking]) -> bool {
    let Some(newest) = markings.first() else { return false };
    let recent = markings.partition_point(|marking| 4 * marking.entries > newest.entries);
    let (recent, before) =
        markings.split_at(recent.clamp(numbers::LEAST_PATIENCE, numbers::MOST_PATIENCE).min(markings.len()));
    let before = &before[..before.len().min(numbers::LEAST_PATIENCE)];
    let median = |of: &[Marking]| {
        let mut estimates: Vec<f64> = of.iter().map(|marking| marking.estimate).collect();
        estimates.sort_by(f64::total_cmp);
        estimates[(estimates.len() - 1) / 2]
    };
    before.len() == numbers::LEAST_PATIENCE && median(recent) > numbers::FALLS * median(before)
}

/// How far what rows know is off.
struct Corrected {
    correction: f64,
    error: f64,
    places: f64,
}

/// From places measured anew in this iteration, and in those before: each counts alike, since few places say of
/// themselves that they are precise where they have missed what is rare; those before count less, since light has changed.
///
/// Now and then one place that is far off is all of what an iteration's places tell, and of its error. So they are taken
/// beside what was known before (a normal prior about it, with a deviation as large), at first that rows are right.
fn corrected(error: &ErrorSums, before: &Steering) -> Corrected {
    let [squared, variance] = error.checked;
    let known = Corrected { correction: before.correction, error: before.correction_error, places: before.places };
    if error.places == 0 {
        return known;
    }
    // Rows that know of no error at all are not off: there is nothing to be known.
    let rough = error.rough.max(f64::MIN_POSITIVE);
    let (now, now_error) = if error.rough > 0.0 { (squared / rough, variance.sqrt() / rough) } else { (1.0, 0.0) };
    let weight = 1.0 / (1.0 + (now_error / known.correction).powi(2));
    let (now, now_error) = (known.correction + weight * (now - known.correction), weight.sqrt() * now_error);
    let (new, old) = (error.places as f64, numbers::KEPT * known.places);
    let places = new + old;
    let of_both = |x: f64, y: f64| (x * new + y * old) / places;
    let error = of_both(now_error, 0.0).hypot(of_both(0.0, known.error));
    // Nothing is known to be less than its own error.
    let correction = of_both(now, known.correction).max(error).max(f64::MIN_POSITIVE);
    Corrected { correction, error, places }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_marked_once_the_light_has_settled_and_until_the_estimate_with_its_doubt_meets_the_tolerance() {
        let with_change = |residual: f64| Settling { residual, predicted_error: 0.1 * residual, ..Settling::default() };
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
        let steering = steer(&small, &none, with_change(0.01), (0.06, 1.0));
        assert_eq!((steering.phase, steering.threshold, steering.lit_mean_w_m2), (Phase::Close, None, 3.0));
        assert!((steering.estimated_nrms - 0.05).abs() < 1e-12, "{}", steering.estimated_nrms);
        assert_eq!(steer(&small, &none, with_change(0.5), (0.06, 1.0)).phase, Phase::Sweep, "light still comes in");
        let marking = steer(&large, &none, with_change(0.04), (0.06, 1.0));
        assert!(marking.phase == Phase::Mark && marking.threshold.is_some());
        assert_eq!(
            steer(&small, &marking, with_change(0.01), (0.06, 1.0)).phase,
            Phase::Sweep,
            "what was just marked is measured once more"
        );
        let enough = steer(&small, &marking, with_change(0.01), (0.06, 1.0));
        let (surely, luck) = (with(0.01, 1.6, 1e-9), with(0.01, 1.9, 0.5));
        assert_eq!(steer(&luck, &enough, with_change(0.01), (0.06, 1.0)).phase, Phase::Close, "more may be chance");
        assert_eq!(steer(&surely, &none, with_change(0.01), (0.06, 1.0)).phase, Phase::Mark);
        // What rows do not know of is found where places are measured anew, and remembered.
        let wrong = steer(&with(0.01, 4.0, 1e-9), &none, with_change(0.01), (0.06, 1.0));
        assert!(wrong.phase == Phase::Mark && (wrong.estimated_nrms - 0.1).abs() < 1e-12, "{wrong:?}");
        let later = steer(&with(0.01, 1.0, 1e-9), &wrong, with_change(0.01), (0.06, 1.0));
        let kept = (1.0 + 4.0 * numbers::KEPT) / (1.0 + numbers::KEPT);
        assert!((later.correction - kept).abs() < 1e-9, "part of what was found before: {later:?}");
        let luck = steer(&with(0.01, 26.0, 3.0), &none, with_change(0.01), (0.06, 1.0));
        assert!(
            (luck.estimated_nrms - 0.05 * 3.5f64.sqrt()).abs() < 1e-9,
            "one tenth of what few places say: {luck:?}"
        );
        // What rows take for noise neighbours may have freed the light of: many places tell, few tell no less than they err.
        let smooth = steer(&with(0.01, 0.2, 1e-9), &none, with_change(0.01), (0.06, 1.0));
        assert!((smooth.estimated_nrms - 0.05 * 0.2f64.sqrt()).abs() < 1e-9, "{smooth:?}");
        let few = steer(&with(0.01, -0.5, 0.5), &none, with_change(0.01), (0.06, 1.0));
        assert!((few.estimated_nrms - 0.05 * 0.2f64.powf(0.25)).abs() < 1e-9, "{few:?}");
        // One place that is far off says little beside what many have told.
        let known = Steering { correction: 3.0, correction_error: 0.2, places: 5000.0, ..none };
        let mut outlier = with(0.01, 40.0, 37.0);
        outlier.places = 1000;
        let beside = steer(&outlier, &known, with_change(0.01), (0.06, 1.0));
        assert!((3.0..3.1).contains(&beside.correction), "{beside:?}");
        assert!((0.2..0.8).contains(&beside.correction_error), "{beside:?}");
        assert_eq!(
            steer(&ErrorSums::default(), &none, with_change(0.0), (0.06, 1.0)).phase,
            Phase::Close,
            "nothing is lit"
        );
    }

    #[test]
    fn what_rays_miss_is_made_up_for_once_light_is_still() {
        let power = |absorbed: f64, escaped: f64| Power {
            emitted_w: [1.0; 3],
            absorbed_w: [absorbed; 3],
            escaped_w: [escaped; 3],
        };
        let still = |power: Power| Settling { power, received_w: [10.0; 3], ..Settling::default() };
        let gained = gain([1.0; 3], still(power(0.95, 0.0)), 0.02);
        assert!(gained.iter().all(|gain| (gain - 1.005).abs() < 1e-12), "{gained:?}");
        assert_eq!(gain(gained, still(power(0.9995, 0.0)), 0.02), gained, "it adds up");
        assert_eq!(gain([1.0; 3], still(power(0.64, 0.3595)), 0.02), [1.0; 3], "an open one adds up");
        let gained = gain([1.0; 3], still(power(0.61, 0.36)), 0.02);
        assert!(gained.iter().all(|gain| (gain - 10.39 / 10.36).abs() < 1e-12), "what leaves is off alike: {gained:?}");
        assert_eq!(gain([1.0; 3], still(power(0.8, 0.0)), 0.02), [1.0; 3], "wrong");
        let moving = Settling { drift: 0.01, predicted_error: 0.01, ..still(power(0.95, 0.0)) };
        assert_eq!(gain([1.0; 3], moving, 0.02), [1.0; 3]);
    }

    #[test]
    fn a_branch_has_stalled_when_markings_that_did_much_have_not_made_the_estimate_fall() {
        let stalled = |of: &[(f64, u64)]| {
            has_stalled(&of.iter().map(|&(estimate, entries)| Marking { estimate, entries }).collect::<Vec<_>>())
        };
        assert!(!stalled(&[(0.3, 32), (0.3, 16), (0.3, 8), (0.3, 4), (0.3, 2)]), "the first markings");
        assert!(!stalled(&[(0.25, 32), (0.28, 16), (0.31, 8), (0.3, 4), (0.3, 2), (0.3, 1)]), "they helped");
        assert!(stalled(&[(0.3, 32), (0.31, 16), (0.33, 8), (0.3, 4), (0.3, 2), (0.3, 1)]));
        assert!(!stalled(&[(0.3, 15), (0.31, 14), (0.33, 13), (0.3, 12), (0.3, 11), (0.3, 10)]), "they did little");
        let little: Vec<(f64, u64)> = (0..19).map(|i| (0.3, 100 - i)).collect();
        assert!(stalled(&little) && !stalled(&little[1..]), "and did it often");
    }
}
