//! What rows of neighbours share: a multiresolution of their lines, whose details count as far as they stand out from
//! noise (James and Stein; block shrinkage of wavelets).
//!
//! An element above rows has the line nearest to those of its four children: a quarter of their noise is left in it. What
//! children add to it is half noise where smooth light has been divided.

use super::line::Line;
use crate::base::Rgb;
use crate::model::geometry::NONE;
use crate::transport::nodes::mesh::{Element, Mesh};
use crate::transport::row::Part;

/// A line that is known up to noise.
#[derive(Clone, Copy, Default)]
struct Known {
    line: Line,
    /// Mean squared error, (W/m2)2.
    noise: f64,
}

/// Share of a line's noise that lies in what four of them add to the line nearest to all.
const OF_DETAILS: f64 = 0.75;

/// Lines of all rows of a part, by row; those of others as they are.
#[must_use]
pub fn lines(mesh: &Mesh, part: Part) -> Vec<Line> {
    let mut lines: Vec<Line> = mesh.rows.iter().map(|row| row.fit.line).collect();
    let elements = &mesh.elements;
    let mut known: Vec<Option<Known>> = vec![None; elements.len()];
    let mut of_row = vec![NONE; elements.len()];
    for (index, row) in mesh.rows.iter().enumerate().filter(|(_, row)| row.part == part) {
        known[row.element as usize] = Some(Known { line: row.fit.line, noise: row.fit.noise });
        of_row[row.element as usize] = index as u32;
    }
    for at in (0..elements.len()).rev() {
        if known[at].is_none() && !elements[at].is_leaf() {
            known[at] = nearest(elements, at, &known);
        }
    }
    // From here on the line of an element is what is left of it.
    let mut left: Vec<Line> = known.iter().map(|known| known.map_or(Line::default(), |known| known.line)).collect();
    for at in 0..elements.len() {
        let (Some(above), true) = (&known[at], of_row[at] == NONE && !elements[at].is_leaf()) else {
            if of_row[at] != NONE {
                lines[of_row[at] as usize] = left[at];
            }
            continue;
        };
        let children = elements[at].first_child as usize..elements[at].first_child as usize + 4;
        let (mut size, mut noise) = (0.0, 0.0);
        let details = children.clone().map(|child| {
            let of = &known[child].expect("the element above has a line");
            let to = offset(elements, at, child);
            let before = above.line.about(to);
            let mean = of.line.mean - before.mean;
            let along = [0, 1].map(|k| of.line.along[k] - before.along[k]);
            noise += 0.25 * of.noise;
            Line { mean, along }
        });
        let details: Vec<Line> = details.collect();
        let inner = spread(elements, at).map(|x| x / 3.0);
        for detail in &details {
            size += 0.25 * (detail.mean.norm_squared() + product(inner, &detail.along, &detail.along));
        }
        let share = if size > OF_DETAILS * noise { 1.0 - OF_DETAILS * noise / size } else { 0.0 };
        for (child, detail) in children.zip(&details) {
            let base = left[at].about(offset(elements, at, child));
            let scaled = Line { mean: detail.mean * share, along: detail.along.map(|along| along * share) };
            left[child] = base.plus(&scaled);
        }
    }
    lines
}

fn offset(elements: &[Element], from: usize, to: usize) -> [f64; 2] {
    [0, 1].map(|k| elements[to].centroid[k] - elements[from].centroid[k])
}

/// Mean products of the offsets of an element's four children: x x, x y, y y. Alike children are spread so, and their own
/// points a third of it.
fn spread(elements: &[Element], at: usize) -> [f64; 3] {
    let first = elements[at].first_child as usize;
    (first..first + 4).fold([0.0; 3], |sum, child| {
        let [x, y] = offset(elements, at, child);
        [sum[0] + 0.25 * x * x, sum[1] + 0.25 * x * y, sum[2] + 0.25 * y * y]
    })
}

fn product([xx, xy, yy]: [f64; 3], p: &[Rgb; 2], q: &[Rgb; 2]) -> f64 {
    xx * p[0].dot(q[0]) + xy * (p[0].dot(q[1]) + p[1].dot(q[0])) + yy * p[1].dot(q[1])
}

/// The line nearest to those of an element's children; `None` where one has none, or they are slices.
fn nearest(elements: &[Element], at: usize, known: &[Option<Known>]) -> Option<Known> {
    let first = elements[at].first_child as usize;
    let [xx, xy, yy] = spread(elements, at);
    let determinant = xx * yy - xy * xy;
    if determinant <= 1e-3 * xx * yy {
        return None;
    }
    let (mut mean, mut noise) = (Rgb::BLACK, 0.0);
    let mut moments = [Rgb::BLACK; 2];
    for child in first..first + 4 {
        let of = known[child].as_ref()?;
        let [x, y] = offset(elements, at, child);
        mean += of.line.mean * 0.25;
        noise += 0.25 * of.noise;
        let [a, b] = of.line.along;
        moments[0] += (of.line.mean * x + (a * xx + b * xy) * (1.0 / 3.0)) * 0.25;
        moments[1] += (of.line.mean * y + (a * xy + b * yy) * (1.0 / 3.0)) * 0.25;
    }
    // All of the element's points: its children's offsets and what their points are spread around them.
    let scale = 0.75 / determinant;
    let along = [(moments[0] * yy - moments[1] * xy) * scale, (moments[1] * xx - moments[0] * xy) * scale];
    Some(Known { line: Line { mean, along }, noise: (1.0 - OF_DETAILS) * noise })
}
