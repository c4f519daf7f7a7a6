//! Desks with what belongs to them, and tables.

use super::chair;
use crate::canvas::Facing::{Down, East, North, South, Up, West};
use crate::canvas::{ALL, Canvas, SIDES, STANDING};
use crate::material::Material;
use crate::random::Random;

/// Length of a desk, along u, m.
pub const LENGTH: f64 = 1.6;
const DEPTH: f64 = 0.8;
/// Under side and upper side of its top, m.
const TOP: [f64; 2] = [0.71, 0.74];

/// A desk from u = 0 and v = 0 on, whose sitter looks along +v; with drawers, screens, keyboard, chair and bin.
pub fn workplace(mut canvas: Canvas<'_>, number: usize, random: &mut Random) {
    let name = |what: &str| format!("{what}_{number}");
    canvas.object(&name("desk"));
    desk(&mut canvas);
    canvas.object(&name("drawers"));
    drawers(&mut canvas);
    canvas.object(&name("screens"));
    screens(&mut canvas);
    canvas.object(&name("keyboard"));
    canvas.block(Material::Black, [[0.58, 1.02], [0.12, 0.26], [TOP[1], TOP[1] + 0.025]], &STANDING);
    canvas.object(&name("bin"));
    canvas.block(Material::Steel, [[0.2, 0.46], [0.36, 0.62], [0.0, 0.32]], &SIDES);
    let chair = canvas.at(|p| p.within(0.8, -0.3, 0.0).turned(random.between(-25.0, 25.0)));
    chair::office(chair, number, random);
}

fn desk(canvas: &mut Canvas<'_>) {
    canvas.block(Material::Beech, [[0.0, LENGTH], [0.0, DEPTH], TOP], &ALL);
    for u in [0.04, LENGTH - 0.07] {
        canvas.block(Material::Beech, [[u, u + 0.03], [0.05, DEPTH - 0.05], [0.0, TOP[0]]], &SIDES);
    }
    canvas.block(Material::Beech, [[0.1, LENGTH - 0.1], [0.7, 0.72], [0.25, 0.68]], &ALL);
    canvas.block(Material::GreenCloth, [[0.0, LENGTH], [DEPTH - 0.03, DEPTH], [TOP[1], 1.2]], &STANDING);
}

/// Three drawers under the desk; their fronts are the body's.
fn drawers(canvas: &mut Canvas<'_>) {
    let (u, v, z) = ([1.06, 1.48], [0.12, 0.66], [0.05, 0.65]);
    canvas.block(Material::Steel, [u, v, z], &[East, West, North, Up, Down]);
    for i in 0..3 {
        let low = z[0] + 0.2 * f64::from(i);
        canvas.rect(Material::Beech, South, v[0], u, [low, low + 0.2]);
        canvas.block(Material::Steel, [[1.19, 1.35], [v[0] - 0.035, v[0] - 0.02], [low + 0.14, low + 0.16]], &ALL);
    }
}

/// Two of them, side by side.
fn screens(canvas: &mut Canvas<'_>) {
    let foot = TOP[1] + 0.015;
    for middle in [0.51, 1.09] {
        let around = |half: f64| [middle - half, middle + half];
        canvas.block(Material::Black, [around(0.14), [0.38, 0.56], [TOP[1], foot]], &STANDING);
        canvas.block(Material::Black, [around(0.015), [0.465, 0.495], [foot, 0.87]], &SIDES);
        canvas.block(Material::Black, [around(0.27), [0.435, 0.46], [0.87, 1.2]], &ALL);
    }
}

/// A table from u = 0 and v = 0 on.
pub fn table(mut canvas: Canvas<'_>) {
    const SIZE: [f64; 2] = [1.4, 0.8];
    canvas.object("table");
    canvas.block(Material::Oak, [[0.0, SIZE[0]], [0.0, SIZE[1]], TOP], &ALL);
    for u in [0.05, SIZE[0] - 0.075] {
        for v in [0.05, SIZE[1] - 0.075] {
            canvas.block(Material::Steel, [[u, u + 0.025], [v, v + 0.025], [0.0, TOP[0]]], &SIDES);
        }
    }
}
