//! What rows of neighbours share: a multiresolution of their lines, whose details count as far as they stand out from
//! noise (James and Stein; block shrinkage of wavelets).
//!
//! An element above rows has the line nearest to those of its four children: a quarter of their noise is left in it. What
//! children add to it is mostly noise where smooth light has been divided.

use super::line::Line;
use crate::base::Rgb;
use crate::model::geometry::NONE;
use crate::transport::nodes::mesh::{Element, Mesh};
use crate::transport::numbers;
use crate::transport::row::Part;

/// A line that is known up to noise.
#[derive(Clone, Copy)]
struct Known {
    line: Line,
    /// Mean squared error, (W/m2)2.
    noise: f64,
}

/// What is left of the lines of all rows, by row. Each part of the light has a multiresolution of its own.
#[must_use]
pub fn lines(mesh: &Mesh) -> Vec<Line> {
    let mut lines: Vec<Line> = mesh.rows.iter().map(|row| row.fit.line).collect();
    for part in Part::ALL {
        shrink(mesh, part, &mut lines);
    }
    lines
}

fn shrink(mesh: &Mesh, part: Part, lines: &mut [Line]) {
    let elements = &mesh.elements;
    let mut known: Vec<Option<Known>> = vec![None; elements.len()];
    let mut row_of = vec![NONE; elements.len()];
    for (index, row) in mesh.rows.iter().enumerate().filter(|(_, row)| row.part == part) {
        known[row.element as usize] = Some(Known { line: row.fit.line, noise: row.fit.noise });
        row_of[row.element as usize] = index as u32;
    }
    for at in (0..elements.len()).rev() {
        if known[at].is_none() && !elements[at].is_leaf() {
            known[at] = nearest(elements, at, &known);
        }
    }
    // From above: what is left of each line.
    let mut left: Vec<Line> = known.iter().map(|known| known.map_or(Line::default(), |known| known.line)).collect();
    for at in 0..elements.len() {
        let Some(Known { line: above, .. }) = known[at] else { continue };
        if row_of[at] != NONE {
            lines[row_of[at] as usize] = left[at];
            continue;
        }
        let details = Details::of(elements, at, &above, &known);
        for (child, detail) in children(elements, at).into_iter().zip(details.lines) {
            let along = detail.along.map(|along| along * details.share);
            let base = left[at].about(offset(elements, at, child));
            left[child] = base.plus(&Line { mean: detail.mean * details.share, along });
        }
    }
}

/// What the children of an element add to a line, and how much of that counts.
struct Details {
    lines: [Line; 4],
    share: f64,
}

impl Details {
    fn of(elements: &[Element], at: usize, above: &Line, known: &[Option<Known>]) -> Self {
        let (mut size, mut noise) = (0.0, 0.0);
        let lines = children(elements, at).map(|child| {
            let of = known[child].expect("the element above has a line");
            let before = above.about(offset(elements, at, child));
            let detail =
                Line { mean: of.line.mean - before.mean, along: [0, 1].map(|k| of.line.along[k] - before.along[k]) };
            let share = share_of(elements, at, child);
            size += share * (detail.mean.norm_squared() + product(elements[child].moments, &detail.along));
            noise += share * (1.0 - share) * of.noise;
            detail
        });
        Self { lines, share: if size > noise { 1.0 - noise / size } else { 0.0 } }
    }
}

fn children(elements: &[Element], at: usize) -> [usize; 4] {
    [0, 1, 2, 3].map(|quarter| elements[at].first_child as usize + quarter)
}

fn share_of(elements: &[Element], above: usize, child: usize) -> f64 {
    elements[child].area_m2 / elements[above].area_m2
}

fn offset(elements: &[Element], from: usize, to: usize) -> [f64; 2] {
    [0, 1].map(|k| elements[to].centroid[k] - elements[from].centroid[k])
}

/// Mean square of what slopes add over points with these moments.
fn product([xx, xy, yy]: [f64; 3], [a, b]: &[Rgb; 2]) -> f64 {
    xx * a.norm_squared() + 2.0 * xy * a.dot(*b) + yy * b.norm_squared()
}

