//! Input polygons into triangles and convex planar quads, as ingest needs them.
//!
//! Corners are positions in a slice; results are indices into it. Works on any polygon in space,
//! planar or not, by looking along its area vector.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

/// A piece of a polygon: three or four corners in the polygon's winding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece {
    corners: [usize; 4],
    count: usize,
}

impl Piece {
    fn new(corners: &[usize]) -> Self {
        let mut all = [0; 4];
        all[..corners.len()].copy_from_slice(corners);
        Self { corners: all, count: corners.len() }
    }

    /// Indices of the corners.
    #[must_use]
    pub fn corners(&self) -> &[usize] {
        &self.corners[..self.count]
    }
}

/// Sine of the smallest bend at a corner that still counts as one.
const BEND: f64 = 1e-3;

/// Twice the area times the normal (Newell): defined for every polygon.
#[must_use]
pub fn area_vector(points: &[DVec3]) -> DVec3 {
    let Some((first, others)) = points.split_first() else { return DVec3::ZERO };
    others.windows(2).map(|w| (w[0] - *first).cross(w[1] - *first)).fold(DVec3::ZERO, |a, b| a + b)
}

/// Whether all points lie within `tolerance` of the plane through their mean across the area vector.
#[must_use]
pub fn is_planar(points: &[DVec3], tolerance: f64) -> bool {
    let normal = area_vector(points).normalize_or_zero();
    let mean = points.iter().fold(DVec3::ZERO, |a, b| a + *b) / points.len() as f64;
    points.iter().all(|p| (*p - mean).dot(normal).abs() <= tolerance)
}

/// Whether the polygon, seen along its area vector, turns the same way at every corner; a corner
/// that hardly bends is not convex.
#[must_use]
pub fn is_convex(points: &[DVec3]) -> bool {
    let normal = area_vector(points).normalize_or_zero();
    let n = points.len();
    let mut turned = 0.0;
    for i in 0..n {
        let flat = |v: DVec3| v - normal * v.dot(normal);
        let along = flat(points[(i + 1) % n] - points[i]);
        let next = flat(points[(i + 2) % n] - points[(i + 1) % n]);
        let sine = along.cross(next).dot(normal);
        if sine <= BEND * along.length() * next.length() {
            return false;
        }
        turned += sine.atan2(along.dot(next));
    }
    // A star turns the same way at every corner too, but more than once.
    turned < 1.5 * std::f64::consts::TAU
}

/// How often a polygon turns round, seen along its area vector: once where it does not cross itself.
#[must_use]
pub fn turns(points: &[DVec3]) -> f64 {
    let normal = area_vector(points).normalize_or_zero();
    let n = points.len();
    let turn = |i: usize| {
        let (along, next) = (points[(i + 1) % n] - points[i], points[(i + 2) % n] - points[(i + 1) % n]);
        along.cross(next).dot(normal).atan2(along.dot(next))
    };
    (0..n).map(turn).sum::<f64>() / std::f64::consts::TAU
}

/// Splits a polygon of three or more corners. Convex planar quads stay whole; other convex polygons
/// that are not planar become a fan from the first corner; the rest is cut by ear clipping, and
/// neighbouring ears joined to quads. Planar polygons give the same pieces whichever corner or
/// winding they begin with. `tolerance`: distance from the mean plane that counts as planar, m.
#[must_use]
pub fn split(points: &[DVec3], tolerance: f64) -> Vec<Piece> {
    let n = points.len();
    if n == 3 {
        return vec![Piece::new(&[0, 1, 2])];
    }
    let (planar, convex) = (is_planar(points, tolerance), is_convex(points));
    if convex && !planar {
        return (1..n - 1).map(|i| Piece::new(&[0, i, i + 1])).collect();
    }
    if convex && n == 4 {
        return vec![Piece::new(&[0, 1, 2, 3])];
    }
    let (order, turned) = canonical_order(points);
    let sorted: Vec<DVec3> = order.iter().map(|i| points[*i]).collect();
    let pieces = join_ears(&sorted, ears(&sorted), tolerance);
    pieces
        .into_iter()
        .map(|piece| {
            let mut corners: Vec<usize> = piece.corners().iter().map(|i| order[*i]).collect();
            if turned {
                corners.reverse();
            }
            Piece::new(&corners)
        })
        .collect()
}

