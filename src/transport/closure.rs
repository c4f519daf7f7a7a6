//! Closure: each leaf's row of form factors, the escape included, sums to at most 1.
//!
//! A row over 1 is scaled to 1. A row under 1 by no more than the unseen mass of its cluster plus
//! three standard errors is scaled up to 1. A larger gap stays and is reported as unlinked. What is
//! added or taken goes to links and escape by their variances: the escape is known from rays alone,
//! so where all links are proved visible it gives way to them and brings no noise into the light.

use std::f64::consts::PI;

use glam::DVec3;

use super::pair::Node;
use crate::base::NodeName;
use crate::geom::sequence::{Sequence, mix};
use crate::model::links::LeafClosure;
use crate::rays::RayScene;
use crate::rays::traverse::Nearest;

/// Rays that measure a leaf's escape.
const ESCAPE_RAYS: u64 = 64;

/// Share of cosine-weighted rays from all over a leaf that leave the model.
#[must_use]
pub fn measure_escape(scene: &RayScene<'_>, leaf: &Node, seed: u64, rays: &mut u64) -> f64 {
    let sequence = Sequence::new(mix(seed ^ mix(leaf.name.0)) ^ NodeName::ESCAPE.0);
    let mut escaped = 0u64;
    for i in 0..ESCAPE_RAYS {
        let [a, b, c, d] = sequence.point(i);
        let direction = cosine_direction(leaf.normal, c, d);
        *rays += 1;
        if let Nearest::Escaped = scene.nearest(leaf.shape.point(a, b), direction, Some(&leaf.end)) {
            escaped += 1;
        }
    }
    escaped as f64 / ESCAPE_RAYS as f64
}

/// A unit direction about `normal`, cosine-distributed for u, v uniform in [0, 1).
#[must_use]
pub fn cosine_direction(normal: DVec3, u: f64, v: f64) -> DVec3 {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let (radius, angle) = (u.sqrt(), 2.0 * PI * v);
    tangent * (radius * libm::cos(angle)) + bitangent * (radius * libm::sin(angle)) + normal * (1.0 - u).sqrt()
}

/// What is known of a row before closing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Row {
    /// Sum of the links' form factors.
    pub link_sum: f64,
    /// Standard error of that sum.
    pub link_error: f64,
    /// Measured form factor to the escape.
    pub escape: f64,
    /// Form factor that the cluster's visibility list may miss.
    pub unseen: f64,
    /// Whether all that is seen has been linked; only then may a row be scaled up.
    pub complete: bool,
}

/// Error of a form factor's own rounding and averaging, in a sum over a row.
const FLOOR: f64 = 1e-4;

/// Closes a leaf's row.
#[must_use]
pub fn close(leaf: NodeName, row: &Row) -> LeafClosure {
    let link_variance = row.link_error * row.link_error + FLOOR * FLOOR;
    let doubt = (row.escape * (1.0 - row.escape)).max(0.25 / ESCAPE_RAYS as f64) / ESCAPE_RAYS as f64;
    let escape_variance = if row.escape > 0.0 { doubt } else { 0.0 };
    let gap = 1.0 - row.link_sum - row.escape;
    let allowed = row.unseen + 3.0 * (link_variance + escape_variance).sqrt();
    let closes = row.link_sum > 0.0 && (gap < 0.0 || (row.complete && gap <= allowed));
    let (mut factor, mut escape) = (1.0, row.escape);
    if closes {
        let unseen = if gap > 0.0 { row.unseen * row.unseen } else { 0.0 };
        let to_links = (link_variance + unseen) / (link_variance + unseen + escape_variance);
        escape = (row.escape + gap * (1.0 - to_links)).clamp(0.0, 1.0);
        factor = (1.0 - escape) / row.link_sum;
        if !row.complete {
            factor = factor.min(1.0);
        }
    }
    let unlinked = if row.complete { (1.0 - factor * row.link_sum - escape).max(0.0) } else { 0.0 };
    LeafClosure {
        leaf: leaf.0,
        factor: factor as f32,
        escape: escape as f32,
        link_sum: row.link_sum as f32,
        link_error: row.link_error as f32,
        measured_escape: row.escape as f32,
        unlinked: unlinked as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, PatchSide};

    fn closed(row: Row) -> LeafClosure {
        close(NodeName::root(ClusterId(0), PatchSide { patch: 0, side: 0 }), &row)
    }

    #[test]
    fn rows_over_one_are_scaled_down_and_small_gaps_up() {
        let over = closed(Row { link_sum: 1.25, complete: true, ..Row::default() });
        assert!((f64::from(over.factor) - 0.8).abs() < 1e-6, "{over:?}");
        let under = closed(Row { link_sum: 0.996, unseen: 0.005, complete: true, ..Row::default() });
        assert!((f64::from(under.factor) * 0.996 - 1.0).abs() < 1e-6, "{under:?}");
    }

    #[test]
    fn a_large_gap_stays_and_is_reported() {
        let gap = closed(Row { link_sum: 0.7, link_error: 0.01, unseen: 0.005, complete: true, ..Row::default() });
        assert_eq!(gap.factor, 1.0);
        assert!((gap.unlinked - 0.3).abs() < 1e-6, "{gap:?}");
    }

    #[test]
    fn the_escape_gives_way_to_links_that_are_sure() {
        let row = closed(Row { link_sum: 0.6, link_error: 0.0, escape: 0.37, unseen: 0.0, complete: true });
        assert!((row.factor - 1.0).abs() < 1e-3, "{row:?}");
        assert!((f64::from(row.escape) - 0.4).abs() < 1e-3, "{row:?}");
    }

    #[test]
    fn an_unlit_row_stays_zero() {
        let row = closed(Row { unseen: 1.0, complete: true, ..Row::default() });
        assert_eq!((row.factor, row.link_sum), (1.0, 0.0));
    }
}
