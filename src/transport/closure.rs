//! Closure: each leaf's row of form factors, the escape included, sums to at most 1.
//!
//! A row over 1 is scaled to 1. A row under 1 by no more than the unseen mass of its cluster plus
//! three standard errors is scaled up to 1. A larger gap stays and is reported as unlinked. What is
//! added or taken goes to links and escape by their variances: the escape is known from rays alone,
//! so where all links are proved visible it gives way to them and brings no noise into the light.

use super::link_rows::Link;
use super::mesh::Mesh;
use crate::base::NodeName;
use crate::geom::sequence::{Sequence, cosine_direction, mix};
use crate::model::links::LeafClosure;
use crate::rays::RayScene;
use crate::rays::node::Node;
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

/// What is known of a row before closing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Row {
    /// Form factors of the leaf's own links.
    pub own: Part,
    /// Form factors of links of elements above it.
    pub above: Part,
    /// Measured form factor to the escape.
    pub escape: f64,
    /// Form factor that the cluster's visibility list may miss.
    pub unseen: f64,
    /// Whether all that is seen has been linked; only then may a row be scaled up.
    pub complete: bool,
}

/// Part of a row.
#[derive(Clone, Copy, Debug, Default)]
pub struct Part {
    /// Sum of form factors.
    pub sum: f64,
    /// Its variance, from sampled visibility.
    pub variance: f64,
    /// Largest deviation within the leaf: a link's mean over an element is off by up to its spread in
    /// a part of it.
    pub bound: f64,
}

impl Part {
    fn with(self, link: &Link) -> Self {
        let error = f64::from(link.uncertainty);
        Self {
            sum: self.sum + f64::from(link.form_factor),
            variance: self.variance + error * error,
            bound: self.bound + f64::from(link.spread),
        }
    }

    fn plus(self, other: Self) -> Self {
        Self { sum: self.sum + other.sum, variance: self.variance + other.variance, bound: self.bound + other.bound }
    }
}

/// Error of a form factor's own rounding and averaging, in a sum over a row.
const FLOOR: f64 = 1e-4;

/// Closes the rows of all leaves of a mesh that see anything or emit (`emits`: their light may leave the
/// model though none arrives); `measured` gives a leaf's escape, unseen mass and completeness.
/// Ascending by name.
pub fn rows(
    mesh: &Mesh,
    links: &[Vec<Link>],
    emits: impl Fn(NodeName) -> bool,
    mut measured: impl FnMut(NodeName) -> Row,
) -> Vec<LeafClosure> {
    let mut above = vec![Part::default(); mesh.elements.len()];
    let mut out = Vec::new();
    for (at, element) in mesh.elements.iter().enumerate() {
        let own = links[at].iter().fold(Part::default(), |part, link| part.with(link));
        if !element.is_leaf() {
            let first = element.first_child as usize;
            let down = above[at].plus(own);
            above[first..first + 4].fill(down);
        } else if own.sum + above[at].sum > 0.0 || emits(element.name) {
            // The mean over the leaf itself is what its own links are for.
            let own = Part { bound: 0.0, ..own };
            out.push(close(element.name, &Row { own, above: above[at], ..measured(element.name) }));
        }
    }
    out.sort_by_key(|c| c.leaf);
    out
}

/// Closes a leaf's row.
#[must_use]
pub fn close(leaf: NodeName, row: &Row) -> LeafClosure {
    let variance = |part: &Part| {
        let half_bound = 0.5 * part.bound;
        let floor = FLOOR * part.sum;
        part.variance + half_bound * half_bound + floor * floor
    };
    let (own, above) = (variance(&row.own), variance(&row.above));
    let doubt = (row.escape * (1.0 - row.escape)).max(0.25 / ESCAPE_RAYS as f64) / ESCAPE_RAYS as f64;
    let out = if row.escape > 0.0 { doubt } else { 0.0 };
    let sum = row.own.sum + row.above.sum;
    let gap = 1.0 - sum - row.escape;
    let allowed = row.unseen + row.own.bound + row.above.bound + 3.0 * (own + above + out).sqrt();
    let mut closed = Closed { own: row.own.sum, above: row.above.sum, escape: row.escape };
    if gap < 0.0 || (row.complete && gap <= allowed) {
        closed = closed.share(gap, [own, above, out], if gap > 0.0 { row.unseen } else { 0.0 });
    }
    let factor = |after: f64, before: f64| if before > 0.0 { after / before } else { 1.0 };
    let unlinked = if row.complete { (1.0 - closed.own - closed.above - closed.escape).max(0.0) } else { 0.0 };
    LeafClosure {
        leaf: leaf.0,
        own_factor: factor(closed.own, row.own.sum) as f32,
        above_factor: factor(closed.above, row.above.sum) as f32,
        escape: closed.escape as f32,
        unlinked: unlinked as f32,
        own_sum: row.own.sum as f32,
        above_sum: row.above.sum as f32,
        measured_escape: row.escape as f32,
        error: (own + above).sqrt() as f32,
    }
}

