//! Where most of a model lies, whatever single faces lie elsewhere: a marker at zero beside a building in national
//! coordinates, a ground that reaches to the horizon.

use std::collections::BinaryHeap;

use glam::DVec3;

use crate::geom::bounds::Bounds;
use crate::geom::sequence::mix_point;

/// Faces looked at for the whole model; chosen by their places, so that neither order nor memory matters.
const SAMPLED: usize = 4096;
/// Share of the faces that lie within the radius.
const MOST: f64 = 0.9;
/// Radii beyond which a model is wide: its coordinates are rounded to a ten-thousandth of a radius there.
const WIDE: f64 = 1000.0;
/// Radii beyond which a face is far off. Landscapes, towns and skies lie within; buildings in national coordinates are
/// this far from zero.
const FAR: f64 = 2e4;

/// The middle of a model's faces, and what most of them lie within; model units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Whereabouts {
    pub middle: DVec3,
    /// Largest coordinate difference from the middle of nine faces in ten.
    pub radius: f64,
}

impl Whereabouts {
    /// Farthest corner of a face from the middle, by its largest coordinate difference.
    #[must_use]
    pub fn distance(&self, points: &[DVec3]) -> f64 {
        points.iter().map(|p| (*p - self.middle).abs().max_element()).fold(0.0, f64::max)
    }

    /// Whether so much more than most of the model is held by these corners that coordinates from their centre would
    /// lose its details.
    #[must_use]
    pub fn is_wide(&self, points: &[DVec3]) -> bool {
        self.distance(points) > WIDE * self.radius
    }

    /// Whether a face reaches so far that it says nothing of where the model is.
    #[must_use]
    pub fn is_far(&self, points: &[DVec3]) -> bool {
        self.distance(points) > FAR * self.radius
    }
}

/// Faces drawn from all.
#[derive(Default)]
pub struct Sample(BinaryHeap<(u64, [u64; 6], bool)>);

/// A face's box, and whether it emits.
type Seen = ([DVec3; 2], bool);

impl Sample {
    /// Adds a face by its corners.
    pub fn add(&mut self, points: &[DVec3], emits: bool) {
        let Bounds { min: low, max: high } = Bounds::of(points);
        let hash = mix_point(low) ^ mix_point(high).rotate_left(32);
        if self.0.len() < SAMPLED || self.0.peek().is_some_and(|largest| hash < largest.0) {
            let [a, b, c] = low.to_array().map(f64::to_bits);
            let [d, e, f] = high.to_array().map(f64::to_bits);
            self.0.push((hash, [a, b, c, d, e, f], emits));
            if self.0.len() > SAMPLED {
                self.0.pop();
            }
        }
    }

    /// What they tell; `None` if there are none.
    #[must_use]
    pub fn whereabouts(self) -> Option<Whereabouts> {
        let faces: Vec<Seen> = (self.0.into_sorted_vec().into_iter())
            .map(|(_, bits, emits)| {
                let [a, b, c, d, e, f] = bits.map(f64::from_bits);
                ([DVec3::new(a, b, c), DVec3::new(d, e, f)], emits)
            })
            .collect();
        let boxes: Vec<[DVec3; 2]> = chief_part(faces).into_iter().map(|(corners, _)| corners).collect();
        let last = boxes.len().checked_sub(1)?;
        let middle = DVec3::from_array([0, 1, 2].map(|axis| {
            let mut all: Vec<f64> = boxes.iter().map(|[low, high]| 0.5 * (low[axis] + high[axis])).collect();
            all.sort_unstable_by(f64::total_cmp);
            all[last / 2]
        }));
        let around = Whereabouts { middle, radius: 0.0 };
        let mut distances: Vec<f64> = boxes.iter().map(|corners| around.distance(corners)).collect();
        distances.sort_unstable_by(f64::total_cmp);
        Some(Whereabouts { radius: distances[(MOST * last as f64) as usize], ..around })
    }
}

