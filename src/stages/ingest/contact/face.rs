//! One face: what touches it, and what it becomes.

use std::ops::ControlFlow;

use glam::{DVec2, DVec3};

use super::cell::{Border, Cell, Corner};
use super::choice::middles;
use super::doubles::Edges;
use super::joined::{CHAIN_M, Graph};
use super::neighbours::{Face, Near, Neighbours};
use super::plane::{Plane, box_of, is_along_edge};
use super::segments::{CROSSING, Segment, Touched};
use super::sink::Sink;
use super::tree::{Grower, longest_first};
use super::{FaceCuts, Rules};
use crate::base::Result;
use crate::geom::bounds::Bounds;

/// Segments of a region at most that are worked on at once.
const MOST: usize = 1 << 14;
/// Rounding of stored coordinates, relative to the largest, with room for all that is done with them.
const ROUNDING: f64 = 8.0 / (1 << 24) as f64;
/// Width below which a part counts as a needle, relative to its face's length.
const THIN: f64 = 4e-6;

/// Cuts a face along what touches it.
pub fn cut_face(face: &Face, neighbours: &mut Neighbours, rules: &Rules, sink: &mut Sink) -> Result<FaceCuts> {
    let (points, n) = face.points();
    let points = &points[..n];
    let plane = Plane::of(points);
    let corner =
        |i: usize| Corner { flat: plane.flat(points[i]), at: points[i], of_face: Some(i as u8), edge: Border::Outline };
    let cell = Cell { corners: (0..n).map(corner).collect() };
    let mut sink = sink.face(plane, face.named);
    if cell.extent_m() < rules.least_m {
        sink.part(&cell)?;
        return sink.finish(0.0);
    }
    let outline: Vec<DVec2> = cell.corners.iter().map(|c| c.flat).collect();
    let farthest = points.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
    let near_m = rules.snap_m.max(ROUNDING * farthest).max(THIN * cell.extent_m());
    let touched = Touched { plane, outline: &outline, near_m, rules };
    let grower = Grower { sink: &mut sink, near_m, least_m: rules.least_m, corners: n };
    Work { row: face.row, touched, neighbours, grower }.cut(cell)?;
    sink.finish(near_m)
}

/// What the regions of a face are cut with.
struct Work<'a, 'b> {
    row: u64,
    touched: Touched<'a>,
    neighbours: &'a mut Neighbours,
    grower: Grower<'a, 'b>,
}

impl Work<'_, '_> {
    /// Cuts a region; what it is to the node above. One that too much touches is halved first.
    fn cut(&mut self, cell: Cell) -> Result<u32> {
        if let Some(segments) = self.segments(&cell)? {
            return self.grower.grow(cell, self.chains(&segments));
        }
        let near_m = self.touched.near_m;
        let halves = middles(&cell).find_map(|line| cell.split(line, near_m));
        let Some(halves) = halves.filter(|_| cell.extent_m() >= self.touched.rules.least_m) else {
            return self.grower.grow(cell, Vec::new());
        };
        // What stands along such a line is not known: it counts as closed.
        let (line, corners) = (halves.line, &halves.left.corners);
        let [first, .., last] = corners[..] else { unreachable!("a cell has corners") };
        let all = Segment::new(first.flat, last.flat, CROSSING);
        let (node, [left, right]) = self.grower.begin(halves, vec![all])?;
        let (left, right) = (self.cut(left)?, self.cut(right)?);
        self.grower.sink.set(node, line, [left, right])?;
        Ok(node)
    }

    /// All segments that reach a region, unless they are too many; without those that double an edge of the face.
    fn segments(&mut self, cell: &Cell) -> Result<Option<Vec<Segment>>> {
        let [low, high] = box_of(cell.corners.iter().map(|c| c.flat));
        let mut segments = Vec::new();
        let touched = &self.touched;
        for_each_near(self.neighbours, touched, self.row, cell, |other| {
            touched.segments(other, |segment| {
                let [from, to] = box_of(segment.ends.into_iter());
                if from.cmple(high).all() && low.cmple(to).all() {
                    segments.push(segment);
                }
            });
            if segments.len() > MOST { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })?;
        if segments.len() > MOST {
            return Ok(None);
        }
        if segments.iter().any(|s| is_along_edge(touched.outline, s.ends, CHAIN_M)) {
            let mut edges = Edges::new(touched);
            for_each_near(self.neighbours, touched, self.row, cell, |other| {
                edges.add(other);
                ControlFlow::Continue(())
            })?;
            edges.finish();
            segments.retain(|s| !edges.double(s));
        }
        Ok(Some(segments))
    }

    /// Segments joined, simplified, and without chains that are too short, the longest first.
    fn chains(&self, segments: &[Segment]) -> Vec<Segment> {
        if segments.is_empty() {
            return Vec::new();
        }
        let Touched { near_m, rules, .. } = self.touched;
        let mut graph = Graph::of(segments, near_m);
        graph.drop_short_chains(CHAIN_M.max(rules.contact_m), rules.least_m);
        graph.simplify();
        let at = |i: u32| graph.points[i as usize];
        longest_first(graph.edges.iter().map(|e| Segment { ends: e.ends.map(at), kinds: e.kinds }).collect())
    }
}

/// Visits the corners of the faces near a region of the face of that row, until told to stop.
fn for_each_near(
    neighbours: &mut Neighbours,
    touched: &Touched,
    row: u64,
    cell: &Cell,
    mut visit: impl FnMut(&[DVec3]) -> ControlFlow<()>,
) -> Result<()> {
    let near_m = touched.rules.contact_m;
    let around = cell.corners.iter().fold(Bounds::EMPTY, |b, c| b.with(c.at));
    let bounds = Bounds { min: around.min - near_m, max: around.max + near_m };
    neighbours.for_each(&Near { bounds, plane: touched.plane, near_m }, |other| {
        if other.row == row {
            return ControlFlow::Continue(());
        }
        let (points, n) = other.points();
        visit(&points[..n])
    })
}
