//! Corners of quadtree elements on an integer grid: corners that coincide have the same key.

use super::polygon::Polygon;
use super::quadtree;
use crate::base::name::MAX_DEPTH;

/// A corner in units of 4^-14 of the patch, since an edge is cut into up to four parts at a time: along its first
/// edge, along its last.
pub type GridPoint = [u32; 2];

/// Corners of the element at `path` of a patch, and their number, in the order of its shape's.
#[must_use]
pub fn element_corners(patch: &Polygon, path: u32) -> ([GridPoint; 4], usize) {
    let one = 1u32 << (2 * MAX_DEPTH);
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
