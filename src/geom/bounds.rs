//! Axis-aligned boxes.

use glam::DVec3;

/// A box; `EMPTY` contains nothing and grows to whatever is added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest corner, m.
    pub min: DVec3,
    /// Largest corner, m.
    pub max: DVec3,
}

impl Bounds {
    /// Contains nothing.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// Grown to hold a point.
    #[must_use]
    pub fn with(self, point: DVec3) -> Self {
        Self { min: self.min.min(point), max: self.max.max(point) }
    }

    /// Smallest box round both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Box round some points.
    #[must_use]
    pub fn of(points: &[DVec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, p| b.with(*p))
    }

    /// From stored corners.
    #[must_use]
    pub fn from_f32(min: [f32; 3], max: [f32; 3]) -> Self {
        Self { min: DVec3::from_array(min.map(f64::from)), max: DVec3::from_array(max.map(f64::from)) }
    }

    /// Edge lengths, m; negative for `EMPTY`.
    #[must_use]
    pub fn size(self) -> DVec3 {
        self.max - self.min
    }

    /// Middle.
    #[must_use]
    pub fn centre(self) -> DVec3 {
        (self.min + self.max) * 0.5
    }

    /// Surface area, m2.
    #[must_use]
    pub fn area(self) -> f64 {
        let s = self.size().max(DVec3::ZERO);
        2.0 * (s.x * s.y + s.y * s.z + s.z * s.x)
    }

    /// Whether the two share a point.
    #[must_use]
    pub fn meets(self, other: Self) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }
}
