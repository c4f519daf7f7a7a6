//! Corners of quadtree elements on an integer grid: corners that coincide have the same key.

#[cfg(test)]
use super::quadtree;
use crate::base::name::MAX_DEPTH;

/// A corner in units of 2^-14 of the patch: along its first edge, along its last.
pub type GridPoint = [u32; 2];

/// Corners of the element at `path` of a patch with `count` corners, in the order of its shape's.
#[must_use]
pub fn element_corners(count: usize, path: u32) -> [GridPoint; 4] {
    let one = 1u32 << MAX_DEPTH;
    let mut c =
        if count == 3 { [[0, 0], [one, 0], [0, one], [0, one]] } else { [[0, 0], [one, 0], [one, one], [0, one]] };
    let depth = (31 - path.leading_zeros()) / 2;
    for level in (0..depth).rev() {
        c = child(c, count, (path >> (2 * level)) & 3);
    }
    c
}

/// The same cuts as `quadtree::child` makes.
fn child(c: [GridPoint; 4], count: usize, quarter: u32) -> [GridPoint; 4] {
    let mid = |i: usize, j: usize| [(c[i][0] + c[j][0]) / 2, (c[i][1] + c[j][1]) / 2];
    if count == 3 {
        let (ab, bc, ca) = (mid(0, 1), mid(1, 2), mid(2, 0));
        let [x, y, z] = match quarter {
            0 => [c[0], ab, ca],
            1 => [ab, c[1], bc],
            2 => [ca, bc, c[2]],
            _ => [bc, ca, ab],
        };
        return [x, y, z, z];
    }
    let (ab, bc, cd, da, centre) = (mid(0, 1), mid(1, 2), mid(2, 3), mid(3, 0), mid(0, 2));
    match quarter {
        0 => [c[0], ab, centre, da],
        1 => [ab, c[1], bc, centre],
        2 => [centre, bc, c[2], cd],
        _ => [da, centre, cd, c[3]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::polygon::Polygon;
    use glam::DVec3;

    #[test]
    fn grid_corners_follow_the_shapes() {
        let one = f64::from(1u32 << MAX_DEPTH);
        for count in [3, 4] {
            let whole = element_corners(count, 1).map(|[u, v]| DVec3::new(f64::from(u), f64::from(v), 0.0));
            let mut shape = Polygon::new(&whole[..count]);
            let mut path = 1;
            for quarter in [3, 1, 0, 2, 3, 3, 1] {
                shape = quadtree::child(&shape, quarter);
                path = path << 2 | quarter;
                let grid = element_corners(count, path);
                for (corner, [u, v]) in shape.corners().iter().zip(grid) {
                    let distance = corner.distance(DVec3::new(f64::from(u), f64::from(v), 0.0));
                    assert!(distance < 1e-9 * one, "{count} {path:b}");
                }
            }
        }
    }
}
