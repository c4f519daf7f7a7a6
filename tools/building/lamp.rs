//! Ceiling panels: plain ones, or luminaires whose light comes from a row of small cells.

use super::canvas::Facing::{Down, East, North, South, Up, West};
use super::canvas::{Canvas, Span};
use super::material::Material;
use super::plan::HEIGHT;

/// Length along u and width, m.
const SIZE: [f64; 2] = [1.2, 0.3];
/// Under side, below the ceiling, and thickness, m: the gap above lets light on to the ceiling.
const DROP: f64 = 0.2;
const THICKNESS: f64 = 0.05;
/// Cells of a luminaire, and the bars between and around them, m.
const CELLS: usize = 7;
const BARS: f64 = 0.02;

/// Hangs panels in rows and columns, evenly over a rectangle of the plan.
pub fn panels(canvas: &mut Canvas<'_>, is_furnished: bool, (u, v): (Span, Span), [columns, rows]: [usize; 2]) {
    let middle = |[low, high]: Span, i: usize, of: usize| low + (high - low) * (i as f64 + 0.5) / of as f64;
    for row in 0..rows {
        for column in 0..columns {
            let at = [middle(u, column, columns), middle(v, row, rows)];
            canvas.object(&format!("panel_{row}_{column}"));
            let here = &mut canvas.at(|p| p.within(at[0] - 0.5 * SIZE[0], at[1] - 0.5 * SIZE[1], HEIGHT - DROP));
            if is_furnished {
                luminaire(here)
            } else {
                here.rect(Material::Lamp, Down, 0.0, [0.0, SIZE[0]], [0.0, SIZE[1]])
            }
        }
    }
}

/// A closed tray; from below a ladder of bars with a cell in each gap.
fn luminaire(canvas: &mut Canvas<'_>) {
    let [length, width] = SIZE;
    let tray = [[0.0, length], [0.0, width], [0.0, THICKNESS]];
    canvas.block(Material::White, tray, &[East, West, North, South, Up]);
    let inner = [BARS, width - BARS];
    for side in [[0.0, BARS], [inner[1], width]] {
        canvas.rect(Material::White, Down, 0.0, [0.0, length], side);
    }
    let pitch = (length - BARS) / CELLS as f64;
    for i in 0..=CELLS {
        let u = i as f64 * pitch;
        canvas.rect(Material::White, Down, 0.0, [u, u + BARS], inner);
        if i < CELLS {
            canvas.rect(Material::Lamp, Down, 0.0, [u + BARS, u + pitch], inner);
        }
    }
}
