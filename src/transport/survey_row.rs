//! A surveyed row: how noisy it is, and how much what it brings differs from quarter to quarter of its
//! receiver. From stored numbers alone, so that rows are tested again without a ray.

use super::link_rows::Link;
use crate::base::Rgb;

/// A quarter that sees as much as the whole is this many 64ths.
pub const WHOLE: f64 = 64.0;

/// Packs what the four quarters of a receiver see of a source, relative to the whole of it.
#[must_use]
pub fn pack_quarters(relative: [f64; 4]) -> f32 {
    // Four quarters have a mean of 1: none is above 4.
    f32::from_bits(u32::from_le_bytes(relative.map(|x| (x * WHOLE).round().clamp(0.0, 255.0) as u8)))
}

/// What [`pack_quarters`] packed.
#[must_use]
pub fn quarters(packed: f32) -> [f64; 4] {
    packed.to_bits().to_le_bytes().map(|x| f64::from(x) / WHOLE)
}

/// What is off in a row, W/m2.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Worth {
    /// Mean irradiance.
    pub irradiance: f64,
    /// Standard error of it.
    pub noise: f64,
    /// Largest difference of a quarter from the mean that noise does not explain.
    pub gradient: f64,
}

/// Returns what is off in a row of surveyed links, each with its source's radiosity, W/m2.
///
/// A closed row sums to 1, so an error in one form factor is made up by all others: what counts is how
/// much a source differs from the `mean` of all that is seen.
#[must_use]
pub fn worth(row: &[(Link, Rgb)], mean: Rgb) -> Worth {
    let light = row.iter().fold(Rgb::BLACK, |light, (link, b)| light + *b * f64::from(link.form_factor));
    let mut variance = 0.0;
    let mut quarter = [Rgb::BLACK; 4];
    for (link, radiosity) in row {
        let differs = *radiosity - mean;
        let error = f64::from(link.uncertainty);
        variance += error * error * differs.norm_squared();
        for (sum, relative) in quarter.iter_mut().zip(quarters(link.spread)) {
            *sum += differs * (f64::from(link.form_factor) * (relative - 1.0));
        }
    }
    let noise = variance.sqrt();
    let largest = quarter.iter().map(|q| q.norm_squared().sqrt()).fold(0.0, f64::max);
    // A quarter has a quarter of the rays.
    Worth { irradiance: light.norm_squared().sqrt(), noise, gradient: (largest - 2.0 * noise).max(0.0) }
}

/// Mean radiosity of the sources of a row, W/m2.
#[must_use]
pub fn mean(row: &[(Link, Rgb)]) -> Rgb {
    let sum: f64 = row.iter().map(|(link, _)| f64::from(link.form_factor)).sum();
    let light = row.iter().fold(Rgb::BLACK, |light, (link, b)| light + *b * f64::from(link.form_factor));
    if sum > 0.0 { light * (1.0 / sum) } else { Rgb::BLACK }
}

/// Standard error of a share of `rays` rays: one of all may as well have been none or two.
#[must_use]
pub fn counted_error(share: f64, rays: f64) -> f64 {
    (share * (1.0 - share).max(1.0 / rays) / rays).sqrt()
}
