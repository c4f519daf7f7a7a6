//! Tone mapping: linear radiance to display values.

use crate::base::{Rgb, lux};

/// Name of the operator, written into pictures.
pub const NAME: &str = "exposure to a log-average of 0.22, then Reinhard 2002 with white at 4";

/// Exposure that brings the log-average luminance of the lit pixels to a middle grey.
#[must_use]
pub fn exposure(pixels: &[[f32; 3]]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for pixel in pixels {
        let y = lux(Rgb::from_f32(*pixel));
        if y > 0.0 {
            sum += libm::log(y);
            count += 1.0;
        }
    }
    if count > 0.0 { 0.22 * lux(Rgb::grey(1.0)) / libm::exp(sum / count) } else { 1.0 }
}

/// A linear pixel as sRGB bytes.
#[must_use]
pub fn display(pixel: [f32; 3], exposure: f64) -> [u8; 3] {
    const WHITE: f64 = 4.0;
    pixel.map(|x| {
        let x = f64::from(x) * exposure;
        let mapped = x * (1.0 + x / (WHITE * WHITE)) / (1.0 + x);
        (srgb(mapped.min(1.0)) * 255.0).round() as u8
    })
}

/// The sRGB transfer function of a linear value in 0..=1.
#[must_use]
pub fn srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brighter_stays_brighter_and_black_stays_black() {
        let values: Vec<u8> = (0..50).map(|i| display([i as f32 * 0.1; 3], 1.0)[0]).collect();
        assert!(values.windows(2).all(|w| w[0] <= w[1]) && values[0] == 0, "{values:?}");
        assert!((srgb(1.0) - 1.0).abs() < 1e-12);
    }
}