/// The corners from the least one on, towards the lesser neighbour; whether that is against the
/// winding.
fn canonical_order(points: &[DVec3]) -> (Vec<usize>, bool) {
    let n = points.len();
    let less = |a: usize, b: usize| points[a].to_array().map(f64::to_bits) < points[b].to_array().map(f64::to_bits);
    let start = (1..n).fold(0, |best, i| if less(i, best) { i } else { best });
    let turned = less((start + n - 1) % n, (start + 1) % n);
    let order = (0..n).map(|i| if turned { (start + n - i) % n } else { (start + i) % n }).collect();
    (order, turned)
}

/// Ear clipping of the polygon as seen along its area vector; triangles wind as the polygon does.
fn ears(points: &[DVec3]) -> Vec<[usize; 3]> {
    let normal = area_vector(points).normalize_or(DVec3::Z);
    let (u, v) = normal.any_orthonormal_pair();
    let flat: Vec<DVec2> = points.iter().map(|p| *p - points[0]).map(|p| DVec2::new(p.dot(u), p.dot(v))).collect();
    let numbers: Vec<f64> = flat.iter().flat_map(|p| [p.x, p.y]).collect();
    let mut out: Vec<[usize; 3]> = earcutr::earcut(&numbers, &[], 2)
        .map(|indices| indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect())
        .unwrap_or_default();
    if out.is_empty() {
        // Too thin to clip: a fan keeps what area there is.
        return (1..points.len() - 1).map(|i| [0, i, i + 1]).collect();
    }
    for t in &mut out {
        if (flat[t[1]] - flat[t[0]]).perp_dot(flat[t[2]] - flat[t[0]]) < 0.0 {
            t.swap(1, 2);
        }
    }
    out
}

/// Joins ears that share an edge and make a convex planar quad, in order, each with the first that fits.
fn join_ears(points: &[DVec3], ears: Vec<[usize; 3]>, tolerance: f64) -> Vec<Piece> {
    let mut out: Vec<Piece> = Vec::with_capacity(ears.len());
    // Who has an edge, as it winds: a neighbour has it the other way round.
    let mut owners: HashMap<[usize; 2], Vec<usize>> = HashMap::with_capacity(3 * ears.len());
    for ear in ears {
        let edges = [0, 1, 2].map(|i| [ear[i], ear[(i + 1) % 3]]);
        let mut near: Vec<usize> = edges
            .iter()
            .filter_map(|[a, b]| owners.get(&[*b, *a]))
            .flatten()
            .copied()
            .filter(|i| out[*i].count == 3)
            .collect();
        near.sort_unstable();
        let joined = near.into_iter().find_map(|i| {
            let [a, b, c, _] = out[i].corners;
            joined_quad(&[a, b, c], &ear, points, tolerance).map(|quad| (i, quad))
        });
        match joined {
            Some((i, quad)) => out[i] = Piece::new(&quad),
            None => {
                for edge in edges {
                    owners.entry(edge).or_default().push(out.len());
                }
                out.push(Piece::new(&ear));
            }
        }
    }
    out
}

fn joined_quad(a: &[usize; 3], b: &[usize; 3], points: &[DVec3], tolerance: f64) -> Option<[usize; 4]> {
    for i in 0..3 {
        for j in 0..3 {
            if a[i] == b[(j + 1) % 3] && a[(i + 1) % 3] == b[j] {
                let quad = [a[(i + 2) % 3], a[i], b[(j + 2) % 3], a[(i + 1) % 3]];
                return is_good_quad(&quad.map(|k| points[k]), tolerance).then_some(quad);
            }
        }
    }
    None
}

