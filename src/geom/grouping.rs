//! Splits sets of boxes in two: at a wide gap, or where the surface area heuristic says.

use super::bounds::Bounds;

/// An axis order and where to cut it: items before `at` go left.
struct Cut {
    axis: usize,
    at: usize,
}

fn sort_along(boxes: &[Bounds], items: &mut [u32], axis: usize, key: impl Fn(&Bounds, usize) -> f64) {
    items.sort_unstable_by(|a, b| {
        let (ka, kb) = (key(&boxes[*a as usize], axis), key(&boxes[*b as usize], axis));
        ka.total_cmp(&kb).then(a.cmp(b))
    });
}

fn middle(b: &Bounds, axis: usize) -> f64 {
    b.min[axis] + b.max[axis]
}

fn least(b: &Bounds, axis: usize) -> f64 {
    b.min[axis]
}

/// Cuts `items` (indices of `boxes`) in two where that costs least: surface area of each part's box
/// times the number of `granule`s it fills. Sorts the items; returns how many go to the first part.
/// Two items at least.
#[must_use]
pub fn cut_by_area(boxes: &[Bounds], items: &mut [u32], granule: usize) -> usize {
    let n = items.len();
    let mut best: Option<(f64, usize, Cut)> = None;
    let mut areas = vec![0.0; n];
    for axis in 0..3 {
        sort_along(boxes, items, axis, middle);
        let mut right = Bounds::EMPTY;
        for i in (1..n).rev() {
            right = right.union(boxes[items[i] as usize]);
            areas[i] = right.area();
        }
        let mut left = Bounds::EMPTY;
        for at in 1..n {
            left = left.union(boxes[items[at - 1] as usize]);
            let cost = left.area() * at.div_ceil(granule) as f64 + areas[at] * (n - at).div_ceil(granule) as f64;
            let imbalance = at.abs_diff(n - at);
            if best.as_ref().is_none_or(|b| (cost, imbalance) < (b.0, b.1)) {
                best = Some((cost, imbalance, Cut { axis, at }));
            }
        }
    }
    let cut = best.map_or(Cut { axis: 0, at: n / 2 }, |b| b.2);
    sort_along(boxes, items, cut.axis, middle);
    cut.at
}

/// Cuts `items` at the widest gap along an axis, if the parts lie farther apart there than the
/// larger is wide. Sorts the items; returns how many go to the first part.
#[must_use]
pub fn cut_at_gap(boxes: &[Bounds], items: &mut [u32]) -> Option<usize> {
    let n = items.len();
    let mut best: Option<(f64, Cut)> = None;
    for axis in 0..3 {
        sort_along(boxes, items, axis, least);
        let mut right = vec![Bounds::EMPTY; n + 1];
        for i in (0..n).rev() {
            right[i] = right[i + 1].union(boxes[items[i] as usize]);
        }
        let mut left = Bounds::EMPTY;
        for at in 1..n {
            left = left.union(boxes[items[at - 1] as usize]);
            let gap = right[at].min[axis] - left.max[axis];
            let width = left.size().max_element().max(right[at].size().max_element());
            if gap > width && best.as_ref().is_none_or(|b| gap > b.0) {
                best = Some((gap, Cut { axis, at }));
            }
        }
    }
    let (_, cut) = best?;
    sort_along(boxes, items, cut.axis, least);
    Some(cut.at)
}

/// Splits items until no part has more than `most` of them, is over `most_weight` or falls apart at a gap. An item
/// weighs at most that.
#[must_use]
pub fn compact_parts(boxes: &[Bounds], weights: &[u32], most: usize, most_weight: u32) -> Vec<Vec<u32>> {
    let fits =
        |items: &[u32]| items.len() <= most && items.iter().map(|i| weights[*i as usize]).sum::<u32>() <= most_weight;
    let mut waiting = vec![(0..boxes.len() as u32).collect::<Vec<_>>()];
    let mut parts = Vec::new();
    while let Some(mut items) = waiting.pop() {
        let cut = match cut_at_gap(boxes, &mut items) {
            Some(at) => at,
            None if !fits(&items) => cut_by_area(boxes, &mut items, most),
            None => {
                items.sort_unstable();
                parts.push(items);
                continue;
            }
        };
        let right = items.split_off(cut);
        waiting.push(right);
        waiting.push(items);
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn unit_boxes(places: impl Iterator<Item = [f64; 3]>) -> Vec<Bounds> {
        places.map(DVec3::from_array).map(|p| Bounds { min: p, max: p + 1.0 }).collect()
    }

    #[test]
    fn a_row_of_boxes_is_cut_into_full_compact_parts() {
        let boxes = unit_boxes((0..128).map(|i| [f64::from(i), 0.0, 0.0]));
        let parts = compact_parts(&boxes, &[1; 128], 32, 256);
        assert_eq!(parts.iter().map(Vec::len).collect::<Vec<_>>(), [32; 4]);
        assert_eq!(parts[0], (0..32).collect::<Vec<_>>());
    }

    #[test]
    fn parts_farther_apart_than_they_are_wide_go_their_own_ways() {
        let far = unit_boxes([[0., 0., 0.], [1., 0., 0.], [10., 0., 0.], [0.5, 0., 0.]].into_iter());
        assert_eq!(compact_parts(&far, &[1; 4], 64, 256), [vec![0, 1, 3], vec![2]]);
        let near = unit_boxes([[0., 0., 0.], [1., 0., 0.], [3.5, 0., 0.]].into_iter());
        assert_eq!(compact_parts(&near, &[1; 3], 64, 256).len(), 1, "the gap of 1.5 is narrower than 2");
    }

    #[test]
    fn boxes_in_one_place_are_cut_in_half() {
        let boxes = unit_boxes((0..100).map(|_| [0.0; 3]));
        let parts = compact_parts(&boxes, &[1; 100], 64, 256);
        assert_eq!(parts.iter().map(Vec::len).collect::<Vec<_>>(), [50, 50]);
    }

    #[test]
    fn no_part_is_too_heavy() {
        let boxes = unit_boxes((0..64).map(|i| [f64::from(i), 0.0, 0.0]));
        let weights: Vec<u32> = (0..64).map(|i| if i % 16 == 0 { 200 } else { 3 }).collect();
        let parts = compact_parts(&boxes, &weights, 64, 256);
        let weight = |part: &Vec<u32>| part.iter().map(|i| weights[*i as usize]).sum::<u32>();
        assert!(parts.len() >= 4 && parts.iter().all(|part| weight(part) <= 256), "{parts:?}");
        assert_eq!(parts.iter().map(Vec::len).sum::<usize>(), 64);
    }
}
