//! The light that a version stores, at any place of a patch side: what export, pictures, `sample --stored` and the checks
//! of a visit read.
//!
//! At corners it is the mean of what the leaves around predict, in a leaf it lies between its corners. What leaves miss of
//! their means then is predicted beside their lines, once, within what these reach: between corners light would be too
//! bright where it is dim beside what is bright. Over the side it has the mean that is stored. A corner on an edge of a
//! larger leaf has what lies on that edge. It reads across patches where seams say that nothing stands between them, so
//! never through walls.

use std::rc::Rc;

use glam::DVec3;
use hashbrown::HashMap;

use crate::base::{NodeName, PatchSide, Rgb};
use crate::geom::grid::{GridPoint, element_corners, places_on_edges};
use crate::geom::polygon::Polygon;
use crate::geom::triangulation::triangles;
use crate::model::geometry::GeometryView;
use crate::transport::light::line::Line;
use crate::transport::light::sheet::{OnEdge, Sheet, SheetLeaf, around, mean};
use crate::transport::numbers;

/// The irradiance over a patch side, and over the parts of its face that light goes on to.
pub struct SideLight {
    /// By patch.
    sheets: Vec<Smooth>,
}

/// Sides of a cluster as they are asked for, those that are joined built once.
#[derive(Default)]
pub struct SideLights {
    joined: HashMap<PatchSide, Rc<SideLight>>,
}

impl SideLights {
    /// As [`SideLight::new`]; always the same cluster's.
    pub fn of(
        &mut self,
        geometry: &GeometryView<'_>,
        at: PatchSide,
        leaves: impl Fn(PatchSide) -> Vec<(NodeName, Line)>,
    ) -> Rc<SideLight> {
        if let Some(known) = self.joined.get(&at) {
            return Rc::clone(known);
        }
        let light = Rc::new(SideLight::new(geometry, at, leaves));
        if light.sheets.len() > 1 {
            self.joined.extend(light.sides(at).map(|side| (side, Rc::clone(&light))));
        }
        light
    }
}

/// The irradiance over one of them.
struct Smooth {
    patch: u8,
    shape: Polygon,
    corners: HashMap<GridPoint, Rgb>,
    /// Corners of leaves beyond a seam: on which edge, how far along, and the light there, W/m2.
    beyond: Vec<(usize, f64, Rgb)>,
}

/// A corner of a leaf, or of smaller leaves on its edge.
#[derive(Clone, Copy)]
pub struct Vertex {
    /// Where, if leaves of the same patch have it.
    pub point: Option<GridPoint>,
    /// The place, m.
    pub place: DVec3,
    /// W/m2.
    pub light: Rgb,
}

/// What lies between two corners of a leaf's edge: how far along it, as a share, where on the grid, W/m2.
type Between = (f64, Option<GridPoint>, Rgb);

impl SideLight {
    /// Of a side and those it is joined to; `leaves` of each, in any order that is always the same.
    #[must_use]
    pub fn new(
        geometry: &GeometryView<'_>,
        at: PatchSide,
        leaves: impl Fn(PatchSide) -> Vec<(NodeName, Line)>,
    ) -> Self {
        let patches = geometry.joined(at);
        let sheet = |patch: &u8| {
            let of = PatchSide { patch: *patch, ..at };
            Sheet::new(*patch, &geometry.patches[usize::from(*patch)], &leaves(of))
        };
        let mut sheets: Vec<Sheet> = patches.iter().map(sheet).collect();
        for sheet in &mut sheets {
            let open = geometry.seams_of(sheet.patch.into()).iter().filter(|s| s.sides >> at.side & 1 == 1);
            sheet.join(&open.copied().collect::<Vec<_>>(), |patch| patches.binary_search(&patch).ok());
        }
        let once = predicted(&sheets);
        for (sheet, once) in sheets.iter_mut().zip(&once) {
            sheet.make_up(|leaf| leaf.line.mean - once.flux(leaf) * (1.0 / leaf.area_m2));
        }
        let mut smooth = predicted(&sheets);
        let (mut stored, mut between) = (Rgb::BLACK, Rgb::BLACK);
        for (smooth, sheet) in smooth.iter().zip(&sheets) {
            for leaf in &sheet.leaves {
                (stored, between) = (stored + leaf.line.mean * leaf.area_m2, between + smooth.flux(leaf));
            }
        }
        let kept = Rgb(std::array::from_fn(|c| if between.0[c] > 0.0 { stored.0[c] / between.0[c] } else { 1.0 }));
        smooth.iter_mut().for_each(|smooth| smooth.scale(kept));
        Self { sheets: smooth }
    }

