//! Where a thing stands: its own axes u, v and z up, placed and turned in the building.

/// A local frame, m.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    origin: [f64; 3],
    /// The u axis in the building's plan; v is a quarter turn further.
    along: [f64; 2],
}

impl Place {
    /// At a corner of the building's plan, with u along x.
    #[must_use]
    pub fn new(x: f64, y: f64, z: f64) -> Self {
        Self { origin: [x, y, z], along: [1.0, 0.0] }
    }

    /// A frame within this one, at (u, v, z).
    #[must_use]
    pub fn within(self, u: f64, v: f64, z: f64) -> Self {
        Self { origin: self.point([u, v, z]), ..self }
    }

    /// Turned anticlockwise by quarters, exactly.
    #[must_use]
    pub fn quarters(self, count: usize) -> Self {
        let [x, y] = self.along;
        Self { along: [[x, y], [-y, x], [-x, -y], [y, -x]][count % 4], ..self }
    }

    /// Turned anticlockwise, degrees.
    #[must_use]
    pub fn turned(self, degrees: f64) -> Self {
        let angle = degrees.to_radians();
        let (cos, sin) = (libm::cos(angle), libm::sin(angle));
        let [x, y] = self.along;
        Self { along: [x * cos - y * sin, x * sin + y * cos], ..self }
    }

    /// A local point in the building, m.
    #[must_use]
    pub fn point(self, [u, v, z]: [f64; 3]) -> [f64; 3] {
        let ([x, y], at) = (self.along, self.origin);
        [at[0] + u * x - v * y, at[1] + u * y + v * x, at[2] + z]
    }
}
