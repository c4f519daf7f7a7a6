//! Chairs; who sits at the origin looks along +v.

use crate::canvas::Facing::Down;
use crate::canvas::{ALL, Canvas, SIDES};
use crate::material::{CLOTHS, Material};
use crate::random::Random;

/// At a desk, with arms.
pub fn office(mut canvas: Canvas<'_>, number: usize, random: &mut Random) {
    canvas.object(&format!("chair_{number}"));
    frame(&mut canvas, random.one_of(&CLOTHS));
    for u in [-0.29, 0.25] {
        canvas.block(Material::Black, [[u, u + 0.04], [-0.18, 0.15], [0.64, 0.67]], &ALL);
        let post = [[u, u + 0.025], [-0.015, 0.01], [0.44, 0.64]];
        canvas.block(Material::Steel, post, &SIDES);
        canvas.block(Material::Steel, post, &[Down]);
    }
}

/// Without arms.
pub fn visitors(mut canvas: Canvas<'_>, number: usize, random: &mut Random) {
    canvas.object(&format!("visitors_chair_{number}"));
    frame(&mut canvas, random.one_of(&CLOTHS));
}

/// Seat, back and legs. Legs are so thin that they cut nothing they stand on, however they are turned.
fn frame(canvas: &mut Canvas<'_>, cloth: Material) {
    canvas.block(cloth, [[-0.23, 0.23], [-0.23, 0.23], [0.43, 0.48]], &ALL);
    canvas.block(cloth, [[-0.22, 0.22], [-0.29, -0.25], [0.56, 0.95]], &ALL);
    for u in [-0.18, 0.155] {
        let post = [[u, u + 0.025], [-0.285, -0.255], [0.4, 0.56]];
        canvas.block(Material::Steel, post, &SIDES);
        canvas.block(Material::Steel, post, &[Down]);
        for v in [-0.2, 0.175] {
            canvas.block(Material::Steel, [[u, u + 0.025], [v, v + 0.025], [0.0, 0.43]], &SIDES);
        }
    }
}