    /// The sides it covers; `at`: one of them.
    pub fn sides(&self, at: PatchSide) -> impl Iterator<Item = PatchSide> + '_ {
        self.sheets.iter().map(move |sheet| PatchSide { patch: sheet.patch, ..at })
    }

    /// Corners of leaves on one of them.
    #[must_use]
    pub fn corners_of(&self, side: PatchSide) -> usize {
        let sheet = self.sheet(side.patch);
        sheet.corners.len() + sheet.beyond.len()
    }

    fn sheet(&self, patch: u8) -> &Smooth {
        let at = self.sheets.binary_search_by_key(&patch, |sheet| sheet.patch);
        &self.sheets[at.expect("one of these patches")]
    }

    /// The corners of a leaf, and those that smaller leaves have on its edges, in the winding of the front; with triangles
    /// between them if there are such. `shape`: the leaf's, in that winding.
    #[must_use]
    pub fn outline(&self, leaf: NodeName, shape: &Polygon) -> (Vec<Vertex>, Vec<[usize; 3]>) {
        let sheet = self.sheet(leaf.patch_side().patch);
        let (points, count) = element_corners(&sheet.shape, leaf.path());
        sheet.outline(&points[..count], shape)
    }

    /// The light at a point of a leaf, W/m2. `shape`: the leaf's, in the winding of the front.
    #[must_use]
    pub fn at(&self, leaf: NodeName, shape: &Polygon, point: DVec3) -> Rgb {
        let (outline, triangles) = self.outline(leaf, shape);
        let between = |weights: &mut dyn Iterator<Item = (f64, usize)>| {
            weights.fold(Rgb::BLACK, |sum, (weight, i)| sum + outline[i].light * weight)
        };
        let in_triangle = |triangle: [usize; 3]| (area_weights(triangle.map(|i| outline[i].place), point), triangle);
        let least = |weights: [f64; 3]| weights.into_iter().fold(f64::INFINITY, f64::min);
        match triangles.into_iter().map(in_triangle).reduce(|a, b| if least(b.0) > least(a.0) { b } else { a }) {
            Some((weights, triangle)) => between(&mut weights.into_iter().zip(triangle)),
            None => between(&mut mean_value_weights(shape.corners(), point).into_iter().zip(0..outline.len())),
        }
    }
}

/// What leaves predict together, sheet by sheet.
fn predicted(sheets: &[Sheet]) -> Vec<Smooth> {
    let mut smooth: Vec<Smooth> = sheets.iter().map(Smooth::of).collect();
    for sheet in 0..sheets.len() {
        for (edge, along, point) in sheets[sheet].on_edges() {
            let places = around(sheets, OnEdge { sheet, edge, along });
            if places.len() == 1 {
                continue;
            }
            let light = mean(sheets, &places);
            smooth[sheet].corners.insert(point, light);
            let elsewhere = |p: &&OnEdge| p.sheet != sheet && !sheets[p.sheet].has_corner(p.edge, p.along);
            for place in places.iter().filter(elsewhere) {
                smooth[place.sheet].beyond.push((place.edge, place.along, light));
            }
        }
    }
    smooth.iter_mut().zip(sheets).for_each(|(smooth, sheet)| smooth.settle(&sheet.leaves));
    smooth
}

impl Smooth {
    fn of(sheet: &Sheet) -> Self {
        Self { patch: sheet.patch, shape: sheet.shape, corners: sheet.means(), beyond: Vec::new() }
    }

