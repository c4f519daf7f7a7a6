//! The leaves of a patch side, and what they predict together where they meet: over seams, with those of other patches.

use hashbrown::HashMap;

use crate::base::{NodeName, Rgb};
use crate::geom::grid::{Descent, GridPoint, places_on_edges};
use crate::geom::polygon::Polygon;
use crate::geom::quadtree::patch_polygon;
use crate::model::geometry::{PatchRecord, Seam};
use crate::transport::light::line::Line;
use crate::transport::nodes::frame::{Frame, Plane};
use crate::transport::numbers;

/// A leaf with its light.
pub struct SheetLeaf {
    /// Levels below the patch.
    pub depth: u32,
    /// Its corners, as many as it has.
    pub points: [GridPoint; 4],
    /// How many.
    pub count: usize,
    /// Its shape, in the winding of the front.
    pub shape: Polygon,
    /// m2.
    pub area_m2: f64,
    /// What arrives.
    pub line: Line,
    /// What it predicts beyond its line, W/m2: see [`Sheet::make_up`].
    missed: Rgb,
    /// What its line reaches at its corners, by channel.
    range: [Rgb; 2],
    centroid: Plane,
}

fn offset(from: Plane, to: Plane) -> Plane {
    [to[0] - from[0], to[1] - from[1]]
}

fn not_negative(light: Rgb) -> Rgb {
    Rgb(light.0.map(|x| x.max(0.0)))
}

impl SheetLeaf {
    /// What it predicts at a place of the patch's plane.
    fn predicts(&self, at: Plane) -> Predicted {
        let sum = not_negative(self.line.at(offset(self.centroid, at)) + self.missed);
        Predicted { sum, leaves: 1.0, range: self.range }
    }
}

/// What leaves predict where they meet, W/m2.
#[derive(Clone, Copy)]
struct Predicted {
    sum: Rgb,
    leaves: f64,
    /// Of their lines, by channel.
    range: [Rgb; 2],
}

/// The least and the most of two ranges.
fn range_of(one: [Rgb; 2], other: [Rgb; 2]) -> [Rgb; 2] {
    let of_both =
        |i: usize, choose: fn(f64, f64) -> f64| Rgb(std::array::from_fn(|c| choose(one[i].0[c], other[i].0[c])));
    [of_both(0, f64::min), of_both(1, f64::max)]
}

impl Predicted {
    fn plus(self, other: Self) -> Self {
        let range = range_of(self.range, other.range);
        Self { sum: self.sum + other.sum, leaves: self.leaves + other.leaves, range }
    }

    /// Their mean; what leaves have missed takes it no farther than their lines reach.
    fn mean(&self) -> Rgb {
        let mean = self.sum * (1.0 / self.leaves);
        Rgb(std::array::from_fn(|c| mean.0[c].clamp(self.range[0].0[c], self.range[1].0[c])))
    }
}

/// A place on an edge of one of several sheets.
#[derive(Clone, Copy)]
pub struct OnEdge {
    /// Which sheet.
    pub sheet: usize,
    /// Which edge, from the corner of that number to the next.
    pub edge: usize,
    /// How far along it, as a share.
    pub along: f64,
}

/// Where leaves have a corner on an edge.
struct Stop {
    along: f64,
    point: GridPoint,
    /// The leaf whose edge begins there.
    leaf: usize,
}

/// A patch side that meets others over seams.
pub struct Sheet {
    /// The patch.
    pub patch: u8,
    /// Its shape.
    pub shape: Polygon,
    /// Its leaves.
    pub leaves: Vec<SheetLeaf>,
    /// By corner of leaves: what those that meet there predict.
    predicted: HashMap<GridPoint, Predicted>,
    frame: Frame,
    /// By edge, ascending; no more than corners if no seam needs them.
    stops: Vec<Vec<Stop>>,
    /// Open ones, with the number of the sheet beyond.
    seams: Vec<(Seam, usize)>,
}

impl Sheet {
    /// From leaves and their lines, in any order that is always the same; that of the tree is quickest.
    #[must_use]
    pub fn new(patch: u8, record: &PatchRecord, leaves: &[(NodeName, Line)]) -> Self {
        let (shape, frame) = (patch_polygon(record), Frame::of(record));
        let mut descent = Descent::into(&shape);
        let leaf = |(name, line): &(NodeName, Line)| {
            let (element, points) = descent.to(name.path());
            let centroid = frame.plane(element.centroid());
            let reached = element.corners().iter().map(|c| not_negative(line.at(offset(centroid, frame.plane(*c)))));
            let start = [Rgb::grey(f64::INFINITY), Rgb::BLACK];
            SheetLeaf {
                depth: name.depth(),
                points,
                count: element.corners().len(),
                shape: *element,
                area_m2: element.area(),
                line: *line,
                missed: Rgb::BLACK,
                range: reached.fold(start, |range, light| range_of(range, [light; 2])),
                centroid,
            }
        };
        let leaves: Vec<SheetLeaf> = leaves.iter().map(leaf).collect();
        let predicted = HashMap::with_capacity(leaves.len() + leaves.len() / 2);
        let mut sheet = Self { patch, shape, leaves, predicted, frame, stops: Vec::new(), seams: Vec::new() };
        sheet.predict();
        sheet
    }

    fn predict(&mut self) {
        self.predicted.clear();
        for leaf in &self.leaves {
            for (point, corner) in leaf.points.iter().zip(leaf.shape.corners()) {
                let predicted = leaf.predicts(self.frame.plane(*corner));
                let of_all = |before: &mut Predicted| *before = before.plus(predicted);
                self.predicted.entry(*point).and_modify(of_all).or_insert(predicted);
            }
        }
    }

