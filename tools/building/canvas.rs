//! Drawing in a local frame: rectangles that face along an axis, blocks of them, and quads.

use super::material::Material;
use super::obj::Obj;
use super::place::Place;

/// Where a rectangle's front faces, in the local frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Facing {
    /// +u
    East,
    /// -u
    West,
    /// +v
    North,
    /// -v
    South,
    /// +z
    Up,
    /// -z
    Down,
}

use Facing::{Down, East, North, South, Up, West};

/// All faces of a block.
pub const ALL: [Facing; 6] = [East, West, North, South, Up, Down];
/// Of one that stands on something.
pub const STANDING: [Facing; 5] = [East, West, North, South, Up];
/// Of one that goes from floor to top.
pub const SIDES: [Facing; 4] = [East, West, North, South];

/// Low and high end along an axis, m.
pub type Span = [f64; 2];

/// A pen in a local frame.
pub struct Canvas<'a> {
    obj: &'a mut Obj,
    place: Place,
    /// Names of objects begin with it.
    prefix: &'a str,
}

impl<'a> Canvas<'a> {
    /// A canvas at a place of the building.
    pub fn new(obj: &'a mut Obj, place: Place, prefix: &'a str) -> Self {
        Self { obj, place, prefix }
    }

    /// The same pen at a place within this one's frame.
    pub fn at(&mut self, place: impl FnOnce(Place) -> Place) -> Canvas<'_> {
        Canvas { obj: &mut *self.obj, place: place(self.place), prefix: self.prefix }
    }

    /// Begins an object. Names need not differ from those of other prefixes.
    pub fn object(&mut self, name: &str) {
        self.obj.object(&format!("{}.{name}", self.prefix));
    }

    /// Draws a quad, m, anticlockwise seen from its front.
    pub fn quad(&mut self, material: Material, corners: [[f64; 3]; 4]) {
        self.obj.quad(material, corners.map(|corner| self.place.point(corner)));
    }

    /// Draws a rectangle at `at` along the axis it faces; `a` and `b`: its spans along the other two, in order of u, v, z.
    pub fn rect(&mut self, material: Material, facing: Facing, at: f64, [a0, a1]: Span, [b0, b1]: Span) {
        let corners = match facing {
            East => [[at, a0, b0], [at, a1, b0], [at, a1, b1], [at, a0, b1]],
            West => [[at, a1, b0], [at, a0, b0], [at, a0, b1], [at, a1, b1]],
            North => [[a1, at, b0], [a0, at, b0], [a0, at, b1], [a1, at, b1]],
            South => [[a0, at, b0], [a1, at, b0], [a1, at, b1], [a0, at, b1]],
            Up => [[a0, b0, at], [a1, b0, at], [a1, b1, at], [a0, b1, at]],
            Down => [[a0, b1, at], [a1, b1, at], [a1, b0, at], [a0, b0, at]],
        };
        self.quad(material, corners);
    }

    /// Draws some faces of a block, fronts outwards.
    pub fn block(&mut self, material: Material, [u, v, z]: [Span; 3], faces: &[Facing]) {
        for facing in faces {
            match facing {
                East => self.rect(material, East, u[1], v, z),
                West => self.rect(material, West, u[0], v, z),
                North => self.rect(material, North, v[1], u, z),
                South => self.rect(material, South, v[0], u, z),
                Up => self.rect(material, Up, z[1], u, v),
                Down => self.rect(material, Down, z[0], u, v),
            }
        }
    }
}
