//! What stands in a room: workplaces, shelves with books, a cupboard, a board on the wall, chairs for others.

mod books;
mod chair;
mod desk;
mod storage;

use super::canvas::Canvas;
use super::canvas::Facing::{Down, East, North, South, Up};
use super::material::Material;
use super::random::Random;
use super::room::{Behind, INSIDE};

/// Furnishes a room in the frame of its unit.
pub fn draw(canvas: &mut Canvas<'_>, behind: Behind, random: &mut Random) {
    match behind {
        Behind::Room => for_one(canvas, random),
        Behind::Corridor | Behind::Facade(_) => for_two(canvas, behind.depth(), random),
    }
}

/// Two desks along the side walls at the far end, shelves behind one of them.
fn for_two(canvas: &mut Canvas<'_>, depth: f64, random: &mut Random) {
    let near = depth - 2.1;
    desk::workplace(canvas.at(|p| p.within(1.0, near, 0.0).quarters(1)), 1, random);
    desk::workplace(canvas.at(|p| p.within(3.1, near + desk::LENGTH, 0.0).quarters(3)), 2, random);
    for (number, v) in [(1, 2.85), (2, 1.5)] {
        storage::shelf(canvas.at(|p| p.within(3.63, v, 0.0).quarters(3)), number, random);
    }
    storage::cupboard(canvas.at(|p| p.within(3.2, 0.5, 0.0).quarters(2)));
    board(canvas, [1.2, 2.8]);
    for (number, u) in [(1, 1.5), (2, 2.5)] {
        chair::visitors(canvas.at(|p| p.within(u, 2.2, 0.0).turned(random.between(-30.0, 30.0))), number, random);
    }
}

/// A desk at the back, and a table for two.
fn for_one(canvas: &mut Canvas<'_>, random: &mut Random) {
    desk::workplace(canvas.at(|p| p.within(1.9, 2.9, 0.0)), 1, random);
    storage::shelf(canvas.at(|p| p.within(3.63, 2.2, 0.0).quarters(3)), 1, random);
    storage::cupboard(canvas.at(|p| p.within(0.55, 2.25, 0.0).quarters(1)));
    board(canvas, [1.0, 2.2]);
    desk::table(canvas.at(|p| p.within(1.1, 1.5, 0.0)));
    for (number, u) in [(1, 1.45), (2, 2.1)] {
        chair::visitors(canvas.at(|p| p.within(u, 1.2, 0.0).turned(random.between(-15.0, 15.0))), number, random);
    }
}

/// A white board on the left wall.
fn board(canvas: &mut Canvas<'_>, along: [f64; 2]) {
    canvas.object("board");
    let board = [[INSIDE[0], INSIDE[0] + 0.02], along, [0.8, 2.1]];
    canvas.block(Material::White, board, &[East, North, South, Up, Down]);
}
