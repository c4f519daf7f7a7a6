//! Shelves and cupboards, from u = 0 and v = 0 on; their fronts face along -v.

use super::books;
use crate::canvas::Facing::{Down, East, North, South, Up, West};
use crate::canvas::{ALL, Canvas};
use crate::material::Material;
use crate::random::Random;

const WIDTH: f64 = 1.25;
const DEPTH: f64 = 0.35;
/// Thickness of all boards, m.
const BOARD: f64 = 0.02;
/// From board to board, upper side to upper side, m.
const PITCH: f64 = 0.38;
const COMPARTMENTS: usize = 5;

/// A shelf with a row of books in each compartment. It is drawn from within, compartment by compartment: no face of it
/// is hidden by another, and none is cut.
pub fn shelf(mut canvas: Canvas<'_>, number: usize, random: &mut Random) {
    let oak = Material::Oak;
    let (inside, height) = ([BOARD, WIDTH - BOARD], COMPARTMENTS as f64 * PITCH + BOARD);
    canvas.object(&format!("shelf_{number}"));
    let whole = [[0.0, WIDTH], [0.0, DEPTH], [0.0, height]];
    canvas.block(oak, whole, &[East, West, North, Up]);
    for side in [[0.0, BOARD], [inside[1], WIDTH]] {
        canvas.rect(oak, South, 0.0, side, [0.0, height]);
    }
    for i in 0..COMPARTMENTS {
        let bottom = BOARD + i as f64 * PITCH;
        let (up, back) = ([bottom, bottom + PITCH - BOARD], DEPTH - BOARD);
        canvas.rect(oak, South, 0.0, inside, [bottom - BOARD, bottom]);
        canvas.rect(oak, Up, bottom, inside, [0.0, back]);
        canvas.rect(oak, East, inside[0], [0.0, back], up);
        canvas.rect(oak, West, inside[1], [0.0, back], up);
        canvas.rect(oak, South, back, inside, up);
        canvas.rect(oak, Down, up[1], inside, [0.0, back]);
    }
    canvas.rect(oak, South, 0.0, inside, [height - BOARD, height]);
    for i in 0..COMPARTMENTS {
        let mut row = canvas.at(|p| p.within(inside[0] + 0.03, 0.03, BOARD + i as f64 * PITCH));
        row.object(&format!("books_{number}_{i}"));
        books::row(&mut row, inside[1] - inside[0] - 0.06, random);
    }
}

/// A cupboard with two doors.
pub fn cupboard(mut canvas: Canvas<'_>) {
    let [width, depth, height] = [1.5, 0.45, 2.1];
    canvas.object("cupboard");
    canvas.block(Material::White, [[0.0, width], [0.0, depth], [0.0, height]], &[East, West, North, Up]);
    for (door, handle) in [([0.0, 0.5 * width], -0.05), ([0.5 * width, width], 0.03)] {
        let u = 0.5 * width + handle;
        canvas.rect(Material::White, South, 0.0, door, [0.0, height]);
        canvas.block(Material::Steel, [[u, u + 0.02], [-0.035, -0.02], [0.9, 1.1]], &ALL);
    }
}