/// The faces on the chief side of every gap that is wider than [`WIDE`] times what lies on either side: where more
/// emit, or of two that are alike in this where there are more, or those farther from zero, where markers stand.
fn chief_part(mut faces: Vec<Seen>) -> Vec<Seen> {
    let mut axis = 0;
    let mut uncut = 0;
    while uncut < 3 && faces.len() > 1 {
        let middle = |([low, high], _): &Seen| 0.5 * (low[axis] + high[axis]);
        faces.sort_by(|a, b| middle(a).total_cmp(&middle(b)));
        let gap = |i: usize| middle(&faces[i]) - middle(&faces[i - 1]);
        let widest = (2..faces.len()).fold(1, |w, i| if gap(i) > gap(w) { i } else { w });
        let gap = gap(widest);
        let (low, high) = (Part::of(&faces[..widest]), Part::of(&faces[widest..]));
        (axis, uncut) = ((axis + 1) % 3, uncut + 1);
        if gap > WIDE * low.size.min(high.size) {
            if low.weight() > high.weight() {
                faces.truncate(widest);
            } else {
                faces.drain(..widest);
            }
            uncut = 0;
        }
    }
    faces
}

/// Faces on one side of a gap.
struct Part {
    emitting: usize,
    faces: usize,
    size: f64,
    from_zero: f64,
}

impl Part {
    fn of(faces: &[Seen]) -> Self {
        let add = |all: Bounds, ([min, max], _): &Seen| all.union(Bounds { min: *min, max: *max });
        let bounds = faces.iter().fold(Bounds::EMPTY, add);
        Self {
            emitting: faces.iter().filter(|(_, emits)| *emits).count(),
            faces: faces.len(),
            size: bounds.size().max_element(),
            from_zero: bounds.centre().length(),
        }
    }

    fn weight(&self) -> (usize, usize, f64) {
        (self.emitting, self.faces, self.from_zero)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(at: DVec3, width: f64) -> [DVec3; 3] {
        [at, at + DVec3::X * width, at + DVec3::Y * width]
    }

    #[test]
    fn a_marker_at_zero_and_a_ground_to_the_horizon_are_far_from_a_building_and_its_town_is_not() {
        let corner = DVec3::new(500_000.0, 5_000_000.0, 100.0);
        let mut sample = Sample::default();
        for i in 0..10_000 {
            sample.add(&tile(corner + DVec3::new(f64::from(i % 100), f64::from(i / 100), 0.0), 1.0), false);
        }
        let (marker, ground) = (tile(DVec3::ZERO, 1.0), tile(corner, 1.5e6));
        sample.add(&marker, false);
        sample.add(&ground, false);
        let found = sample.whereabouts().unwrap();
        assert!((20.0..80.0).contains(&found.radius), "{found:?}");
        assert!(found.is_far(&marker) && found.is_far(&ground));
        let town = tile(corner + 50_000.0, 1.0);
        assert!(!found.is_far(&town) && found.is_wide(&town));
    }

    #[test]
    fn of_a_building_and_a_marker_with_as_many_faces_the_one_at_zero_is_the_marker() {
        let corner = DVec3::new(500_000.0, 5_000_000.0, 100.0);
        let mut sample = Sample::default();
        for i in 0..6 {
            sample.add(&tile(DVec3::splat(f64::from(i)), 1.0), false);
            sample.add(&tile(corner + f64::from(i), 1.0), false);
        }
        let found = sample.whereabouts().unwrap();
        assert!(found.is_far(&tile(DVec3::ZERO, 1.0)) && !found.is_far(&tile(corner, 1.0)), "{found:?}");
        // A logo of more faces than a building that is lit.
        let mut sample = Sample::default();
        for i in 0..60 {
            sample.add(&tile(DVec3::splat(f64::from(i) * 0.1), 0.1), false);
            if i < 36 {
                sample.add(&tile(corner + f64::from(i), 1.0), i == 0);
            }
        }
        let found = sample.whereabouts().unwrap();
        assert!(found.is_far(&tile(DVec3::ZERO, 1.0)) && !found.is_far(&tile(corner, 1.0)), "{found:?}");
    }

    #[test]
    fn one_face_is_where_the_model_is() {
        let mut sample = Sample::default();
        sample.add(&tile(DVec3::splat(7.0), 2.0), false);
        let found = sample.whereabouts().unwrap();
        assert!(found.radius > 0.0 && !found.is_far(&tile(DVec3::splat(7.0), 2.0)), "{found:?}");
        assert_eq!(Sample::default().whereabouts(), None);
    }
}