    fn at(&self, point: GridPoint) -> Rgb {
        self.corners.get(&point).copied().unwrap_or(Rgb::BLACK)
    }

    /// Once all values are there.
    fn settle(&mut self, leaves: &[SheetLeaf]) {
        self.beyond.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        self.beyond.dedup_by(|later, kept| later.0 == kept.0 && later.1 - kept.1 <= numbers::SAME);
        let mut order: Vec<&SheetLeaf> = leaves.iter().collect();
        order.sort_by_key(|leaf| leaf.depth);
        for SheetLeaf { points, count, .. } in order {
            (0..*count).for_each(|i| self.straighten(points[i], points[(i + 1) % count]));
        }
    }

    /// Puts corners of smaller leaves that lie between two corners of a leaf's edge on the line between these.
    fn straighten(&mut self, from: GridPoint, to: GridPoint) {
        let middle = [0, 1].map(|i| (from[i] + to[i]) / 2);
        if middle == from || middle == to || !self.corners.contains_key(&middle) {
            return;
        }
        let value = (self.corners[&from] + self.corners[&to]) * 0.5;
        self.corners.insert(middle, value);
        self.straighten(from, middle);
        self.straighten(middle, to);
    }

    fn between(&self, from: GridPoint, to: GridPoint) -> Vec<Between> {
        let mut found = Vec::new();
        self.collect_between([(from, 0.0), (to, 1.0)], &mut found);
        if !self.beyond.is_empty() {
            self.collect_beyond(from, to, &mut found);
        }
        found
    }

    fn collect_between(&self, [from, to]: [(GridPoint, f64); 2], found: &mut Vec<Between>) {
        let middle = [0, 1].map(|i| (from.0[i] + to.0[i]) / 2);
        let along = 0.5 * (from.1 + to.1);
        if let Some(light) = self.corners.get(&middle).filter(|_| middle != from.0 && middle != to.0) {
            self.collect_between([from, (middle, along)], found);
            found.push((along, Some(middle), *light));
            self.collect_between([(middle, along), to], found);
        }
    }

    fn collect_beyond(&self, from: GridPoint, to: GridPoint, found: &mut Vec<Between>) {
        let ends = |edge: usize| {
            let on = |point| places_on_edges(&self.shape, point).find(|place| place.0 == edge);
            Some([on(from)?.1, on(to)?.1])
        };
        let Some((edge, [from, to])) = (0..4).find_map(|edge| Some((edge, ends(edge)?))) else { return };
        let first = self.beyond.partition_point(|other| other.0 < edge);
        let on_edge = self.beyond[first..].iter().take_while(|other| other.0 == edge);
        let inside =
            on_edge.map(|(_, at, light)| ((at - from) / (to - from), *light)).filter(|b| b.0 > 0.0 && b.0 < 1.0);
        let first = found.len();
        found.extend(inside.map(|(along, light)| (along, None, light)));
        found[first..].sort_by(|a, b| a.0.total_cmp(&b.0));
    }

    fn outline(&self, points: &[GridPoint], shape: &Polygon) -> (Vec<Vertex>, Vec<[usize; 3]>) {
        let (n, corners) = (points.len(), shape.corners());
        let mut outline = Vec::with_capacity(n);
        for (i, &point) in points.iter().enumerate() {
            outline.push(Vertex { point: Some(point), place: corners[i], light: self.at(point) });
            let place = |along: f64| corners[i].lerp(corners[(i + 1) % n], along);
            let between = self.between(point, points[(i + 1) % n]);
            outline.extend(between.into_iter().map(|(along, point, light)| Vertex {
                point,
                place: place(along),
                light,
            }));
        }
        let places: Vec<DVec3> = if outline.len() > n { outline.iter().map(|v| v.place).collect() } else { Vec::new() };
        (outline, triangles(&places))
    }

