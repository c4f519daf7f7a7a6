//! Deterministic points that fill space evenly: Sobol's sequence, scrambled by a seed, so that every random number derives
//! from `--seed` and from names.

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

/// Points of Sobol's sequence in four dimensions, scrambled as Owen has it: what lies in one part of a grid stays together
/// and goes to another part. Runs of 2^k points from a multiple of 2^k on have one in each part of every grid of that many,
/// in the first two dimensions; in the others nearly so.
#[derive(Clone, Copy, Debug)]
pub struct Sequence {
    seeds: [u32; 4],
}

/// Number `i` of a dimension is what bit `i` of a point's number turns round, the lowest bit the first after the point: by
/// primitive polynomials of degrees 0 to 3 and first numbers as of Joe and Kuo (2008).
const DIRECTIONS: [[u32; 4]; 32] = {
    /// Degree, inner coefficients, first numbers.
    const POLYNOMIALS: [(usize, u32, [u32; 3]); 4] =
        [(0, 0, [0; 3]), (1, 0, [1, 0, 0]), (2, 1, [1, 3, 0]), (3, 1, [1, 3, 1])];
    let mut directions = [[0; 4]; 32];
    let mut dimension = 0;
    while dimension < 4 {
        let (degree, inner, first) = POLYNOMIALS[dimension];
        let mut numbers = [0u32; 32];
        let mut i = 0;
        while i < 32 {
            numbers[i] = if degree == 0 {
                1 << (31 - i)
            } else if i < degree {
                first[i] << (31 - i)
            } else {
                let mut number = numbers[i - degree] ^ numbers[i - degree] >> degree;
                let mut k = 1;
                while k < degree {
                    number ^= (inner >> (degree - 1 - k) & 1) * numbers[i - k];
                    k += 1;
                }
                number
            };
            directions[i][dimension] = numbers[i].reverse_bits();
            i += 1;
        }
        dimension += 1;
    }
    directions
};

/// A hash whose every bit depends on itself and those below alone (Laine and Karras 2011, with Vegdahl's constants).
fn scrambled(mut bits: u32, seed: u32) -> u32 {
    bits ^= bits.wrapping_mul(0x3d20_adea);
    bits = bits.wrapping_add(seed);
    bits = bits.wrapping_mul(seed >> 16 | 1);
    bits ^= bits.wrapping_mul(0x0552_6c56);
    bits ^ bits.wrapping_mul(0x53a2_2864)
}

impl Sequence {
    /// The sequence of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut state = seed;
        Self {
            seeds: std::array::from_fn(|_| {
                state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
                mix(state) as u32
            }),
        }
    }

    /// Point `index`, below 2^32, each coordinate in [0, 1).
    #[must_use]
    pub fn point(&self, index: u64) -> [f64; 4] {
        let (mut left, mut bits) = (index as u32, [0; 4]);
        while left != 0 {
            let of_bit = &DIRECTIONS[left.trailing_zeros() as usize];
            bits = std::array::from_fn(|d| bits[d] ^ of_bit[d]);
            left &= left - 1;
        }
        std::array::from_fn(|d| {
            let number = scrambled(bits[d], self.seeds[d]).reverse_bits();
            (f64::from(number) + 0.5) * (1.0 / (1u64 << 32) as f64)
        })
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

    /// Cells of a grid of 2^a by 2^b that points lie in.
    fn cells(points: &[[f64; 4]], [d, e]: [usize; 2], [a, b]: [u32; 2]) -> usize {
        let at = |x: f64, levels: u32| (x * f64::from(1u32 << levels)) as u32;
        points.iter().map(|p| (at(p[d], a), at(p[e], b))).collect::<std::collections::BTreeSet<_>>().len()
    }

    #[test]
    fn runs_have_a_point_in_each_part_of_every_grid() {
        for seed in 0..20 {
            let sequence = Sequence::new(seed);
            for levels in 0..=8 {
                let count = 1u64 << levels;
                let run: Vec<_> = (seed * count..(seed + 1) * count).map(|i| sequence.point(i)).collect();
                for a in 0..=levels {
                    assert_eq!(cells(&run, [0, 1], [a, levels - a]), run.len(), "seed {seed}, 2^{a} of 2^{levels}");
                }
                for d in 0..4 {
                    assert_eq!(cells(&run, [d, d], [levels, 0]), run.len(), "dimension {d}");
                }
            }
        }
    }

    #[test]
    fn scrambling_is_even_whatever_the_point() {
        let means: [f64; 4] = (0..10_000).fold([0.0; 4], |sum, seed| {
            let point = Sequence::new(seed).point(3);
            std::array::from_fn(|d| sum[d] + point[d] / 1e4)
        });
        assert!(means.iter().all(|mean| (mean - 0.5).abs() < 0.015), "{means:?}");
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
