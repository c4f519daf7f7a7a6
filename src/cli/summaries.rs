//! Summaries of stages in lines for people, where figures are rounded as the command line does.

use super::drawing::{bytes, count, thousands};
use crate::stages::{partition, sample, solve_group, visibility};

fn percent(share: f64) -> String {
    format!("{:.3} %", 100.0 * share)
}

/// Of `visibility`.
#[must_use]
pub fn visibility(s: &visibility::Summary) -> Vec<String> {
    vec![
        format!("{} pairs of clusters may exchange light, {} rays", thousands(s.pairs), count(s.rays as f64)),
        format!(
            "unseen form factor: mean {}, largest {}; {} of the rays left the model",
            percent(s.missing_form_factor_mean),
            percent(s.missing_form_factor_max),
            percent(s.escape_mean)
        ),
    ]
}

/// Of `partition`.
#[must_use]
pub fn partition(s: &partition::Summary) -> Vec<String> {
    vec![
        format!(
            "{} groups, {} of the exchange within them, predicted contraction {:.3}",
            thousands(s.groups),
            percent(s.intra_group_share),
            s.predicted_contraction
        ),
        format!("largest working set: {}", bytes(s.largest_working_set_bytes)),
    ]
}

/// Of `solve-group`.
#[must_use]
pub fn solve_group(s: &solve_group::Summary) -> Vec<String> {
    match s.group {
        None if s.converged => vec!["The branch has converged: no group is left to solve.".to_owned()],
        None => vec!["No group is free.".to_owned()],
        Some(group) => vec![
            format!("{} groups solved, the last {group}; iteration {}", thousands(s.groups_solved), s.iteration),
            format!(
                "{} elements, {} links ({} new, {} reused), {} rays",
                count(s.work.elements as f64),
                count(s.work.links_stored as f64),
                count(s.work.links_evaluated as f64),
                count(s.work.links_reused as f64),
                count(s.work.rays as f64)
            ),
        ],
    }
}

/// Of `sample`.
#[must_use]
pub fn sample(s: &sample::Summary) -> Vec<String> {
    vec![format!(
        "{} points, {} on surfaces, {} in the open, {} unanswered; lux by 179 lm/W",
        thousands(s.points),
        thousands(s.answered - s.free),
        thousands(s.free),
        thousands(s.unanswered)
    )]
}
