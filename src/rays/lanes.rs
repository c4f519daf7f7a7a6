//! Eight boxes or the four edges of a face at once: the kernels of traversal, for AVX2 and for whatever there is.
//!
//! Both do the same operations in the same order on every number (no fused ones), so that the answer is the same to
//! the bit. The only unsafe code of this room: calls of functions that are compiled for AVX2.

use glam::DVec3;

use crate::model::rays::{RayNode, RayPatch};

/// A ray as boxes see it: f32, padded by more than that loses.
#[derive(Clone, Copy)]
pub(super) struct BoxRay {
    /// Of the direction.
    pub(super) inverse: [f32; 3],
    /// By axis, what is subtracted of a plane's coordinate over the direction: of the one that the ray meets first, and of
    /// the other.
    pub(super) begins: [[f32; 2]; 3],
    /// Which of an axis' two planes the ray meets first.
    pub(super) first_plane: [usize; 3],
    /// Where the ray begins, in its lengths.
    pub(super) low: f32,
}

/// A ray as faces see it, seen along itself: sheared so that it runs along one axis (Woop, Benthin, Wald 2013).
#[derive(Clone, Copy)]
pub(super) struct FaceRay {
    from: DVec3,
    /// The axis that it runs along most is the last.
    axes: [usize; 3],
    /// What is taken off the first two for each metre of the last.
    shear: [f64; 2],
    /// Of the direction along the last.
    inverse: f64,
}

impl FaceRay {
    pub(super) fn new(from: DVec3, along: DVec3) -> Self {
        let size = along.abs();
        let z = if size.x > size.y.max(size.z) { 0 } else { 1 + usize::from(size.z >= size.y) };
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        Self { from, axes: [x, y, z], shear: [along[x] / along[z], along[y] / along[z]], inverse: 1.0 / along[z] }
    }
}

/// Children of a node that a ray enters.
pub(super) struct Entered {
    /// A bit each.
    pub(super) slots: u32,
    /// Where, in lengths of the ray.
    pub(super) near: [f32; 8],
}

/// Kernels.
pub(super) trait Lanes: Copy {
    /// Children that the ray enters before `limit`.
    fn entered(self, node: &RayNode, ray: &BoxRay, limit: f32) -> Entered;

    /// Distance to a face where the ray's line crosses it.
    fn crosses(self, face: &RayPatch, ray: &FaceRay) -> Option<f64>;
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

impl Lanes for Plain {
    #[inline(always)]
    fn entered(self, node: &RayNode, ray: &BoxRay, limit: f32) -> Entered {
        let (mut near, mut far) = ([ray.low; 8], [limit; 8]);
        for axis in 0..3 {
            let first = ray.first_plane[axis] & 1;
            let planes = &node.planes_m[axis];
            for i in 0..8 {
                let at = |plane: usize, begins: f32| planes[plane][i] * ray.inverse[axis] - begins;
                near[i] = greatest(near[i], at(first, ray.begins[axis][0]));
                far[i] = least(far[i], at(1 - first, ray.begins[axis][1]));
            }
        }
        Entered { slots: (0..8).fold(0, |bits, i| bits | u32::from(near[i] <= far[i]) << i), near }
    }

