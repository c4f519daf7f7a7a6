//! `--tolerance` in the model's own units.

use crate::base::Rgb;
use crate::store::ModelFacts;
use crate::transport::oracle::Tolerances;

/// What a model's light comes to on average where there is any, W/m2 (norm over RGB): emitted power
/// over absorbing area, each patch counted once, since one side of most walls faces a dark void. Known
/// before anything is solved, so that tolerances depend on the model alone.
#[must_use]
pub fn typical_irradiance(facts: &ModelFacts) -> f64 {
    let absorbing_m2 = facts.area_m2 * (1.0 - facts.mean_reflectance).max(0.01);
    Rgb(facts.emitted_w).norm_squared().sqrt() / absorbing_m2.max(f64::MIN_POSITIVE)
}

/// Share of the tolerance that a row's links may use up; the rest is for what does not average out.
const ROW_SHARE: f64 = 0.75;

/// The tolerances of a task. No element edge is below `min_element_m`, by default twice the
/// tolerance's share of a typical patch's width.
#[must_use]
pub fn of(facts: &ModelFacts, tolerance: f64, min_element_m: Option<f64>) -> Tolerances {
    Tolerances {
        row_w_m2: ROW_SHARE * tolerance * typical_irradiance(facts),
        min_element_m: min_element_m.unwrap_or_else(|| default_min_element_m(facts, tolerance)),
    }
}

/// `--min-element` where none is given, m.
#[must_use]
pub fn default_min_element_m(facts: &ModelFacts, tolerance: f64) -> f64 {
    2.0 * tolerance * facts.mean_patch_area_m2.sqrt()
}
