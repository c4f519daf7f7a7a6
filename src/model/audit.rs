//! What an audit came to: the figures that `audit` and `run` print and the catalogue keeps.

use serde::{Deserialize, Serialize};

/// A place whose stored light is far off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorstPlace {
    /// Cluster number.
    pub cluster: u32,
    /// Its OBJ object.
    pub object: String,
    /// The place, m, in the axes of the model.
    pub point_m: [f64; 3],
    /// The light that is stored there, W/m2.
    pub stored_w_m2: [f64; 3],
    /// The light that a gather finds, W/m2.
    pub gathered_w_m2: [f64; 3],
}

/// An audit's figures; none where nothing is lit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AuditFigures {
    /// Error of the stored light, nRMS.
    pub audited_nrms: Option<f64>,
    /// Its standard error.
    pub audited_se: Option<f64>,
    /// By how much all stored light is off, relative.
    pub audited_bias: Option<f64>,
    /// Its standard error.
    #[serde(skip)]
    pub bias_se: Option<f64>,
}

/// Error, in tolerances, that an audit has to be sure of before it contradicts an estimate.
const CONTRADICTS: f64 = 1.5;

impl AuditFigures {
    /// Whether the error is surely over what a tolerance allows.
    #[must_use]
    pub fn contradicts(&self, tolerance: f64) -> bool {
        let least = self.audited_nrms.zip(self.audited_se).map(|(nrms, error)| nrms - 2.0 * error);
        least.is_some_and(|least| least > CONTRADICTS * tolerance)
    }
}

/// An audit of a version, as it is kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Audit {
    /// The version.
    pub version: u64,
    /// Places asked for.
    pub places: u64,
    /// What they derive from.
    pub seed: u64,
    /// Places measured: those under other faces are not.
    pub points: u64,
    /// Its figures.
    pub figures: AuditFigures,
    /// Places whose light is farthest off, the worst first.
    pub worst: Vec<WorstPlace>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_audit_contradicts_a_tolerance_that_is_surely_missed_by_half_of_it() {
        let of = |nrms, error| AuditFigures { audited_nrms: Some(nrms), audited_se: Some(error), ..Default::default() };
        assert!(of(0.04, 0.004).contradicts(0.02));
        assert!(!of(0.04, 0.006).contradicts(0.02), "it may be luck");
        assert!(!of(0.029, 0.0).contradicts(0.02));
        assert!(!AuditFigures::default().contradicts(0.02), "nothing is lit");
    }
}
