//! Eight boxes or four faces at once: the kernels of traversal, for AVX2 and for whatever there is.
//!
//! Both do the same operations in the same order on every number (no fused ones), so that the answer is the same to
//! the bit. The only unsafe code of this room: calls of functions that are compiled for AVX2.

use glam::DVec3;

use crate::model::rays::{RayNode, RayPatch};

/// A ray as boxes see it: f32, padded by more than that loses.
#[derive(Clone, Copy)]
pub(super) struct BoxRay {
    pub(super) from_m: [f32; 3],
    /// Of the direction.
    pub(super) inverse: [f32; 3],
    /// What boxes are grown by, in lengths of the ray.
    pub(super) padding: [f32; 3],
    /// Which of an axis' two planes the ray meets first.
    pub(super) first_plane: [usize; 3],
    /// Where the ray begins, in its lengths.
    pub(super) low: f32,
}

/// A ray as faces see it.
#[derive(Clone, Copy)]
pub(super) struct FaceRay {
    pub(super) from: DVec3,
    pub(super) along: DVec3,
}

/// Children of a node that a ray enters.
pub(super) struct Entered {
    /// A bit each.
    pub(super) slots: u32,
    /// Where, in lengths of the ray.
    pub(super) near: [f32; 8],
}

/// Which halves of a node a ray enters second half first: of pairs (bits 0, 2, 4, 6), of fours (bits 0 and 4), of all
/// eight (bit 0). Other bits mean nothing.
pub(super) struct Swaps {
    pub(super) pairs: u32,
    pub(super) fours: u32,
    pub(super) eight: u32,
}

/// Faces that [`Lanes::crossed`] looks at in one go.
pub(super) const AT_ONCE: usize = 4;

/// Kernels.
pub(super) trait Lanes: Copy {
    /// Children that the ray enters before `limit`, and, of more than one, in which order.
    fn entered(self, node: &RayNode, ray: &BoxRay, limit: f32) -> (Entered, Option<Swaps>);

    /// Which of up to four faces the ray's line crosses: bits 0 to 3 by their triangles 0 1 2, 4 to 7 by 0 2 3.
    fn crossed(self, faces: &[RayPatch], ray: &FaceRay) -> u32;
}

/// What casts rays, compiled for each kind of lanes.
pub(super) trait Cast {
    type Answer;
    fn cast<L: Lanes>(self, lanes: L) -> Self::Answer;
}

/// Casts with the widest lanes that there are.
#[inline]
pub(super) fn cast<C: Cast>(what: C) -> C::Answer {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        return unsafe { avx2::cast(what) };
    }
    what.cast(Plain)
}

/// Number by number.
#[derive(Clone, Copy)]
pub(super) struct Plain;

