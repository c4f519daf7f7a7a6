//! Walls with openings, and the frames that line these.

use super::canvas::Facing::{Down, East, North, South, Up, West};
use super::canvas::{Canvas, Facing, Span};
use super::material::Material;

/// Width of a frame's bars, m: what stands on a floor with less than 5 cm does not cut it.
pub const BAR: f64 = 0.045;

/// A hole in a wall, m along it and up.
#[derive(Clone, Copy, Debug)]
pub struct Opening {
    /// Along the wall.
    pub u: Span,
    /// Up.
    pub z: Span,
    /// Whether one may walk through: no frame and no wall at the floor.
    pub is_door: bool,
}

/// One face of a wall in the plane v = `at`, as one object: full strips between openings, and what is left below and above
/// each. `openings` in order along u.
pub fn wall(
    canvas: &mut Canvas<'_>,
    (name, material): (&str, Material),
    (facing, at): (Facing, f64),
    (u, z): (Span, Span),
    openings: &[Opening],
) {
    canvas.object(name);
    let mut from = u[0];
    for opening in openings {
        canvas.rect(material, facing, at, [from, opening.u[0]], z);
        if opening.z[0] > z[0] {
            canvas.rect(material, facing, at, opening.u, [z[0], opening.z[0]]);
        }
        if opening.z[1] < z[1] {
            canvas.rect(material, facing, at, opening.u, [opening.z[1], z[1]]);
        }
        from = opening.u[1];
    }
    canvas.rect(material, facing, at, [from, u[1]], z);
}

/// Lines an opening through a wall of thickness `v` with bars flush with its faces; each bar is an object.
pub fn frame(canvas: &mut Canvas<'_>, (name, material): (&str, Material), opening: Opening, v: Span) {
    let [u0, u1] = opening.u;
    let [z0, z1] = opening.z;
    let sill = if opening.is_door { z0 } else { z0 + BAR };
    let (inner, upright) = ([u0 + BAR, u1 - BAR], [sill, z1 - BAR]);
    canvas.object(&format!("{name}_left"));
    canvas.block(material, [[u0, inner[0]], v, upright], &[East, North, South]);
    canvas.object(&format!("{name}_right"));
    canvas.block(material, [[inner[1], u1], v, upright], &[West, North, South]);
    canvas.object(&format!("{name}_head"));
    canvas.block(material, [opening.u, v, [z1 - BAR, z1]], &[North, South]);
    canvas.rect(material, Down, z1 - BAR, inner, v);
    if !opening.is_door {
        canvas.object(&format!("{name}_sill"));
        canvas.block(material, [opening.u, v, [z0, sill]], &[North, South]);
        canvas.rect(material, Up, sill, inner, v);
    }
}

/// Bars that divide a framed opening into `across` panes in a row; one object.
pub fn mullions(canvas: &mut Canvas<'_>, (name, material): (&str, Material), opening: Opening, v: f64, across: usize) {
    let [half_width, half_depth] = [0.0175, 0.0145];
    let ([u0, u1], [z0, z1]) = (opening.u, opening.z);
    canvas.object(name);
    for i in 1..across {
        let middle = u0 + (u1 - u0) * i as f64 / across as f64;
        let bar = [[middle - half_width, middle + half_width], [v - half_depth, v + half_depth], [z0 + BAR, z1 - BAR]];
        canvas.block(material, bar, &super::canvas::SIDES);
    }
}
