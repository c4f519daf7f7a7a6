//! Light that changes linearly over an element: its mean and two gradients; the line through what was measured at
//! places of it, and how far off that is.

use crate::base::Rgb;
use crate::transport::nodes::frame::Plane;
use crate::transport::numbers;

/// Irradiance over an element, W/m2: `mean + along[0] x + along[1] y`, with x and y in m from the element's centroid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Line {
    /// At the centroid, and on average.
    pub mean: Rgb,
    /// Change a metre along each axis of the patch's frame.
    pub along: [Rgb; 2],
}

impl Line {
    /// At a place, relative to the centroid.
    #[must_use]
    pub fn at(&self, [x, y]: Plane) -> Rgb {
        self.mean + self.along[0] * x + self.along[1] * y
    }

    /// The same light, with another centroid.
    #[must_use]
    pub fn about(&self, place: Plane) -> Self {
        Self { mean: self.at(place), ..*self }
    }

    /// The sum of both.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let along = [0, 1].map(|i| self.along[i] + other.along[i]);
        Self { mean: self.mean + other.mean, along }
    }

    /// The line with its slopes turned down until it is negative nowhere in an element with these corners.
    fn not_negative(mut self, corners: &[Plane]) -> Self {
        for channel in 0..3 {
            self.mean.0[channel] = self.mean.0[channel].max(0.0);
            let [x, y] = self.along.map(|along| along.0[channel]);
            let drop = corners.iter().map(|at| -(x * at[0] + y * at[1])).fold(0.0, f64::max);
            if drop > self.mean.0[channel] {
                let turn = self.mean.0[channel] / drop;
                self.along.iter_mut().for_each(|along| along.0[channel] *= turn);
            }
        }
        self
    }
}

/// Places of an element that are measured.
pub const PLACES: usize = 16;

/// What arrives at each place, W/m2, measured twice and independently.
pub type Halves = [[[f32; 3]; 2]; PLACES];

/// A line through halves and how good it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fit {
    /// Through both halves.
    pub line: Line,
    /// What the light deviates from any line, squared, on average over the element; signed. (W/m2)2
    pub structure: f64,
    /// Standard error of that.
    pub structure_error: f64,
    /// What of the structure stands out from the noise: 0, or what smaller elements would resolve. (W/m2)2
    pub found: f64,
    /// What the line is off for want of rays, squared, on average. (W/m2)2
    pub noise: f64,
}

/// Places of an element, relative to its centroid; those that are not open take no part.
#[derive(Clone, Copy, Debug)]
pub struct Design {
    places: [Plane; PLACES],
    open: u16,
}

impl Design {
    /// Of these places; bit i of `open` says whether place i is.
    #[must_use]
    pub fn new(places: [Plane; PLACES], open: u16) -> Self {
        Self { places, open }
    }

