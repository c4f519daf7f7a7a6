//! Shapes of quadtree elements: they follow from patch and path alone.
//!
//! Children of a triangle: its three corners in order, then the middle; of a quad: its four corners
//! in order, cut at the edge midpoints and the mean of the corners.

use glam::DVec3;

use super::polygon::Polygon;
use crate::model::geometry::PatchRecord;

/// The patch as a polygon in f64, winding towards its front.
#[must_use]
pub fn patch_polygon(patch: &PatchRecord) -> Polygon {
    let corners = patch.corners_m.map(|c| DVec3::from_array(c.map(f64::from)));
    Polygon::new(&corners[..usize::from(patch.corner_count)])
}

/// The element of a patch at `path` (a leading 1, then two bits a level), winding towards the
/// patch's front. Both sides share shapes.
#[must_use]
pub fn element_polygon(patch: &PatchRecord, path: u32) -> Polygon {
    let mut shape = patch_polygon(patch);
    let depth = (31 - path.leading_zeros()) / 2;
    for level in (0..depth).rev() {
        shape = child(&shape, (path >> (2 * level)) & 3);
    }
    shape
}

/// Child `quarter` (0..4) of an element's shape.
#[must_use]
pub fn child(shape: &Polygon, quarter: u32) -> Polygon {
    let c = shape.corners();
    let mid = |i: usize, j: usize| (c[i] + c[j]) * 0.5;
    if c.len() == 3 {
        let (ab, bc, ca) = (mid(0, 1), mid(1, 2), mid(2, 0));
        return match quarter {
            0 => Polygon::new(&[c[0], ab, ca]),
            1 => Polygon::new(&[ab, c[1], bc]),
            2 => Polygon::new(&[ca, bc, c[2]]),
            _ => Polygon::new(&[bc, ca, ab]),
        };
    }
    let (ab, bc, cd, da) = (mid(0, 1), mid(1, 2), mid(2, 3), mid(3, 0));
    let centre = shape.centre();
    match quarter {
        0 => Polygon::new(&[c[0], ab, centre, da]),
        1 => Polygon::new(&[ab, c[1], bc, centre]),
        2 => Polygon::new(&[centre, bc, c[2], cd]),
        _ => Polygon::new(&[da, centre, cd, c[3]]),
    }
}

/// The child of `shape` that holds `point`, which lies on it.
#[must_use]
pub fn child_at(shape: &Polygon, point: DVec3) -> u32 {
    let normal = shape.normal();
    let inside_by = |quarter: u32| {
        let quarter_shape = child(shape, quarter);
        let c = quarter_shape.corners();
        (0..c.len())
            .map(|i| {
                let edge = c[(i + 1) % c.len()] - c[i];
                normal.cross(edge).dot(point - c[i]) / edge.length().max(f64::MIN_POSITIVE)
            })
            .fold(f64::INFINITY, f64::min)
    };
    let mut best = (0, f64::NEG_INFINITY);
    for quarter in 0..4 {
        let depth = inside_by(quarter);
        if depth > best.1 {
            best = (quarter, depth);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn patch(corners: &[[f32; 3]]) -> PatchRecord {
        let mut record = PatchRecord::zeroed();
        for i in 0..4 {
            record.corners_m[i] = corners[i.min(corners.len() - 1)];
        }
        record.corner_count = corners.len() as u8;
        record
    }

    #[test]
    fn children_tile_their_parent_with_its_normal() {
        let quad = patch(&[[0., 0., 0.], [3., 0., 0.], [2., 2., 0.], [0., 1., 0.]]);
        let triangle = patch(&[[0., 0., 1.], [3., 0., 0.], [2., 2., 0.]]);
        for record in [quad, triangle] {
            let whole = patch_polygon(&record);
            for path in [1, 4, 0b1_11, 0b1_10_01] {
                let shape = element_polygon(&record, path);
                let sum: f64 = (0..4).map(|q| child(&shape, q).area()).sum();
                assert!((sum - shape.area()).abs() < 1e-12 * shape.area(), "{path:b}: {sum} {}", shape.area());
                assert!((shape.normal() - whole.normal()).length() < 1e-6);
                for q in 0..4 {
                    assert_eq!(child_at(&shape, child(&shape, q).centroid()), q);
                }
            }
        }
    }
}
