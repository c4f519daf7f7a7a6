//! Corners of quadtree elements on an integer grid: corners that coincide have the same key.

use super::polygon::Polygon;
use super::quadtree;
use crate::base::name::MAX_DEPTH;

/// A corner in units of 4^-14 of the patch, since an edge is cut into up to four parts at a time: along its first
/// edge, along its last.
pub type GridPoint = [u32; 2];

/// The whole of an edge.
const ONE: u32 = 1 << (2 * MAX_DEPTH);

/// The edges of a patch on which a point lies, each with how far along it, as a share: two where it is a corner.
pub fn places_on_edges(patch: &Polygon, [u, v]: GridPoint) -> impl Iterator<Item = (usize, f64)> + use<> {
    let last = patch.corners().len() - 1;
    let [on_first, on_last] = [v == 0, u == 0];
    let (on_second, on_third) = if last == 2 { (u + v == ONE, false) } else { (u == ONE, v == ONE) };
    let edges = [(on_first, 0, u), (on_second, 1, v), (on_third, 2, ONE - u), (on_last, last, ONE - v)];
    edges.into_iter().filter(|(is_on, ..)| *is_on).map(|(_, edge, at)| (edge, f64::from(at) / f64::from(ONE)))
}

/// Corners of the element at `path` of a patch, and their number, in the order of its shape's.
#[must_use]
pub fn element_corners(patch: &Polygon, path: u32) -> ([GridPoint; 4], usize) {
    let one = ONE;
    let mut grid = if patch.corners().len() == 3 {
        [[0, 0], [one, 0], [0, one], [0, one]]
    } else {
        [[0, 0], [one, 0], [one, one], [0, one]]
    };
    let mut shape = *patch;
    let depth = (31 - path.leading_zeros()) / 2;
    for level in (0..depth).rev() {
        (shape, grid) = quadtree::child_on_grid(&shape, &grid, (path >> (2 * level)) & 3, mixed);
    }
    (grid, shape.corners().len())
}

fn mixed(a: GridPoint, b: GridPoint, quarters: u32) -> GridPoint {
    std::array::from_fn(|i| (a[i] * (4 - quarters) + b[i] * quarters) / 4)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn a_point_is_on_the_edges_on_which_its_place_lies() {
        for corners in [&[DVec3::ZERO, DVec3::X, DVec3::ONE, DVec3::Y][..], &[DVec3::ZERO, DVec3::X, DVec3::Y]] {
            let patch = Polygon::new(corners);
            let n = corners.len();
            let (points, _) = element_corners(&patch, 1);
            for i in 0..n {
                let middle = [0, 1].map(|k| (points[i][k] + points[(i + 1) % n][k]) / 2);
                assert_eq!(places_on_edges(&patch, middle).collect::<Vec<_>>(), [(i, 0.5)]);
                let mut at_corner: Vec<_> = places_on_edges(&patch, points[i]).collect();
                at_corner.sort_by(|a, b| b.1.total_cmp(&a.1));
                assert_eq!(at_corner, [((i + n - 1) % n, 1.0), (i, 0.0)]);
            }
            assert_eq!(places_on_edges(&patch, [ONE / 4; 2]).count(), 0);
        }
    }

    #[test]
    fn grid_corners_follow_the_shapes() {
        let one = f64::from(1u32 << (2 * MAX_DEPTH));
        for (count, squeezed) in [(3, 1.0), (4, 1.0), (3, 0.03), (4, 0.03)] {
            let corners = [[0.0, 0.0], [1.0, 0.0], if count == 3 { [0.0, 1.0] } else { [1.0, 1.0] }, [0.0, 1.0]];
            let patch = Polygon::new(&corners.map(|[u, v]| DVec3::new(u, v * squeezed, 0.0))[..count]);
            let mut shape = patch;
            let mut path = 1;
            for quarter in [3, 1, 0, 2, 3, 3, 1] {
                shape = quadtree::child(&shape, quarter);
                path = path << 2 | quarter;
                let (grid, count) = element_corners(&patch, path);
                assert_eq!(count, shape.corners().len());
                for (corner, [u, v]) in shape.corners().iter().zip(grid) {
                    let at = DVec3::new(f64::from(u), f64::from(v) * squeezed, 0.0) / one;
                    assert!(corner.distance(at) < 1e-9, "{count} {path:b}");
                }
            }
        }
    }
}
