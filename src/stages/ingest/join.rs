//! Pairs of triangles that make a convex planar quad are joined: in a window over the faces in file
//! order, so that memory stays bounded.

use std::collections::{HashMap, VecDeque};

use glam::DVec3;

use super::piece::Piece;
use super::pieces::planar_tolerance;
use super::record_file::RecordFile;
use crate::base::{Progress, Result};
use crate::geom::split::is_good_quad;

/// Triangles that wait for a partner.
const WINDOW: usize = 4096;

type Edge = [[u32; 3]; 2];

/// Copies what stays of `from` to `to`, joined.
pub fn join(
    from: &mut RecordFile<Piece>,
    to: &mut RecordFile<Piece>,
    snap_m: f64,
    progress: &dyn Progress,
) -> Result<()> {
    progress.begin("join", "patches", Some(from.len()));
    let mut window = Window { waiting: VecDeque::new(), first: 0, by_edge: HashMap::new(), snap_m };
    let mut object = None;
    for i in 0..from.len() {
        let piece = from.get(i)?;
        if piece.gone == 1 {
            continue;
        }
        if object != Some(piece.object) {
            window.flush(0, to)?;
            object = Some(piece.object);
        }
        if piece.corner_count == 4 {
            to.push(piece)?;
        } else if let Some(quad) = window.partner(&piece) {
            to.push(quad)?;
        } else {
            window.wait(piece);
            window.flush(WINDOW, to)?;
        }
        if i % 16_384 == 0 {
            progress.step(i)?;
        }
    }
    window.flush(0, to)
}

struct Window {
    waiting: VecDeque<Option<Piece>>,
    /// Number of the first that waits.
    first: u64,
    by_edge: HashMap<Edge, u64>,
    snap_m: f64,
}

fn edge(piece: &Piece, i: usize) -> Edge {
    [piece.corners_m[i], piece.corners_m[(i + 1) % 3]].map(|c| c.map(f32::to_bits))
}

impl Window {
    /// Takes the waiting triangle that makes the most rectangular quad with this one.
    fn partner(&mut self, piece: &Piece) -> Option<Piece> {
        let mut best: Option<(f64, u64, Piece)> = None;
        for j in 0..3 {
            let [p, q] = edge(piece, j);
            let Some(&number) = self.by_edge.get(&[q, p]) else { continue };
            let Some(Some(other)) = self.waiting.get((number - self.first) as usize) else { continue };
            let Some(i) = (0..3).find(|&i| edge(other, i) == [q, p]) else { continue };
            let Some((score, quad)) = quad(other, i, piece, j, self.snap_m) else { continue };
            if best.as_ref().is_none_or(|b| score < b.0) {
                best = Some((score, number, quad));
            }
        }
        let (_, number, quad) = best?;
        let taken = self.waiting[(number - self.first) as usize].take()?;
        self.forget(&taken, number);
        Some(quad)
    }

    fn forget(&mut self, piece: &Piece, number: u64) {
        for i in 0..3 {
            if self.by_edge.get(&edge(piece, i)) == Some(&number) {
                self.by_edge.remove(&edge(piece, i));
            }
        }
    }

    fn wait(&mut self, piece: Piece) {
        let number = self.first + self.waiting.len() as u64;
        for i in 0..3 {
            self.by_edge.insert(edge(&piece, i), number);
        }
        self.waiting.push_back(Some(piece));
    }

    /// Lets the oldest go until no more than `keep` wait.
    fn flush(&mut self, keep: usize, to: &mut RecordFile<Piece>) -> Result<()> {
        while self.waiting.len() > keep {
            if let Some(Some(piece)) = self.waiting.pop_front() {
                self.forget(&piece, self.first);
                to.push(piece)?;
            }
            self.first += 1;
        }
        Ok(())
    }
}

/// The quad of triangles `a` and `b`, whose edges `i` and `j` are one, and how far from a rectangle
/// it is: its largest cosine.
fn quad(a: &Piece, i: usize, b: &Piece, j: usize, snap_m: f64) -> Option<(f64, Piece)> {
    if a.material != b.material || a.object != b.object {
        return None;
    }
    let mut quad = Piece { corner_count: 4, ..*a };
    let picks = [(a, (i + 2) % 3), (a, i), (b, (j + 2) % 3), (a, (i + 1) % 3)];
    for (k, (from, at)) in picks.into_iter().enumerate() {
        quad.corners_m[k] = from.corners_m[at];
        quad.named[k] = from.named[at];
    }
    quad.add_sources(b);
    let (points, _) = quad.points();
    if !is_good_quad(&points, planar_tolerance(&points, snap_m)) {
        return None;
    }
    let cosine = |k: usize| {
        let (x, y): (DVec3, DVec3) = (points[(k + 1) % 4] - points[k], points[(k + 3) % 4] - points[k]);
        (x.dot(y) / (x.length() * y.length())).abs()
    };
    Some(((0..4).map(cosine).fold(0.0, f64::max), quad))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Quiet;
    use bytemuck::Zeroable;

    fn triangle(corners: [[f32; 2]; 3], material: u32) -> Piece {
        let mut piece = Piece { corner_count: 3, material: [material, u32::MAX], ..Piece::zeroed() };
        for i in 0..4 {
            let [x, y] = corners[i.min(2)];
            piece.corners_m[i] = [x, y, 0.0];
        }
        piece
    }

    fn joined(input: &[Piece]) -> Vec<u32> {
        let dir = tempfile::tempdir().unwrap();
        let mut from = RecordFile::create(dir.path(), "from", 0).unwrap();
        let mut to = RecordFile::create(dir.path(), "to", 0).unwrap();
        for piece in input {
            from.push(*piece).unwrap();
        }
        join(&mut from, &mut to, 1e-5, &Quiet).unwrap();
        (0..to.len()).map(|i| to.get(i).unwrap().corner_count).collect()
    }

    #[test]
    fn two_halves_of_a_rectangle_become_one_quad() {
        let a = triangle([[0., 0.], [2., 0.], [2., 1.]], 0);
        let b = triangle([[2., 1.], [0., 1.], [0., 0.]], 0);
        assert_eq!(joined(&[a, b]), [4]);
        assert_eq!(joined(&[a, triangle([[2., 1.], [0., 1.], [0., 0.]], 1)]), [3, 3]);
    }

    #[test]
    fn halves_that_make_a_dart_or_a_larger_triangle_stay_apart() {
        let a = triangle([[0., 0.], [2., 0.], [2., 1.]], 0);
        assert_eq!(joined(&[a, triangle([[2., 1.], [0.5, 2.], [0., 0.]], 0)]).len(), 1);
        assert_eq!(joined(&[a, triangle([[0., 0.], [2., 1.], [4., 9.]], 0)]).len(), 2);
        let b = triangle([[2., 0.], [4., 0.], [2., 1.]], 0);
        assert_eq!(joined(&[a, b]), [3, 3]);
    }
}