/// The line nearest to those of an element's children; `None` where one has none, or the element is no wider than a line.
fn nearest(elements: &[Element], at: usize, known: &[Option<Known>]) -> Option<Known> {
    let [xx, xy, yy] = elements[at].moments;
    let determinant = xx * yy - xy * xy;
    if determinant <= numbers::NARROW * (xx + yy).powi(2) {
        return None;
    }
    let (mut mean, mut noise) = (Rgb::BLACK, 0.0);
    let mut moments = [Rgb::BLACK; 2];
    for child in children(elements, at) {
        let Known { line, noise: of_child } = known[child]?;
        let share = share_of(elements, at, child);
        let [x, y] = offset(elements, at, child);
        let ([a, b], [xx, xy, yy]) = (line.along, elements[child].moments);
        mean += line.mean * share;
        noise += share * share * of_child;
        moments[0] += (line.mean * x + a * xx + b * xy) * share;
        moments[1] += (line.mean * y + a * xy + b * yy) * share;
    }
    let along = [moments[0] * yy - moments[1] * xy, moments[1] * xx - moments[0] * xy];
    Some(Known { line: Line { mean, along: along.map(|along| along * (1.0 / determinant)) }, noise })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, NodeName, PatchSide};
    use crate::model::geometry::PatchRecord;
    use crate::transport::light::line::Fit;
    use crate::transport::nodes::mesh::MeshRow;
    use bytemuck::Zeroable;

    /// A side of sixteen elements, each with a row of this line and noise.
    fn mesh(corners: &[[f32; 3]], noise: f64, line: impl Fn(usize, [f64; 2]) -> Line) -> Mesh {
        let mut patch = PatchRecord::zeroed();
        patch.corners_m = std::array::from_fn(|i| corners[i.min(corners.len() - 1)]);
        (patch.corner_count, patch.sides) = (corners.len() as u8, 3);
        let mut mesh = Mesh::new(ClusterId(0), &[patch]);
        mesh.split(0, &patch);
        for quarter in 0..4 {
            let name = NodeName::root(ClusterId(0), PatchSide { patch: 0, side: 0 }).child(quarter);
            mesh.split(mesh.nearest(name), &patch);
        }
        let leaves = mesh.leaves(PatchSide { patch: 0, side: 0 });
        for (number, at) in leaves.into_iter().enumerate() {
            let fit = Fit { line: line(number, mesh.elements[at].centroid), noise, ..Fit::default() };
            mesh.rows.push(MeshRow { element: at as u32, part: Part::Indirect, rounds: 4, fit });
        }
        mesh
    }

    fn power(mesh: &Mesh, lines: &[Line]) -> f64 {
        mesh.rows
            .iter()
            .zip(lines)
            .map(|(row, line)| mesh.elements[row.element as usize].area_m2 * line.mean.0[0])
            .sum()
    }

    fn square(mesh: &Mesh, lines: &[Line]) -> f64 {
        let of = |(row, line): (&MeshRow, &Line)| {
            let element = &mesh.elements[row.element as usize];
            element.area_m2 * (line.mean.norm_squared() + product(element.moments, &line.along))
        };
        mesh.rows.iter().zip(lines).map(of).sum()
    }

    const QUAD: [[f32; 3]; 4] = [[0.0; 3], [3.0, 0.0, 0.0], [4.0, 2.0, 0.0], [1.0, 2.0, 0.0]];
    const SKEW: [[f32; 3]; 4] = [[0.0; 3], [3.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.5, 1.0, 0.0]];
    const NEEDLE: [[f32; 3]; 3] = [[0.0; 3], [3.0, 0.0, 0.0], [2.0, 0.3, 0.0]];

    fn uneven(number: usize) -> f64 {
        [1.0, -0.5, 0.25, -1.0, 0.6, 0.3, -0.8][number % 7]
    }

    #[test]
    fn light_that_is_linear_over_all_stays_what_it_is() {
        for corners in [&QUAD[..], &SKEW, &NEEDLE] {
            let of = |_: usize, [x, y]: [f64; 2]| Line {
                mean: Rgb::grey(5.0 + x - 0.5 * y),
                along: [Rgb::grey(1.0), Rgb::grey(-0.5)],
            };
            let mesh = mesh(corners, 1.0, of);
            for (row, line) in mesh.rows.iter().zip(lines(&mesh)) {
                let off = line.mean - row.fit.line.mean;
                assert!(
                    off.norm_squared() < 1e-18 && (line.along[1] + Rgb::grey(0.5)).norm_squared() < 1e-12,
                    "{line:?}"
                );
            }
        }
    }

    #[test]
    fn details_within_the_noise_go_those_beyond_it_stay_and_power_is_kept() {
        let of = |number: usize, _: [f64; 2]| Line { mean: Rgb::grey(5.0 + uneven(number)), ..Line::default() };
        let (noisy, sharp) = (mesh(&QUAD, 10.0, of), mesh(&QUAD, 1e-9, of));
        for (mesh, stays) in [(&noisy, false), (&sharp, true)] {
            let before: Vec<Line> = mesh.rows.iter().map(|row| row.fit.line).collect();
            let after = lines(mesh);
            assert!((power(mesh, &before) / power(mesh, &after) - 1.0).abs() < 1e-12);
            let moved = before.iter().zip(&after).map(|(a, b)| (a.mean - b.mean).norm_squared()).fold(0.0, f64::max);
            assert_eq!(moved < 1e-9, stays, "{moved}");
        }
    }

    #[test]
    fn no_shape_makes_light_grow() {
        for corners in [&QUAD[..], &SKEW, &NEEDLE] {
            for noise in [1e-9, 0.1, 10.0] {
                let along = |number: usize| [uneven(number + 1), uneven(number + 3)].map(|x| Rgb::grey(30.0 * x));
                let of = |number: usize, _: [f64; 2]| Line { mean: Rgb::grey(uneven(number)), along: along(number) };
                let mesh = mesh(corners, noise, of);
                let before: Vec<Line> = mesh.rows.iter().map(|row| row.fit.line).collect();
                let after = lines(&mesh);
                assert!(square(&mesh, &after) <= square(&mesh, &before) * (1.0 + 1e-9), "{corners:?}, noise {noise}");
            }
        }
    }
}
