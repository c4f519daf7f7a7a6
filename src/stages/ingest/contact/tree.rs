//! A region of a face split along its segments, and what is left as parts: the nodes of the face's cut tree.

use super::cell::{Border, Cell, Corner, Halves};
use super::choice::{CROWD, Cut, along_segment, halving, on_line, parted};
use super::doubles::without_doubles;
use super::plane::Line;
use super::segments::Segment;
use super::sink::FaceSink;
use crate::base::Result;

/// What regions of a face grow with.
pub struct Grower<'a, 'b> {
    /// Where nodes and parts go.
    pub sink: &'a mut FaceSink<'b>,
    /// Lines nearer than this are one, and nothing narrower is made, m.
    pub near_m: f64,
    /// Regions smaller than this stay whole, m.
    pub least_m: f64,
    /// Corners of the face.
    pub corners: usize,
}

impl Grower<'_, '_> {
    /// Splits a region along segments in order of length; what it is to the node above. A crowded one is halved first,
    /// so that parts stay in proportion.
    pub fn grow(&mut self, cell: Cell, segments: Vec<Segment>) -> Result<u32> {
        if segments.len() <= CROWD {
            return self.split(cell, without_doubles(segments));
        }
        let is_large = cell.extent_m() >= self.least_m;
        match halving(&cell, &segments, self.near_m).filter(|_| is_large) {
            Some(cut) => self.node(cut, segments, Self::grow),
            None => self.finish(cell),
        }
    }

    fn split(&mut self, cell: Cell, mut segments: Vec<Segment>) -> Result<u32> {
        let is_large = cell.extent_m() >= self.least_m;
        match along_segment(&cell, &mut segments, self.near_m).filter(|_| is_large) {
            Some(cut) => self.node(cut, segments, Self::split),
            None => self.finish(cell),
        }
    }

    /// A node whose halves go on in the same way.
    fn node(
        &mut self,
        cut: Cut,
        segments: Vec<Segment>,
        go_on: fn(&mut Self, Cell, Vec<Segment>) -> Result<u32>,
    ) -> Result<u32> {
        let Cut { halves, kinds } = cut;
        if let Some(kinds) = kinds {
            self.sink.count(kinds);
        }
        let line = halves.line;
        let (node, [left, right]) = self.begin(halves, on_line(&segments, line, self.near_m))?;
        let [on_left, on_right] = parted(segments, line, self.near_m).map(longest_first);
        let children = [go_on(self, left, on_left)?, go_on(self, right, on_right)?];
        self.sink.set(node, line, children)?;
        Ok(node)
    }

    /// Makes room for a node: its number, and the halves with their new edges named. `contact`: what stands along them.
    pub fn begin(&mut self, halves: Halves, contact: Vec<Segment>) -> Result<(u32, [Cell; 2])> {
        let node = self.sink.node(contact)?;
        let named = |mut cell: Cell| {
            let made = cell.corners.iter_mut().filter(|corner| corner.edge == Border::Made);
            made.for_each(|corner| corner.edge = Border::Node(node));
            cell
        };
        Ok((node, [halves.left, halves.right].map(named)))
    }

    /// Makes parts of a region: along diagonals into as few triangles and quads as it takes.
    fn finish(&mut self, mut cell: Cell) -> Result<u32> {
        if cell.corners.len() == self.corners && cell.corners.iter().all(|c| c.of_face.is_some()) {
            return self.sink.part(&cell);
        }
        straighten(&mut cell.corners, 0.25 * self.near_m);
        let n = cell.corners.len();
        if n == 3 || (n == 4 && flattest(&cell.corners) > FLAT) {
            return self.sink.part(&cell);
        }
        let best = diagonals(&cell).reduce(|a, b| if b.0 > a.0 { b } else { a });
        match best.filter(|(width_m, ..)| *width_m >= 0.5 * self.near_m) {
            Some((_, halves)) => {
                let line = halves.line;
                let (node, [left, right]) = self.begin(halves, Vec::new())?;
                let left = self.finish(left)?;
                let right = self.finish(right)?;
                self.sink.set(node, line, [left, right])?;
                Ok(node)
            }
            None if n == 4 => self.sink.part(&cell),
            None => {
                let bend = |i: usize| bend(&cell.corners, i);
                let least = (0..n).reduce(|a, b| if bend(b) < bend(a) { b } else { a }).expect("it has corners");
                cell.corners.remove(least);
                self.finish(cell)
            }
        }
    }
}

/// Sine of the least turn at the corners of a quad.
const FLAT: f64 = 2e-3;

/// Longest first, of equal ones the one that comes first by its coordinates.
#[must_use]
pub fn longest_first(mut segments: Vec<Segment>) -> Vec<Segment> {
    let key = |s: &Segment| s.ends.map(|p| p.to_array());
    segments.sort_by(|a, b| {
        b.length().total_cmp(&a.length()).then_with(|| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal))
    });
    segments
}

/// Takes corners away that bend by no more than this, m.
fn straighten(corners: &mut Vec<Corner>, near_m: f64) {
    let mut i = 0;
    while i < corners.len() && corners.len() > 3 {
        if bend(corners, i) <= near_m {
            corners.remove(i);
            i = i.saturating_sub(1);
        } else {
            i += 1;
        }
    }
}

/// How far a corner is from the line through its neighbours, m.
fn bend(corners: &[Corner], i: usize) -> f64 {
    let n = corners.len();
    Line::through(corners[(i + 1) % n].flat, corners[(i + n - 1) % n].flat).left_m(corners[i].flat)
}

fn flattest(corners: &[Corner]) -> f64 {
    let n = corners.len();
    let sine = |i: usize| {
        let (a, b, c) = (corners[i].flat, corners[(i + 1) % n].flat, corners[(i + 2) % n].flat);
        (b - a).normalize().perp_dot((c - b).normalize())
    };
    (0..n).map(sine).fold(1.0, f64::min)
}

/// Splits along diagonals that take no more parts than need be, each with the lesser of the halves' widths, m.
fn diagonals(cell: &Cell) -> impl Iterator<Item = (f64, Halves)> {
    let n = cell.corners.len();
    let pairs = (0..n).flat_map(move |i| (i + 2..n).map(move |j| [i, j])).filter(move |[i, j]| {
        let steps = j - i;
        steps < n - 1 && (n == 4 || steps % 2 == 1 || (n - steps) % 2 == 1)
    });
    pairs.map(move |[i, j]| {
        let mut right = Cell { corners: cell.corners[i..=j].to_vec() };
        let mut left = Cell { corners: cell.corners[j..].iter().chain(&cell.corners[..=i]).copied().collect() };
        for half in [&mut left, &mut right] {
            half.corners.last_mut().expect("it has corners").edge = Border::Made;
        }
        let line = Line::through(cell.corners[i].flat, cell.corners[j].flat);
        (left.width_m().min(right.width_m()), Halves { line, left, right })
    })
}