    #[inline(always)]
    fn crosses(self, face: &RayPatch, ray: &FaceRay) -> Option<f64> {
        let off = |axis: usize| face.corners_m.map(|c| f64::from(c[ray.axes[axis]]) - ray.from[ray.axes[axis]]);
        let z = off(2);
        let sheared = |of: usize| {
            let across = off(of);
            std::array::from_fn(|i| across[i] - ray.shear[of] * z[i])
        };
        let (x, y): ([f64; 4], [f64; 4]) = (sheared(0), sheared(1));
        let side = |p: usize, q: usize| x[p] * y[q] - y[p] * x[q];
        let edges = [side(0, 1), side(1, 2), side(2, 3), side(3, 0)];
        ray.distance([x, y, z], edges, side(2, 0), face.corner_count)
    }
}

impl FaceRay {
    /// Distance along the ray to the triangle 0 1 2 or 0 2 3 that it passes through; of the four `corners` axis by axis.
    /// `edges`: twice the areas that the ray spans with each edge, 0 to 1 and so on; `diagonal`: with that from 2 to 0.
    #[inline(always)]
    fn distance(&self, corners: [[f64; 4]; 3], edges: [f64; 4], diagonal: f64, count: u32) -> Option<f64> {
        let inside = |u: f64, v: f64, w: f64| (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        let [ab, bc, cd, da] = edges;
        let [a, b, c, d] = corners[2];
        let (weights, along) = if inside(ab, bc, diagonal) {
            ([bc, diagonal, ab], [a, b, c])
        } else if count == 4 && inside(-diagonal, cd, da) {
            // The mirrored order of the products gives exactly the negative.
            ([cd, da, -diagonal], [a, c, d])
        } else {
            return None;
        };
        let whole = weights[0] + weights[1] + weights[2];
        let sum = weights[0] * along[0] + weights[1] * along[1] + weights[2] * along[2];
        // Areas of a face that the ray runs along are rounding.
        let [x, y, z] = corners.map(|axis| axis.into_iter().fold(0.0, |most: f64, c| most.max(c.abs())));
        (whole.abs() > 8.0 * f64::EPSILON * (x + y) * (x + y + z)).then(|| sum / whole * self.inverse)
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::{BoxRay, Cast, Entered, FaceRay, Lanes, RayNode, RayPatch};

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
        fn entered(self, node: &RayNode, ray: &BoxRay, limit: f32) -> Entered {
            // SAFETY: there is an `Avx2` only where the processor has AVX2.
            unsafe { entered(node, ray, limit) }
        }

        #[inline(always)]
        fn crosses(self, face: &RayPatch, ray: &FaceRay) -> Option<f64> {
            // SAFETY: as above.
            unsafe { crosses(face, ray) }
        }
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn entered(node: &RayNode, ray: &BoxRay, limit: f32) -> Entered {
        let (mut near, mut far) = (_mm256_set1_ps(ray.low), _mm256_set1_ps(limit));
        for axis in 0..3 {
            let first = ray.first_plane[axis] & 1;
            let planes = &node.planes_m[axis];
            let inverse = _mm256_set1_ps(ray.inverse[axis]);
            let at = |plane: usize, begins: f32| {
                let plane: __m256 = bytemuck::cast(planes[plane]);
                _mm256_sub_ps(_mm256_mul_ps(plane, inverse), _mm256_set1_ps(begins))
            };
            near = _mm256_max_ps(near, at(first, ray.begins[axis][0]));
            far = _mm256_min_ps(far, at(1 - first, ray.begins[axis][1]));
        }
        let slots = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32;
        Entered { slots, near: bytemuck::cast(near) }
    }

    /// The coordinates of four corners, axis by axis.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn by_axis(corners_m: &[[f32; 3]; 4]) -> [__m128; 3] {
        let [a, b, c]: [__m128; 3] = bytemuck::cast(*corners_m);
        // a: x0 y0 z0 x1, b: y1 z1 x2 y2, c: z2 x3 y3 z3.
        let (x2y2x3y3, y0z0y1z1) = (_mm_shuffle_ps::<0b10_01_11_10>(b, c), _mm_shuffle_ps::<0b01_00_10_01>(a, b));
        [
            _mm_shuffle_ps::<0b10_00_11_00>(a, x2y2x3y3),
            _mm_shuffle_ps::<0b11_01_10_00>(y0z0y1z1, x2y2x3y3),
            _mm_shuffle_ps::<0b11_00_11_01>(y0z0y1z1, c),
        ]
    }

    /// As [`super::Plain`] has it, operation by operation; corners in lanes.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn crosses(face: &RayPatch, ray: &FaceRay) -> Option<f64> {
        let by_axis = by_axis(&face.corners_m);
        let off = |axis: usize| {
            let axis = ray.axes[axis] % 3;
            _mm256_sub_pd(_mm256_cvtps_pd(by_axis[axis]), _mm256_set1_pd(ray.from[axis]))
        };
        let z = off(2);
        let sheared = |axis: usize| _mm256_sub_pd(off(axis), _mm256_mul_pd(_mm256_set1_pd(ray.shear[axis]), z));
        let (x, y) = (sheared(0), sheared(1));
        let side = |px, py, qx, qy| _mm256_sub_pd(_mm256_mul_pd(px, qy), _mm256_mul_pd(py, qx));
        let next = |v: __m256d| _mm256_permute4x64_pd::<0b00_11_10_01>(v);
        let across = |v: __m256d| _mm256_permute2f128_pd::<1>(v, v);
        let edges = side(x, y, next(x), next(y));
        let diagonal = _mm256_cvtsd_f64(side(across(x), across(y), x, y));
        ray.distance(bytemuck::cast([x, y, z]), bytemuck::cast(edges), diagonal, face.corner_count)
    }
}
