//! Closure: each leaf's row of form factors, the escape included, sums to at most 1.
//!
//! A row over 1 is brought to 1. A row under 1 by no more than the unseen mass of its cluster plus
//! three standard errors is brought up to 1. A larger gap stays and is reported as unlinked.
//!
//! What is added or taken is shared by variances between three parts that err independently: the leaf's
//! own links, links of elements above it (whose means err alike within a leaf: in the corner of a room all
//! are too low), and the escape. Within a part it goes to each link by its standard error, so a lamp that
//! is seen whole keeps its exact form factor.

use super::link_rows::Link;
use super::mesh::Mesh;
use super::row_parts::{Parts, Sums};
use crate::base::NodeName;
use crate::geom::sequence::{Sequence, cosine_direction, mix};
use crate::model::links::LeafClosure;
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::rays::traverse::Nearest;

/// Rays that measure a leaf's escape: most of the light that leaves a model comes straight from emitters.
#[must_use]
pub fn escape_rays(emits: bool) -> u64 {
    if emits { 4096 } else { 64 }
}

/// Share of `count` cosine-weighted rays from all over a leaf that leave the model.
#[must_use]
pub fn measure_escape(scene: &RayScene<'_>, leaf: &Node, count: u64, seed: u64, rays: &mut u64) -> f64 {
    let sequence = Sequence::new(mix(seed ^ mix(leaf.name.0)) ^ NodeName::ESCAPE.0);
    let mut escaped = 0u64;
    for i in 0..count {
        let [a, b, c, d] = sequence.point(i);
        let direction = cosine_direction(leaf.normal, c, d);
        *rays += 1;
        if let Nearest::Escaped = scene.nearest(leaf.shape.point(a, b), direction, Some(&leaf.end)) {
            escaped += 1;
        }
    }
    escaped as f64 / count as f64
}

/// What is known of a row before closing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Row {
    /// The leaf's own links.
    pub own: Sums,
    /// Those of elements above it.
    pub above: Sums,
    /// Measured form factor to the escape.
    pub escape: f64,
    /// Rays that measured it.
    pub escape_rays: u64,
    /// Form factor that the cluster's visibility list may miss.
    pub unseen: f64,
    /// Whether all that is seen has been linked; only then may a row be filled up.
    pub complete: bool,
}

/// Closes the rows of all leaves of a mesh that see anything or emit (`emits`: their light may leave the model though
/// none arrives); `measured` gives a leaf's escape, unseen mass and completeness. Ascending by name.
pub fn rows(
    mesh: &Mesh,
    links: &[Vec<Link>],
    emits: impl Fn(NodeName) -> bool,
    mut measured: impl FnMut(NodeName) -> Row,
) -> Vec<LeafClosure> {
    let rows = &links[mesh.sectors.len()..];
    let sums = |row: &[Link], is_leafs| row.iter().fold(Sums::default(), |sum, link| sum.with(link, is_leafs));
    let mut above = vec![Sums::default(); rows.len()];
    let mut leaves = Vec::new();
    for (at, element) in mesh.elements.iter().enumerate() {
        if !element.is_leaf() {
            let first_child = element.first_child as usize;
            let down = above[at].plus(&sums(&rows[at], false));
            above[first_child..first_child + 4].fill(down);
            continue;
        }
        let own = sums(&rows[at], true);
        if own.form_factor + above[at].form_factor > 0.0 || emits(element.name) {
            leaves.push(close(element.name, &Row { own, above: above[at], ..measured(element.name) }));
        }
    }
    leaves.sort_by_key(|c| c.leaf);
    leaves
}

