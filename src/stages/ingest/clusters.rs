//! Clusters: the pieces of each OBJ object, split in space where too many or too far apart.
//!
//! Objects come one after the other from an external sort; within an object pieces come along a
//! Morton curve, so that an object larger than memory is split block by block.

use std::path::Path;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::piece::Piece;
use super::pieces::bounds;
use super::record_file::RecordFile;
use super::sorter::Sorter;
use crate::base::Result;
use crate::geom::bounds::Bounds;
use crate::geom::grouping::compact_parts;

/// Pieces that are split in memory at once.
const BLOCK: usize = 1 << 16;

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
struct Placed {
    object: u64,
    morton: u64,
    piece: u64,
}

/// Visits the clusters in order: the rows of their pieces, ascending.
pub fn for_each_cluster(
    pieces: &mut RecordFile<Piece>,
    most: usize,
    scratch: (&Path, u64),
    mut visit: impl FnMut(&mut RecordFile<Piece>, &[u64]) -> Result<()>,
) -> Result<()> {
    let mut whole = Bounds::EMPTY;
    for i in 0..pieces.len() {
        let piece = pieces.get(i)?;
        if piece.gone == 0 {
            whole = whole.union(bounds(&piece));
        }
    }
    let mut placed = Sorter::new(scratch.0, scratch.1);
    for i in 0..pieces.len() {
        let piece = pieces.get(i)?;
        if piece.gone == 0 {
            let morton = morton(bounds(&piece).centre(), whole);
            placed.push(Placed { object: u64::from(piece.object), morton, piece: i })?;
        }
    }
    let mut block: Vec<Placed> = Vec::new();
    for next in placed.finish()? {
        let next = next?;
        if block.first().is_some_and(|b| b.object != next.object) {
            split_block(pieces, &block, most, &mut visit)?;
            block.clear();
        } else if block.len() == BLOCK {
            let rest = block.split_off(best_break(&block));
            split_block(pieces, &block, most, &mut visit)?;
            block = rest;
        }
        block.push(next);
    }
    if !block.is_empty() {
        split_block(pieces, &block, most, &mut visit)?;
    }
    Ok(())
}

/// Where in the later half of a block the curve makes its widest jump.
fn best_break(block: &[Placed]) -> usize {
    let jump = |i: usize| (block[i - 1].morton ^ block[i].morton).leading_zeros();
    (block.len() / 2..block.len()).min_by_key(|i| jump(*i)).unwrap_or(block.len() / 2)
}

fn split_block(
    pieces: &mut RecordFile<Piece>,
    block: &[Placed],
    most: usize,
    visit: &mut impl FnMut(&mut RecordFile<Piece>, &[u64]) -> Result<()>,
) -> Result<()> {
    let mut rows: Vec<u64> = block.iter().map(|p| p.piece).collect();
    rows.sort_unstable();
    let mut boxes = Vec::with_capacity(rows.len());
    for row in &rows {
        boxes.push(bounds(&pieces.get(*row)?));
    }
    for part in compact_parts(&boxes, most) {
        let of: Vec<u64> = part.iter().map(|i| rows[*i as usize]).collect();
        visit(pieces, &of)?;
    }
    Ok(())
}

/// 21 bits per axis, interleaved.
fn morton(at: DVec3, whole: Bounds) -> u64 {
    let size = whole.size().max_element().max(f64::MIN_POSITIVE);
    let cell = ((at - whole.min) / size * 2_097_151.0).clamp(DVec3::ZERO, DVec3::splat(2_097_151.0));
    let spread = |x: f64| {
        let x = x as u64;
        (0..21).fold(0, |bits, i| bits | (x >> i & 1) << (3 * i))
    };
    spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(n: usize, object: impl Fn(usize) -> u32) -> (tempfile::TempDir, RecordFile<Piece>) {
        let dir = tempfile::tempdir().unwrap();
        let mut pieces = RecordFile::create(dir.path(), "pieces", 1 << 20).unwrap();
        for i in 0..n * n {
            let (x, y) = ((i % n) as f32, (i / n) as f32);
            let mut piece = Piece { corner_count: 4, object: object(i), ..Piece::zeroed() };
            piece.corners_m = [[x, y, 0.], [x + 1., y, 0.], [x + 1., y + 1., 0.], [x, y + 1., 0.]];
            pieces.push(piece).unwrap();
        }
        (dir, pieces)
    }

    fn clusters(pieces: &mut RecordFile<Piece>, dir: &Path) -> Vec<Vec<u64>> {
        let mut all = Vec::new();
        for_each_cluster(pieces, 64, (dir, 1 << 20), |_, rows| {
            all.push(rows.to_vec());
            Ok(())
        })
        .unwrap();
        all
    }

    #[test]
    fn every_piece_is_in_one_cluster_of_its_object_and_none_is_too_large() {
        let (dir, mut pieces) = grid(40, |i| (i % 3) as u32);
        let all = clusters(&mut pieces, dir.path());
        let mut rows: Vec<u64> = all.iter().flatten().copied().collect();
        rows.sort_unstable();
        assert_eq!(rows, (0..1600).collect::<Vec<_>>());
        for of in &all {
            assert!(of.len() <= 64 && of.iter().all(|r| r % 3 == of[0] % 3), "{of:?}");
        }
    }

    #[test]
    fn an_object_of_several_blocks_falls_into_compact_clusters() {
        let (dir, mut pieces) = grid(400, |_| 0);
        let all = clusters(&mut pieces, dir.path());
        assert_eq!(all.iter().map(Vec::len).sum::<usize>(), 160_000);
        assert!(all.len() < 3200, "{} clusters for 2500 full ones", all.len());
        let mut perimeter = 0.0;
        for of in &all {
            let mut b = Bounds::EMPTY;
            for row in of {
                b = b.union(bounds(&pieces.get(*row).unwrap()));
            }
            perimeter += b.size().x + b.size().y;
        }
        let mean = perimeter / all.len() as f64;
        assert!(mean < 20.0, "a square of 64 has 16, these have {mean}");
    }
}