/// As `minps` has it.
#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// As `maxps` has it.
#[inline(always)]
fn greatest(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Which lanes lie behind those that lie `step` from them, where groups of as many begin where their first lane does.
fn behind(near: &mut [[f32; 8]; 3], low: f32, step: usize) -> u32 {
    let entry: [f32; 8] =
        std::array::from_fn(|i| greatest(greatest(greatest(near[0][i], near[1][i]), near[2][i]), low));
    for axis in near {
        let of = *axis;
        *axis = std::array::from_fn(|i| least(of[i], of[i ^ step]));
    }
    (0..8).fold(0, |bits, i| bits | u32::from(entry[i] > entry[i ^ step]) << i)
}

impl Lanes for Plain {
    #[inline(always)]
    fn entered(self, node: &RayNode, ray: &BoxRay, limit: f32) -> (Entered, Option<Swaps>) {
        let (mut by_axis, mut near, mut far) = ([[0.0; 8]; 3], [ray.low; 8], [limit; 8]);
        for axis in 0..3 {
            let first = ray.first_plane[axis] & 1;
            let planes = &node.planes_m[axis];
            for i in 0..8 {
                let at = |plane: usize| (planes[plane][i] - ray.from_m[axis]) * ray.inverse[axis];
                by_axis[axis][i] = at(first) - ray.padding[axis];
                near[i] = greatest(near[i], by_axis[axis][i]);
                far[i] = least(far[i], at(1 - first) + ray.padding[axis]);
            }
        }
        let slots = (0..8).fold(0, |bits, i| bits | u32::from(near[i] <= far[i]) << i);
        let several = slots & slots.wrapping_sub(1) != 0;
        let swaps = several.then(|| {
            let pairs = behind(&mut by_axis, ray.low, 1);
            let fours = behind(&mut by_axis, ray.low, 2);
            Swaps { pairs, fours, eight: behind(&mut by_axis, ray.low, 4) }
        });
        (Entered { slots, near }, swaps)
    }

    #[inline(always)]
    fn crossed(self, faces: &[RayPatch], ray: &FaceRay) -> u32 {
        let bits = |(i, face): (usize, &RayPatch)| ray.crosses(face) << i;
        faces.iter().take(AT_ONCE).enumerate().map(bits).fold(0, |all, face| all | face)
    }
}

impl FaceRay {
    /// A corner of a face, relative to the ray's start.
    #[inline(always)]
    pub(super) fn corner(&self, face: &RayPatch, corner: usize) -> DVec3 {
        DVec3::from_array(face.corners_m[corner].map(f64::from)) - self.from
    }

    /// Which of a face's triangles the ray's line crosses: bit 0 or bit 4.
    fn crosses(&self, face: &RayPatch) -> u32 {
        let side = |p: DVec3, q: DVec3| self.along.dot(p.cross(q));
        let inside = |u: f64, v: f64, w: f64| (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| self.corner(face, i));
        let diagonal = side(c, a);
        if inside(side(a, b), side(b, c), diagonal) {
            return 1;
        }
        // The mirrored order of the products gives exactly the negative.
        u32::from(face.corner_count == 4 && inside(-diagonal, side(c, d), side(d, a))) << 4
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod avx2 {
    use std::arch::x86_64::*;

    use super::{AT_ONCE, BoxRay, Cast, Entered, FaceRay, Lanes, RayNode, RayPatch, Swaps};

    /// Made by [`cast`] alone, which needs AVX2.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx2(());

    /// Compiles all that casts for AVX2.
    #[target_feature(enable = "avx2")]
    pub(in super::super) fn cast<C: Cast>(what: C) -> C::Answer {
        what.cast(Avx2(()))
    }

    impl Lanes for Avx2 {
        #[inline(always)]
        fn entered(self, node: &RayNode, ray: &BoxRay, limit: f32) -> (Entered, Option<Swaps>) {
            // SAFETY: there is an `Avx2` only where the processor has AVX2.
            unsafe { entered(node, ray, limit) }
        }

        #[inline(always)]
        fn crossed(self, faces: &[RayPatch], ray: &FaceRay) -> u32 {
            // SAFETY: as above.
            unsafe { crossed(faces, ray) }
        }
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn entered(node: &RayNode, ray: &BoxRay, limit: f32) -> (Entered, Option<Swaps>) {
        let (mut by_axis, mut near, mut far) =
            ([_mm256_setzero_ps(); 3], _mm256_set1_ps(ray.low), _mm256_set1_ps(limit));
        for axis in 0..3 {
            let first = ray.first_plane[axis] & 1;
            let (from, inverse) = (_mm256_set1_ps(ray.from_m[axis]), _mm256_set1_ps(ray.inverse[axis]));
            let padding = _mm256_set1_ps(ray.padding[axis]);
            let planes = &node.planes_m[axis];
            let (a, b): (__m256, __m256) = (bytemuck::cast(planes[first]), bytemuck::cast(planes[1 - first]));
            by_axis[axis] = _mm256_sub_ps(_mm256_mul_ps(_mm256_sub_ps(a, from), inverse), padding);
            near = _mm256_max_ps(near, by_axis[axis]);
            far = _mm256_min_ps(far, _mm256_add_ps(_mm256_mul_ps(_mm256_sub_ps(b, from), inverse), padding));
        }
        let slots = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32;
        let several = slots & slots.wrapping_sub(1) != 0;
        let entered = Entered { slots, near: bytemuck::cast(near) };
        (entered, if several { Some(swaps(by_axis, near, ray.low)) } else { None })
    }

    /// `near` is where each child begins; that of a group begins, on each axis, where its first child does.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn swaps(by_axis: [__m256; 3], near: __m256, low: f32) -> Swaps {
        let low = _mm256_set1_ps(low);
        let entry = |[x, y, z]: [__m256; 3]| _mm256_max_ps(_mm256_max_ps(_mm256_max_ps(x, y), z), low);
        let behind = |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(a, b)) as u32;
        let (one, two) = (|v| _mm256_permute_ps::<0b10_11_00_01>(v), |v| _mm256_permute_ps::<0b01_00_11_10>(v));
        let pairs = by_axis.map(|v| _mm256_min_ps(v, one(v)));
        let fours = pairs.map(|v| _mm256_min_ps(v, two(v)));
        let (of_pairs, of_fours) = (entry(pairs), entry(fours));
        Swaps {
            pairs: behind(near, one(near)),
            fours: behind(of_pairs, two(of_pairs)),
            eight: behind(of_fours, _mm256_permute2f128_ps::<1>(of_fours, of_fours)),
        }
    }

    /// Four faces' corners by coordinate, relative to the ray's start.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn corners(faces: &[RayPatch], ray: &FaceRay) -> [[__m256d; 3]; 4] {
        let from = [ray.from.x, ray.from.y, ray.from.z].map(|x| _mm256_set1_pd(x));
        let rows: [[__m128; 3]; AT_ONCE] = std::array::from_fn(|i| {
            bytemuck::cast::<[[f32; 3]; 4], [[f32; 4]; 3]>(faces[i.min(faces.len() - 1)].corners_m)
                .map(|row| bytemuck::cast(row))
        });
        // A corner and a third in each row of four numbers.
        let columns: [[__m128; 4]; 3] = std::array::from_fn(|k| {
            let [a, b, c, d] = rows.map(|row| row[k]);
            let (ab, cd) = (_mm_unpacklo_ps(a, b), _mm_unpacklo_ps(c, d));
            let (ab_high, cd_high) = (_mm_unpackhi_ps(a, b), _mm_unpackhi_ps(c, d));
            [
                _mm_movelh_ps(ab, cd),
                _mm_movehl_ps(cd, ab),
                _mm_movelh_ps(ab_high, cd_high),
                _mm_movehl_ps(cd_high, ab_high),
            ]
        });
        std::array::from_fn(|corner| {
            std::array::from_fn(|axis| {
                let at = 3 * corner + axis;
                _mm256_sub_pd(_mm256_cvtps_pd(columns[at / 4][at % 4]), from[axis])
            })
        })
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn crossed(faces: &[RayPatch], ray: &FaceRay) -> u32 {
        if faces.is_empty() {
            return 0;
        }
        let [a, b, c, d] = corners(faces, ray);
        let along = [ray.along.x, ray.along.y, ray.along.z].map(|x| _mm256_set1_pd(x));
        let minor =
            |p: __m256d, q: __m256d, r: __m256d, s: __m256d| _mm256_sub_pd(_mm256_mul_pd(p, q), _mm256_mul_pd(r, s));
        let side = |p: [__m256d; 3], q: [__m256d; 3]| {
            let (x, y, z) =
                (minor(p[1], q[2], q[1], p[2]), minor(p[2], q[0], q[2], p[0]), minor(p[0], q[1], q[0], p[1]));
            let xy = _mm256_add_pd(_mm256_mul_pd(along[0], x), _mm256_mul_pd(along[1], y));
            _mm256_add_pd(xy, _mm256_mul_pd(along[2], z))
        };
        let zero = _mm256_setzero_pd();
        let up = |v: __m256d| _mm256_cmp_pd::<_CMP_GE_OQ>(v, zero);
        let down = |v: __m256d| _mm256_cmp_pd::<_CMP_LE_OQ>(v, zero);
        let all = |u: __m256d, v: __m256d, w: __m256d| _mm256_and_pd(_mm256_and_pd(u, v), w);
        let bits = |v: __m256d, w: __m256d| _mm256_movemask_pd(_mm256_or_pd(v, w)) as u32;
        let (ab, bc, ca) = (side(a, b), side(b, c), side(c, a));
        let of_faces = (1 << faces.len().min(AT_ONCE)) - 1;
        let first = bits(all(up(ab), up(bc), up(ca)), all(down(ab), down(bc), down(ca))) & of_faces;
        let quads =
            faces.iter().take(AT_ONCE).enumerate().fold(0, |all, (i, f)| all | u32::from(f.corner_count == 4) << i);
        let rest = quads & !first;
        if rest == 0 {
            return first;
        }
        let (cd, da) = (side(c, d), side(d, a));
        // The mirrored order of the products gives exactly the negative.
        let second = bits(all(down(ca), up(cd), up(da)), all(up(ca), down(cd), down(da)));
        first | (second & rest) << 4
    }
}
