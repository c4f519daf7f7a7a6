//! Small convex planar polygons: what elements and clipped sources are.

use glam::DVec3;

use super::split::area_vector;

/// Most corners a [`Polygon`] may have: a quad clipped by two planes, with room to spare.
pub const MAX_CORNERS: usize = 8;

/// How far the diagonals' middles of a quad may lie apart, relative to a diagonal, where it counts as a parallelogram.
const EVEN: f64 = 1e-3;

/// A convex planar polygon of up to [`MAX_CORNERS`] corners, m, on the stack.
#[derive(Clone, Copy, Debug)]
pub struct Polygon {
    corners: [DVec3; MAX_CORNERS],
    count: usize,
}

impl Polygon {
    /// From its corners, at most [`MAX_CORNERS`].
    #[must_use]
    pub fn new(points: &[DVec3]) -> Self {
        let mut corners = [DVec3::ZERO; MAX_CORNERS];
        corners[..points.len()].copy_from_slice(points);
        Self { corners, count: points.len() }
    }

    /// The corners, in winding order.
    #[must_use]
    pub fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    /// Twice the area times the unit normal (right-handed winding).
    #[must_use]
    pub fn doubled_area_vector(&self) -> DVec3 {
        area_vector(self.corners())
    }

    /// Area, m2.
    #[must_use]
    pub fn area(&self) -> f64 {
        0.5 * self.doubled_area_vector().length()
    }

    /// Unit normal of the front, the side from which the corners run anticlockwise.
    #[must_use]
    pub fn normal(&self) -> DVec3 {
        self.doubled_area_vector().normalize_or_zero()
    }

    /// Mean of the corners.
    #[must_use]
    pub fn centre(&self) -> DVec3 {
        self.corners().iter().fold(DVec3::ZERO, |a, b| a + *b) / self.count.max(1) as f64
    }

    /// Centre of area.
    #[must_use]
    pub fn centroid(&self) -> DVec3 {
        let c = self.corners();
        let (mut sum, mut weight) = (DVec3::ZERO, 0.0);
        for i in 1..c.len().saturating_sub(1) {
            let area = (c[i] - c[0]).cross(c[i + 1] - c[0]).length();
            sum += (c[0] + c[i] + c[i + 1]) * (area / 3.0);
            weight += area;
        }
        if weight > 0.0 { sum / weight } else { self.centre() }
    }

    /// A point by two numbers in [0, 1): uniform in area over triangles and parallelograms, by the
    /// bilinear map over other quads, by a fan over larger polygons.
    #[must_use]
    pub fn point(&self, u: f64, v: f64) -> DVec3 {
        let c = self.corners();
        match c.len() {
            4 => c[0] * ((1.0 - u) * (1.0 - v)) + c[1] * (u * (1.0 - v)) + c[2] * (u * v) + c[3] * ((1.0 - u) * v),
            3 => {
                let root = u.sqrt();
                c[0] * (1.0 - root) + c[1] * (root * (1.0 - v)) + c[2] * (root * v)
            }
            _ => self.fan_point(u, v),
        }
    }

    /// A point by two numbers in [0, 1), uniform in area over all shapes.
    #[must_use]
    pub fn even_point(&self, u: f64, v: f64) -> DVec3 {
        if self.is_skew() { self.fan_point(u, v) } else { self.point(u, v) }
    }

    /// Whether it is a quad, but no parallelogram.
    #[must_use]
    pub fn is_skew(&self) -> bool {
        let c = self.corners();
        c.len() == 4 && (c[0] + c[2]).distance(c[1] + c[3]) > EVEN * (c[0].distance(c[2]))
    }

    fn fan_point(&self, u: f64, v: f64) -> DVec3 {
        let c = self.corners();
        let area = |i: usize| (c[i] - c[0]).cross(c[i + 1] - c[0]).length();
        let total: f64 = (1..c.len() - 1).map(area).sum();
        let mut left = u * total;
        for i in 1..c.len() - 1 {
            let a = area(i);
            if left < a || i == c.len() - 2 {
                return Self::new(&[c[0], c[i], c[i + 1]]).point((left / a).clamp(0.0, 1.0), v);
            }
            left -= a;
        }
        c[0]
    }

    /// The part where `normal . x >= offset`.
    #[must_use]
    pub fn clip(&self, normal: DVec3, offset: f64) -> Self {
        let mut out = Self { corners: [DVec3::ZERO; MAX_CORNERS], count: 0 };
        let c = self.corners();
        for i in 0..c.len() {
            let (a, b) = (c[i], c[(i + 1) % c.len()]);
            let (da, db) = (normal.dot(a) - offset, normal.dot(b) - offset);
            if da >= 0.0 {
                out.push(a);
            }
            if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
                out.push(a + (b - a) * (da / (da - db)));
            }
        }
        out
    }

    fn push(&mut self, point: DVec3) {
        if self.count < MAX_CORNERS {
            self.corners[self.count] = point;
            self.count += 1;
        }
    }

    /// Corners in the opposite order, so that the normal turns round.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let mut out = *self;
        out.corners[..self.count].reverse();
        out
    }

    /// Longest edge, m.
    #[must_use]
    pub fn longest_edge(&self) -> f64 {
        let c = self.corners();
        (0..c.len()).map(|i| c[i].distance(c[(i + 1) % c.len()])).fold(0.0, f64::max)
    }

    /// Radius of a ball round [`Self::centre`] that holds the polygon, m.
    #[must_use]
    pub fn radius(&self) -> f64 {
        let centre = self.centre();
        self.corners().iter().map(|c| c.distance(centre)).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_clipped_in_half_keeps_half_its_area_and_its_normal() {
        let square = Polygon::new(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]);
        let half = square.clip(DVec3::X, 0.5);
        assert!((half.area() - 0.5).abs() < 1e-15, "{}", half.area());
        assert!((half.normal() - DVec3::Z).length() < 1e-15);
        assert_eq!(square.clip(DVec3::X, 2.0).corners().len(), 0);
        assert!((square.reversed().normal() + DVec3::Z).length() < 1e-15);
    }

    #[test]
    fn points_of_a_polygon_average_to_its_centroid() {
        let triangle = Polygon::new(&[DVec3::ZERO, DVec3::X, DVec3::Y]);
        let pentagon =
            Polygon::new(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.5, 1.5, 0.0), DVec3::Y]);
        for polygon in [triangle, pentagon] {
            let n = 200;
            let mut mean = DVec3::ZERO;
            for i in 0..n {
                for j in 0..n {
                    mean += polygon.point((f64::from(i) + 0.5) / f64::from(n), (f64::from(j) + 0.5) / f64::from(n));
                }
            }
            mean /= f64::from(n * n);
            assert!((mean - polygon.centroid()).length() < 2e-3, "{mean} {}", polygon.centroid());
        }
    }
}
