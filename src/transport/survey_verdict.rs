//! What becomes of an element that is surveyed: split, or kept with so many rays.

use super::oracle::Tolerances;
use super::refine::Context;
use super::survey::RAYS;
use super::survey_row::Worth;
use crate::base::name::MAX_DEPTH;
use crate::rays::node::Node;

/// Share of the error that a row may carry which noise may make up.
const NOISE_SHARE: f64 = 0.5;

/// Edge, in smallest elements, of an element beyond which noise must fall as area grows: else few large ones, seeing
/// little, would carry most of the error of all power.
const LARGE: f64 = 8.0;

/// Share of the smallest element's edge down to which what is close by is resolved.
const NEAR_FLOOR: f64 = 0.25;

/// How often what a mean hides of what is close by counts: for what the node gets, and for what it sends, since what is
/// close to a part of it hides that part from others, which see the rest and get the mean.
const GOT_AND_SENT: f64 = 2.0;

/// Width of a strip, in smallest elements, beyond which its quarters would be more for its width than for its length.
const NARROW: f64 = 0.25;

/// What is to be done with an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Keep a row; so many rays would be enough.
    Keep(u64),
    Split,
}

/// Whether an element is to be split for what is close by, when its mean hides so much of it (W/m2).
pub(super) fn can_resolve(context: &Context<'_>, r: &Node, unresolved: f64) -> bool {
    let floor_m = NEAR_FLOOR * context.tolerances.min_element_m;
    hides_much(&context.tolerances, r.shape.area(), unresolved) && can_divide(r, floor_m)
}

/// Verdict on an element that may be divided down to elements of `smallest_m`.
pub(super) fn verdict(context: &Context<'_>, r: &Node, worth: &Worth, smallest_m: f64) -> Verdict {
    let tolerances = &context.tolerances;
    let area_m2 = r.shape.area();
    let floor_m2 = tolerances.min_element_m * tolerances.min_element_m;
    let matters = |error: f64| {
        let excess = error / tolerances.row_w_m2;
        excess > 1.0 && excess * area_m2 > floor_m2
    };
    if can_divide(r, smallest_m) && matters(worth.gradient) {
        return Verdict::Split;
    }
    let size = area_m2 / (LARGE * LARGE * floor_m2);
    let noise = worth.noise / NOISE_SHARE * size.sqrt().max(1.0);
    if !matters(noise) {
        return Verdict::Keep(RAYS.0);
    }
    let excess = noise / tolerances.row_w_m2;
    let wanted = ((RAYS.0 as f64 * excess * excess).ceil() as u64).next_power_of_two();
    // The few rays that decide see little of what is small and bright: where many are wanted, more are.
    if size > 1.0 && wanted > RAYS.1 / 4 && can_divide(r, smallest_m) {
        return Verdict::Split;
    }
    Verdict::Keep(wanted)
}

/// Whether what a mean over so much area hides of what is close by (W/m2) matters.
fn hides_much(tolerances: &Tolerances, area_m2: f64, unresolved: f64) -> bool {
    let floor_m = NEAR_FLOOR * tolerances.min_element_m;
    let excess = GOT_AND_SENT * unresolved / tolerances.row_w_m2;
    excess > 1.0 && excess * area_m2 > floor_m * floor_m
}

/// Whether an element may be divided into elements no smaller than `smallest_m`.
pub(super) fn can_divide(r: &Node, smallest_m: f64) -> bool {
    let narrow_m = NARROW * smallest_m;
    r.name.depth() < MAX_DEPTH && !r.is_smallest(smallest_m) && r.shape.area() > narrow_m * narrow_m
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_mean_hides_counts_for_what_is_got_and_for_what_is_sent() {
        let tolerances = Tolerances { row_w_m2: 1.0, min_element_m: 0.4 };
        let large_m2 = 1.0;
        assert!(hides_much(&tolerances, large_m2, 0.6), "half of the error is carried twice");
        assert!(!hides_much(&tolerances, large_m2, 0.4));
        // A node of a quarter of the smallest element's edge, 0.01 m2, is divided for no less than its own error.
        assert!(!hides_much(&tolerances, 0.004, 0.6) && hides_much(&tolerances, 0.004, 1.3));
    }
}
