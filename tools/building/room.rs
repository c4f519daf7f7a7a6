//! A room: floor, ceiling and walls, a door and a high window to the corridor, windows and radiators at the facade.

use super::canvas::Facing::{Down, East, North, South, Up, West};
use super::canvas::{ALL, Canvas, STANDING, Span};
use super::material::Material;
use super::plan::{BAY, CORE, FACADE, HEIGHT, INNER_DEPTH, OUTER_DEPTH, SLAB, WALL};
use super::wall::{Opening, frame, mullions, wall};

/// What lies behind a room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Behind {
    /// Another room.
    Room,
    /// The other corridor.
    Corridor,
    /// The open; at an end of the building the facade goes round its corner, towards -u or +u.
    Facade(Corner),
}

/// Whether a facade goes on round a corner of the building.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Corner {
    /// No.
    No,
    /// At u = 0.
    Low,
    /// At u = [`BAY`].
    High,
}

/// A room's inside along u.
pub const INSIDE: Span = [0.5 * WALL, BAY - 0.5 * WALL];

const DOOR: Opening = Opening { u: [0.5, 1.5], z: [0.0, 2.1], is_door: true };
const HIGH_WINDOW: Opening = Opening { u: [1.9, 3.7], z: [2.25, 2.75], is_door: false };
const WINDOWS: [Opening; 2] = [
    Opening { u: [0.4, 1.9], z: [0.9, 2.5], is_door: false },
    Opening { u: [2.2, 3.7], z: [0.9, 2.5], is_door: false },
];

impl Behind {
    /// How deep the room is, m.
    #[must_use]
    pub fn depth(self) -> f64 {
        match self {
            Self::Room => INNER_DEPTH,
            Self::Corridor => CORE[1] - CORE[0] - 2.0 * WALL,
            Self::Facade(_) => OUTER_DEPTH,
        }
    }
}

/// Draws a room in the frame of its unit.
pub fn draw(canvas: &mut Canvas<'_>, behind: Behind) {
    let depth = behind.depth();
    let (along, up) = ([0.0, depth], [0.0, HEIGHT]);
    canvas.object("floor");
    canvas.rect(Material::Carpet, Up, 0.0, INSIDE, along);
    canvas.object("ceiling");
    canvas.rect(Material::CeilingTile, Down, HEIGHT, INSIDE, along);
    canvas.object("wall_left");
    canvas.rect(Material::Plaster, East, INSIDE[0], along, up);
    canvas.object("wall_right");
    canvas.rect(Material::Plaster, West, INSIDE[1], along, up);
    to_corridor(canvas);
    let plaster = |name| (name, Material::Plaster);
    match behind {
        Behind::Room => wall(canvas, plaster("wall_back"), (South, depth), (INSIDE, up), &[]),
        Behind::Corridor => {
            wall(canvas, plaster("wall_back"), (South, depth), (INSIDE, up), &[]);
            wall(canvas, plaster("wall_far"), (North, depth + WALL), ([0.0, BAY], up), &[]);
        }
        Behind::Facade(corner) => to_the_open(canvas, corner),
    }
}

fn to_corridor(canvas: &mut Canvas<'_>) {
    let (openings, up, through) = ([DOOR, HIGH_WINDOW], [0.0, HEIGHT], [-WALL, 0.0]);
    wall(canvas, ("wall_door", Material::Plaster), (North, 0.0), (INSIDE, up), &openings);
    wall(canvas, ("wall_corridor", Material::Plaster), (South, -WALL), ([0.0, BAY], up), &openings);
    frame(canvas, ("door", Material::Oak), DOOR, through);
    canvas.object("threshold");
    canvas.rect(Material::Lino, Up, 0.0, DOOR.u, through);
    door_leaf(canvas);
    frame(canvas, ("high_window", Material::Oak), HIGH_WINDOW, through);
    mullions(canvas, ("high_window_bars", Material::Oak), HIGH_WINDOW, -0.5 * WALL, 2);
}

/// The leaf stands open, at a right angle to its wall.
fn door_leaf(canvas: &mut Canvas<'_>) {
    let (hinge, thickness) = (DOOR.u[0], 0.04);
    canvas.object("door_leaf");
    canvas.block(Material::Oak, [[hinge - thickness, hinge], [0.02, 0.96], [0.0, 2.05]], &STANDING);
    for u in [hinge + 0.02, hinge - thickness - 0.04] {
        canvas.block(Material::Steel, [[u, u + 0.02], [0.8, 0.92], [1.02, 1.05]], &ALL);
    }
}

fn to_the_open(canvas: &mut Canvas<'_>, corner: Corner) {
    let (inner, outer) = (OUTER_DEPTH, OUTER_DEPTH + FACADE);
    let outside = match corner {
        Corner::No => [0.0, BAY],
        Corner::Low => [-FACADE, BAY],
        Corner::High => [0.0, BAY + FACADE],
    };
    wall(canvas, ("wall_window", Material::Plaster), (South, inner), (INSIDE, [0.0, HEIGHT]), &WINDOWS);
    wall(canvas, ("facade", Material::Facade), (North, outer), (outside, [-SLAB, HEIGHT]), &WINDOWS);
    for (i, window) in WINDOWS.into_iter().enumerate() {
        frame(canvas, (&format!("window_{i}"), Material::White), window, [inner, outer]);
        mullions(canvas, (&format!("window_{i}_bars"), Material::White), window, 0.5 * (inner + outer), 3);
        let [u0, u1] = window.u;
        canvas.object(&format!("window_{i}_board"));
        let board = [[u0, u1], [inner - 0.18, inner], [window.z[0] - 0.03, window.z[0]]];
        canvas.block(Material::Beech, board, &[East, West, South, Up, Down]);
        radiator(canvas.at(|p| p.within(u0 + 0.1, inner - 0.14, 0.0)), i);
    }
}

/// Three panels in front of the wall, 1.3 m long.
fn radiator(mut canvas: Canvas<'_>, number: usize) {
    canvas.object(&format!("radiator_{number}"));
    for u in [0.0, 0.45, 0.9] {
        canvas.block(Material::White, [[u, u + 0.4], [0.0, 0.08], [0.12, 0.72]], &ALL);
    }
}