    fn each(&self) -> impl Iterator<Item = usize> + '_ {
        (0..PLACES).filter(|i| self.open & (1 << i) != 0)
    }

    /// Fits a line to what was measured, for an element with these corners (relative to its centroid).
    ///
    /// Slopes no steeper than noise alone makes them are left out, others turned down by what noise is of them
    /// (James and Stein).
    #[must_use]
    pub fn fit(&self, halves: &Halves, corners: &[Plane]) -> Fit {
        let count = self.open.count_ones() as usize;
        if count == 0 {
            return Fit::default();
        }
        let n = count as f64;
        let value = |i: usize, half: usize| Rgb::from_f32(halves[i][half]);
        let middle = [0, 1].map(|k| self.each().map(|i| self.places[i][k]).sum::<f64>() / n);
        let offset = |i: usize| [0, 1].map(|k| self.places[i][k] - middle[k]);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for [x, y] in self.each().map(offset) {
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        }
        let determinant = xx * yy - xy * xy;
        let mut means = [Rgb::BLACK; 2];
        let mut slopes = [[Rgb::BLACK; 2]; 2];
        for half in 0..2 {
            means[half] = self.each().fold(Rgb::BLACK, |sum, i| sum + value(i, half)) * (1.0 / n);
            if count >= numbers::LEAST_OF_LINE && determinant > numbers::NOTHING * (xx * yy).max(f64::MIN_POSITIVE) {
                let (mut a, mut b) = (Rgb::BLACK, Rgb::BLACK);
                for i in self.each() {
                    let (d, [x, y]) = (value(i, half) - means[half], offset(i));
                    (a, b) = (a + d * x, b + d * y);
                }
                slopes[half] = [(a * yy - b * xy) * (1.0 / determinant), (b * xx - a * xy) * (1.0 / determinant)];
            }
        }
        // Mean product over the places of what two slopes bring.
        let product = |p: &[Rgb; 2], q: &[Rgb; 2]| {
            (xx * p[0].dot(q[0]) + xy * (p[0].dot(q[1]) + p[1].dot(q[0])) + yy * p[1].dot(q[1])) / n
        };
        let both = [0, 1].map(|k| (slopes[0][k] + slopes[1][k]) * 0.5);
        // What the halves differ by at a place is noise; slopes follow from twice as many numbers at n places.
        let apart = self.each().map(|i| (value(i, 0) - value(i, 1)).norm_squared()).sum::<f64>() / (2.0 * n);
        let (all, by_noise) = (product(&both, &both), apart / n);
        let share = if all > by_noise { 1.0 - by_noise / all } else { 0.0 };
        let predicted = |half: usize, i: usize, share: f64| {
            let [x, y] = offset(i);
            means[half] + (slopes[half][0] * x + slopes[half][1] * y) * share
        };
        let (mut products, mut squares) = (0.0, 0.0);
        for i in self.each() {
            // Whole slopes: chosen by the same numbers, the share would hide part of what lines leave.
            let [a, b] = [0, 1].map(|half| value(i, half) - predicted(half, i, 1.0));
            let z = a.dot(b);
            products += z;
            squares += z * z;
        }
        let freedom = (n - if all > 0.0 { 3.0 } else { 1.0 }).max(1.0);
        let turned_down = (1.0 - share).powi(2) * (all - by_noise).max(0.0);
        // The halves' means are one number: small by luck, they would keep a row from ever being looked at again.
        let of_mean = (means[0] - means[1]).norm_squared() / 4.0;
        let of_mean =
            (of_mean + numbers::NOISE_KNOWN * numbers::NOISE_OF_MEAN * by_noise) / (1.0 + numbers::NOISE_KNOWN);
        let noise = of_mean + share * share * by_noise;
        let (structure, structure_error) = (products / freedom + turned_down, squares.sqrt() / freedom);
        let (bend, bend_error) = self.bend(halves);
        let stands_out = |x: f64, error: f64| {
            let least = numbers::FOUND * error;
            if x > least { x - least * least / x } else { 0.0 }
        };
        // Places that differ from each other by more than the halves do are what is looked for.
        let by_chance = (n * (2.0 * structure.max(0.0) * apart + apart * apart)).sqrt() / freedom;
        let found = stands_out(structure, by_chance).max(stands_out(bend, bend_error));
        let along = both.map(|slope| slope * share);
        let mean = (means[0] + means[1]) * 0.5;
        let line = Line { mean, along }.about(middle.map(|m| -m)).not_negative(corners);
        Fit { line, structure, structure_error, found, noise }
    }

    /// What a parabola explains beyond any line, squared, on average, and the standard error of that: three numbers tell
    /// of smooth structure long before sixteen places do.
    fn bend(&self, halves: &Halves) -> (f64, f64) {
        const TERMS: usize = 6;
        let n = self.open.count_ones() as usize;
        if n <= TERMS + 2 {
            return (0.0, 0.0);
        }
        let scale = self.each().flat_map(|i| self.places[i]).fold(0.0, |most: f64, x| most.max(x.abs()));
        // Polynomials over the places, each made orthogonal to those before.
        let mut terms: Vec<[f64; PLACES]> = Vec::with_capacity(TERMS);
        for term in 0..TERMS {
            let mut values = [0.0; PLACES];
            for i in self.each() {
                let [x, y] = self.places[i].map(|x| x / scale);
                values[i] = [1.0, x, y, x * x, x * y, y * y][term];
            }
            let size = values.iter().map(|v| v * v).sum::<f64>().sqrt();
            for before in &terms {
                let along: f64 = values.iter().zip(before).map(|(v, b)| v * b).sum();
                values.iter_mut().zip(before).for_each(|(v, b)| *v -= along * b);
            }
            let left = values.iter().map(|v| v * v).sum::<f64>().sqrt();
            if left <= numbers::NOTHING_STORED * size.max(f64::MIN_POSITIVE) {
                return (0.0, 0.0);
            }
            values.iter_mut().for_each(|v| *v /= left);
            terms.push(values);
        }
        let coefficient = |half: usize, term: &[f64; PLACES]| {
            self.each().fold(Rgb::BLACK, |sum, i| sum + Rgb::from_f32(halves[i][half]) * term[i])
        };
        let (mut bend, mut rest) = (0.0, 0.0);
        for i in self.each() {
            rest += halves[i].iter().map(|half| Rgb::from_f32(*half).norm_squared()).sum::<f64>();
        }
        for (index, term) in terms.iter().enumerate() {
            let [a, b] = [0, 1].map(|half| coefficient(half, term));
            rest -= a.norm_squared() + b.norm_squared();
            if index >= 3 {
                bend += a.dot(b);
            }
        }
        let variance = rest.max(0.0) / (2 * (n - TERMS)) as f64;
        (bend / n as f64, 3f64.sqrt() * variance / n as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::sequence::{mix, unit};

    /// Uniform numbers in 0..1.
    struct Numbers(u64);

    impl Numbers {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            unit(mix(self.0))
        }

        /// About standard normal.
        fn normal(&mut self) -> f64 {
            (0..12).map(|_| self.next()).sum::<f64>() - 6.0
        }
    }

    const SQUARE: [Plane; 4] = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];

    /// Mean structure, noise and what is found, and the line's true mean squared error, over many fits.
    fn trial(field: impl Fn(Plane) -> f64, deviation: f64) -> (Fit, f64) {
        let mut numbers = Numbers(7);
        let (mut structure, mut noise, mut found, mut true_error) = (0.0, 0.0, 0.0, 0.0);
        const TRIALS: u32 = 4000;
        for _ in 0..TRIALS {
            let places: [Plane; PLACES] = std::array::from_fn(|i| {
                let cell = |k: usize, x: f64| (k as f64 + x) / 4.0 - 0.5;
                [cell(i % 4, numbers.next()), cell(i / 4, numbers.next())]
            });
            // The mean of numbers that are spread evenly has less noise than they would give it one by one.
            let evenly = 1.0 - (numbers::NOISE_OF_MEAN / 0.5).sqrt();
            let of_halves = [0, 1].map(|_| {
                let noise: [f64; PLACES] = std::array::from_fn(|_| deviation * numbers.normal());
                noise.map(|x| x - evenly * noise.iter().sum::<f64>() / PLACES as f64)
            });
            let halves: Halves =
                std::array::from_fn(|i| of_halves.map(|noise| [(field(places[i]) + noise[i]) as f32, 0.0, 0.0]));
            let fit = Design::new(places, u16::MAX).fit(&halves, &SQUARE);
            structure += fit.structure;
            noise += fit.noise;
            found += fit.found;
            for _ in 0..16 {
                let at = [numbers.next() - 0.5, numbers.next() - 0.5];
                true_error += (fit.line.at(at).0[0] - field(at)).powi(2) / 16.0;
            }
        }
        let n = f64::from(TRIALS);
        (Fit { structure: structure / n, noise: noise / n, found: found / n, ..Fit::default() }, true_error / n)
    }

    #[test]
    fn a_flat_field_with_noise_gives_the_noise() {
        let (Fit { structure, noise, found, .. }, true_error) = trial(|_| 10.0, 1.0);
        // Three standard errors of 4,000 trials.
        assert!(structure.abs() < 0.013, "structure {structure} beside noise {noise}");
        // Slopes that noise makes stay in where they are steep, and nobody can tell them from others: of a mean and two slopes
        // they are half of the error, of which a quarter is known.
        assert!((noise / true_error - 0.65).abs() < 0.05, "noise {noise}, error {true_error}");
        // Taken whole, what stands out by chance would be 2.2 times the noise.
        assert!(found < 1.2 * noise, "{} of the noise is found", found / noise);
    }

    #[test]
    fn a_step_gives_the_true_error_of_the_line() {
        // Where noise hides a slope, the line goes without it and nobody knows of that part.
        for (deviation, off) in [(0.0, 0.08), (1.0, 0.08), (3.0, 0.12)] {
            let (Fit { structure, noise, .. }, true_error) =
                trial(|[x, _]| if x > 0.1 { 20.0 } else { 15.0 }, deviation);
            let estimate = structure + noise;
            assert!((estimate / true_error - 1.0).abs() < off, "{structure} + {noise} for {true_error}");
        }
    }

    #[test]
    fn a_slope_is_found_and_goes_below_zero_nowhere() {
        let places = std::array::from_fn(|i| [(i % 4) as f64 / 4.0 - 0.375, (i / 4) as f64 / 4.0 - 0.375]);
        let steep: Halves = std::array::from_fn(|i| [[(10.0 + 8.0 * places[i][0]) as f32; 3]; 2]);
        let fit = Design::new(places, u16::MAX).fit(&steep, &SQUARE);
        assert!((fit.line.along[0].0[0] - 8.0).abs() < 1e-5 && fit.line.along[1].0[0].abs() < 1e-5, "{fit:?}");
        assert!(fit.structure.abs() < 1e-9 && fit.noise.abs() < 1e-9, "{fit:?}");
        let corner: Halves = std::array::from_fn(|i| [[if i == 0 { 16.0 } else { 0.0 }; 3]; 2]);
        let fit = Design::new(places, u16::MAX).fit(&corner, &SQUARE);
        assert!(SQUARE.iter().all(|at| fit.line.at(*at).0[0] >= -1e-12), "{fit:?}");
    }
}