    /// Has every leaf predict more by what it misses, W/m2.
    pub fn make_up(&mut self, missed: impl Fn(&SheetLeaf) -> Rgb) {
        self.leaves.iter_mut().for_each(|leaf| leaf.missed = missed(leaf));
        self.predict();
    }

    /// Takes note of the open seams to the other sheets.
    pub fn join(&mut self, seams: &[Seam], number_of: impl Fn(u8) -> Option<usize>) {
        let beyond = |seam: &Seam| Some((*seam, number_of(seam.other as u8)?));
        self.seams = seams.iter().filter_map(beyond).collect();
        if self.seams.is_empty() {
            return;
        }
        self.stops = self.shape.corners().iter().map(|_| Vec::new()).collect();
        for (number, leaf) in self.leaves.iter().enumerate() {
            for i in 0..leaf.count {
                let (point, next) = (leaf.points[i], leaf.points[(i + 1) % leaf.count]);
                for (edge, along) in places_on_edges(&self.shape, point) {
                    if places_on_edges(&self.shape, next).any(|(other, to)| other == edge && to > along) {
                        self.stops[edge].push(Stop { along, point, leaf: number });
                    }
                }
            }
        }
        self.stops.iter_mut().for_each(|stops| stops.sort_by(|a, b| a.along.total_cmp(&b.along)));
    }

    /// By corner of leaves: the mean of what those that meet there predict, W/m2.
    #[must_use]
    pub fn means(&self) -> HashMap<GridPoint, Rgb> {
        self.predicted.iter().map(|(point, predicted)| (*point, predicted.mean())).collect()
    }

    /// Corners of leaves on the patch's edges, if it has seams: on which edge, how far along, and where on the grid.
    pub fn on_edges(&self) -> impl Iterator<Item = (usize, f64, GridPoint)> + '_ {
        let of = |(edge, stops): (usize, &'_ Vec<Stop>)| stops.iter().map(move |s| (edge, s.along, s.point)).collect();
        self.stops.iter().enumerate().flat_map(of as fn((usize, &Vec<Stop>)) -> Vec<_>)
    }

    /// Whether leaves have a corner at a place of an edge.
    #[must_use]
    pub fn has_corner(&self, edge: usize, along: f64) -> bool {
        along >= 1.0 - numbers::SAME || along - self.stop_before(edge, along).along <= numbers::SAME
    }

    /// The last corner up to a place of an edge.
    fn stop_before(&self, edge: usize, along: f64) -> &Stop {
        let stops = &self.stops[edge];
        &stops[stops.partition_point(|stop| stop.along <= along + numbers::SAME) - 1]
    }

    /// The seams at a place of an edge: where it lies beyond.
    fn beyond(&self, edge: usize, along: f64) -> impl Iterator<Item = OnEdge> + '_ {
        let meets = move |seam: &&(Seam, usize)| {
            let [from, to] = seam.0.along.map(f64::from);
            usize::from(seam.0.edge) == edge && (from - numbers::SAME..=to + numbers::SAME).contains(&along)
        };
        self.seams.iter().filter(meets).map(move |(seam, sheet)| {
            let ([from, to], [first, last]) = (seam.along.map(f64::from), seam.other_along.map(f64::from));
            let along = first + (along - from) / (to - from) * (last - first);
            OnEdge { sheet: *sheet, edge: usize::from(seam.other_edge), along: along.clamp(0.0, 1.0) }
        })
    }

    /// What the leaves at a place of an edge predict.
    fn at_edge(&self, edge: usize, along: f64) -> Predicted {
        let last = self.stop_before(edge, along);
        if along - last.along <= numbers::SAME {
            return self.predicted[&last.point];
        }
        if 1.0 - along <= numbers::SAME {
            return self.at_edge((edge + 1) % self.stops.len(), 0.0);
        }
        let corners = self.shape.corners();
        let place = corners[edge].lerp(corners[(edge + 1) % corners.len()], along);
        self.leaves[last.leaf].predicts(self.frame.plane(place))
    }
}

/// The places that are one with a place of an edge, over all seams there; itself among them, by sheet.
#[must_use]
pub fn around(sheets: &[Sheet], from: OnEdge) -> Vec<OnEdge> {
    let mut found = vec![from];
    let mut next = 0;
    while let Some(&OnEdge { sheet, edge, along }) = found.get(next) {
        next += 1;
        let n = sheets[sheet].shape.corners().len();
        let before = (along <= numbers::SAME).then_some(((edge + n - 1) % n, 1.0));
        let after = (along >= 1.0 - numbers::SAME).then_some(((edge + 1) % n, 0.0));
        for (edge, along) in [Some((edge, along)), before, after].into_iter().flatten() {
            for place in sheets[sheet].beyond(edge, along) {
                if found.iter().all(|known| known.sheet != place.sheet) {
                    found.push(place);
                }
            }
        }
    }
    found.sort_by_key(|place| place.sheet);
    found
}

/// The mean of what all leaves around such places predict, W/m2.
#[must_use]
pub fn mean(sheets: &[Sheet], places: &[OnEdge]) -> Rgb {
    let all = places.iter().map(|place| sheets[place.sheet].at_edge(place.edge, place.along));
    all.reduce(Predicted::plus).map_or(Rgb::BLACK, |predicted| predicted.mean())
}
