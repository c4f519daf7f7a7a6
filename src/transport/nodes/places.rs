//! Where an element is measured: in every round sixteen places, one in each cell of a grid over it.

use glam::DVec3;

use super::frame::{Frame, Plane};
use crate::geom::polygon::Polygon;
use crate::geom::sequence::{Sequence, mix, unit};
use crate::rays::locate::Covering;
use crate::rays::node::Node;
use crate::transport::light::line::{Design, PLACES};
use crate::transport::row::Part;

/// Places of an element: in every round another one in each cell of a grid.
pub struct Places<'a> {
    shape: Polygon,
    covering: &'a Covering,
    seed: u64,
    /// Bit i: cell i is open. What is covered where the first round looks takes no part.
    pub open: u16,
}

/// Tries to find an open place in a cell.
const TRIES: u64 = 4;

impl<'a> Places<'a> {
    /// Of an element, for one part of its light. What covers its side is left out.
    #[must_use]
    pub fn of(node: &Node, part: Part, seed: u64, covering: &'a Covering) -> Self {
        let mut places = Self { shape: node.shape, covering, seed: seed_of(node, part, seed), open: 0 };
        for cell in 0..PLACES {
            if places.open_at(cell, 0).is_some() {
                places.open |= 1 << cell;
            }
        }
        places
    }

    /// The open cells, by number.
    pub fn each(&self) -> impl Iterator<Item = usize> + '_ {
        (0..PLACES).filter(|i| self.open & (1 << i) != 0)
    }

    /// Two numbers in 0..1 for a place of a cell, over the whole element.
    fn numbers(&self, cell: usize, round: u64, turn: u64) -> [f64; 2] {
        let jitter = |k: u64| unit(mix(self.seed ^ mix(round << 16 | (cell as u64) << 8 | turn << 1 | k)));
        [((cell % 4) as f64 + jitter(0)) / 4.0, ((cell / 4) as f64 + jitter(1)) / 4.0]
    }

    fn open_at(&self, cell: usize, round: u64) -> Option<DVec3> {
        (0..TRIES).find_map(|turn| {
            let [u, v] = self.numbers(cell, round, turn);
            let point = self.shape.even_point(u, v);
            (!self.covering.covers(point)).then_some(point)
        })
    }

    /// The place of an open cell in a round.
    #[must_use]
    pub fn at(&self, cell: usize, round: u16) -> DVec3 {
        let found = self.open_at(cell, u64::from(round)).or_else(|| self.open_at(cell, 0));
        found.unwrap_or_else(|| self.shape.centroid())
    }

    /// For fitting what so many rounds measured: middles of the places of each cell, relative to a centroid.
    #[must_use]
    pub fn design(&self, rounds: u16, frame: &Frame, centroid: Plane) -> Design {
        let middles = std::array::from_fn(|cell| {
            let (mut sum, count) = ([0.0; 2], f64::from(rounds.max(1)));
            for round in 0..u64::from(rounds.max(1)) {
                let [u, v] = self.numbers(cell, round, 0);
                sum = [sum[0] + u, sum[1] + v];
            }
            let at = frame.plane(self.shape.even_point(sum[0] / count, sum[1] / count));
            [at[0] - centroid[0], at[1] - centroid[1]]
        });
        Design::new(middles, self.open)
    }
}

/// A seed that no other element or part has.
fn seed_of(node: &Node, part: Part, seed: u64) -> u64 {
    mix(seed ^ mix(node.name.0 ^ (part as u64) << 63))
}

/// Numbers for the rays of an element: two independent sequences, each handed out to the places in an order of its own,
/// so that what one half meets at a place tells nothing of what the other meets there.
pub struct Draws {
    sequences: [Sequence; 2],
    orders: [[u8; PLACES]; 2],
}

impl Draws {
    /// Of an element, for one part of its light.
    #[must_use]
    pub fn of(node: &Node, part: Part, seed: u64) -> Self {
        let seed = seed_of(node, part, seed);
        let orders = [1, 2].map(|half| {
            let mut order: [u8; PLACES] = std::array::from_fn(|i| i as u8);
            for i in (1..PLACES).rev() {
                order.swap(i, (mix(seed ^ mix(half << 32 | i as u64)) % (i as u64 + 1)) as usize);
            }
            order
        });
        Self { sequences: [3, 4].map(|half| Sequence::new(mix(seed ^ half << 40))), orders }
    }

    /// Four numbers in 0..1 for a half's ray from a place in a round.
    #[must_use]
    pub fn draw(&self, half: usize, place: usize, round: u32) -> [f64; 4] {
        self.sequences[half].point(u64::from(round) * PLACES as u64 + u64::from(self.orders[half][place]))
    }
}
