//! Which line splits a region next.

use glam::DVec2;

use super::cell::{Cell, Halves};
use super::joined::CHAIN_M;
use super::plane::{Line, crossing};
use super::segments::Segment;
use super::tree::longest_first;

/// A region with more segments than this is crowded.
pub const CROWD: usize = 64;
/// Segments that are looked at for halving it: the longest.
const CANDIDATES: usize = 16;
/// Up to so many segments each is tried out to the end (a rollout of the choice among more). Of a duplex's 22,121 patches
/// that saves 61; twice the number saves 131, at half as much time again for the whole of ingest.
const FEW: usize = 12;
/// Where a crowded region may be halved, as shares of its length.
const MIDDLES: [f64; 9] = [0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65, 0.3, 0.7];

/// How a segment lies to a line.
enum Side {
    On,
    Left,
    Right,
    /// At this share of it.
    Across(f64),
}

fn side(segment: &Segment, line: Line, near_m: f64) -> Side {
    let [from, to] = segment.ends.map(|p| line.left_m(p));
    if from.abs() <= near_m && to.abs() <= near_m {
        return Side::On;
    }
    if from >= -near_m && to >= -near_m {
        return Side::Left;
    }
    if from <= near_m && to <= near_m {
        return Side::Right;
    }
    // What is left of a segment beyond a line it ends at is no line of its own.
    let (t, length) = (crossing(from, to), segment.length());
    let (first, second) = if from > 0.0 { (Side::Left, Side::Right) } else { (Side::Right, Side::Left) };
    if t * length < CHAIN_M && t < 0.5 {
        second
    } else if (1.0 - t) * length < CHAIN_M {
        first
    } else {
        Side::Across(t)
    }
}

/// The segments left of a line, and right of it; what crosses it is on both sides, what runs along it on none.
pub fn parted(segments: Vec<Segment>, line: Line, near_m: f64) -> [Vec<Segment>; 2] {
    let (mut left, mut right) = (Vec::new(), Vec::new());
    for segment in segments {
        match side(&segment, line, near_m) {
            Side::On => {}
            Side::Left => left.push(segment),
            Side::Right => right.push(segment),
            Side::Across(t) => {
                let [a, b] = segment.ends;
                let middle = a.lerp(b, t);
                let halves = [[a, middle], [middle, b]].map(|ends| Segment { ends, ..segment });
                let is_left = line.left_m(a) > 0.0;
                left.push(halves[usize::from(!is_left)]);
                right.push(halves[usize::from(is_left)]);
            }
        }
    }
    [left, right]
}

/// The segments that run along a line.
pub fn on_line(segments: &[Segment], line: Line, near_m: f64) -> Vec<Segment> {
    segments.iter().filter(|s| matches!(side(s, line, near_m), Side::On)).copied().collect()
}

/// What a split along a line does to the segments of a region.
#[derive(Default)]
struct Effect {
    crossed: usize,
    on: usize,
    sides: [usize; 2],
}

impl Effect {
    fn of(segments: &[Segment], line: Line, near_m: f64) -> Self {
        let mut effect = Self::default();
        for segment in segments {
            match side(segment, line, near_m) {
                Side::On => effect.on += 1,
                Side::Left => effect.sides[0] += 1,
                Side::Right => effect.sides[1] += 1,
                Side::Across(_) => effect.crossed += 1,
            }
        }
        effect
    }

    /// How many segments there are more of afterwards.
    fn growth(&self) -> isize {
        self.crossed as isize - self.on as isize
    }

    fn is_even(&self, count: usize) -> bool {
        self.sides.iter().all(|side| side + self.crossed >= count / 4)
    }
}

/// A split to be made, along a segment of these kinds unless it only halves.
pub struct Cut {
    /// The region's halves.
    pub halves: Halves,
    /// Of the segment.
    pub kinds: Option<u8>,
}

