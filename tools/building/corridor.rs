//! Corridors, and the gables that close their ends and the building.

use super::canvas::Facing::{Down, North, South, Up};
use super::canvas::{Canvas, Span};
use super::lamp;
use super::material::Material;
use super::plan::{CORE, CORRIDOR, CORRIDORS, FACADE, HEIGHT, NORTH, Plan, SLAB};
use super::wall::{Opening, frame, mullions, wall};

/// Draws a corridor's part along a bay, in the building's frame.
pub fn draw(canvas: &mut Canvas<'_>, x: Span, y: Span, is_furnished: bool) {
    canvas.object("floor");
    canvas.rect(Material::Lino, Up, 0.0, x, y);
    canvas.object("ceiling");
    canvas.rect(Material::CeilingTile, Down, HEIGHT, x, y);
    lamp::panels(canvas, is_furnished, (x, y), [2, 1]);
}

/// A corridor's window, along the gable.
const WINDOW: Opening = Opening { u: [0.4, CORRIDOR - 0.4], z: [0.9, 2.5], is_door: false };

/// Draws both gables of a floor, in the building's frame.
pub fn gables(canvas: &mut Canvas<'_>, plan: &Plan) {
    // With the inside towards +v, u runs northwards in the east and southwards in the west.
    gable(&mut canvas.at(|p| p.within(plan.length(), 0.0, 0.0).quarters(1)), "east", |y| y);
    gable(&mut canvas.at(|p| p.within(0.0, NORTH, 0.0).quarters(3)), "west", |[y0, y1]| [NORTH - y1, NORTH - y0]);
}

/// Draws a gable whose inner face is v = 0, its outer v = -[`FACADE`]; `along`: from y to u.
fn gable(canvas: &mut Canvas<'_>, name: &str, along: impl Fn(Span) -> Span) {
    let facade = |part: &str| format!("gable_{name}_{part}");
    let blank = [[-FACADE, CORRIDORS[0][0]], CORE, [CORRIDORS[1][1], NORTH + FACADE]];
    for (part, y) in ["south", "core", "north"].into_iter().zip(blank) {
        wall(canvas, (&facade(part), Material::Facade), (South, -FACADE), (along(y), [-SLAB, HEIGHT]), &[]);
    }
    for (part, y) in ["window_south", "window_north"].into_iter().zip(CORRIDORS) {
        let [from, to] = along(y);
        let window = Opening { u: WINDOW.u.map(|u| from + u), ..WINDOW };
        let (inner, outer) = (facade(part), facade(&format!("{part}_outside")));
        wall(canvas, (&inner, Material::Plaster), (North, 0.0), ([from, to], [0.0, HEIGHT]), &[window]);
        wall(canvas, (&outer, Material::Facade), (South, -FACADE), ([from, to], [-SLAB, HEIGHT]), &[window]);
        frame(canvas, (&facade(&format!("{part}_frame")), Material::White), window, [-FACADE, 0.0]);
        mullions(canvas, (&facade(&format!("{part}_bars")), Material::White), window, -0.5 * FACADE, 3);
    }
}
