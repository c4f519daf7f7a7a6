//! Deterministic low-discrepancy points: a rank-1 (R2) sequence shifted by a seed, so that every
//! random number derives from `--seed` and from names.

use std::f64::consts::PI;

use glam::DVec3;

/// Mixes a word so that close inputs give unrelated outputs (the finaliser of splitmix64).
#[must_use]
pub fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A point as a seed.
#[must_use]
pub fn mix_point(p: DVec3) -> u64 {
    p.x.to_bits() ^ mix(p.y.to_bits() ^ mix(p.z.to_bits()))
}

/// A number in [0, 1) from the top 53 bits.
#[must_use]
pub fn unit(x: u64) -> f64 {
    (x >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// Points of the four-dimensional R sequence with a random shift (Cranley-Patterson).
#[derive(Clone, Copy, Debug)]
pub struct Sequence {
    shift: [u64; 4],
}

/// 2^64 / g^k for the root g of x^5 = x + 1, the generalised golden ratio of four dimensions.
const STEP: [u64; 4] = [0xdb4f_0b91_75ae_2165, 0xbbe0_5633_03a4_615f, 0xa0f2_ec75_a1fe_1575, 0x89e1_8285_7d9e_d688];

impl Sequence {
    /// The sequence of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut state = seed;
        Self {
            shift: std::array::from_fn(|_| {
                state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
                mix(state)
            }),
        }
    }

    /// Point `index`, each coordinate in [0, 1).
    #[must_use]
    pub fn point(&self, index: u64) -> [f64; 4] {
        std::array::from_fn(|d| unit(self.shift[d].wrapping_add(STEP[d].wrapping_mul(index + 1))))
    }
}

/// A unit direction about `normal`, cosine-distributed for u, v uniform in [0, 1).
#[must_use]
pub fn cosine_direction(normal: DVec3, u: f64, v: f64) -> DVec3 {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let (radius, angle) = (u.sqrt(), 2.0 * PI * v);
    tangent * (radius * libm::cos(angle)) + bitangent * (radius * libm::sin(angle)) + normal * (1.0 - u).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_steps_are_powers_of_the_generalised_golden_ratio() {
        let mut g = 1.5f64;
        for _ in 0..100 {
            g = (1.0 + g).powf(0.2);
        }
        for (k, step) in STEP.iter().enumerate() {
            let expected = g.powi(-(k as i32 + 1));
            assert!((unit(*step) - expected).abs() < 1e-12, "{k}: {} {expected}", unit(*step));
        }
    }

    #[test]
    fn points_fill_the_square_evenly() {
        let sequence = Sequence::new(42);
        let n = 4096;
        let inside = (0..n).filter(|i| {
            let [a, b, c, d] = sequence.point(*i);
            a * a + b * b < 1.0 && c + d < 1.0
        });
        let share = inside.count() as f64 / n as f64;
        assert!((share - std::f64::consts::PI / 8.0).abs() < 5e-3, "{share}");
    }
}
