//! Rows of books.

use crate::canvas::Canvas;
use crate::canvas::Facing::{East, North, South, Up, West};
use crate::material::COVERS;
use crate::random::Random;

/// Depth of books, m.
const DEPTH: f64 = 0.25;
/// Books of a row at most: an object of 61 quads.
const MOST: usize = 15;
/// Difference of height that shows, m.
const STEP: f64 = 0.01;

/// A row from u = 0 on, at most so long, m. Books that touch hide each other's sides: what is drawn is the row's
/// outline, spines, backs, tops, and between neighbours the step from one height to the other.
pub fn row(canvas: &mut Canvas<'_>, most_m: f64, random: &mut Random) {
    let (mut end, mut height) = (0.0, 0.0);
    for _ in 0..MOST {
        let thickness = random.between(0.04, 0.085);
        if end + thickness > most_m {
            break;
        }
        let (next, cover) = (STEP * random.between(20.0, 33.0).floor(), random.one_of(&COVERS));
        if next > height {
            canvas.rect(cover, West, end, [0.0, DEPTH], [height, next]);
        } else if next < height {
            canvas.rect(cover, East, end, [0.0, DEPTH], [next, height]);
        }
        let book = [[end, end + thickness], [0.0, DEPTH], [0.0, next]];
        canvas.block(cover, book, &[South, North, Up]);
        (end, height) = (end + thickness, next);
    }
    canvas.rect(COVERS[0], East, end, [0.0, DEPTH], [0.0, height]);
}
