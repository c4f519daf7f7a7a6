//! The stair hall: two flights a floor with a half landing between, in a shaft from floor to floor.

use super::canvas::Facing::{Down, East, North, South, Up, West};
use super::canvas::{Canvas, Span};
use super::floor::Level;
use super::lamp;
use super::material::Material;
use super::plan::{BAY, HEIGHT, SLAB, STOREY, WALL};
use super::room::INSIDE;
use super::wall::{Opening, frame, wall};

/// Steps of a flight, the last of which is the landing it reaches.
const STEPS: usize = 10;
const RISE: f64 = STOREY / (2 * STEPS) as f64;
const GOING: f64 = 0.28;
/// Length of a flight in plan, its width, and its distance from the walls, m.
const RUN: f64 = (STEPS - 1) as f64 * GOING;
const WIDTH: f64 = 1.6;
const ASIDE: f64 = 0.15;
/// A flight's thickness below its inner edges, m.
const WAIST: f64 = 0.2;

/// The landing at the floor's height, the shaft, and the half landing in it.
const LANDING: Span = [0.0, 2.0];
const SHAFT: Span = [LANDING[1], LANDING[1] + RUN + 1.3];
const HALF_LANDING: Span = [LANDING[1] + RUN, SHAFT[1]];
/// The half landing's thickness: it covers a flight's end.
const HALF_LANDING_Z: Span = [0.5 * STOREY - 0.4, 0.5 * STOREY];

const ENTRANCE: Opening = Opening { u: [0.6, 3.5], z: [0.0, 2.4], is_door: true };

/// Draws a floor's part in the frame of the southern inner unit.
pub fn draw(canvas: &mut Canvas<'_>, level: Level) {
    hall(canvas, level);
    if !level.is_ground {
        canvas.object("slab_edge");
        canvas.rect(Material::Plaster, North, SHAFT[0], INSIDE, [-SLAB, 0.0]);
    }
    if !level.is_top {
        canvas.object("half_landing");
        canvas.rect(Material::Stone, Up, HALF_LANDING_Z[1], INSIDE, HALF_LANDING);
        canvas.rect(Material::Plaster, Down, HALF_LANDING_Z[0], INSIDE, HALF_LANDING);
        canvas.rect(Material::Plaster, South, HALF_LANDING[0], INSIDE, HALF_LANDING_Z);
        let lowest = if level.is_ground { 0.0 } else { f64::NEG_INFINITY };
        flight(canvas.at(|p| p.within(INSIDE[0] + ASIDE, SHAFT[0], 0.0)), "lower_flight", lowest);
        let upper = canvas.at(|p| p.within(INSIDE[1] - ASIDE, HALF_LANDING[0], HALF_LANDING_Z[1]).quarters(2));
        flight(upper, "upper_flight", f64::NEG_INFINITY);
    } else if !level.is_ground {
        canvas.object("guard");
        let guard = [[INSIDE[0], INSIDE[1] - ASIDE - WIDTH], [SHAFT[0] - 0.1, SHAFT[0]], [0.0, 1.0]];
        canvas.block(Material::Plaster, guard, &[North, South, East, Up]);
    }
    lamp::panels(canvas, level.is_furnished, (INSIDE, LANDING), [3, 2]);
}

fn hall(canvas: &mut Canvas<'_>, level: Level) {
    let whole = [LANDING[0], SHAFT[1]];
    canvas.object("floor");
    canvas.rect(Material::Stone, Up, 0.0, INSIDE, if level.is_ground { whole } else { LANDING });
    canvas.object("ceiling");
    canvas.rect(Material::CeilingTile, Down, HEIGHT, INSIDE, if level.is_top { whole } else { LANDING });
    let shaft_z = [0.0, if level.is_top { HEIGHT } else { STOREY }];
    for (name, facing, u) in [("wall_left", East, INSIDE[0]), ("wall_right", West, INSIDE[1])] {
        canvas.object(name);
        canvas.rect(Material::Plaster, facing, u, LANDING, [0.0, HEIGHT]);
        canvas.rect(Material::Plaster, facing, u, SHAFT, shaft_z);
    }
    let plaster = |name| (name, Material::Plaster);
    wall(canvas, plaster("wall_back"), (South, SHAFT[1]), (INSIDE, shaft_z), &[]);
    wall(canvas, plaster("wall_entrance"), (North, 0.0), (INSIDE, [0.0, HEIGHT]), &[ENTRANCE]);
    wall(canvas, plaster("wall_corridor"), (South, -WALL), ([0.0, BAY], [0.0, HEIGHT]), &[ENTRANCE]);
    frame(canvas, ("entrance", Material::Oak), ENTRANCE, [-WALL, 0.0]);
    canvas.object("threshold");
    canvas.rect(Material::Stone, Up, 0.0, ENTRANCE.u, [-WALL, 0.0]);
}

/// A flight that rises along v from the origin. Nothing of it goes below `lowest`, m: the ground floor has no shaft.
fn flight(mut canvas: Canvas<'_>, name: &str, lowest: f64) {
    canvas.object(name);
    let under = |v: f64| f64::max(v * RISE / GOING - WAIST, lowest);
    for step in 0..STEPS - 1 {
        let [v0, v1] = [step, step + 1].map(|i| i as f64 * GOING);
        let [z0, top] = [step, step + 1].map(|i| i as f64 * RISE);
        let [under0, under1] = [v0, v1].map(under);
        canvas.rect(Material::Stone, South, v0, [0.0, WIDTH], [z0, top]);
        canvas.rect(Material::Stone, Up, top, [0.0, WIDTH], [v0, v1]);
        let side = |u: f64| [[u, v0, under0], [u, v1, under1], [u, v1, top], [u, v0, top]];
        let [a, b, c, d] = side(0.0);
        canvas.quad(Material::Plaster, [b, a, d, c]);
        canvas.quad(Material::Plaster, side(WIDTH));
        let stands = under1 == lowest;
        if !stands {
            let soffit = [[0.0, v1, under1], [WIDTH, v1, under1], [WIDTH, v0, under0], [0.0, v0, under0]];
            canvas.quad(Material::Plaster, soffit);
        }
    }
}
