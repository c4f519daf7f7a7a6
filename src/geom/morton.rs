//! Order of points along a Morton curve: neighbours in it are neighbours in space.

use glam::DVec3;

use super::bounds::Bounds;

/// Where a point of a box lies on the curve: 21 bits per axis, interleaved.
#[must_use]
pub fn morton(at: DVec3, whole: Bounds) -> u64 {
    let size = whole.size().max_element().max(f64::MIN_POSITIVE);
    let cell = ((at - whole.min) / size * 2_097_151.0).clamp(DVec3::ZERO, DVec3::splat(2_097_151.0));
    spread(cell.x as u64) | spread(cell.y as u64) << 1 | spread(cell.z as u64) << 2
}

/// 21 bits, two zeros behind each.
fn spread(bits: u64) -> u64 {
    let step = |x: u64, shift: u32, mask: u64| (x | x << shift) & mask;
    let x = step(bits & 0x1f_ffff, 32, 0x1f_0000_0000_ffff);
    let x = step(x, 16, 0x1f_0000_ff00_00ff);
    let x = step(x, 8, 0x100f_00f0_0f00_f00f);
    let x = step(x, 4, 0x10c3_0c30_c30c_30c3);
    step(x, 2, 0x1249_2492_4924_9249)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_of_the_axes_alternate() {
        for bits in [0u64, 1, 2, 0x1f_ffff, 0x15_5555, 0x0a_bcde] {
            let slowly = (0..21).fold(0, |all, i| all | (bits >> i & 1) << (3 * i));
            assert_eq!(spread(bits), slowly, "{bits:x}");
        }
        let cube = Bounds::of(&[DVec3::ZERO, DVec3::splat(2_097_151.0)]);
        assert_eq!(morton(DVec3::new(1.0, 0.0, 3.0), cube), 0b100_101);
    }
}
