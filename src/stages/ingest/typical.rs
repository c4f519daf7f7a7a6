//! How wide a model's typical patch is.

use glam::DVec3;

use super::frame::{Frame, Survey};
use super::piece::Piece;
use super::record_file::RecordFile;
use super::whereabouts::Whereabouts;
use crate::base::Result;
use crate::geom::split::area_vector;

/// Which pieces lie far off: they say nothing of the model's size.
#[derive(Clone, Copy)]
pub struct Far {
    whereabouts: Option<Whereabouts>,
    frame: Frame,
}

impl Far {
    /// No piece does.
    #[cfg(test)]
    pub const NONE: Self = Self { whereabouts: None, frame: Frame { origin: DVec3::ZERO, metres_per_unit: 1.0 } };

    /// Of a survey's faces.
    #[must_use]
    pub fn of(survey: &Survey, frame: Frame) -> Self {
        Self { whereabouts: survey.whereabouts, frame }
    }

    /// Whether a stored polygon (m from the origin) is among them.
    #[must_use]
    pub fn holds(&self, corners: &[[f32; 3]]) -> bool {
        let in_model = |c: &[f32; 3]| self.frame.model_position(*c);
        self.whereabouts.is_some_and(|around| corners.iter().any(|c| around.is_far(&[in_model(c)])))
    }
}

/// Widths are told apart by a sixteenth of an octave.
const PER_OCTAVE: f64 = 16.0;
/// Octaves from the narrowest width told apart, 2^-24 m, to the widest.
const OCTAVES: usize = 64;
/// Times the median by area (half of all area is of patches that are narrower) that a patch's width may be to be
/// typical: what is wider are a few large floors, and light changes over them as it does elsewhere.
const WIDEST: f64 = 2.0;

/// Width of a typical patch, m: the root of the mean of patches' areas by area, or twice their median by area if that
/// is less. All in proportion to the model, so that a mistaken unit changes nothing.
pub fn width_m(pieces: &mut RecordFile<Piece>, far: Far) -> Result<f64> {
    let mut by_width = vec![0.0f64; OCTAVES * PER_OCTAVE as usize];
    let (mut sum, mut squares) = (0.0, 0.0);
    for i in 0..pieces.len() {
        let piece = pieces.get(i)?;
        let (points, n) = piece.points();
        if piece.gone == 1 || far.holds(&piece.corners_m[..n]) {
            continue;
        }
        let area = area_m2(&points[..n]);
        sum += area;
        squares += area * area;
        let bin = ((0.5 * area.log2() + 24.0) * PER_OCTAVE).clamp(0.0, by_width.len() as f64 - 1.0);
        by_width[bin as usize] += area;
    }
    if sum == 0.0 {
        return Ok(0.0);
    }
    let mut below = 0.0;
    let median = by_width.iter().position(|area| {
        below += area;
        2.0 * below >= sum
    });
    let median_m = ((median.unwrap_or(0) as f64 + 0.5) / PER_OCTAVE - 24.0).exp2();
    Ok((squares / sum).sqrt().min(WIDEST * median_m))
}

fn area_m2(points: &[DVec3]) -> f64 {
    0.5 * area_vector(points).length()
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    fn width(widths: &[(f32, usize)], unit: f32) -> f64 {
        let dir = tempfile::tempdir().unwrap();
        let mut pieces = RecordFile::create(dir.path(), "pieces", 0).unwrap();
        for &(width, count) in widths {
            let w = width * unit;
            for _ in 0..count {
                let mut piece = Piece { corner_count: 4, ..Piece::zeroed() };
                piece.corners_m = [[0.0; 3], [w, 0.0, 0.0], [w, w, 0.0], [0.0, w, 0.0]];
                pieces.push(piece).unwrap();
            }
        }
        width_m(&mut pieces, Far::NONE).unwrap()
    }

    #[test]
    fn the_mean_by_area_is_typical_unless_few_large_floors_make_it() {
        assert!((width(&[(2.0, 6)], 1.0) - 2.0).abs() < 1e-9);
        // A floor of 30 m among 400 walls of 2 m: 900 of 2,500 m2.
        let typical = width(&[(30.0, 1), (2.0, 400)], 1.0);
        assert!((typical - 4.0).abs() < 0.2, "{typical}");
        let in_millimetres = width(&[(30.0, 1), (2.0, 400)], 1000.0);
        assert!((in_millimetres / typical / 1000.0 - 1.0).abs() < 0.05, "{in_millimetres}");
    }
}
