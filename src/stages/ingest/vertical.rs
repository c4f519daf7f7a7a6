//! Which axis of a model is its vertical, y or z, and how sure that is.
//!
//! Three things speak for an axis: floors and ceilings face along it, most buildings are wider than high, lamps look
//! down. None is enough: a corridor has more wall than floor, a tower is high, a window shines sideways.

use glam::DVec3;

use super::materials::Material;
use crate::geom::split::area_vector;

/// What all lamps looking one way along an axis (down; up where they are wound the wrong way) counts, as a logarithm of a ratio: as much as nearly three times the area.
const LAMPS: f64 = 1.0;
/// Logarithm of a ratio from which the vertical is clear: three times as much speaks for it as for the other.
const SURE: f64 = 1.1;
/// What may speak against it all the same.
const DOUBT: f64 = 0.35;
/// Times its second longest side that a model's longest may be: what is longer and is not said to lie by its lamps may
/// be a corridor or a tower.
const LONG: f64 = 2.0;

/// What speaks for an axis.
#[derive(Clone, Copy, Debug, Default)]
pub struct Vertical {
    /// Area that faces mostly along x, y, z, squared model units.
    area_along: [f64; 3],
    /// Emitted power (any unit) times the front normal, and its sum without directions.
    emission: DVec3,
    emitted: f64,
}

impl Vertical {
    /// Adds a face.
    pub fn add(&mut self, points: &[DVec3], material: &Material) {
        let area = area_vector(points) * 0.5;
        let size = area.abs();
        let axis = if size.z >= size.y && size.z >= size.x { 2 } else { usize::from(size.y >= size.x) };
        self.area_along[axis] += area.length();
        let exitance = material.exitance.norm_squared().sqrt();
        self.emission += area * exitance;
        self.emitted += area.length() * exitance;
    }

    /// The vertical of a model of that size (any unit), and whether it is sure. In a near tie z.
    #[must_use]
    pub fn up(&self, size: DVec3) -> (char, bool) {
        let [_, y, z] = self.area_along;
        let ratio = |a: f64, b: f64| if a > 0.0 && b > 0.0 { (a / b).ln() } else { 0.0 };
        let lamps_along = |axis: usize| if self.emitted > 0.0 { self.emission[axis].abs() / self.emitted } else { 0.0 };
        let area = if y == 0.0 || z == 0.0 { SURE * (f64::from(y > 0.0) - f64::from(z > 0.0)) } else { ratio(y, z) };
        let lamps = LAMPS * (lamps_along(1) - lamps_along(2));
        let all = [area, ratio(size.z, size.y), lamps];
        let for_y: f64 = all.iter().sum();
        if for_y.abs() < SURE {
            return ('z', false);
        }
        let mut sides = size.to_array();
        sides.sort_unstable_by(f64::total_cmp);
        let is_long = sides[2] > LONG * sides[1] && sides[2] != size.x && lamps * for_y.signum() < DOUBT;
        let is_doubted = is_long || all.iter().any(|evidence| evidence * for_y.signum() < -DOUBT);
        (if for_y > 0.0 { 'y' } else { 'z' }, !is_doubted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Rgb;

    /// A box of that size with lamps of a square metre below its ceiling, which lies along `up`.
    fn room(size: DVec3, up: Option<usize>) -> (char, bool) {
        let plain = Material { rho: Rgb::grey(0.5), exitance: Rgb::BLACK };
        let lamp = Material { exitance: Rgb::grey(1.0), ..plain };
        let mut vertical = Vertical::default();
        let tile = |axis: usize, turned: bool| {
            let (a, b) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
            let mut corners = [DVec3::ZERO, a, a + b, b];
            if turned {
                corners.reverse();
            }
            corners
        };
        for axis in 0..3 {
            for turned in [false, true] {
                vertical.add(&tile(axis, turned).map(|c| c * size), &plain);
            }
        }
        if let Some(up) = up {
            vertical.add(&tile(up, true), &lamp);
        }
        vertical.up(size)
    }

    #[test]
    fn a_corridor_with_lamps_below_its_ceiling_a_hall_and_a_tower_tell_their_vertical() {
        assert_eq!(room(DVec3::new(20.0, 2.0, 3.0), Some(2)), ('z', false), "its walls speak for y");
        assert_eq!(room(DVec3::new(5.0, 2.8, 4.0), Some(1)), ('y', true));
        assert_eq!(room(DVec3::new(20.0, 30.0, 3.0), None), ('z', true));
        assert_eq!(room(DVec3::new(20.0, 3.0, 30.0), None), ('y', true));
        assert_eq!(room(DVec3::new(5.0, 4.0, 2.8), Some(2)), ('z', true));
    }

    #[test]
    fn what_could_stand_either_way_stands_on_z_and_that_is_not_sure() {
        for (size, lamps) in [
            (DVec3::splat(3.0), None),
            (DVec3::new(3.0, 2.7, 3.0), None),
            // A corridor, and a room with a window in its long wall.
            (DVec3::new(20.0, 2.0, 3.0), None),
            (DVec3::new(5.0, 4.0, 2.8), Some(1)),
        ] {
            assert_eq!(room(size, lamps), ('z', false), "{size} {lamps:?}");
        }
        assert!(!room(DVec3::new(5.0, 5.0, 15.0), None).1, "a tower, or a corridor along z");
        assert!(!room(DVec3::new(5.0, 5.0, 30.0), Some(2)).1, "its lamps speak for a tower");
    }

    #[test]
    fn what_speaks_against_it_makes_a_clear_vertical_doubtful() {
        let lit = Vertical { area_along: [1.0, 1.0, 2.1], emission: -DVec3::Z, emitted: 1.0 };
        assert_eq!(lit.up(DVec3::new(8.0, 8.0, 8.0)), ('z', true));
        assert_eq!(lit.up(DVec3::new(8.0, 8.0, 13.2)), ('z', false), "higher than wide");
    }
}
