//! Where the model lies: its bounds and the store's origin, from the faces that count.

use std::path::PathBuf;

use glam::DVec3;

use super::materials::Material;
use super::piece::{FaceCorner, NONE, Source};
use super::pieces::is_needle;
use super::read::{Face, Spilled};
use super::vertical::Vertical;
use super::whereabouts::{Sample, Whereabouts};
use crate::base::text::shown;
use crate::base::{Error, Progress, Result};
use crate::geom::bounds::Bounds;

/// Patches that are wider than this as a rule, m, are no building's: a house of centimetres read as metres has 400.
const WIDEST_TYPICAL_M: f64 = 60.0;
/// Snap length as a share of the bounding diagonal.
const SNAP: f64 = 1e-5;
/// Longest that may be given, as such a share.
const MOST_SNAP: f64 = 0.01;
/// Longest that it is by itself, m, however large the model.
const MOST_SNAP_M: f64 = 1e-3;

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

/// What the faces that count say of the whole model: those with an area, and not far off.
pub struct Survey {
    /// Box round them, model units.
    pub bounds: Bounds,
    /// What tells the vertical.
    pub vertical: Vertical,
    /// Where the model is; `None` if it has no faces.
    pub whereabouts: Option<Whereabouts>,
    /// How many faces lie far off, with the first of them and its distance, model units.
    far: Option<(u64, Source, f64)>,
}

impl Survey {
    /// Looks at every face whose corners are there and usable.
    pub fn of(
        spilled: &mut Spilled,
        materials: &[Material],
        metres_per_unit: f64,
        progress: &dyn Progress,
    ) -> Result<Self> {
        progress.begin("measure", "faces", Some(spilled.polygons));
        let mut sample = Sample::default();
        let mut bounds = Bounds::EMPTY;
        let mut vertical = Vertical::default();
        for_each_shape(spilled, metres_per_unit, progress, |face, points| {
            bounds = bounds.union(Bounds::of(points));
            sample.add(points, materials[face.material as usize].emits());
            vertical.add(points, &materials[face.material as usize]);
        })?;
        let whereabouts = sample.whereabouts();
        let mut survey = Self { bounds, vertical, whereabouts, far: None };
        let Some(whereabouts) = whereabouts else { return Ok(survey) };
        if !whereabouts.is_far(&[bounds.min, bounds.max]) {
            return Ok(survey);
        }
        let (mut near, mut vertical, mut far) = (Bounds::EMPTY, Vertical::default(), None);
        for_each_shape(spilled, metres_per_unit, progress, |face, points| {
            if whereabouts.is_far(points) {
                let (count, ..) = far.get_or_insert((0, face.source, whereabouts.distance(points)));
                *count += 1;
            } else {
                near = near.union(Bounds::of(points));
                vertical.add(points, &materials[face.material as usize]);
            }
        })?;
        (survey.bounds, survey.vertical, survey.far) = (near, vertical, far);
        Ok(survey)
    }

    /// Most of the model, where its bounds are so wide that they tell nothing of it.
    fn most(&self) -> Option<Whereabouts> {
        self.whereabouts.filter(|around| around.is_wide(&[self.bounds.min, self.bounds.max]))
    }

    /// The frame of a store: its origin is the centre of the bounds, or of most of the model, in whole units.
    #[must_use]
    pub fn frame(&self, metres_per_unit: f64) -> Frame {
        let centre = if self.is_empty() { DVec3::ZERO } else { self.bounds.centre() };
        Frame { origin: self.most().map_or(centre, |around| around.middle).round(), metres_per_unit }
    }

    /// Faces this near coincide where nothing else is given, m: no more than what parts of a building are apart, no
    /// less than coordinates are rounded by.
    #[must_use]
    pub fn snap_m(&self, metres_per_unit: f64) -> f64 {
        let whole = if self.is_empty() { 0.0 } else { self.bounds.size().length() };
        let diagonal_m = self.most().map_or(whole, |around| 2.0 * around.radius) * metres_per_unit;
        (SNAP * diagonal_m).min(MOST_SNAP_M).max(2.0 * f64::from(f32::EPSILON) * diagonal_m)
    }

    /// Refuses a snap length that would melt the model.
    pub fn refuse_snap(&self, snap_m: f64, metres_per_unit: f64) -> Result<()> {
        let size_m = self.bounds.size().length() * metres_per_unit;
        if self.is_empty() || snap_m <= MOST_SNAP * size_m {
            return Ok(());
        }
        Err(Error::Usage {
            message: format!("`--snap` of {snap_m:e} m is over a hundredth of the model's {size_m:.3} m"),
            help: "give a length that nothing but rounding is shorter than, or leave out `--snap`".to_owned(),
        })
    }

