//! Where the model lies: its bounds, the store's origin, the vertical.

use glam::DVec3;

use super::piece::{FaceCorner, NONE};
use super::read::{Face, Spilled};
use crate::base::{Error, Progress, Result};
use crate::geom::bounds::Bounds;
use crate::geom::split::area_vector;

/// Vertices farther from zero than this, m, are as good as infinite: f64 itself rounds them to a tenth of a micrometre.
const FARTHEST_M: f64 = 1e9;

/// From model coordinates to the store's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// The store's origin, model units.
    pub origin: DVec3,
    /// Metres per model unit.
    pub metres_per_unit: f64,
}

impl Frame {
    /// Whether a vertex lies where something can be.
    #[must_use]
    pub fn is_usable(&self, position: DVec3) -> bool {
        is_usable(position, self.metres_per_unit)
    }

    /// A vertex, rounded once: m from the origin. -0 is 0, so that equal places have equal bits.
    #[must_use]
    pub fn store_position(&self, position: DVec3) -> [f32; 3] {
        ((position - self.origin) * self.metres_per_unit).as_vec3().to_array().map(|x| x + 0.0)
    }

    /// A stored place in model coordinates and units.
    #[must_use]
    pub fn model_position(&self, stored: [f32; 3]) -> DVec3 {
        self.origin + DVec3::from_array(stored.map(f64::from)) / self.metres_per_unit
    }
}

fn is_usable(position: DVec3, metres_per_unit: f64) -> bool {
    position.is_finite() && position.abs().max_element() * metres_per_unit <= FARTHEST_M
}

/// What the faces' vertices say of the whole model.
#[derive(Clone, Copy, Debug)]
pub struct Survey {
    /// Box round every vertex that a face uses, model units.
    pub bounds: Bounds,
    /// Area that faces along y and along z, squared model units.
    area_along: [f64; 2],
}

impl Survey {
    /// Looks at every face whose corners are there and usable.
    pub fn of(spilled: &mut Spilled, metres_per_unit: f64, progress: &dyn Progress) -> Result<Self> {
        progress.begin("measure", "faces", Some(spilled.polygons));
        let mut survey = Self { bounds: Bounds::EMPTY, area_along: [0.0; 2] };
        let mut points = Vec::new();
        spilled.for_each_face(
            |spilled, face| {
                points.clear();
                for corner in &face.corners {
                    match position(spilled, face, *corner)? {
                        Some(p) if is_usable(p, metres_per_unit) => points.push(p),
                        _ => return Ok(()),
                    }
                }
                survey.add(&points);
                Ok(())
            },
            progress,
        )?;
        Ok(survey)
    }

    fn add(&mut self, points: &[DVec3]) {
        self.bounds = self.bounds.union(Bounds::of(points));
        let area = area_vector(points) * 0.5;
        let size = area.abs();
        if size.z >= size.y && size.z >= size.x {
            self.area_along[1] += area.length();
        } else if size.y >= size.x {
            self.area_along[0] += area.length();
        }
    }

    /// The vertical: of y and z the axis that more area faces along.
    #[must_use]
    pub fn up(&self) -> char {
        if self.area_along[1] > self.area_along[0] { 'z' } else { 'y' }
    }

    /// The frame of a store: its origin is the centre of the bounds, in whole units.
    #[must_use]
    pub fn frame(&self, metres_per_unit: f64) -> Frame {
        let origin = if self.is_empty() { DVec3::ZERO } else { self.bounds.centre().round() };
        Frame { origin, metres_per_unit }
    }

    /// Length of the diagonal of the bounds, model units; 0 if there are none.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        if self.is_empty() { 0.0 } else { self.bounds.size().length() }
    }

    fn is_empty(&self) -> bool {
        self.bounds.min.x > self.bounds.max.x
    }

    /// What is odd about the model's size, if anything.
    #[must_use]
    pub fn size_warning(&self, metres_per_unit: f64) -> Option<String> {
        let size = self.bounds.size() * metres_per_unit;
        let longest = size.max_element();
        let [x, y, z] = size.to_array();
        let odd = if longest > 2000.0 {
            "very large"
        } else if longest < 0.5 {
            "very small"
        } else {
            return None;
        };
        Some(format!(
            "the model is {x:.3} x {y:.3} x {z:.3} m, {odd} for a building: if its unit is another, give `--units`"
        ))
    }
}

/// Position of a face's corner in model units; `None` if its file has no such vertex.
pub fn position(spilled: &mut Spilled, face: &Face, corner: FaceCorner) -> Result<Option<DVec3>> {
    let end = spilled.files[face.source.file as usize].vertices.1;
    if corner.vertex == NONE || u64::from(corner.vertex) >= end {
        return Ok(None);
    }
    spilled.positions.get(u64::from(corner.vertex)).map(|p| Some(DVec3::from_array(p)))
}

/// The error for a model without anything to light.
#[must_use]
pub fn no_faces(spilled: &Spilled) -> Error {
    let names: Vec<_> = spilled.files.iter().map(|f| f.path.display().to_string()).collect();
    let mut why = format!("`f` records: {}", spilled.polygons);
    for warning in spilled.skipped.warnings(&spilled.files.iter().map(|f| f.path.clone()).collect::<Vec<_>>()) {
        why = format!("{why}; {warning}");
    }
    for (what, n) in &spilled.ignored {
        why = format!("{why}; {what}: {n}");
    }
    Error::failed(
        format!("{}: no face with an area ({why})", names.join(", ")),
        "write the model as polygons (OBJ `f` records)",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_building_ten_kilometres_away_keeps_its_shape_to_the_last_bit() {
        let near = Survey { bounds: Bounds::of(&[DVec3::ZERO, DVec3::splat(30.0)]), area_along: [0.0; 2] };
        let shift = DVec3::new(10_000.0, -10_000.0, 5_000.0);
        let far = Survey { bounds: Bounds::of(&[shift, shift + 30.0]), area_along: [0.0; 2] };
        for place in [[1.25, 2.5, 3.75], [29.125, 0.0625, 7.0]] {
            let place = DVec3::from_array(place);
            assert_eq!(near.frame(1.0).store_position(place), far.frame(1.0).store_position(place + shift));
        }
        let frame = far.frame(0.01);
        let back = frame.model_position(frame.store_position(shift + 7.0));
        assert!((back - shift - 7.0).length() < 1e-4, "{back}");
    }

    #[test]
    fn floors_and_ceilings_tell_the_vertical() {
        let mut survey = Survey { bounds: Bounds::EMPTY, area_along: [0.0; 2] };
        survey.add(&[DVec3::ZERO, DVec3::X * 4.0, DVec3::new(4.0, 0.0, 3.0)]);
        assert_eq!(survey.up(), 'y');
        survey.add(&[DVec3::ZERO, DVec3::X * 4.0, DVec3::new(4.0, 4.0, 0.0)]);
        assert_eq!(survey.up(), 'z');
        assert!(survey.size_warning(1.0).is_none());
        assert!(survey.size_warning(1000.0).unwrap().contains("--units"));
    }
}
