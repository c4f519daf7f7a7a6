//! Colours: linear RGB triples, f64 for sums, `[f32; 3]` where stored.

use std::ops::{Add, AddAssign, Mul, Sub};

/// A linear RGB triple; what it measures (W/m2, reflectance...) is in the name of the variable.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rgb(pub [f64; 3]);

/// Luminous efficacy used for lux, lm/W (Radiance's convention).
pub const EFFICACY_LM_PER_W: f64 = 179.0;

/// Illuminance of an irradiance in W/m2, lx: `179 (0.265 R + 0.670 G + 0.065 B)`.
#[must_use]
pub fn lux(irradiance: Rgb) -> f64 {
    let [r, g, b] = irradiance.0;
    EFFICACY_LM_PER_W * (0.265 * r + 0.670 * g + 0.065 * b)
}

impl Rgb {
    /// All three channels 0.
    pub const BLACK: Self = Self([0.0; 3]);

    /// The same value in every channel.
    #[must_use]
    pub fn grey(value: f64) -> Self {
        Self([value; 3])
    }

    /// From stored f32.
    #[must_use]
    pub fn from_f32(stored: [f32; 3]) -> Self {
        Self(stored.map(f64::from))
    }

    /// Rounded for storage.
    #[must_use]
    pub fn to_f32(self) -> [f32; 3] {
        self.0.map(|x| x as f32)
    }

    /// Channel by channel product.
    #[must_use]
    pub fn times(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] * other.0[i]))
    }

    /// Largest channel.
    #[must_use]
    pub fn max(self) -> f64 {
        self.0[0].max(self.0[1]).max(self.0[2])
    }

    /// Sum over the channels of their products.
    #[must_use]
    pub fn dot(self, other: Self) -> f64 {
        self.0[0] * other.0[0] + self.0[1] * other.0[1] + self.0[2] * other.0[2]
    }

    /// Sum of squares of the channels.
    #[must_use]
    pub fn norm_squared(self) -> f64 {
        self.dot(self)
    }

    /// Whether every channel is exactly 0.
    #[must_use]
    pub fn is_black(self) -> bool {
        self.0 == [0.0; 3]
    }
}

impl Add for Rgb {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + other.0[i]))
    }
}

impl Sub for Rgb {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] - other.0[i]))
    }
}

impl AddAssign for Rgb {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Mul<f64> for Rgb {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self(self.0.map(|x| x * factor))
    }
}
