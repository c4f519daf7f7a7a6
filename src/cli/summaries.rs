//! The summaries of the stages, in lines for people.

use super::drawing::{bytes, count, thousands};
use crate::stages::summary::Summary;
use crate::stages::{partition, sample, solve_group, visibility};

fn percent(share: f64) -> String {
    format!("{:.3} %", 100.0 * share)
}

/// A summary with the command that comes next, which the stage itself does not know.
pub struct WithNext<S> {
    /// The stage's summary.
    pub summary: S,
    /// The command.
    pub next: Option<String>,
    /// Its lines.
    pub lines: Vec<String>,
}

impl<S: serde::Serialize> serde::Serialize for WithNext<S> {
    fn serialize<T: serde::Serializer>(&self, serializer: T) -> Result<T::Ok, T::Error> {
        self.summary.serialize(serializer)
    }
}

impl<S: serde::Serialize> Summary for WithNext<S> {
    fn lines(&self) -> Vec<String> {
        self.lines.clone()
    }

    fn next(&self) -> Option<String> {
        self.next.clone()
    }
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
