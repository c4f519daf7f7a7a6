//! `--tolerance` in the model's own units.

use crate::base::{Result, Rgb};
use crate::model::solve_options::SolveOptions;
use crate::store::{ModelFacts, Store};
use crate::transport::oracle::Tolerances;

/// What a model's light comes to on average where there is any, W/m2 (norm over RGB): emitted power
/// over absorbing area, each patch counted once, since one side of most walls faces a dark void. Known
/// before anything is solved, so that tolerances depend on the model alone. Any number does where nothing emits.
#[must_use]
pub fn typical_irradiance(facts: &ModelFacts) -> f64 {
    let absorbing_m2 = facts.area_m2 * (1.0 - facts.mean_reflectance).max(0.01);
    let emitted_w = Rgb(facts.emitted_w).norm_squared().sqrt();
    if emitted_w > 0.0 { emitted_w / absorbing_m2.max(f64::MIN_POSITIVE) } else { 1.0 }
}

/// Share of the tolerance that a row's links may use up; the rest is for what does not average out.
const ROW_SHARE: f64 = 0.75;

/// The tolerances of a task.
#[must_use]
pub fn of(facts: &ModelFacts, options: &SolveOptions) -> Tolerances {
    Tolerances {
        row_w_m2: ROW_SHARE * options.tolerance * typical_irradiance(facts),
        min_element_m: smallest_element_m(facts, options),
    }
}

/// The smallest element edge of a version's solution, m; 0 where nobody has solved on its branch yet.
pub fn min_element_m(store: &Store, version: u64, facts: &ModelFacts) -> Result<f64> {
    let branch = store.version(version)?.map_or(0, |row| row.branch);
    Ok(store.options_of_branch(branch)?.map_or(0.0, |options| smallest_element_m(facts, &options)))
}

/// `--min-element`, m: by default twice the tolerance's share of a typical patch's width.
fn smallest_element_m(facts: &ModelFacts, options: &SolveOptions) -> f64 {
    options.min_element_m.unwrap_or_else(|| 2.0 * options.tolerance * facts.mean_patch_area_m2.sqrt())
}
