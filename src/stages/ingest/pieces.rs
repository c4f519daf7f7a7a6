//! Second pass: faces into pieces, each a triangle or a convex planar quad.

use std::path::PathBuf;

use bytemuck::Zeroable;
use glam::DVec3;

use super::frame::{Frame, position};
use super::piece::{FaceCorner, NONE, Piece, Source};
use super::read::{Face, Spilled};
use super::record_file::RecordFile;
use super::skipped::Cause;
use super::typical::Far;
use super::whereabouts::Whereabouts;
use crate::base::text::shown;
use crate::base::{Error, Progress, Result};
use crate::geom::bounds::Bounds;
use crate::geom::split::{area_vector, split, turns};

/// Bend of a quad that still counts as planar, relative to its longest and to its shortest edge.
const PLANAR: f64 = 1e-4;
const PLANAR_ACROSS: f64 = 0.01;
/// Height of a sliver, relative to its longest edge, that counts as no area.
const THIN: f64 = 1e-6;
/// Four times the rounding of stored coordinates, relative to the largest.
const ROUNDING: f64 = 4.0 / (1 << 24) as f64;
/// Corners of a face at most: ear clipping takes up to two seconds there.
const MOST_CORNERS: usize = 16_384;
/// Of one that crosses itself: half a second there, with the cube of their number.
const MOST_CROSSING: usize = 1_024;
/// Patches with a longer edge are split, m: 1 cm at the greatest depth.
const LONGEST_EDGE_M: f64 = 160.0;
/// Widths of a typical patch up to which edges may be longer than that: a thousandth of one at the greatest depth.
const LONGEST_EDGE: f64 = 16.0;
/// Most patches that one face is split into: a square of 80 km.
const MOST_PIECES: f64 = 1e6;

/// How far from its mean plane a polygon's corners may lie, m.
#[must_use]
pub fn planar_tolerance(points: &[DVec3], snap_m: f64) -> f64 {
    let shortest = edges(points).fold(f64::INFINITY, f64::min);
    (0.5 * snap_m).max((PLANAR * longest_edge(points)).min(PLANAR_ACROSS * shortest))
}

fn edges(points: &[DVec3]) -> impl Iterator<Item = f64> {
    (0..points.len()).map(|i| points[i].distance(points[(i + 1) % points.len()]))
}

fn longest_edge(points: &[DVec3]) -> f64 {
    edges(points).fold(0.0, f64::max)
}

/// Whether a polygon has no area to speak of.
#[must_use]
pub fn is_needle(points: &[DVec3]) -> bool {
    area_vector(points).length() <= THIN * longest_edge(points).powi(2)
}

/// Whether the rounding of stored coordinates leaves nothing of a polygon's area.
#[must_use]
pub fn is_lost_in_rounding(points: &[DVec3]) -> bool {
    let farthest = points.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
    area_vector(points).length() <= longest_edge(points) * ROUNDING * farthest
}

/// Makes pieces of all faces, in order; faces without any are listed as skipped.
pub fn make(
    spilled: &mut Spilled,
    (frame, whereabouts): (Frame, Option<Whereabouts>),
    snap_m: f64,
    pieces: &mut RecordFile<Piece>,
    progress: &dyn Progress,
) -> Result<()> {
    progress.begin("split", "faces", Some(spilled.polygons));
    spilled.for_each_face(|spilled, face| one_face(spilled, face, (frame, whereabouts), snap_m, pieces), progress)
}