/// The split that halves a crowded region: of lines near its middle, and along long segments that have many on either
/// side, the one that multiplies segments least. They come in order of length.
pub fn halving(cell: &Cell, segments: &[Segment], near_m: f64) -> Option<Cut> {
    let middles = middles(cell).map(|line| (line, None));
    let longest = segments.iter().take(CANDIDATES).map(|s| (s.line(), Some(s.kinds)));
    let lines = longest.chain(middles).map(|(line, kinds)| (Effect::of(segments, line, near_m), line, kinds));
    let even = lines.filter(|(effect, _, kinds)| kinds.is_none() || effect.is_even(segments.len()));
    let mut all: Vec<_> = even.map(|(effect, line, kinds)| (effect.growth(), line, kinds)).collect();
    all.sort_by_key(|(growth, ..)| *growth);
    all.into_iter().find_map(|(_, line, kinds)| Some(Cut { halves: cell.split(line, near_m)?, kinds }))
}

/// The split of a region along one of its segments; of few, that which leaves the fewest parts in the end, then the longest.
/// None if none can be made. They come in order of length; of many, those that split nothing are taken away.
pub fn along_segment(cell: &Cell, segments: &mut Vec<Segment>, near_m: f64) -> Option<Cut> {
    if segments.len() > FEW {
        return along_best(cell, segments, near_m);
    }
    let cuts = segments.iter().filter_map(|s| Cut::along(cell, s, near_m));
    cuts.min_by_key(|cut| cut.parts(segments, near_m))
}

/// The split that multiplies segments least; of equal ones the one whose halves have the fewest corners, then the longest.
fn along_best(cell: &Cell, segments: &mut Vec<Segment>, near_m: f64) -> Option<Cut> {
    loop {
        let growth: Vec<isize> = segments.iter().map(|s| Effect::of(segments, s.line(), near_m).growth()).collect();
        let least = *growth.iter().min()?;
        let best = segments.iter().zip(&growth).filter(|(_, growth)| **growth == least);
        let cuts = best.filter_map(|(s, _)| Cut::along(cell, s, near_m));
        if let Some(cut) = cuts.min_by_key(|cut| whole(&cut.halves.left) + whole(&cut.halves.right)) {
            return Some(cut);
        }
        let mut growth = growth.into_iter();
        segments.retain(|_| growth.next() != Some(least));
    }
}

/// Triangles and quads that a region falls into as it is.
fn whole(cell: &Cell) -> usize {
    (cell.corners.len() - 1) / 2
}

/// Parts that a region falls into where the best split is taken each time.
fn parts(cell: &Cell, mut segments: Vec<Segment>, near_m: f64) -> usize {
    along_best(cell, &mut segments, near_m).map_or_else(|| whole(cell), |cut| cut.parts(&segments, near_m))
}

impl Cut {
    fn along(cell: &Cell, segment: &Segment, near_m: f64) -> Option<Self> {
        Some(Self { halves: cell.split(segment.line(), near_m)?, kinds: Some(segment.kinds) })
    }

    /// Parts that there are in the end.
    fn parts(&self, segments: &[Segment], near_m: f64) -> usize {
        let Halves { line, left, right } = &self.halves;
        let [on_left, on_right] = parted(segments.to_vec(), *line, near_m).map(longest_first);
        parts(left, on_left, near_m) + parts(right, on_right, near_m)
    }
}

/// Lines across a region's longest edge near its middle, the middle first.
pub fn middles(cell: &Cell) -> impl Iterator<Item = Line> {
    let corners = &cell.corners;
    let edge = |i: usize| corners[(i + 1) % corners.len()].flat - corners[i].flat;
    let longer = |a: usize, b: usize| if edge(b).length_squared() > edge(a).length_squared() { b } else { a };
    let longest = (0..corners.len()).reduce(longer).expect("a region has corners");
    let (start, along) = (corners[longest].flat, edge(longest).normalize());
    let places = corners.iter().map(|c| (c.flat - start).dot(along));
    let (low, high) = places.fold((0.0, 0.0), |(l, h), x| (f64::min(l, x), f64::max(h, x)));
    MIDDLES.into_iter().map(move |share| {
        let at: DVec2 = start + along * (low + (high - low) * share);
        Line::through(at, at + along.perp())
    })
}
