//! The atrium: a well through all floors, with galleries at its ends and parapets round it.

use super::canvas::Facing::{Down, East, North, South, Up, West};
use super::canvas::{Canvas, Span};
use super::floor::Level;
use super::lamp;
use super::material::Material;
use super::plan::{BAY, CORE, HEIGHT, Plan, SLAB};

/// Width of the galleries at the ends, m.
const GALLERY: f64 = 1.3;
/// Thickness and height of parapets, m.
const PARAPET: f64 = 0.12;
const RAIL: f64 = 1.0;
/// From the ceiling below to a parapet's top, on the well's side.
const EDGE: Span = [-SLAB, RAIL];

/// Draws a floor's part, in the building's frame.
pub fn draw(canvas: &mut Canvas<'_>, plan: &Plan, level: Level) {
    let x = plan.atrium();
    let well = [x[0] + GALLERY, x[1] - GALLERY];
    for (name, facing, at) in [("wall_west", East, x[0]), ("wall_east", West, x[1])] {
        canvas.object(name);
        canvas.rect(Material::Plaster, facing, at, CORE, [0.0, HEIGHT]);
    }
    if level.is_ground {
        for (i, bay) in by_bay(x).enumerate() {
            canvas.object(&format!("floor_{i}"));
            canvas.rect(Material::Stone, Up, 0.0, bay, CORE);
        }
    } else {
        for (name, gallery) in [("floor_west", [x[0], well[0] - PARAPET]), ("floor_east", [well[1] + PARAPET, x[1]])] {
            canvas.object(name);
            canvas.rect(Material::Stone, Up, 0.0, gallery, CORE);
        }
        parapets(canvas, well);
    }
    if level.is_top {
        for (i, bay) in by_bay(x).enumerate() {
            canvas.object(&format!("ceiling_{i}"));
            canvas.rect(Material::CeilingTile, Down, HEIGHT, bay, CORE);
        }
    } else {
        ceilings(canvas, x, well);
    }
    let bays = by_bay(x).count();
    lamp::panels(canvas, level.is_furnished, (x, CORE), [2 * bays, 2]);
}

/// Equal parts of a span, about as long as a bay.
fn by_bay([low, high]: Span) -> impl Iterator<Item = Span> {
    let count = ((high - low) / BAY).round().max(1.0);
    let at = move |i: usize| low + (high - low) * i as f64 / count;
    (0..count as usize).map(move |i| [at(i), at(i + 1)])
}

/// The parapets at the galleries take the corners.
fn parapets(canvas: &mut Canvas<'_>, well: Span) {
    let across = [CORE[0] + PARAPET, CORE[1] - PARAPET];
    let (gallery, rail) = (Material::Plaster, [0.0, RAIL]);
    for (name, x, [inner, outer]) in [
        ("parapet_west", [well[0] - PARAPET, well[0]], [(East, well[0]), (West, well[0] - PARAPET)]),
        ("parapet_east", [well[1], well[1] + PARAPET], [(West, well[1]), (East, well[1] + PARAPET)]),
    ] {
        canvas.object(name);
        canvas.rect(gallery, inner.0, inner.1, across, EDGE);
        canvas.rect(gallery, outer.0, outer.1, CORE, rail);
        canvas.rect(Material::Oak, Up, RAIL, x, CORE);
        canvas.rect(gallery, South, CORE[0], x, rail);
        canvas.rect(gallery, North, CORE[1], x, rail);
    }
    for (i, x) in by_bay(well).enumerate() {
        for (name, y, [inner, outer]) in [
            ("south", [CORE[0], across[0]], [(North, across[0]), (South, CORE[0])]),
            ("north", [across[1], CORE[1]], [(South, across[1]), (North, CORE[1])]),
        ] {
            canvas.object(&format!("parapet_{name}_{i}"));
            canvas.rect(gallery, inner.0, inner.1, x, EDGE);
            canvas.rect(gallery, outer.0, outer.1, x, rail);
            canvas.rect(Material::Oak, Up, RAIL, x, y);
        }
    }
}

/// Ceilings under the galleries and under the parapets of the floor above.
fn ceilings(canvas: &mut Canvas<'_>, x: Span, well: Span) {
    for (name, gallery) in [("ceiling_west", [x[0], well[0]]), ("ceiling_east", [well[1], x[1]])] {
        canvas.object(name);
        canvas.rect(Material::CeilingTile, Down, HEIGHT, gallery, CORE);
    }
    for (i, x) in by_bay(well).enumerate() {
        for (name, y) in [("south", [CORE[0], CORE[0] + PARAPET]), ("north", [CORE[1] - PARAPET, CORE[1]])] {
            canvas.object(&format!("ceiling_{name}_{i}"));
            canvas.rect(Material::CeilingTile, Down, HEIGHT, x, y);
        }
    }
}
