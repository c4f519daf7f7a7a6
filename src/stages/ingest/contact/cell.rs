//! Convex regions of a face, and how a line splits one without leaving a sliver.

use glam::{DVec2, DVec3};

use super::plane::{Line, box_of, crossing};

/// A corner of a [`Cell`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// In the face's plane, m.
    pub flat: DVec2,
    /// In space, m from the store's origin: on the face's edges where the face is bent.
    pub at: DVec3,
    /// Which corner of the face it is, if it is one.
    pub of_face: Option<u8>,
    /// What the edge that begins here lies on.
    pub edge: Border,
}

/// What an edge of a [`Cell`] lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Border {
    /// An edge of the face.
    Outline,
    /// The line that made the cell.
    Made,
    /// The line of a node of the face's cut tree.
    Node(u32),
}

/// A convex region of a face, anticlockwise in its plane.
#[derive(Clone, Debug)]
pub struct Cell {
    /// Three or more.
    pub corners: Vec<Corner>,
}

/// A cell in two.
pub struct Halves {
    /// What parts them, through a corner of both at either end.
    pub line: Line,
    /// Left of it.
    pub left: Cell,
    /// Right of it.
    pub right: Cell,
}

/// Where a line passes a cell's boundary.
struct Gate {
    corner: Corner,
    is_new: bool,
    /// Corners of the cell before and after it.
    before: usize,
    after: usize,
}

impl Cell {
    /// Length of the diagonal of its box, m.
    #[must_use]
    pub fn extent_m(&self) -> f64 {
        let [low, high] = box_of(self.corners.iter().map(|c| c.flat));
        low.distance(high)
    }

    /// Twice its area, m2.
    #[must_use]
    pub fn doubled_area(&self) -> f64 {
        let first = self.corners[0].flat;
        self.corners[1..].windows(2).map(|w| (w[0].flat - first).perp_dot(w[1].flat - first)).sum()
    }

    /// Its area by its length, a triangle's height: how wide it is, m.
    #[must_use]
    pub fn width_m(&self) -> f64 {
        let far = |a: &Corner| self.corners.iter().map(|b| a.flat.distance_squared(b.flat)).fold(0.0, f64::max);
        self.doubled_area() / self.corners.iter().map(far).fold(f64::MIN_POSITIVE, f64::max).sqrt()
    }

    /// Splits along a line. Where that passes a corner within `near_m` it runs through the corner; none if a half
    /// would be narrower than that.
    #[must_use]
    pub fn split(&self, line: Line, near_m: f64) -> Option<Halves> {
        let n = self.corners.len();
        let off: Vec<f64> = self.corners.iter().map(|c| line.left_m(c.flat)).collect();
        let is_left = |i: usize| off[i] > near_m;
        let is_right = |i: usize| off[i] < -near_m;
        let last_left = (0..n).find(|i| is_left(*i) && !is_left((i + 1) % n))?;
        let last_right = (0..n).find(|i| is_right(*i) && !is_right((i + 1) % n))?;
        let (start, end) = (self.gate(last_left, &off, near_m), self.gate(last_right, &off, near_m));
        let moved = !(start.is_new && end.is_new);
        let line = if moved { Line::through(start.corner.flat, end.corner.flat) } else { line };
        let (left, right) = (self.between(&end, &start), self.between(&start, &end));
        (left.width_m() >= near_m && right.width_m() >= near_m).then_some(Halves { line, left, right })
    }

    /// Where the line leaves the side of a run of corners that ends with `last`.
    fn gate(&self, last: usize, off: &[f64], near_m: f64) -> Gate {
        let n = self.corners.len();
        let on = (1..n).map(|k| (last + k) % n).take_while(|i| off[*i].abs() <= near_m);
        if let Some(i) = on.reduce(|a, b| if off[b].abs() < off[a].abs() { b } else { a }) {
            return Gate { corner: self.corners[i], is_new: false, before: (i + n - 1) % n, after: (i + 1) % n };
        }
        let next = (last + 1) % n;
        let (a, b, t) = (&self.corners[last], &self.corners[next], crossing(off[last], off[next]));
        let corner = Corner { flat: a.flat.lerp(b.flat, t), at: a.at.lerp(b.at, t), of_face: None, edge: a.edge };
        Gate { corner, is_new: true, before: last, after: next }
    }

    fn between(&self, start: &Gate, end: &Gate) -> Self {
        let n = self.corners.len();
        let count = (end.before + n - start.after) % n + 1;
        let mut corners = Vec::with_capacity(count + 2);
        corners.push(start.corner);
        corners.extend((0..count).map(|k| self.corners[(start.after + k) % n]));
        corners.push(Corner { edge: Border::Made, ..end.corner });
        Self { corners }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(corners: &[[f64; 2]]) -> Cell {
        let corner = |p: &[f64; 2]| Corner {
            flat: DVec2::from_array(*p),
            at: DVec3::new(p[0], p[1], 0.0),
            of_face: None,
            edge: Border::Outline,
        };
        Cell { corners: corners.iter().map(corner).collect() }
    }

    #[test]
    fn halves_share_the_line_and_nothing_else() {
        let square = cell(&[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]);
        let halves = square.split(Line::through(DVec2::new(0.5, -3.0), DVec2::new(0.5, 4.0)), 1e-3).unwrap();
        assert_eq!((halves.left.doubled_area(), halves.right.doubled_area()), (1.0, 3.0));
        assert_eq!((halves.left.corners.len(), halves.right.corners.len()), (4, 4));
        assert!(halves.left.corners.iter().all(|c| halves.line.left_m(c.flat) >= 0.0));
        for half in [&halves.left, &halves.right] {
            for (i, corner) in half.corners.iter().enumerate() {
                let is_on = |c: &Corner| halves.line.left_m(c.flat).abs() < 1e-12;
                let is_made = is_on(corner) && is_on(&half.corners[(i + 1) % 4]);
                assert_eq!(corner.edge == Border::Made, is_made, "edge {i}");
            }
        }
    }

    #[test]
    fn a_line_near_a_corner_goes_through_it_and_one_near_an_edge_splits_nothing() {
        let square = cell(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        let halves = square.split(Line::through(DVec2::new(0.0, 5e-4), DVec2::new(1.0, 1.0)), 1e-3).unwrap();
        assert_eq!((halves.left.corners.len(), halves.right.corners.len()), (3, 3));
        assert_eq!(halves.line.left_m(DVec2::ZERO), 0.0);
        assert!(square.split(Line::through(DVec2::new(0.0, 5e-4), DVec2::new(1.0, 0.0)), 1e-3).is_none());
        let tip = cell(&[[0.0, 0.0], [1.0, 0.0], [1.0, 0.01]]);
        assert!(tip.split(Line::through(DVec2::new(0.002, 0.0), DVec2::new(0.002, 1.0)), 1e-3).is_none());
        assert!(square.split(Line::through(DVec2::new(0.0, 2.0), DVec2::new(1.0, 2.0)), 1e-3).is_none());
    }
}