/// Closes a leaf's row.
#[must_use]
pub fn close(leaf: NodeName, row: &Row) -> LeafClosure {
    let rays = row.escape_rays.max(1) as f64;
    let doubt = (row.escape * (1.0 - row.escape)).max(0.25 / rays) / rays;
    let escape_error = if row.escape > 0.0 { doubt.sqrt().min(row.escape) } else { 0.0 };
    let sum = row.own.form_factor + row.above.form_factor;
    let gap = 1.0 - sum - row.escape;
    let errors = row.own.error + row.above.error + escape_error;
    let parts = Parts::of(row.own, row.above, row.escape, escape_error);
    let parts = if gap < 0.0 {
        parts.without(-gap)
    } else if row.complete && gap <= row.unseen + 3.0 * errors {
        parts.with(gap, row.unseen)
    } else {
        parts
    };
    let [own, above, out] = parts.map_to_sums();
    let unlinked = if row.complete { (1.0 - own - above - out).max(0.0) } else { 0.0 };
    LeafClosure {
        leaf: leaf.0,
        own_scale: parts.0[0].scale as f32,
        own_correction: parts.0[0].correction as f32,
        above_scale: parts.0[1].scale as f32,
        above_correction: parts.0[1].correction as f32,
        escape: out as f32,
        unlinked: unlinked as f32,
        closed_sum: (own + above) as f32,
        measured_escape: row.escape as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, PatchSide};
    use crate::transport::row_parts::error;

    fn closed(row: Row) -> LeafClosure {
        close(NodeName::root(ClusterId(0), PatchSide { patch: 0, side: 0 }), &row)
    }

    fn links(form_factor: f64, error: f64) -> Sums {
        Sums { form_factor, error, variance: error * error, steepest: error / form_factor }
    }

    #[test]
    fn rows_over_one_are_brought_down_and_small_gaps_filled() {
        let over = closed(Row { own: links(1.25, 0.0), complete: true, ..Row::default() });
        assert!((f64::from(over.own_scale) - 0.8).abs() < 1e-6, "{over:?}");
        let over = closed(Row { own: links(1.25, 0.5), complete: true, ..Row::default() });
        assert!((f64::from(over.closed_sum) - 1.0).abs() < 1e-6 && over.own_scale == 1.0, "{over:?}");
        let under = closed(Row { own: links(0.996, 0.0), unseen: 0.005, complete: true, ..Row::default() });
        assert!((f64::from(under.closed_sum) - 1.0).abs() < 1e-6, "{under:?}");
    }

    #[test]
    fn a_large_gap_stays_and_is_reported() {
        let gap = closed(Row { own: links(0.7, 0.01), unseen: 0.005, complete: true, ..Row::default() });
        assert_eq!((gap.own_scale, gap.own_correction), (1.0, 0.0));
        assert!((gap.unlinked - 0.3).abs() < 1e-6, "{gap:?}");
    }

    #[test]
    fn the_escape_gives_way_to_links_that_are_sure() {
        let row = closed(Row { own: links(0.6, 0.0), escape: 0.37, escape_rays: 64, complete: true, ..Row::default() });
        assert_eq!((row.own_scale, row.closed_sum), (1.0, 0.6));
        assert!((f64::from(row.escape) - 0.4).abs() < 1e-6, "{row:?}");
    }

    #[test]
    fn links_from_above_give_way_to_the_leafs_own() {
        let row = closed(Row { own: links(0.6, 0.001), above: links(0.5, 0.1), complete: true, ..Row::default() });
        assert!((f64::from(row.closed_sum) - 1.0).abs() < 1e-6, "{row:?}");
        assert!(f64::from(row.own_correction) * 0.001 > -2e-5, "{row:?}");
        assert!((f64::from(row.above_correction) * 0.1 + 0.1).abs() < 1e-4, "{row:?}");
    }

    #[test]
    fn no_link_turns_negative_however_large_the_excess() {
        // One sure link of 1.2 and a doubtful one of 0.3, which cannot give more than itself.
        let sums = Sums { form_factor: 1.5, error: 0.2, variance: 0.04, steepest: 0.2 / 0.3 };
        let row = closed(Row { own: sums, complete: true, ..Row::default() });
        assert!((f64::from(row.closed_sum) - 1.0).abs() < 1e-6, "{row:?}");
        let doubtful = f64::from(row.own_scale) * 0.3 + f64::from(row.own_correction) * 0.2;
        assert!(doubtful > -1e-7, "{doubtful}");
    }

    #[test]
    fn sure_links_keep_their_form_factors_and_doubtful_ones_give_way() {
        let link = |form_factor: f32, uncertainty: f32| Link {
            source: NodeName::root(ClusterId(1), PatchSide { patch: 0, side: 0 }),
            form_factor,
            spread: 0.0,
            uncertainty,
            class: crate::model::links::Visibility::Partial,
        };
        let (sure, doubtful, nothing) = (link(0.5, 0.0), link(0.52, 0.05), link(0.0, 0.05));
        let own = [&sure, &doubtful, &nothing].iter().fold(Sums::default(), |s, l| s.with(l, true));
        let row = closed(Row { own, complete: true, ..Row::default() });
        let after = |l: &Link| {
            f64::from(row.own_scale) * f64::from(l.form_factor) + f64::from(row.own_correction) * error(l, true)
        };
        assert!((after(&sure) - 0.5).abs() < 1e-4, "{row:?}");
        assert!((after(&doubtful) - 0.5).abs() < 1e-4, "{row:?}");
        assert_eq!(after(&nothing), 0.0, "what carries nothing is never lit");
    }

    #[test]
    fn an_unlit_row_stays_zero() {
        let row = closed(Row { unseen: 1.0, complete: true, ..Row::default() });
        assert_eq!((row.own_scale, row.closed_sum), (1.0, 0.0));
    }
}