fn one_face(
    spilled: &mut Spilled,
    face: &Face,
    (frame, whereabouts): (Frame, Option<Whereabouts>),
    snap_m: f64,
    pieces: &mut RecordFile<Piece>,
) -> Result<()> {
    let mut corners: Vec<(FaceCorner, [f32; 3])> = Vec::with_capacity(face.corners.len());
    let mut named = Vec::with_capacity(face.corners.len());
    for corner in &face.corners {
        let Some(at) = position(spilled, face, *corner)? else {
            let (start, end) = spilled.files[face.source.file as usize].vertices;
            let detail = match corner.vertex {
                NONE => format!("face uses a vertex far beyond the {} defined", end - start),
                v => format!("face uses vertex {} but only {} are defined", u64::from(v) - start + 1, end - start),
            };
            return spilled.skipped.add(Cause::BadFace, face.source, &detail);
        };
        if !frame.is_usable(at) {
            let detail = format!("corner at {} {} {} is not finite, or over 1e9 m from zero", at.x, at.y, at.z);
            return spilled.skipped.add(Cause::NotFinite, face.source, &detail);
        }
        named.push(at);
        let stored = frame.store_position(at);
        if corners.last().is_none_or(|last| last.1 != stored) {
            corners.push((*corner, stored));
        }
    }
    while corners.len() > 1 && corners[0].1 == corners[corners.len() - 1].1 {
        corners.pop();
    }
    let points: Vec<DVec3> = corners.iter().map(|c| DVec3::from_array(c.1.map(f64::from))).collect();
    if let Some(detail) = too_many(&points) {
        return spilled.skipped.add(Cause::TooManyCorners, face.source, &detail);
    }
    let mut made = 0;
    if points.len() >= 3 {
        for part in split(&points, planar_tolerance(&points, snap_m)) {
            let shape: Vec<DVec3> = part.corners().iter().map(|i| points[*i]).collect();
            if !is_needle(&shape) && !is_lost_in_rounding(&shape) {
                pieces.push(piece(face, part.corners().iter().map(|i| corners[*i])))?;
                made += 1;
            }
        }
    }
    if made > 0 {
        // Halves that turn against each other leave no area between them, and no turn that can be told.
        if points.len() > 3 && (is_needle(&points) || (turns(&points).abs() - 1.0).abs() > 0.5) {
            spilled.crossing.get_or_insert((0, face.source)).0 += 1;
        }
        return Ok(());
    }
    match whereabouts.filter(|around| !is_needle(&named) && around.is_far(&named)) {
        Some(around) => {
            let away_m = around.distance(&named) * frame.metres_per_unit;
            let detail = format!("face is too small to be stored {away_m:.0} m from the rest of the model");
            spilled.skipped.add(Cause::TooFar, face.source, &detail)
        }
        None => spilled.skipped.add(Cause::Degenerate, face.source, "face has no area"),
    }
}

/// Why a polygon would take too long to cut up, if it would.
fn too_many(points: &[DVec3]) -> Option<String> {
    let n = points.len();
    if n > MOST_CORNERS {
        Some(format!("face has {n} corners, over the limit of {MOST_CORNERS}"))
    } else if n > MOST_CROSSING && turns(points).abs() > 1.5 {
        Some(format!("face has {n} corners and crosses itself, over the limit of {MOST_CROSSING} for such a one"))
    } else {
        None
    }
}

fn piece(face: &Face, corners: impl Iterator<Item = (FaceCorner, [f32; 3])>) -> Piece {
    let mut piece = Piece { source_count: 1, object: face.object, material: [face.material, NONE], ..Piece::zeroed() };
    piece.sources[0] = face.source;
    for (named, at) in corners {
        let i = piece.corner_count as usize;
        piece.corners_m[i..].fill(at);
        piece.named[i] = named;
        piece.corner_count += 1;
    }
    piece
}

/// Splits pieces with too long an edge for a model whose typical patch is so wide: the parts go to the end, the whole
/// is gone. Neighbours are cut at the same places, the midpoints of their common edges. What lies far off stays whole.
pub fn split_long(pieces: &mut RecordFile<Piece>, typical_m: f64, far: Far, paths: &[PathBuf]) -> Result<()> {
    let longest_m = LONGEST_EDGE_M.max(LONGEST_EDGE * typical_m);
    let is_long = |piece: &Piece| {
        let (points, n) = piece.points();
        piece.gone == 0 && longest_edge(&points[..n]) > longest_m && !far.holds(&piece.corners_m[..n])
    };
    refuse_too_many(pieces, longest_m, &is_long, paths)?;
    let mut i = 0;
    while i < pieces.len() {
        let mut whole = pieces.get(i)?;
        if is_long(&whole) {
            whole.gone = 1;
            pieces.set(i, whole)?;
            for half in halves(&whole) {
                pieces.push(half)?;
            }
        }
        i += 1;
    }
    Ok(())
}

/// Fails if splitting would make more than [`MOST_PIECES`] of one face.
fn refuse_too_many(
    pieces: &mut RecordFile<Piece>,
    longest_m: f64,
    is_long: &dyn Fn(&Piece) -> bool,
    paths: &[PathBuf],
) -> Result<()> {
    for i in 0..pieces.len() {
        let piece = pieces.get(i)?;
        if !is_long(&piece) {
            continue;
        }
        let (points, n) = piece.points();
        let (edge_m, area_m2) = (longest_edge(&points[..n]), 0.5 * area_vector(&points[..n]).length());
        // Halved until no edge is too long, pieces have a quarter to all of the longest square.
        let count = 4.0 * area_m2 / (longest_m * longest_m) + 2.0 * edge_m / longest_m;
        if count > MOST_PIECES {
            let Source { file, line, .. } = piece.sources[0];
            return Err(Error::TooLarge {
                message: format!(
                    "{}:{line}: a face of {edge_m:.0} m would become {count:.0} patches of {longest_m:.0} m, over the limit of {MOST_PIECES}",
                    shown(&paths[file as usize])
                ),
                help: "leave the face out, cut it down to the building, or give `--units`".to_owned(),
            });
        }
    }
    Ok(())
}

