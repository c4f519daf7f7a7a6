//! Where an element is measured: in every round sixteen places, one in each cell of it.
//!
//! The cells of an element whose children are alike are its children's children. Four rounds look at the four children of
//! a cell, sixteen at theirs: so four rounds of an element are one of each of its children, which take them over.

use glam::DVec3;

use super::frame::{Frame, Plane};
use crate::geom::polygon::Polygon;
use crate::geom::quadtree::UnitCut;
use crate::geom::sequence::{Sequence, mix, unit};
use crate::rays::locate::Covering;
use crate::rays::node::Node;
use crate::transport::light::line::{Design, PLACES};
use crate::transport::row::{Found, GONE, Part, Row, Share, slot};

/// Places of an element: in every round another one in each cell.
pub struct Places {
    shape: Polygon,
    alike: Option<UnitCut>,
    covering: Covering,
    /// Of the element.
    seed: u64,
    /// Of its side, and where below it the element lies.
    of_side: u64,
    path: u64,
    /// Bit i: cell i is open. What is covered where the first round looks takes no part.
    pub open: u16,
}

/// Tries to find an open place in a cell.
const TRIES: u64 = 4;

/// Levels below a cell in which rounds are spread evenly.
const LEVELS: u32 = 3;

impl Places {
    /// Of an element, for one part of its light. What covers its side is left out.
    #[must_use]
    pub fn of(node: &Node, part: Part, seed: u64, covering: &Covering) -> Self {
        let of_side = mix(seed ^ mix((node.name.0 >> 29) << 1 ^ (part as u64) << 63));
        let (seed, path) = (seed_of(node, part, seed), u64::from(node.name.path()));
        let (alike, covering) = (UnitCut::alike(&node.shape), covering.over(&node.shape));
        let mut places = Self { shape: node.shape, alike, covering, seed, of_side, path, open: u16::MAX };
        if !places.covering.is_empty() {
            places.open =
                (0..PLACES).filter(|cell| places.open_at(*cell, 0).is_some()).fold(0, |open, i| open | 1 << i);
        }
        places
    }