    fn is_empty(&self) -> bool {
        self.bounds.min.x > self.bounds.max.x
    }

    /// What is odd about where the model lies and how large it is. `paths`: of the files.
    #[must_use]
    pub fn warnings(&self, metres_per_unit: f64, typical_m: f64, paths: &[PathBuf]) -> Vec<String> {
        let mut all = Vec::new();
        if let (Some((count, first, distance)), Some(around)) = (self.far, self.whereabouts) {
            all.push(format!(
                "{count} faces lie far off, the first {:.0} m away, where most of the model lies within {:.1} m: first {}:{}; \
                 they count for nothing that is measured of the whole",
                distance * metres_per_unit,
                around.radius * metres_per_unit,
                shown(&paths[first.file as usize]),
                first.line
            ));
        }
        all.extend(self.size_warning(metres_per_unit, typical_m));
        all
    }

    /// `typical_m`: width of a typical patch.
    fn size_warning(&self, metres_per_unit: f64, typical_m: f64) -> Option<String> {
        let size = self.bounds.size() * metres_per_unit;
        let longest = size.max_element();
        let [x, y, z] = size.to_array();
        let odd = if longest > 2000.0 || typical_m > WIDEST_TYPICAL_M {
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

/// Visits the faces that have an area, with their corners in model units.
fn for_each_shape(
    spilled: &mut Spilled,
    metres_per_unit: f64,
    progress: &dyn Progress,
    mut visit: impl FnMut(&Face, &[DVec3]),
) -> Result<()> {
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
            if !is_needle(&points) {
                visit(face, &points);
            }
            Ok(())
        },
        progress,
    )
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
    let names: Vec<_> = spilled.files.iter().map(|f| shown(&f.path)).collect();
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

    fn survey(bounds: Bounds) -> Survey {
        Survey { bounds, vertical: Vertical::default(), whereabouts: None, far: None }
    }

    #[test]
    fn a_building_ten_kilometres_away_keeps_its_shape_to_the_last_bit() {
        let near = survey(Bounds::of(&[DVec3::ZERO, DVec3::splat(30.0)]));
        let shift = DVec3::new(10_000.0, -10_000.0, 5_000.0);
        let far = survey(Bounds::of(&[shift, shift + 30.0]));
        for place in [[1.25, 2.5, 3.75], [29.125, 0.0625, 7.0]] {
            let place = DVec3::from_array(place);
            assert_eq!(near.frame(1.0).store_position(place), far.frame(1.0).store_position(place + shift));
        }
        let frame = far.frame(0.01);
        let back = frame.model_position(frame.store_position(shift + 7.0));
        assert!((back - shift - 7.0).length() < 1e-4, "{back}");
    }

    #[test]
    fn faces_of_large_buildings_coincide_within_a_millimetre_and_rounding_is_never_less() {
        let snap = |side: f64| survey(Bounds::of(&[DVec3::ZERO, DVec3::X * side])).snap_m(1.0);
        assert_eq!((snap(10.0), snap(100.0), snap(3000.0)), (1e-4, 1e-3, 1e-3));
        assert!(snap(1e5) > 2.0 * 1e5 / f64::from(1 << 24), "{}", snap(1e5));
    }

    #[test]
    fn a_marker_that_is_not_so_far_off_moves_neither_origin_nor_snap_length() {
        let around = |points: &[DVec3]| {
            let mut sample = Sample::default();
            points.iter().for_each(|p| sample.add(&[*p, *p + DVec3::X, *p + DVec3::Y], false));
            Survey { whereabouts: sample.whereabouts(), ..survey(Bounds::of(points)) }
        };
        let building: Vec<DVec3> = (0..20).map(|i| DVec3::new(40_000.0 + f64::from(i), 0.0, 0.0)).collect();
        let marked = around(&[&building[..], &[DVec3::ZERO]].concat());
        assert!((marked.frame(1.0).origin.x - 40_010.0).abs() < 20.0, "{}", marked.frame(1.0).origin);
        assert!(marked.snap_m(1.0) < 2.0 * around(&building).snap_m(1.0), "{}", marked.snap_m(1.0));
    }

    #[test]
    fn a_size_that_no_building_has_is_named() {
        let size = |metres| survey(Bounds::of(&[DVec3::ZERO, DVec3::splat(4.0)])).size_warning(metres, 3.0 * metres);
        assert!(size(1.0).is_none());
        // Millimetres, and centimetres.
        assert!(size(1000.0).unwrap().contains("--units") && size(100.0).unwrap().contains("--units"));
    }
}
