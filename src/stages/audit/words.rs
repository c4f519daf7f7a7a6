//! What people read of an audit.

use crate::base::Error;
use crate::model::audit::{AuditFigures, WorstPlace};

/// The error of the stored light as people read it: as it was estimated, and as it was audited.
#[must_use]
pub fn error_line(estimated: Option<f64>, audited: &AuditFigures) -> Option<String> {
    let percent = |x: f64| 100.0 * x;
    let mut parts: Vec<String> = estimated.iter().map(|x| format!("estimated {:.2} %", percent(*x))).collect();
    if let Some((nrms, error)) = audited.audited_nrms.zip(audited.audited_se) {
        parts.push(format!("audited {:.2} % +- {:.2} %", percent(nrms), percent(error)));
    }
    if let Some((bias, error)) = audited.audited_bias.zip(audited.bias_se) {
        parts.push(format!("bias {:+.2} % +- {:.2} %", percent(bias), percent(error)));
    }
    (!parts.is_empty()).then(|| format!("error of the stored light: {}", parts.join(", ")))
}

/// The place where an audit found the light farthest off.
#[must_use]
pub fn worst_line(worst: &WorstPlace) -> String {
    let numbers = |of: [f64; 3]| of.map(|x| format!("{x:.3}")).join(" ");
    format!(
        "worst of the audited places: {} at {} m, stored {}, measured {} W/m2",
        if worst.object.is_empty() { format!("cluster {}", worst.cluster) } else { worst.object.clone() },
        numbers(worst.point_m),
        numbers(worst.stored_w_m2),
        numbers(worst.gathered_w_m2)
    )
}

/// What is said of a version that an audit contradicts.
#[must_use]
pub fn contradicted(audited: &AuditFigures, tolerance: f64) -> Error {
    let percent = |x: Option<f64>| 100.0 * x.unwrap_or_default();
    Error::NotConverged {
        message: format!(
            "not converged: the audited error of the stored light is {:.2} % +- {:.2} %, for a tolerance of {:.2} %",
            percent(audited.audited_nrms),
            percent(audited.audited_se),
            100.0 * tolerance
        ),
        help:
            "run again with a smaller `--tolerance`, or a finer `--quality`; `clerestory audit` names the worst places"
                .to_owned(),
    }
}