    /// The integral over a leaf, W.
    fn flux(&self, leaf: &SheetLeaf) -> Rgb {
        let (outline, triangles) = self.outline(&leaf.points[..leaf.count], &leaf.shape);
        let mean =
            |of: &[usize]| of.iter().fold(Rgb::BLACK, |sum, &i| sum + outline[i].light) * (1.0 / of.len() as f64);
        if triangles.is_empty() {
            return mean(&[0, 1, 2, 3][..leaf.count]) * leaf.area_m2;
        }
        let doubled_m2 = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length();
        let of_triangle = |of: &[usize; 3]| mean(of) * (0.5 * doubled_m2(of.map(|i| outline[i].place)));
        triangles.iter().map(of_triangle).fold(Rgb::BLACK, |sum, part| sum + part)
    }

    fn scale(&mut self, by: Rgb) {
        self.corners.values_mut().for_each(|light| *light = light.times(by));
        self.beyond.iter_mut().for_each(|(.., light)| *light = light.times(by));
    }
}

/// Barycentric coordinates of a point in a triangle's plane; one is below 0 outside, and in a line of three points.
fn area_weights([a, b, c]: [DVec3; 3], point: DVec3) -> [f64; 3] {
    let normal = (b - a).cross(c - a);
    let doubled = normal.length_squared();
    if doubled == 0.0 {
        return [-1.0; 3];
    }
    let share = |from: DVec3, to: DVec3| (to - from).cross(point - from).dot(normal) / doubled;
    [share(b, c), share(c, a), share(a, b)]
}

