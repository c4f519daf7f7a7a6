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

/// Faces that a ray's line crosses.
pub(super) struct Crossed {
    /// A bit each.
    pub(super) faces: u32,
    /// Where, in lengths of the ray.
    pub(super) at: [f64; AT_ONCE],
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

    /// Which of up to four faces the ray's line crosses.
    fn crossed(self, faces: &[RayPatch], ray: &FaceRay) -> Crossed;
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
        for (axis, entry) in by_axis.iter_mut().enumerate() {
            let first = ray.first_plane[axis] & 1;
            let planes = &node.planes_m[axis];
            for i in 0..8 {
                let at = |plane: usize| (planes[plane][i] - ray.from_m[axis]) * ray.inverse[axis];
                entry[i] = at(first) - ray.padding[axis];
                near[i] = greatest(near[i], entry[i]);
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
    fn crossed(self, faces: &[RayPatch], ray: &FaceRay) -> Crossed {
        let mut crossed = Crossed { faces: 0, at: [0.0; AT_ONCE] };
        for (i, face) in faces.iter().take(AT_ONCE).enumerate() {
            if let Some(t) = ray.crosses(face) {
                crossed.faces |= 1 << i;
                crossed.at[i] = t;
            }
        }
        crossed
    }
}

impl FaceRay {
    /// Distance to a face where the ray's line crosses it: corners are taken relative to the ray's start.
    fn crosses(&self, face: &RayPatch) -> Option<f64> {
        let corner = |i: usize| DVec3::from_array(face.corners_m[i].map(f64::from)) - self.from;
        let side = |p: DVec3, q: DVec3| self.along.dot(p.cross(q));
        let inside = |u: f64, v: f64, w: f64| (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        let (a, b, c) = (corner(0), corner(1), corner(2));
        let diagonal = side(c, a);
        if inside(side(a, b), side(b, c), diagonal) {
            return self.distance(a, b, c);
        }
        if face.corner_count < 4 {
            return None;
        }
        let d = corner(3);
        // The mirrored order of the products gives exactly the negative.
        if inside(-diagonal, side(c, d), side(d, a)) { self.distance(a, c, d) } else { None }
    }

    /// Distance to the plane of a triangle.
    fn distance(&self, a: DVec3, b: DVec3, c: DVec3) -> Option<f64> {
        let normal = (b - a).cross(c - a);
        let speed = normal.dot(self.along);
        (speed != 0.0).then(|| normal.dot(a) / speed)
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::{AT_ONCE, BoxRay, Cast, Crossed, DVec3, Entered, FaceRay, Lanes, RayNode, RayPatch, Swaps};

    /// Made by [`cast`] alone, which needs AVX2.
    #[derive(Clone, Copy)]
    pub(super) struct Avx2(());

    /// Compiles all that casts for AVX2.
    #[target_feature(enable = "avx2")]
    pub(super) fn cast<C: Cast>(what: C) -> C::Answer {
        what.cast(Avx2(()))
    }

    impl Lanes for Avx2 {
        #[inline(always)]
        fn entered(self, node: &RayNode, ray: &BoxRay, limit: f32) -> (Entered, Option<Swaps>) {
            // SAFETY: there is an `Avx2` only where the processor has AVX2.
            unsafe { entered(node, ray, limit) }
        }

        #[inline(always)]
        fn crossed(self, faces: &[RayPatch], ray: &FaceRay) -> Crossed {
            // SAFETY: as above.
            unsafe { crossed(faces, ray) }
        }
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn entered(node: &RayNode, ray: &BoxRay, limit: f32) -> (Entered, Option<Swaps>) {
        let (mut by_axis, mut near, mut far) =
            ([_mm256_setzero_ps(); 3], _mm256_set1_ps(ray.low), _mm256_set1_ps(limit));
        for (axis, entry) in by_axis.iter_mut().enumerate() {
            let first = ray.first_plane[axis] & 1;
            let (from, inverse) = (_mm256_set1_ps(ray.from_m[axis]), _mm256_set1_ps(ray.inverse[axis]));
            let padding = _mm256_set1_ps(ray.padding[axis]);
            let planes = &node.planes_m[axis];
            let (a, b): (__m256, __m256) = (bytemuck::cast(planes[first]), bytemuck::cast(planes[1 - first]));
            *entry = _mm256_sub_ps(_mm256_mul_ps(_mm256_sub_ps(a, from), inverse), padding);
            near = _mm256_max_ps(near, *entry);
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
        let (mut pairs, mut fours) = (by_axis, by_axis);
        for axis in 0..3 {
            pairs[axis] = _mm256_min_ps(by_axis[axis], one(by_axis[axis]));
            fours[axis] = _mm256_min_ps(pairs[axis], two(pairs[axis]));
        }
        let (of_pairs, of_fours) = (entry(pairs), entry(fours));
        Swaps {
            pairs: behind(near, one(near)),
            fours: behind(of_pairs, two(of_pairs)),
            eight: behind(of_fours, _mm256_permute2f128_ps::<1>(of_fours, of_fours)),
        }
    }

    /// The same four numbers of each of four faces, by number.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn columns(faces: [&[[f32; 4]; 3]; AT_ONCE], row: usize) -> [__m128; 4] {
        let of = |face: usize| bytemuck::cast::<[f32; 4], __m128>(faces[face][row]);
        let (a, b, c, d) = (of(0), of(1), of(2), of(3));
        let (ab, cd) = (_mm_unpacklo_ps(a, b), _mm_unpacklo_ps(c, d));
        let (ab_high, cd_high) = (_mm_unpackhi_ps(a, b), _mm_unpackhi_ps(c, d));
        let low = [_mm_movelh_ps(ab, cd), _mm_movehl_ps(cd, ab)];
        [low[0], low[1], _mm_movelh_ps(ab_high, cd_high), _mm_movehl_ps(cd_high, ab_high)]
    }

    /// Four faces' corners by coordinate, relative to the ray's start.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn corners(faces: &[RayPatch], ray: &FaceRay) -> [[__m256d; 3]; 4] {
        let rows = |i: usize| bytemuck::cast_ref(&faces[i.min(faces.len() - 1)].corners_m);
        let rows = [rows(0), rows(1), rows(2), rows(3)];
        let from = vector(ray.from);
        let mut corners = [[_mm256_setzero_pd(); 3]; 4];
        for row in 0..3 {
            let columns = columns(rows, row);
            for (column, numbers) in columns.into_iter().enumerate() {
                let at = 4 * row + column;
                corners[at / 3][at % 3] = _mm256_sub_pd(_mm256_cvtps_pd(numbers), from[at % 3]);
            }
        }
        corners
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn vector(of: DVec3) -> [__m256d; 3] {
        [_mm256_set1_pd(of.x), _mm256_set1_pd(of.y), _mm256_set1_pd(of.z)]
    }

    /// As glam has it.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn cross(p: [__m256d; 3], q: [__m256d; 3]) -> [__m256d; 3] {
        [
            _mm256_sub_pd(_mm256_mul_pd(p[1], q[2]), _mm256_mul_pd(q[1], p[2])),
            _mm256_sub_pd(_mm256_mul_pd(p[2], q[0]), _mm256_mul_pd(q[2], p[0])),
            _mm256_sub_pd(_mm256_mul_pd(p[0], q[1]), _mm256_mul_pd(q[0], p[1])),
        ]
    }

    /// As glam has it.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn dot(p: [__m256d; 3], q: [__m256d; 3]) -> __m256d {
        let xy = _mm256_add_pd(_mm256_mul_pd(p[0], q[0]), _mm256_mul_pd(p[1], q[1]));
        _mm256_add_pd(xy, _mm256_mul_pd(p[2], q[2]))
    }

    /// Lanes of `q` where those of `mask` are set, else of `p`.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn blended(p: [__m256d; 3], q: [__m256d; 3], mask: __m256d) -> [__m256d; 3] {
        [_mm256_blendv_pd(p[0], q[0], mask), _mm256_blendv_pd(p[1], q[1], mask), _mm256_blendv_pd(p[2], q[2], mask)]
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn difference(p: [__m256d; 3], q: [__m256d; 3]) -> [__m256d; 3] {
        [_mm256_sub_pd(p[0], q[0]), _mm256_sub_pd(p[1], q[1]), _mm256_sub_pd(p[2], q[2])]
    }

    /// Lanes in which three products are not of opposite signs.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn inside(u: __m256d, v: __m256d, w: __m256d) -> __m256d {
        let zero = _mm256_setzero_pd();
        let up = |v: __m256d| _mm256_cmp_pd::<_CMP_GE_OQ>(v, zero);
        let down = |v: __m256d| _mm256_cmp_pd::<_CMP_LE_OQ>(v, zero);
        let all_up = _mm256_and_pd(_mm256_and_pd(up(u), up(v)), up(w));
        let all_down = _mm256_and_pd(_mm256_and_pd(down(u), down(v)), down(w));
        _mm256_or_pd(all_up, all_down)
    }

    /// As [`FaceRay::crosses`], operation by operation.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn crossed(faces: &[RayPatch], ray: &FaceRay) -> Crossed {
        let mut crossed = Crossed { faces: 0, at: [0.0; AT_ONCE] };
        if faces.is_empty() {
            return crossed;
        }
        let [a, b, c, d] = corners(faces, ray);
        let along = vector(ray.along);
        let side = |p, q| dot(along, cross(p, q));
        let ca = side(c, a);
        let first = inside(side(a, b), side(b, c), ca);
        // The mirrored order of the products gives exactly the negative.
        let ac = _mm256_xor_pd(ca, _mm256_set1_pd(-0.0));
        let second = inside(ac, side(c, d), side(d, a));
        let (mut all, mut quads) = (0, 0);
        for (i, face) in faces.iter().take(AT_ONCE).enumerate() {
            all |= 1 << i;
            quads |= u32::from(face.corner_count == 4) << i;
        }
        let bits = |mask| _mm256_movemask_pd(mask) as u32;
        let of_either = bits(first) & all | bits(second) & quads;
        if of_either != 0 {
            let (q, r) = (blended(c, b, first), blended(d, c, first));
            let normal = cross(difference(q, a), difference(r, a));
            let speed = dot(normal, along);
            let moves = _mm256_cmp_pd::<_CMP_NEQ_UQ>(speed, _mm256_setzero_pd());
            crossed.faces = of_either & bits(moves);
            crossed.at = bytemuck::cast(_mm256_div_pd(dot(normal, a), speed));
        }
        crossed
    }
}
