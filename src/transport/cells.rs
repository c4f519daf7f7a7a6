//! Where on a source rays go.

use glam::DVec3;

use super::form_factor;
use crate::geom::polygon::Polygon;
use crate::geom::quadtree;
use crate::rays::node::Node;

/// Parts of a source that rays are sent to, by what a point sees of each: of a source that is larger than
/// its distance a few rays by area would tell nothing.
pub(super) struct Cells {
    shapes: Vec<Polygon>,
    /// Share of the source's area.
    areas: Vec<f64>,
}

/// Most parts: a source that is much larger than its distance.
const MOST_CELLS: usize = 128;

/// Share of a source's radius up to which it may reach behind a receiver as if it did not.
const BEHIND: f64 = 0.1;

/// Share of the rays that is spread by area alone.
const BY_AREA: f64 = 0.25;

impl Cells {
    /// Of a source that reaches far behind the receiver what lies in front: all other rays would be in vain.
    pub(super) fn new(r: &Node, s: &Node) -> Self {
        let reach = -BEHIND * s.shape.radius();
        let is_in_front = s.shape.corners().iter().all(|c| r.height(*c) >= reach);
        let seen = if is_in_front { s.shape } else { s.in_front_of(r) };
        let mut shapes = match seen.corners() {
            [a, .., d, e] if seen.corners().len() == 5 => {
                let quad = Polygon::new(&seen.corners()[..4]);
                vec![quad, Polygon::new(&[*a, *d, *e])]
            }
            _ => vec![seen],
        };
        let distance = r.shape.centre().distance(seen.centre());
        let levels = [1.0, 0.25, 0.06].iter().filter(|far| distance < *far * seen.radius()).count();
        for _ in 0..levels {
            shapes = shapes.iter().flat_map(|shape| (0..4).map(|q| quadtree::child(shape, q))).collect();
        }
        let total: f64 = shapes.iter().map(Polygon::area).sum();
        let areas = shapes.iter().map(|shape| shape.area() / total).collect();
        Self { shapes, areas }
    }

    /// How many parts.
    pub(super) fn count(&self) -> usize {
        self.shapes.len()
    }

    /// A point of the source by two numbers in 0..1, and its density relative to one by area.
    pub(super) fn draw(&self, r: &Node, s: &Node, from: DVec3, [c, d]: [f64; 2]) -> (DVec3, f64) {
        if let [whole] = self.shapes.as_slice() {
            return (whole.even_point(c, d), 1.0);
        }
        let mut seen = [0.0; MOST_CELLS];
        for (seen, shape) in seen.iter_mut().zip(&self.shapes) {
            *seen = form_factor::at_point(from, r.normal, shape, s.normal);
        }
        let total: f64 = seen.iter().sum();
        let mut before = 0.0;
        for (i, (shape, by_area)) in self.shapes.iter().zip(&self.areas).enumerate() {
            let by_view = if total > 0.0 { seen[i] / total } else { *by_area };
            let share = BY_AREA * by_area + (1.0 - BY_AREA) * by_view;
            if c < before + share || i + 1 == self.shapes.len() {
                let within = ((c - before) / share).clamp(0.0, 1.0);
                return (shape.even_point(within, d), share / by_area);
            }
            before += share;
        }
        unreachable!("the last part takes what is left")
    }
}