/// Mean value coordinates of a point of a convex polygon: at most four corners, adding up to 1.
///
/// Source: Floater 2003, "Mean value coordinates".
fn mean_value_weights(corners: &[DVec3], point: DVec3) -> [f64; 4] {
    let n = corners.len();
    let scale = corners.iter().map(|c| c.distance(point)).fold(0.0, f64::max);
    let mut weights = [0.0; 4];
    let half_tangent = |a: DVec3, b: DVec3| {
        let (la, lb) = (a.length(), b.length());
        a.cross(b).length() / (la * lb + a.dot(b)).max(numbers::NOTHING * la * lb)
    };
    for i in 0..n {
        let to = corners[i] - point;
        let next = corners[(i + 1) % n] - point;
        if to.cross(next).length() <= numbers::NOTHING * to.length() * next.length() && to.dot(next) < 0.0 {
            // On an edge.
            let sum = to.length() + next.length();
            weights = [0.0; 4];
            (weights[i], weights[(i + 1) % n]) = (next.length() / sum, to.length() / sum);
            return weights;
        }
        if to.length() <= numbers::NOTHING * scale {
            weights = [0.0; 4];
            weights[i] = 1.0;
            return weights;
        }
        let (before, after) = (corners[(i + n - 1) % n] - point, corners[(i + 1) % n] - point);
        weights[i] = (half_tangent(before, to) + half_tangent(to, after)) / to.length();
    }
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ClusterId;
    use crate::geom::quadtree::{child_at, element_polygon};
    use crate::model::geometry::{ClusterHead, PatchRecord, Seam};
    use bytemuck::Zeroable;

    /// A rectangle from x = `from` to `to` and y = 0 to 1.
    fn rectangle(from: f32, to: f32) -> PatchRecord {
        let mut patch = PatchRecord::zeroed();
        patch.corners_m = [[from, 0.0, 0.0], [to, 0.0, 0.0], [to, 1.0, 0.0], [from, 1.0, 0.0]];
        (patch.corner_count, patch.sides) = (4, 3);
        patch
    }

    fn constant(of: f64) -> Line {
        Line { mean: Rgb::grey(of), ..Line::default() }
    }

    fn root(patch: u8) -> NodeName {
        NodeName::root(ClusterId(0), PatchSide { patch, side: 0 })
    }

    type Leaves = Vec<(NodeName, Line)>;

    /// Patches with their leaves.
    struct Model {
        patches: Vec<PatchRecord>,
        seams: Vec<Seam>,
        leaves: Vec<Leaves>,
    }

    impl Model {
        fn light(&self, at: u8) -> SideLight {
            let head = ClusterHead::zeroed();
            let (patches, seams) = (&self.patches[..], &self.seams[..]);
            let geometry = GeometryView { head: &head, patches, seams };
            SideLight::new(&geometry, root(at).patch_side(), |side| self.leaves[usize::from(side.patch)].clone())
        }

        fn at(&self, light: &SideLight, patch: u8, point: DVec3) -> f64 {
            let record = &self.patches[usize::from(patch)];
            let mut leaf = root(patch);
            while !self.leaves[usize::from(patch)].iter().any(|(name, _)| *name == leaf) {
                leaf = leaf.child(child_at(&element_polygon(record, leaf.path()), point));
            }
            light.at(leaf, &element_polygon(record, leaf.path()), point).0[0]
        }

        /// What is stored over all patches, and what lies between corners.
        fn fluxes(&self, light: &SideLight) -> [f64; 2] {
            let n = 64;
            let mut sums = [0.0; 2];
            for (number, (record, leaves)) in self.patches.iter().zip(&self.leaves).enumerate() {
                let shape = element_polygon(record, 1);
                let area = |leaf: &(NodeName, Line)| element_polygon(record, leaf.0.path()).area();
                sums[0] += leaves.iter().map(|leaf| leaf.1.mean.0[0] * area(leaf)).sum::<f64>();
                let [a, b, _, d] = [0, 1, 2, 3].map(|i| shape.corners()[i]);
                let share = |i: u32| (f64::from(i) + 0.5) / f64::from(n);
                let place = |i: u32| a + (b - a) * share(i % n) + (d - a) * share(i / n);
                let sum: f64 = (0..n * n).map(|i| self.at(light, number as u8, place(i))).sum();
                sums[1] += sum / f64::from(n * n) * shape.area();
            }
            sums
        }
    }

    fn square(leaves: Leaves) -> Model {
        Model { patches: vec![rectangle(0.0, 1.0)], seams: Vec::new(), leaves: vec![leaves] }
    }

    fn quarters(of: NodeName, values: [f64; 4]) -> Leaves {
        values.into_iter().enumerate().map(|(q, value)| (of.child(q as u32), constant(value))).collect()
    }

    #[test]
    fn a_corner_has_the_mean_of_the_leaves_that_meet_there_within_what_they_reach() {
        let model = square(quarters(root(0), [1.0, 2.0, 3.0, 4.0]));
        let light = model.light(0);
        assert!((model.at(&light, 0, DVec3::new(1.0, 1.0, 0.0)) - 3.0).abs() < 1e-12, "alone, whatever it misses");
        assert!((model.at(&light, 0, DVec3::new(0.5, 0.5, 0.0)) - 2.5).abs() < 1e-12, "of all four");
    }

    /// Light that fades by a factor of 2.7 from leaf to leaf, each with the line of its middle.
    #[test]
    fn what_leaves_miss_of_their_means_is_made_up_for() {
        let record = rectangle(0.0, 1.0);
        let of_leaf = |name: NodeName| {
            let x = element_polygon(&record, name.path()).centroid().x;
            let mean = (4.0 * x).exp();
            (name, Line { mean: Rgb::grey(mean), along: [Rgb::grey(4.0 * mean), Rgb::BLACK] })
        };
        let leaves: Leaves = (0..16).map(|i| of_leaf(root(0).child(i / 4).child(i % 4))).collect();
        let sheet = Sheet::new(0, &record, &leaves);
        let missed = |smooth: &Smooth| -> f64 {
            let of = |leaf: &SheetLeaf| (leaf.line.mean * leaf.area_m2 - smooth.flux(leaf)).0[0].abs();
            sheet.leaves.iter().map(of).sum()
        };
        let (plain, light) = (missed(&predicted(std::slice::from_ref(&sheet))[0]), square(leaves.clone()).light(0));
        let made_up = missed(&light.sheets[0]);
        assert!(made_up < 0.75 * plain, "{made_up} of {plain}");
    }

    #[test]
    fn light_is_continuous_where_a_small_leaf_meets_a_large_one_and_keeps_its_mean() {
        let mut leaves = quarters(root(0), [0.0, 1.0, 2.0, 3.0]);
        leaves.splice(..1, quarters(root(0).child(0), [8.0, 9.0, 12.0, 17.0]));
        let model = square(leaves);
        let light = model.light(0);
        for y in [0.05, 0.2, 0.25, 0.3, 0.45] {
            let [left, right] = [-1e-12, 1e-12].map(|x| model.at(&light, 0, DVec3::new(0.5 + x, y, 0.0)));
            assert!((left - right).abs() < 1e-9, "{left} and {right} at {y}");
        }
        let [stored, between] = model.fluxes(&light);
        assert!((between / stored - 1.0).abs() < 1e-3, "{between} for {stored}");
    }

    /// Two rectangles side by side that meet from y = `from` to `to`; the right one has smaller leaves at the bottom.
    fn two(from: f32, to: f32) -> Model {
        let along = [from, to];
        let seam = Seam {
            patch: 0,
            other: 1,
            edge: 1,
            other_edge: 3,
            sides: 1,
            reserved: 0,
            along,
            other_along: [1.0 - from, 1.0 - to],
        };
        let mut right = quarters(root(1), [5.0, 1.0, 2.0, 7.0]);
        right.splice(..1, quarters(root(1).child(0), [8.0, 9.0, 12.0, 17.0]));
        Model {
            patches: vec![rectangle(0.0, 1.0), rectangle(1.0, 1.6)],
            seams: vec![seam, seam.turned()],
            leaves: vec![quarters(root(0), [0.0, 3.0, 2.0, 3.0]), right],
        }
    }

    fn jump(model: &Model, y: f64) -> f64 {
        let lights = [model.light(0), model.light(1)];
        let [left, right] = [0, 1].map(|i| model.at(&lights[i], i as u8, DVec3::new(1.0, y, 0.0)));
        (left - right).abs()
    }

    #[test]
    fn light_is_continuous_over_a_seam_and_keeps_its_mean() {
        let model = two(0.0, 1.0);
        for y in [0.0, 0.05, 0.2, 0.25, 0.3, 0.45, 0.5, 0.7, 1.0] {
            assert!(jump(&model, y) < 1e-9, "{} at {y}", jump(&model, y));
        }
        let [stored, between] = model.fluxes(&model.light(0));
        assert!((between / stored - 1.0).abs() < 1e-3, "{between} for {stored}");
    }

    #[test]
    fn light_is_not_read_past_the_end_of_a_seam_nor_on_the_side_on_which_it_is_closed() {
        let model = two(0.5, 1.0);
        for (y, is_one) in [(0.1, false), (0.3, false), (0.6, true), (0.9, true)] {
            assert_eq!(jump(&model, y) < 1e-9, is_one, "at {y}: {}", jump(&model, y));
        }
        let mut closed = two(0.0, 1.0);
        closed.seams.iter_mut().for_each(|seam| seam.sides = 2);
        assert_eq!(closed.light(0).sides(root(0).patch_side()).count(), 1);
        assert!(jump(&closed, 0.3) > 1.0);
    }

    #[test]
    fn no_point_lies_in_a_triangle_that_is_a_line() {
        let line = [DVec3::ZERO, DVec3::X, DVec3::X];
        assert!(area_weights(line, DVec3::X * 0.5).into_iter().all(|weight| weight < 0.0));
    }

    #[test]
    fn mean_value_weights_reproduce_the_point() {
        let c = [DVec3::ZERO, DVec3::new(3.0, 0.0, 0.0), DVec3::new(2.0, 2.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
        for p in [DVec3::new(1.0, 0.5, 0.0), DVec3::new(0.1, 0.1, 0.0), c[2], DVec3::new(1.2, 0.0, 0.0)] {
            let w = mean_value_weights(&c, p);
            let back = (0..4).fold(DVec3::ZERO, |s, i| s + c[i] * w[i]);
            assert!((back - p).length() < 1e-9, "{back} for {p}");
        }
    }
}