fn halves(whole: &Piece) -> [Piece; 2] {
    let (points, n) = whole.points();
    let length = |i: usize| points[i].distance(points[(i + 1) % n]);
    let longest = (1..n).fold(0, |best, i| if length(i) > length(best) { i } else { best });
    // Turned so that the longest edge runs from corner 0 to corner 1.
    let at = |i: usize| (whole.named[(longest + i) % n], whole.corners_m[(longest + i) % n]);
    let mid = |i: usize, j: usize| {
        let middle = (points[(longest + i) % n] + points[(longest + j) % n]) * 0.5;
        (FaceCorner::MADE, middle.as_vec3().to_array())
    };
    let rebuilt = |corners: &[(FaceCorner, [f32; 3])]| {
        let mut part = Piece { gone: 0, corner_count: corners.len() as u32, ..*whole };
        for (i, (named, at)) in corners.iter().enumerate() {
            part.named[i] = *named;
            part.corners_m[i..].fill(*at);
        }
        part
    };
    if n == 3 {
        [rebuilt(&[at(0), mid(0, 1), at(2)]), rebuilt(&[mid(0, 1), at(1), at(2)])]
    } else {
        [rebuilt(&[at(0), mid(0, 1), mid(2, 3), at(3)]), rebuilt(&[mid(0, 1), at(1), at(2), mid(2, 3)])]
    }
}

/// Box round a piece, m from the origin.
#[must_use]
pub fn bounds(piece: &Piece) -> Bounds {
    let (points, n) = piece.points();
    Bounds::of(&points[..n])
}

/// Box round all pieces that are not gone.
pub fn bounds_of_all(pieces: &mut RecordFile<Piece>) -> Result<Bounds> {
    let mut whole = Bounds::EMPTY;
    for i in 0..pieces.len() {
        let piece = pieces.get(i)?;
        if piece.gone == 0 {
            whole = whole.union(bounds(&piece));
        }
    }
    Ok(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_patches_are_halved_until_no_edge_is_too_long_and_keep_their_area() {
        let dir = tempfile::tempdir().unwrap();
        let mut pieces = RecordFile::create(dir.path(), "pieces", 0).unwrap();
        let mut quad = Piece { corner_count: 4, ..Piece::zeroed() };
        quad.corners_m = [[0., 0., 0.], [500., 0., 0.], [500., 300., 0.], [0., 300., 0.]];
        let mut triangle = Piece { corner_count: 3, ..Piece::zeroed() };
        triangle.corners_m = [[0., 0., 0.], [500., 0., 0.], [0., 0., 30.], [0., 0., 30.]];
        pieces.push(quad).unwrap();
        pieces.push(triangle).unwrap();
        split_long(&mut pieces, 1.0, Far::NONE, &[]).unwrap();
        let mut area = 0.0;
        for i in 0..pieces.len() {
            let piece = pieces.get(i).unwrap();
            if piece.gone == 0 {
                let (points, n) = piece.points();
                assert!(longest_edge(&points[..n]) <= LONGEST_EDGE_M);
                area += 0.5 * area_vector(&points[..n]).length();
            }
        }
        assert!((area - 500.0 * 300.0 - 7500.0).abs() < 1e-6, "{area}");
    }
    #[test]
    fn a_face_that_would_take_minutes_to_cut_up_is_told_by_its_corners_and_crossings() {
        let round = |n: u32, times: f64| -> Vec<DVec3> {
            let angle = |i: u32| std::f64::consts::TAU * times * f64::from(i) / f64::from(n);
            (0..n).map(angle).map(|a| DVec3::new(a.cos(), a.sin(), 0.0)).collect()
        };
        assert_eq!(too_many(&round(16_384, 1.0)), None);
        assert!(too_many(&round(16_385, 1.0)).unwrap().contains("16385 corners, over the limit of 16384"));
        assert_eq!(too_many(&round(1_023, 511.0)), None);
        assert!(too_many(&round(1_025, 512.0)).unwrap().contains("1025 corners and crosses itself"));
    }
}