    /// The open cells, by number.
    pub fn each(&self) -> impl Iterator<Item = usize> + '_ {
        (0..PLACES).filter(|i| self.open & (1 << i) != 0)
    }

    /// The child of a cell (of alike children) that a round looks at, the path of the cell extended by it: each of every
    /// four rounds another one, in an order of their own, so that where a ray begins tells nothing of where it goes.
    fn step(&self, path: u64, round: u64) -> u64 {
        path << 2 | (round ^ mix(self.of_side ^ mix(path ^ (round / 4) << 48))) & 3
    }

    /// Two numbers in 0..1 for a place of a cell of a grid over the whole element.
    fn numbers(&self, cell: usize, round: u64, turn: u64) -> [f64; 2] {
        let [u, v] = self.jitter((cell as u64) << 8 | turn << 1, round);
        [((cell % 4) as f64 + u) / 4.0, ((cell / 4) as f64 + v) / 4.0]
    }

    fn jitter(&self, of: u64, round: u64) -> [f64; 2] {
        [0, 1].map(|k| unit(mix(self.seed ^ mix(round << 16 | of | k))))
    }

    fn place(&self, cell: usize, round: u64, turn: u64) -> DVec3 {
        let Some(alike) = self.alike else {
            let [u, v] = self.numbers(cell, round, turn);
            return self.shape.even_point(u, v);
        };
        let mut path = self.path << 4 | cell as u64;
        let jitter = self.jitter((cell as u64) << 8 | turn << 1, round);
        if turn > 0 {
            return alike.point(&self.shape, alike.within(path, 2, alike.even(jitter)));
        }
        for level in 0..LEVELS {
            path = self.step(path, round >> (2 * level));
        }
        alike.point(&self.shape, alike.within(path, 2 + LEVELS, alike.even(jitter)))
    }

    fn open_at(&self, cell: usize, round: u64) -> Option<DVec3> {
        (0..TRIES).find_map(|turn| {
            let point = self.place(cell, round, turn);
            (!self.covering.covers(point)).then_some(point)
        })
    }

    /// The place of an open cell in a round.
    #[must_use]
    pub fn at(&self, cell: usize, round: u16) -> DVec3 {
        if self.covering.is_empty() {
            return self.place(cell, u64::from(round), 0);
        }
        let found = self.open_at(cell, u64::from(round)).or_else(|| self.open_at(cell, 0));
        found.unwrap_or_else(|| self.shape.centroid())
    }

    /// For fitting what so many rounds measured: middles of the places of each cell, relative to a centroid.
    #[must_use]
    pub fn design(&self, rounds: u16, frame: &Frame, centroid: Plane) -> Design {
        let middles = std::array::from_fn(|cell| {
            let at = frame.plane(match self.alike {
                // Rounds that went through all quarters of a cell were in its middle on average, near enough.
                Some(alike) if rounds.is_multiple_of(4) && rounds > 0 => {
                    alike.point(&self.shape, alike.within(cell as u64, 2, alike.centroid()))
                }
                Some(_) => {
                    let places = (0..rounds.max(1)).map(|round| self.place(cell, u64::from(round), 0));
                    places.fold(DVec3::ZERO, |sum, place| sum + place) / f64::from(rounds.max(1))
                }
                None => {
                    let (mut sum, count) = ([0.0; 2], f64::from(rounds.max(1)));
                    for round in 0..u64::from(rounds.max(1)) {
                        let [u, v] = self.numbers(cell, round, 0);
                        sum = [sum[0] + u, sum[1] + v];
                    }
                    self.shape.even_point(sum[0] / count, sum[1] / count)
                }
            });
            [at[0] - centroid[0], at[1] - centroid[1]]
        });
        Design::new(middles, self.open)
    }

    /// What rays of the element's row have found within one of its children: the child's own first rounds, a quarter as
    /// many; none where children are not alike or something covers the side.
    #[must_use]
    pub fn of_child(&self, row: &Row, quarter: u32) -> Row {
        let nests = self.alike.is_some() && self.covering.is_empty();
        let rounds = if nests { row.rounds / 4 } else { 0 };
        // Where a cell's ray of a round went: the child's cell.
        let cell_of = |cell: usize, round: u16| {
            let path = self.path << 4 | cell as u64;
            (cell % 4) << 2 | (self.step(path, u64::from(round)) & 3) as usize
        };
        let cells = 4 * quarter as usize..4 * quarter as usize + 4;
        let found = match &row.found {
            Found::Shares(shares) => Found::Shares(
                (shares.iter())
                    .filter(|share| cells.contains(&usize::from(share.slot / 2)) && u16::from(share.round) < 4 * rounds)
                    .map(|share| {
                        let cell = cell_of(usize::from(share.slot / 2), u16::from(share.round));
                        Share { slot: slot(cell, usize::from(share.slot % 2)), round: share.round / 4, ..*share }
                    })
                    .collect(),
            ),
            Found::Hits(hits) => {
                let mut of_child = vec![GONE; 2 * PLACES * usize::from(rounds)];
                for round in 0..4 * rounds {
                    for cell in cells.clone() {
                        for half in 0..2 {
                            let to = usize::from(round / 4) * PLACES + cell_of(cell, round);
                            of_child[2 * to + half] = hits[2 * (usize::from(round) * PLACES + cell) + half];
                        }
                    }
                }
                Found::Hits(of_child)
            }
        };
        Row { element: row.element.child(quarter), part: row.part, rounds, open: u16::MAX, found }
    }
}

/// A seed that no other element or part has.
fn seed_of(node: &Node, part: Part, seed: u64) -> u64 {
    mix(seed ^ mix(node.name.0 ^ (part as u64) << 63))
}

/// Numbers for the rays of an element: two independent sequences, each handed out to the places in an order of its own:
/// were it the same, what halves have wrong would go over the places alike, and look like structure.
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
        let turned = (0..4).filter(|bit| round >> bit & 1 == 1).fold(0, |turned, bit| turned ^ TURNS[bit as usize]);
        self.sequences[half].point(u64::from(round) * PLACES as u64 + u64::from(self.orders[half][place] ^ turned))
    }
}

