//! Pieces with the same corners: duplicates go, opposite pairs become one patch with two materials.
//!
//! Candidates meet in cells of space, sorted externally; only pieces whose centres meet in a cell are
//! looked at. The first piece stays; of the materials that face one way an emitting one wins, else
//! the first.

use std::path::Path;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::materials::Material;
use super::piece::{NONE, Piece};
use super::record_file::RecordFile;
use super::skipped::{Cause, Skipped};
use super::sorter::Sorter;
use crate::base::{Progress, Result};
use crate::geom::sequence::mix;

/// Cells are this many snap lengths wide.
const CELL: f64 = 32.0;
/// Corners coincide only within this share of a face's shortest edge, however large the snap.
const NEAR: f64 = 0.05;
/// Pieces of one cell that are compared with each other.
const CROWD: usize = 1 << 12;

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
struct InCell {
    cell: u64,
    piece: u64,
    /// Bits of the centre's coordinates, and of 0.
    centre: [u32; 4],
}

impl InCell {
    fn centre(&self) -> DVec3 {
        DVec3::from_array([0, 1, 2].map(|i| f64::from(f32::from_bits(self.centre[i]))))
    }
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
struct Match {
    first: u64,
    later: u64,
}

/// What a search works with.
pub struct Search<'a> {
    /// Scratch folder.
    pub dir: &'a Path,
    /// For sorting, bytes.
    pub memory_bytes: u64,
    /// Faces this near coincide, m.
    pub snap_m: f64,
    /// Materials by number.
    pub materials: &'a [Material],
}

impl Search<'_> {
    /// Resolves all coinciding pieces in place; duplicates are listed as skipped.
    pub fn run(&self, pieces: &mut RecordFile<Piece>, skipped: &mut Skipped, progress: &dyn Progress) -> Result<()> {
        progress.begin("compare", "patches", Some(pieces.len()));
        let mut cells = Sorter::new(self.dir, self.memory_bytes);
        for i in 0..pieces.len() {
            let piece = pieces.get(i)?;
            if piece.gone == 0 {
                let centre = centre(&piece);
                let [x, y, z] = centre.as_vec3().to_array().map(f32::to_bits);
                self.cells_of(centre, |cell| cells.push(InCell { cell, piece: i, centre: [x, y, z, 0] }))?;
            }
            if i % 65_536 == 0 {
                progress.go_on()?;
            }
        }
        let mut matches = Sorter::new(self.dir, self.memory_bytes / 4);
        let mut crowd: Vec<InCell> = Vec::new();
        let mut seen = 0;
        for entry in cells.finish()? {
            let entry = entry?;
            if crowd.first().is_some_and(|c| c.cell != entry.cell) || crowd.len() == CROWD {
                crowd.clear();
            }
            for other in &crowd {
                // Centres are rounded here: a little more than the snap length.
                let rounding = 1e-6 * entry.centre().abs().max_element();
                if other.centre().distance(entry.centre()) <= self.snap_m + rounding
                    && orientation(&pieces.get(other.piece)?, &pieces.get(entry.piece)?, self.snap_m).is_some()
                {
                    matches.push(Match { first: other.piece, later: entry.piece })?;
                    break;
                }
            }
            crowd.push(entry);
            seen += 1;
            if seen % 65_536 == 0 {
                progress.step(seen.min(pieces.len()))?;
            }
        }
        self.resolve(matches, pieces, skipped)
    }

    /// The cells that may hold the centres of pieces that coincide with one centred here.
    fn cells_of(&self, centre: DVec3, mut visit: impl FnMut(u64) -> Result<()>) -> Result<()> {
        let width = (CELL * self.snap_m).max(1e-6);
        let margin = self.snap_m.max(width * 1e-6);
        let low = ((centre - margin) / width).floor().as_i64vec3().to_array();
        let high = ((centre + margin) / width).floor().as_i64vec3().to_array();
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    visit(mix(mix(mix(x as u64) ^ y as u64) ^ z as u64))?;
                }
            }
        }
        Ok(())
    }

    fn resolve(&self, matches: Sorter<Match>, pieces: &mut RecordFile<Piece>, skipped: &mut Skipped) -> Result<()> {
        for found in matches.finish()? {
            let Match { first, later } = found?;
            let (mut kept, mut other) = (pieces.get(first)?, pieces.get(later)?);
            if kept.gone == 1 || other.gone == 1 {
                continue;
            }
            let Some(orientation) = orientation(&kept, &other, self.snap_m) else { continue };
            let same_winding = orientation == Orientation::Same;
            let [front, back] = if same_winding { other.material } else { [other.material[1], other.material[0]] };
            let duplicate = (kept.material[0] != NONE && front != NONE) || (kept.material[1] != NONE && back != NONE);
            kept.material = [self.winner(kept.material[0], front), self.winner(kept.material[1], back)];
            kept.add_sources(&other);
            other.gone = 1;
            pieces.set(first, kept)?;
            pieces.set(later, other)?;
            if duplicate {
                for source in &other.sources[..other.source_count as usize] {
                    skipped.add(Cause::Duplicate, *source, "face has the corners and winding of one before it")?;
                }
            }
        }
        Ok(())
    }

    fn winner(&self, first: u32, later: u32) -> u32 {
        let emits = |m: u32| m != NONE && self.materials[m as usize].emits();
        if first == NONE || (emits(later) && !emits(first)) { later } else { first }
    }
}

