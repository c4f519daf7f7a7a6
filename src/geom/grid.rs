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

/// Elements of a patch one after the other, each found from what it shares with the one before.
pub struct Descent {
    /// Down to the last: paths, shapes and corners.
    above: Vec<(u32, Polygon, [GridPoint; 4])>,
}

impl Descent {
    /// Into a patch.
    #[must_use]
    pub fn into(patch: &Polygon) -> Self {
        Self { above: vec![(1, *patch, element_corners(patch, 1).0)] }
    }

    /// An element's shape, and its corners in the order of the shape's.
    pub fn to(&mut self, path: u32) -> (&Polygon, [GridPoint; 4]) {
        let depth_of = |path: u32| (31 - path.leading_zeros()) / 2;
        let depth = depth_of(path);
        let is_above = |at: u32| depth_of(at) <= depth && path >> (2 * (depth - depth_of(at))) == at;
        while self.above.last().is_some_and(|(at, ..)| !is_above(*at)) {
            self.above.pop();
        }
        loop {
            let (at, shape, grid) = self.above.last().expect("the patch is above all");
            if *at == path {
                break;
            }
            let quarter = path >> (2 * (depth - depth_of(*at) - 1)) & 3;
            let (shape, grid) = quadtree::child_on_grid(shape, grid, quarter, mixed);
            self.above.push((at << 2 | quarter, shape, grid));
        }
        let (_, shape, grid) = self.above.last().expect("just there");
        (shape, *grid)
    }
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
            let (mut path, mut descent) = (1, Descent::into(&patch));
            for quarter in [3, 1, 0, 2, 3, 3, 1] {
                shape = quadtree::child(&shape, quarter);
                path = path << 2 | quarter;
                let (grid, count) = element_corners(&patch, path);
                assert_eq!(count, shape.corners().len());
                for other in [path, path ^ 1, 1, path ^ 3] {
                    let (found, corners) = descent.to(other);
                    assert_eq!(
                        (found.corners().len(), corners),
                        (element_corners(&patch, other).1, element_corners(&patch, other).0)
                    );
                }
                assert_eq!(descent.to(path).0.corners(), shape.corners());
                for (corner, [u, v]) in shape.corners().iter().zip(grid) {
                    let at = DVec3::new(f64::from(u), f64::from(v) * squeezed, 0.0) / one;
                    assert!(corner.distance(at) < 1e-9, "{count} {path:b}");
                }
            }
        }
    }
}