/// What each bit of a round does to a place's turn in it. So turned, a round's rays are sixteen in a row of the sequence, and
/// those of a place over 2^k rounds, k up to 4, have one in each part of every grid of that many in the first two dimensions
/// as well. Of the eight ways to get that the one which comes nearest to it in the others.
const TURNS: [u8; 4] = [3, 6, 12, 11];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, PatchSide};
    use crate::geom::quadtree::child_at;
    use crate::model::geometry::PatchRecord;
    use crate::transport::row::Hit;
    use bytemuck::Zeroable;

    fn node(corners: &[[f32; 3]]) -> Node {
        let mut patch = PatchRecord::zeroed();
        patch.corners_m = std::array::from_fn(|i| corners[i.min(corners.len() - 1)]);
        (patch.corner_count, patch.sides) = (corners.len() as u8, 3);
        Node::root(ClusterId(0), &patch, PatchSide { patch: 0, side: 0 })
    }

    /// The cell of an element that holds a place.
    fn cell_of(element: &Node, place: DVec3) -> usize {
        let child = child_at(&element.shape, place);
        (4 * child + child_at(&element.child(child).shape, place)) as usize
    }

    #[test]
    fn rays_of_a_place_fill_the_hemisphere_as_evenly_as_those_of_a_round() {
        let draws = Draws::of(&node(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), Part::Indirect, 1);
        for levels in 0..=4u32 {
            let rounds = 1u32 << levels;
            for (half, place) in [(0, 0), (0, 5), (1, 15)] {
                for first in [0, rounds] {
                    let rays: Vec<_> = (first..first + rounds).map(|round| draws.draw(half, place, round)).collect();
                    for a in 0..=levels {
                        let cell = |[u, v, ..]: [f64; 4]| {
                            ((u * f64::from(1 << a)) as u32, (v * f64::from(1 << (levels - a))) as u32)
                        };
                        let cells: std::collections::BTreeSet<_> = rays.iter().map(|&ray| cell(ray)).collect();
                        assert_eq!(cells.len(), rays.len(), "place {place}, rounds from {first}, 2^{a} of 2^{levels}");
                    }
                }
            }
        }
    }

    #[test]
    fn four_rounds_of_an_element_are_one_of_each_of_its_children() {
        let quad = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [4.0, 2.0, 0.0], [1.0, 2.0, 0.0]];
        let triangle = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [1.0, 2.0, 0.0]];
        for corners in [&quad[..], &triangle[..]] {
            let element = node(corners);
            let places = Places::of(&element, Part::Indirect, 1, &Covering::default());
            const ROUNDS: u16 = 16;
            // Each hit says which it is.
            let each = (0..ROUNDS).flat_map(|round| (0..2 * PLACES as u16).map(move |slot| [round, slot]));
            let hits = each.clone().map(|at| Hit { side: element.name, at }).collect();
            let share = |[round, slot]: [u16; 2]| Share {
                lamp: element.name,
                slot: slot as u8,
                round: round as u8,
                factor: f32::from(100 * round + slot),
            };
            for (part, found) in
                [(Part::Indirect, Found::Hits(hits)), (Part::Direct, Found::Shares(each.map(share).collect()))]
            {
                let row = Row { element: element.name, part, rounds: ROUNDS, open: u16::MAX, found };
                for quarter in 0..4 {
                    let (child, of_child) = (element.child(quarter), places.of_child(&row, quarter));
                    assert_eq!((of_child.element, of_child.rounds), (child.name, ROUNDS / 4));
                    assert_eq!(of_child.len(), 2 * PLACES * usize::from(ROUNDS / 4));
                    let seen: Vec<([u16; 2], usize, u16)> = match &of_child.found {
                        Found::Hits(hits) => (hits.iter().enumerate())
                            .map(|(i, hit)| (hit.at, i % (2 * PLACES), (i / (2 * PLACES)) as u16))
                            .collect(),
                        Found::Shares(shares) => (shares.iter())
                            .map(|s| ([s.factor as u16 / 100, s.factor as u16 % 100], s.slot.into(), s.round.into()))
                            .collect(),
                    };
                    for ([round, slot], to_slot, to_round) in seen {
                        let place = places.at(usize::from(slot / 2), round);
                        assert_eq!(cell_of(&element, place), usize::from(slot / 2));
                        assert_eq!(child_at(&element.shape, place), quarter);
                        assert_eq!(cell_of(&child, place), to_slot / 2, "round {round}, slot {slot}");
                        assert_eq!((to_slot % 2, to_round), (usize::from(slot % 2), round / 4));
                    }
                }
            }
        }
    }
}
