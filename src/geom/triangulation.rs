//! Triangles between the points round a convex polygon.

use glam::DVec3;

/// Triangles, by number of point and in their winding; none has a point of the outline on an edge, and in no circle about
/// one lies another point (Delaunay): they are as stout as may be. `outline`: in order, also on edges between corners.
#[must_use]
pub fn triangles(outline: &[DVec3]) -> Vec<[usize; 3]> {
    let mut triangles = Vec::with_capacity(outline.len().saturating_sub(2));
    // Chords with the points between their ends on one side.
    let mut open = vec![(0, outline.len().saturating_sub(1))];
    while let Some((from, to)) = open.pop() {
        let cotangent = |&at: &usize| {
            let (a, b) = (outline[from] - outline[at], outline[to] - outline[at]);
            a.dot(b) / a.cross(b).length()
        };
        // The one that sees the chord under the widest angle.
        let widest = (from + 1..to).min_by(|a, b| cotangent(a).total_cmp(&cotangent(b)));
        if let Some(at) = widest {
            triangles.push([from, at, to]);
            open.extend([(from, at), (at, to)]);
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_of_a_strip_reach_across_it_and_not_along_it() {
        // Points every tenth on the lower edge and every quarter on the upper one of a strip of 4 m by 4 cm.
        let lower = (0..10).map(|i| DVec3::new(0.4 * f64::from(i), 0.0, 0.0));
        let upper = (0..4).map(|i| DVec3::new(4.0 - f64::from(i), 0.04, 0.0));
        let outline: Vec<DVec3> =
            lower.chain([DVec3::new(4.0, 0.0, 0.0)]).chain(upper).chain([DVec3::new(0.0, 0.04, 0.0)]).collect();
        let found = triangles(&outline);
        assert_eq!(found.len(), outline.len() - 2);
        let mut area = 0.0;
        for triangle in found {
            let [a, b, c] = triangle.map(|i| outline[i]);
            let doubled = (b - a).cross(c - a).z;
            assert!(doubled > 1e-6, "{triangle:?} turns with the outline and is none of a line");
            let xs = [a.x, b.x, c.x];
            let long = xs.into_iter().fold(0.0, f64::max) - xs.into_iter().fold(f64::INFINITY, f64::min);
            assert!(long <= 1.0 + 1e-12, "{triangle:?} is {long} m long");
            area += 0.5 * doubled;
        }
        assert!((area - 0.16).abs() < 1e-12, "{area}");
    }

    #[test]
    fn fewer_than_three_points_have_none() {
        assert!(triangles(&[]).is_empty() && triangles(&[DVec3::ZERO, DVec3::X]).is_empty());
    }
}