/// Whether four corners make a planar quad that is plainly convex.
#[must_use]
pub fn is_good_quad(corners: &[DVec3; 4], tolerance: f64) -> bool {
    if !is_convex(corners) || !is_planar(corners, tolerance) {
        return false;
    }
    (0..4).all(|i| {
        let (a, b) = (corners[(i + 1) % 4] - corners[i], corners[(i + 2) % 4] - corners[(i + 1) % 4]);
        a.cross(b).length() > 0.05 * a.length() * b.length()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(points: &[[f64; 2]]) -> Vec<DVec3> {
        points.iter().map(|p| DVec3::new(p[0], p[1], 0.0)).collect()
    }

    fn area(points: &[DVec3], pieces: &[Piece]) -> f64 {
        pieces.iter().map(|p| area_vector(&p.corners().iter().map(|i| points[*i]).collect::<Vec<_>>()).z * 0.5).sum()
    }

    #[test]
    fn pieces_cover_a_polygon_in_its_own_winding() {
        let l_shape = at(&[[0., 0.], [3., 0.], [3., 1.], [1., 1.], [1., 3.], [0., 3.]]);
        let dart = at(&[[0., 0.], [2., 1.], [0., 2.], [0.5, 1.]]);
        let hexagon = at(&[[0., 0.], [1., 0.], [2., 1.], [2., 2.], [1., 2.], [0., 1.]]);
        for (polygon, expected) in [(l_shape, 5.0), (dart, 1.5), (hexagon, 3.0)] {
            for reversed in [false, true] {
                let mut points = polygon.clone();
                let mut sign = 1.0;
                if reversed {
                    points.reverse();
                    sign = -1.0;
                }
                let pieces = split(&points, 1e-9);
                assert!((area(&points, &pieces) - sign * expected).abs() < 1e-12, "{points:?} {pieces:?}");
            }
        }
    }

    #[test]
    fn an_l_becomes_quads_only() {
        let points = at(&[[0., 0.], [3., 0.], [3., 1.], [1., 1.], [1., 3.], [0., 3.]]);
        let pieces = split(&points, 1e-9);
        assert_eq!(pieces.iter().map(|p| p.corners().len()).sum::<usize>(), 8, "{pieces:?}");
    }

    #[test]
    fn a_polygon_written_backwards_from_another_corner_has_the_same_pieces() {
        let points = at(&[[0., 0.], [2., 0.], [3., 1.], [1., 1.2], [2., 2.], [0., 3.], [-1., 1.]]);
        let n = points.len();
        let sets = |points: &[DVec3]| {
            let mut all: Vec<Vec<[i64; 2]>> = split(points, 1e-9)
                .iter()
                .map(|p| {
                    let mut set: Vec<_> = p
                        .corners()
                        .iter()
                        .map(|i| [(points[*i].x * 10.) as i64, (points[*i].y * 10.) as i64])
                        .collect();
                    set.sort_unstable();
                    set
                })
                .collect();
            all.sort();
            all
        };
        let other: Vec<DVec3> = (0..n).map(|i| points[(2 * n + 3 - i) % n]).collect();
        assert_eq!(sets(&points), sets(&other));
    }

    #[test]
    fn a_bent_quad_becomes_a_fan_from_its_first_corner() {
        let bent = [DVec3::ZERO, DVec3::X, DVec3::new(1., 1., 0.2), DVec3::Y];
        assert_eq!(split(&bent, 1e-4), [Piece::new(&[0, 1, 2]), Piece::new(&[0, 2, 3])]);
        assert_eq!(split(&bent, 0.1), [Piece::new(&[0, 1, 2, 3])]);
    }

    #[test]
    fn a_quad_with_a_straight_corner_loses_no_area() {
        let points = at(&[[0., 0.], [1., 0.], [2., 0.], [0., 2.]]);
        let pieces = split(&points, 1e-9);
        assert!((area(&points, &pieces) - 2.0).abs() < 1e-12, "{pieces:?}");
    }

    /// Spikes out and in again: as many ears as corners, in every direction.
    #[test]
    fn a_star_of_60_000_corners_is_split_in_seconds_and_keeps_its_area() {
        let n = 60_000;
        let points: Vec<DVec3> = (0..n)
            .map(|i| (std::f64::consts::TAU * f64::from(i) / f64::from(n), if i % 2 == 0 { 1.0 } else { 2.0 }))
            .map(|(angle, r)| DVec3::new(r * angle.cos(), r * angle.sin(), 0.0))
            .collect();
        let started = std::time::Instant::now();
        let pieces = split(&points, 1e-9);
        let expected = 0.5 * area_vector(&points).z;
        assert!((area(&points, &pieces) / expected - 1.0).abs() < 1e-9, "{} {expected}", area(&points, &pieces));
        assert!(started.elapsed().as_secs() < 60, "{:?}", started.elapsed());
    }

    #[test]
    fn a_pentagram_is_not_convex() {
        let star: Vec<DVec3> = (0..5)
            .map(|i| f64::from(i) * 2.0 * std::f64::consts::TAU / 5.0)
            .map(|a| DVec3::new(a.cos(), a.sin(), 0.0))
            .collect();
        assert!(!is_convex(&star));
    }
}
