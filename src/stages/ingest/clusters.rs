//! Clusters: the faces of each OBJ object, split in space where too many or too far apart.
//!
//! Objects come one after the other from an external sort; within an object faces come along a Morton curve, so that an
//! object larger than memory is split block by block. The parts of a face stay in one cluster, unless they are more than
//! one holds.

use std::path::Path;

use bytemuck::{Pod, Zeroable};

use super::contact::Cuts;
use super::piece::Piece;
use super::pieces::{bounds, bounds_of_all};
use super::record_file::RecordFile;
use super::sorter::Sorter;
use crate::base::Result;
use crate::geom::bounds::Bounds;
use crate::geom::grouping::compact_parts;
use crate::geom::morton::morton;

/// Faces that are split in memory at once.
const BLOCK: usize = 1 << 16;

/// Patches of a cluster at most.
pub const MOST_PATCHES: u32 = 256;

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
struct Placed {
    object: u64,
    morton: u64,
    face: u64,
}

/// The parts of faces that make a cluster.
pub struct Members<'a> {
    /// Rows of its faces, ascending, each with all its parts; or the one of which it holds some.
    pub faces: &'a [u64],
    /// Of one that is spread over several clusters: the parts that this one holds, ascending, and how many clusters
    /// follow with others.
    pub some: Option<(&'a [u32], usize)>,
}

/// Faces, and what they fell into.
pub struct Faces<'a> {
    /// Before they were cut.
    pub whole: &'a mut RecordFile<Piece>,
    /// Their parts.
    pub cuts: &'a mut Cuts,
}

/// Visits the clusters in order. `most`: faces of a cluster at most.
pub fn for_each_cluster(
    faces: &mut Faces<'_>,
    most: usize,
    scratch: (&Path, u64),
    mut visit: impl FnMut(&mut Faces<'_>, &Members<'_>) -> Result<()>,
) -> Result<()> {
    let whole = bounds_of_all(faces.whole)?;
    let mut placed = Sorter::new(scratch.0, scratch.1);
    for i in 0..faces.whole.len() {
        let face = faces.whole.get(i)?;
        if face.gone == 0 {
            let morton = morton(bounds(&face).centre(), whole);
            placed.push(Placed { object: u64::from(face.object), morton, face: i })?;
        }
    }
    let mut block: Vec<Placed> = Vec::new();
    for next in placed.finish()? {
        let next = next?;
        if block.first().is_some_and(|b| b.object != next.object) {
            split_block(faces, &block, most, &mut visit)?;
            block.clear();
        } else if block.len() == BLOCK {
            let rest = block.split_off(best_break(&block));
            split_block(faces, &block, most, &mut visit)?;
            block = rest;
        }
        block.push(next);
    }
    if !block.is_empty() {
        split_block(faces, &block, most, &mut visit)?;
    }
    Ok(())
}

/// Where in the later half of a block the curve makes its widest jump.
fn best_break(block: &[Placed]) -> usize {
    let jump = |i: usize| (block[i - 1].morton ^ block[i].morton).leading_zeros();
    (block.len() / 2..block.len()).min_by_key(|i| jump(*i)).unwrap_or(block.len() / 2)
}

fn split_block(
    faces: &mut Faces<'_>,
    block: &[Placed],
    most: usize,
    visit: &mut impl FnMut(&mut Faces<'_>, &Members<'_>) -> Result<()>,
) -> Result<()> {
    let mut rows: Vec<u64> = block.iter().map(|p| p.face).collect();
    rows.sort_unstable();
    let (mut held, mut boxes, mut weights, mut large) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for row in rows {
        let parts = faces.cuts.faces.get(row)?.parts;
        if parts > MOST_PATCHES {
            large.push(row);
            continue;
        }
        held.push(row);
        boxes.push(bounds(&faces.whole.get(row)?));
        weights.push(parts);
    }
    if !held.is_empty() {
        for items in compact_parts(&boxes, &weights, most, MOST_PATCHES) {
            let of: Vec<u64> = items.iter().map(|i| held[*i as usize]).collect();
            visit(faces, &Members { faces: &of, some: None })?;
        }
    }
    large.into_iter().try_for_each(|row| spread(faces, row, visit))
}

/// Spreads the parts of a face over several clusters. Holds a box for each part of a block, a number for each of all.
fn spread(
    faces: &mut Faces<'_>,
    row: u64,
    visit: &mut impl FnMut(&mut Faces<'_>, &Members<'_>) -> Result<()>,
) -> Result<()> {
    let own = faces.cuts.faces.get(row)?;
    let mut clusters: Vec<Vec<u32>> = Vec::new();
    // Parts that follow each other lie near each other: they come out of one tree.
    for first in (0..own.parts).step_by(BLOCK) {
        let block = first..own.parts.min(first + BLOCK as u32);
        let boxes: Vec<Bounds> = (block.clone())
            .map(|part| Ok(faces.cuts.parts.get(own.first_part + u64::from(part))?.bounds()))
            .collect::<Result<_>>()?;
        let full = MOST_PATCHES as usize;
        for items in compact_parts(&boxes, &vec![1; boxes.len()], full, MOST_PATCHES) {
            clusters.push(items.into_iter().map(|i| first + i).collect());
        }
    }
    let last = clusters.len() - 1;
    for (i, parts) in clusters.iter().enumerate() {
        visit(faces, &Members { faces: &[row], some: Some((parts, last - i)) })?;
    }
    Ok(())
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
        let mut cuts = Cuts::none(pieces, dir).unwrap();
        for_each_cluster(&mut Faces { whole: pieces, cuts: &mut cuts }, 64, (dir, 1 << 20), |_, members| {
            all.push(members.faces.to_vec());
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