/// Mean of a piece's corners.
fn centre(piece: &Piece) -> DVec3 {
    let (points, n) = piece.points();
    points[..n].iter().fold(DVec3::ZERO, |a, b| a + *b) / n as f64
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Orientation {
    Same,
    Opposite,
}

/// Whether two pieces have the same corners, and how they wind.
fn orientation(a: &Piece, b: &Piece, snap_m: f64) -> Option<Orientation> {
    if a.corner_count != b.corner_count {
        return None;
    }
    let ((p, n), (q, _)) = (a.points(), b.points());
    let shortest = (0..n).map(|i| p[i].distance(p[(i + 1) % n])).fold(f64::INFINITY, f64::min);
    let near = snap_m.min(NEAR * shortest);
    let meet = |map: &dyn Fn(usize) -> usize| (0..n).all(|i| p[i].distance(q[map(i)]) <= near);
    for r in 0..n {
        if meet(&|i| (i + r) % n) {
            return Some(Orientation::Same);
        }
        if meet(&|i| (r + n - i) % n) {
            return Some(Orientation::Opposite);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{Quiet, Rgb};
    use crate::stages::ingest::piece::Source;

    fn square(material: u32, line: u32, turned: bool, shift: f32) -> Piece {
        let mut piece = Piece { corner_count: 4, source_count: 1, material: [material, NONE], ..Piece::zeroed() };
        piece.corners_m = [[0., 0., shift], [1., 0., shift], [1., 1., shift], [0., 1., shift]];
        if turned {
            piece.corners_m.reverse();
        }
        piece.corners_m.rotate_left(line as usize % 4);
        piece.sources[0] = Source { file: 0, line, face: line };
        piece
    }

    fn run(input: &[Piece]) -> (Vec<Piece>, u64) {
        let dir = tempfile::tempdir().unwrap();
        let dark = Material { rho: Rgb::grey(0.5), exitance: Rgb::BLACK };
        let lamp = Material { exitance: Rgb::grey(1.0), ..dark };
        let search = Search { dir: dir.path(), memory_bytes: 0, snap_m: 1e-3, materials: &[dark, dark, lamp] };
        let mut pieces = RecordFile::create(dir.path(), "pieces", 0).unwrap();
        let mut skipped = Skipped::create(dir.path()).unwrap();
        for piece in input {
            pieces.push(*piece).unwrap();
        }
        search.run(&mut pieces, &mut skipped, &Quiet).unwrap();
        let left = (0..pieces.len()).map(|i| pieces.get(i).unwrap()).filter(|p| p.gone == 0).collect();
        (left, skipped.counts().values().sum())
    }

    #[test]
    fn an_opposite_pair_is_one_patch_with_a_material_on_each_side() {
        let (left, skipped) = run(&[square(0, 1, false, 0.0), square(1, 2, true, 5e-4)]);
        assert_eq!((left.len(), skipped), (1, 0));
        assert_eq!(left[0].material, [0, 1]);
        assert_eq!(left[0].source_count, 2);
    }

    #[test]
    fn of_duplicates_the_first_stays_and_an_emitter_wins() {
        let (left, skipped) = run(&[square(0, 1, false, 0.0), square(1, 2, false, 0.0)]);
        assert_eq!((left.len(), skipped, left[0].material[0]), (1, 1, 0));
        let (left, skipped) = run(&[square(0, 1, false, 0.0), square(2, 2, false, 0.0), square(1, 3, true, 0.0)]);
        assert_eq!((left.len(), skipped, left[0].material), (1, 1, [2, 1]));
    }

    #[test]
    fn faces_farther_apart_than_the_snap_length_stay() {
        assert_eq!(run(&[square(0, 1, false, 0.0), square(0, 2, false, 0.002)]).0.len(), 2);
    }

    #[test]
    fn faces_smaller_than_the_snap_length_are_not_all_the_same() {
        let mut small = square(0, 1, false, 0.0);
        small.corners_m = small.corners_m.map(|c| c.map(|x| x * 1e-4));
        let mut beside = small;
        for corner in &mut beside.corners_m {
            corner[0] += 1e-4;
        }
        assert_eq!(run(&[small, beside]).0.len(), 2);
    }
}