/// The three parts of a row while it is closed.
struct Closed {
    own: f64,
    above: f64,
    escape: f64,
}

impl Closed {
    /// Adds a gap (or takes an excess) by variances; what lists may miss goes to links by their sums.
    fn share(self, gap: f64, variances: [f64; 3], unseen: f64) -> Self {
        let links = self.own + self.above;
        let missed = unseen * unseen / links.max(f64::MIN_POSITIVE);
        let weights = [variances[0] + missed * self.own, variances[1] + missed * self.above, variances[2]];
        let total: f64 = weights.iter().sum();
        let part = |i: usize| gap * weights[i] / total;
        let shared = Self { own: self.own + part(0), above: self.above + part(1), escape: self.escape + part(2) };
        if shared.own >= 0.0 && shared.above >= 0.0 && shared.escape >= 0.0 {
            return shared;
        }
        // An excess larger than the part that is least sure: all shrink alike.
        let whole = links + self.escape;
        let scale = (whole + gap) / whole;
        Self { own: self.own * scale, above: self.above * scale, escape: self.escape * scale }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, PatchSide};

    fn closed(row: Row) -> LeafClosure {
        close(NodeName::root(ClusterId(0), PatchSide { patch: 0, side: 0 }), &row)
    }

    fn part(sum: f64) -> Part {
        Part { sum, ..Part::default() }
    }

    #[test]
    fn rows_over_one_are_scaled_down_and_small_gaps_up() {
        let over = closed(Row { own: part(1.25), complete: true, ..Row::default() });
        assert!((f64::from(over.own_factor) - 0.8).abs() < 1e-6, "{over:?}");
        let under = closed(Row { own: part(0.996), unseen: 0.005, complete: true, ..Row::default() });
        assert!((f64::from(under.own_factor) * 0.996 - 1.0).abs() < 1e-6, "{under:?}");
    }

    #[test]
    fn a_large_gap_stays_and_is_reported() {
        let own = Part { variance: 1e-4, ..part(0.7) };
        let gap = closed(Row { own, unseen: 0.005, complete: true, ..Row::default() });
        assert_eq!(gap.own_factor, 1.0);
        assert!((gap.unlinked - 0.3).abs() < 1e-6, "{gap:?}");
    }

    #[test]
    fn the_escape_gives_way_to_links_that_are_sure() {
        let row = closed(Row { own: part(0.6), escape: 0.37, complete: true, ..Row::default() });
        assert!((row.own_factor - 1.0).abs() < 1e-3, "{row:?}");
        assert!((f64::from(row.escape) - 0.4).abs() < 1e-3, "{row:?}");
    }

    #[test]
    fn links_from_above_give_way_to_the_leafs_own() {
        let above = Part { bound: 0.1, ..part(0.5) };
        let row = closed(Row { own: part(0.6), above, complete: true, ..Row::default() });
        assert!((row.own_factor - 1.0).abs() < 1e-4, "{row:?}");
        assert!((f64::from(row.above_factor) * 0.5 - 0.4).abs() < 1e-4, "{row:?}");
    }

    #[test]
    fn an_unlit_row_stays_zero() {
        let row = closed(Row { unseen: 1.0, complete: true, ..Row::default() });
        assert_eq!((row.own_factor, row.own_sum), (1.0, 0.0));
    }
}
