//! Direct light: rays from the places of an element to lamps, drawn by what each would bring if nothing stood in
//! between. What it would bring is known in closed form, so that rays tell of shadows alone.

use glam::{DMat3, DVec3};

use crate::base::{ClusterId, NodeName, PatchSide, Result, Rgb};
use crate::geom::bounds::Bounds;
use crate::geom::polygon::Polygon;
use crate::geom::quadtree;
use crate::rays::node::{Facet, Node};
use crate::rays::{RayEnd, RayScene};
use crate::transport::kernel::form_factor::point_to_polygon;
use crate::transport::nodes::places::{Draws, Places};
use crate::transport::numbers;
use crate::transport::row::{Share, slot};
use crate::transport::source::Clusters;

/// A side that emits.
#[derive(Clone)]
struct Lamp {
    name: NodeName,
    shape: Polygon,
    normal: DVec3,
    end: RayEnd,
    /// W/m2 (norm over RGB).
    exitance: f64,
    area_m2: f64,
}

/// Lamps that stand for one while rays are shared out.
#[derive(Clone, Copy)]
struct Bundle {
    centre: DVec3,
    radius_m: f64,
    /// What leaves it, W (norm over RGB).
    power_w: f64,
    /// Normals and their outer products, each times its lamp's power, summed up.
    normals: DVec3,
    squares: DMat3,
    /// The first of two children, or the lamp.
    below: Below,
}

#[derive(Clone, Copy)]
enum Below {
    Lamp(u32),
    Children(u32),
}

/// A light tree: lamps that are near each other lie together.
#[derive(Default)]
pub struct LightTree {
    lamps: Vec<Lamp>,
    /// The root first.
    bundles: Vec<Bundle>,
}

impl Lamp {
    /// Form factor from a point to it if nothing stands in between.
    fn unoccluded(&self, from: DVec3, normal: DVec3) -> f64 {
        if self.normal.dot(from - self.shape.corners()[0]) <= 0.0 {
            return 0.0;
        }
        point_to_polygon(from, normal, &self.shape)
    }
}

impl Bundle {
    fn of(lamp: &Lamp, index: u32) -> Self {
        let (centre, radius_m) = (lamp.shape.centre(), lamp.shape.radius());
        let power_w = lamp.area_m2 * lamp.exitance;
        let normals = lamp.normal * power_w;
        let squares = DMat3::from_cols(normals * lamp.normal.x, normals * lamp.normal.y, normals * lamp.normal.z);
        Self { centre, radius_m, power_w, normals, squares, below: Below::Lamp(index) }
    }

    fn both(a: &Self, b: &Self, children: u32) -> Self {
        let power_w = a.power_w + b.power_w;
        let centre = (a.centre * a.power_w + b.centre * b.power_w) / power_w;
        let reach = |of: &Self| of.centre.distance(centre) + of.radius_m;
        let (normals, squares) = (a.normals + b.normals, a.squares + b.squares);
        let radius_m = reach(a).max(reach(b));
        Self { centre, radius_m, power_w, normals, squares, below: Below::Children(children) }
    }

    /// Share of its power that goes a way, were all of it to go there: `max(0, n.d)` is `(n.d + |n.d|) / 2`, whose first
    /// term adds up over lamps, and whose second the mean square bounds.
    fn sends(&self, way: DVec3) -> f64 {
        let even = (way.dot(self.squares * way) / self.power_w).max(0.0).sqrt();
        0.5 * (self.normals.dot(way) / self.power_w + even)
    }

    /// What arrives at a point, roughly, if nothing stands in between, W/m2; 0 only where nothing can.
    fn expected(&self, from: DVec3, normal: DVec3) -> f64 {
        self.expected_around(from, 0.0, normal)
    }

    /// The same of all points around one.
    fn expected_around(&self, from: DVec3, around_m: f64, normal: DVec3) -> f64 {
        let between = self.centre - from;
        let radius_m = self.radius_m + around_m;
        let distance_m = between.length().max(radius_m);
        let slack = radius_m / distance_m;
        let cos_r = (normal.dot(between) / distance_m + slack).clamp(0.0, 1.0);
        let cos_s = (self.sends(-between / distance_m) + slack).clamp(0.0, 1.0);
        self.power_w * cos_r * cos_s / (std::f64::consts::PI * distance_m * distance_m)
    }
}

impl LightTree {
    /// The lamps of some clusters.
    pub fn of_clusters(clusters: &dyn Clusters, ids: &[ClusterId]) -> Result<Self> {
        let mut lamps = Vec::new();
        for &id in ids {
            let loaded = clusters.cluster(id)?;
            let view = loaded.view();
            for index in (0..view.materials.len()).filter(|i| view.takes_part(*i)) {
                let exitance = Rgb::from_f32(view.materials[index].exitance).norm_squared().sqrt();
                if exitance > 0.0 {
                    let at = PatchSide::from_index(index);
                    let Node { name, shape, normal, end } =
                        Node::root(id, &view.geometry.patches[usize::from(at.patch)], at);
                    lamps.push(Lamp { name, shape, normal, end, exitance, area_m2: shape.area() });
                }
            }
        }
        let mut tree = Self::default();
        let mut order: Vec<Bundle> = lamps.iter().enumerate().map(|(i, l)| Bundle::of(l, i as u32)).collect();
        tree.lamps = lamps;
        if let Some(first) = order.first() {
            tree.bundles.push(*first);
            tree.build(0, &mut order);
        }
        Ok(tree)
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lamps.is_empty()
    }

    /// Bytes that it takes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(self.lamps.as_slice()) + size_of_val(self.bundles.as_slice())
    }

    fn build(&mut self, at: usize, lamps: &mut [Bundle]) {
        if let [only] = lamps {
            self.bundles[at] = *only;
            return;
        }
        let extent = lamps.iter().fold(Bounds::EMPTY, |all, lamp| all.with(lamp.centre)).size();
        let axis = (0..3).fold(0, |widest, axis| if extent[axis] > extent[widest] { axis } else { widest });
        // Stable: lamps come in the order of their names.
        lamps.sort_by(|a, b| a.centre[axis].total_cmp(&b.centre[axis]));
        let (left, right) = lamps.split_at_mut(lamps.len() / 2);
        let children = self.bundles.len();
        self.bundles.extend([left[0], right[0]]);
        self.build(children, left);
        self.build(children + 1, right);
        self.bundles[at] = Bundle::both(&self.bundles[children], &self.bundles[children + 1], children as u32);
    }

    /// What rays from points of a plane, up to so far around one, are shared out among.
    #[must_use]
    pub fn candidates(&self, centre: DVec3, around_m: f64, normal: DVec3) -> Candidates {
        let mut candidates = Vec::with_capacity(numbers::CANDIDATES);
        let expected = |at: u32| self.bundles[at as usize].expected_around(centre, around_m, normal);
        let mut open: Vec<(f64, u32)> = Vec::with_capacity(numbers::CANDIDATES);
        if !self.is_empty() {
            open.push((expected(0), 0));
        }
        while let Some((brings, at)) = open.pop() {
            match self.bundles[at as usize].below {
                _ if brings == 0.0 => {}
                Below::Children(first) if candidates.len() + open.len() + 1 < numbers::CANDIDATES => {
                    for child in [first, first + 1] {
                        let brings = expected(child);
                        // Those that bring most last: they are opened first.
                        let place = open.partition_point(|(other, _)| *other <= brings);
                        open.insert(place, (brings, child));
                    }
                }
                Below::Children(_) | Below::Lamp(_) => candidates.push(at),
            }
        }
        Candidates(candidates)
    }

    /// How rays from a point are shared out; `None` if no lamp can be seen.
    #[must_use]
    pub fn aim(&self, from: DVec3, normal: DVec3) -> Option<Aim> {
        self.aim_among(&self.candidates(from, 0.0, normal), from, normal)
    }

    /// The same, of many points near each other.
    #[must_use]
    pub fn aim_among(&self, candidates: &Candidates, from: DVec3, normal: DVec3) -> Option<Aim> {
        let mut aim = Aim { among: Vec::with_capacity(numbers::CANDIDATES), sum: 0.0 };
        let mut open: Vec<u32> = candidates.0.iter().rev().copied().collect();
        while let Some(at) = open.pop() {
            let bundle = &self.bundles[at as usize];
            match bundle.below {
                Below::Lamp(lamp) => aim.add(self.brings(bundle, lamp, from, normal), at),
                Below::Children(first) if bundle.radius_m >= LARGE * bundle.centre.distance(from) => {
                    open.extend([first, first + 1]);
                }
                Below::Children(_) => aim.add(bundle.expected(from, normal), at),
            }
        }
        (aim.sum > 0.0).then_some(aim)
    }

    /// Casts a ray from a place by four numbers in 0..1. Gives the lamp that it reached, and the
    /// irradiance that it stands for at an exitance of 1, were it the only ray. Counts it.
    pub fn reach(
        &self,
        scene: &RayScene<'_>,
        aim: &Aim,
        &Facet { place, normal, on }: &Facet<'_>,
        [x, u, v, choice]: [f64; 4],
        rays: &mut u64,
    ) -> Option<(NodeName, f64)> {
        let (lamp, brings) = self.draw(aim, place, normal, x)?;
        let to = place_of(lamp, place, normal, [u, v], choice);
        *rays += 1;
        let is_free = !scene.blocked(place, to, on, &lamp.end);
        is_free.then(|| (lamp.name, brings / lamp.exitance))
    }

    /// What a lamp would bring, W/m2.
    fn brings(&self, bundle: &Bundle, lamp: u32, from: DVec3, normal: DVec3) -> f64 {
        let lamp = &self.lamps[lamp as usize];
        let between = bundle.centre - from;
        let distance_m = between.length();
        let (up, down) = (normal.dot(between), -lamp.normal.dot(between));
        if bundle.radius_m < numbers::SMALL_LAMP * distance_m && up > bundle.radius_m && down > 0.0 {
            let squared = distance_m * distance_m;
            return bundle.power_w * up * down / (std::f64::consts::PI * squared * squared);
        }
        lamp.unoccluded(from, normal) * lamp.exitance
    }

    /// A lamp by a number in 0..1, and what it brings if nothing stands in between relative to the probability that it
    /// is drawn, W/m2.
    fn draw(&self, aim: &Aim, from: DVec3, normal: DVec3, x: f64) -> Option<(&Lamp, f64)> {
        let target = x * aim.sum;
        let index = aim.among.partition_point(|(upto, _)| *upto <= target).min(aim.among.len() - 1);
        let before = if index > 0 { aim.among[index - 1].0 } else { 0.0 };
        let own = aim.among[index].0 - before;
        let mut rest = ((target - before) / own).clamp(0.0, BELOW_ONE);
        let mut probability = own / aim.sum;
        let mut bundle = &self.bundles[aim.among[index].1 as usize];
        if let Below::Lamp(lamp) = bundle.below {
            return Some((&self.lamps[lamp as usize], aim.sum));
        }
        loop {
            match bundle.below {
                Below::Lamp(lamp) => {
                    let brings = self.brings(bundle, lamp, from, normal);
                    return (brings > 0.0).then(|| (&self.lamps[lamp as usize], brings / probability));
                }
                Below::Children(first) => {
                    let children = [first, first + 1].map(|at| &self.bundles[at as usize]);
                    let [one, two] = children.map(|child| child.expected(from, normal));
                    if one + two == 0.0 {
                        return None;
                    }
                    let of_first = one / (one + two);
                    let (share, left, next) = if rest < of_first {
                        (of_first, rest / of_first, children[0])
                    } else {
                        (1.0 - of_first, (rest - of_first) / (1.0 - of_first), children[1])
                    };
                    (probability, rest, bundle) = (probability * share, left.clamp(0.0, BELOW_ONE), next);
                }
            }
        }
    }
}

/// Size, in distances, above which a lamp is cut into parts before a place of it is drawn, and a bundle into what is below it.
const LARGE: f64 = numbers::MOST_CELLS as f64 * numbers::ALIKE;

/// The largest number below 1.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON;

/// Lamps and bundles that together stand for all.
pub struct Candidates(Vec<u32>);

/// Lamps and bundles that rays from a point are shared out among, by what each brings.
pub struct Aim {
    /// What they bring, summed up, W/m2, each with its bundle.
    among: Vec<(f64, u32)>,
    sum: f64,
}

impl Aim {
    fn add(&mut self, brings: f64, bundle: u32) {
        if brings > 0.0 {
            self.sum += brings;
            self.among.push((self.sum, bundle));
        }
    }
}

/// A place of a lamp by numbers in 0..1, drawn by what it brings, so that shadows count by what they take: in one of
/// the cells of a grid whose points bring about alike. What is too large for that is cut into parts before.
fn place_of(lamp: &Lamp, from: DVec3, normal: DVec3, [u, v]: [f64; 2], choice: f64) -> DVec3 {
    let (mut part, mut rest) = (lamp.shape, choice);
    let (mut size, least_m2) = (part.radius() / part.centre().distance(from), numbers::NOTHING * lamp.area_m2);
    while size > LARGE && part.area() > least_m2 {
        let children: [Polygon; 4] = std::array::from_fn(|q| quadtree::child(&part, q as u32));
        let brings = children.each_ref().map(|child| point_to_polygon(from, normal, child));
        let Some(chosen) = choose(&brings, &mut rest) else { break };
        part = children[chosen];
        size = part.radius() / part.centre().distance(from);
    }
    let horizon = normal.dot(from);
    if part.corners().iter().any(|c| normal.dot(*c) < horizon) {
        part = part.clip(normal, horizon);
    }
    if part.corners().len() < 3 {
        return lamp.shape.centre();
    }
    let across = (size / numbers::ALIKE).ceil().clamp(1.0, numbers::MOST_CELLS as f64) as usize;
    if across == 1 {
        return part.even_point(u, v);
    }
    // What corners of the cells bring; in a cell it is taken for bilinear.
    let step = 1.0 / across as f64;
    let edges = match *part.corners() {
        [origin, right, _, up] if !part.is_skew() => Some((origin, (right - origin) * step, (up - origin) * step)),
        _ => None,
    };
    let place = |i: f64, j: f64| match edges {
        Some((origin, right, up)) => origin + right * i + up * j,
        None => part.even_point(i * step, j * step),
    };
    let mut corners = [[0.0; numbers::MOST_CELLS + 1]; numbers::MOST_CELLS + 1];
    for (j, row) in corners[..=across].iter_mut().enumerate() {
        for (i, brings) in row[..=across].iter_mut().enumerate() {
            let between = place(i as f64, j as f64) - from;
            let cosines = normal.dot(between).max(0.0) * (-lamp.normal.dot(between)).max(0.0);
            *brings = cosines / between.length_squared().powi(2).max(f64::MIN_POSITIVE);
        }
    }
    let mut cells = [0.0; numbers::MOST_CELLS * numbers::MOST_CELLS];
    for (cell, brings) in cells[..across * across].iter_mut().enumerate() {
        let (i, j) = (cell % across, cell / across);
        *brings = corners[j][i] + corners[j][i + 1] + corners[j + 1][i] + corners[j + 1][i + 1];
    }
    let cell = choose(&cells[..across * across], &mut rest).unwrap_or(0);
    let (i, j) = (cell % across, cell / across);
    let [low, high] = [&corners[j], &corners[j + 1]];
    let v = by_line(low[i] + low[i + 1], high[i] + high[i + 1], v);
    let at = |k: usize| low[k] + (high[k] - low[k]) * v;
    let u = by_line(at(i), at(i + 1), u);
    place(i as f64 + u, j as f64 + v)
}

/// A number in 0..1 whose density goes from one value to another along a line, by an even one.
fn by_line(from: f64, to: f64, number: f64) -> f64 {
    let (sum, difference) = (from + to, to - from);
    if difference.abs() <= numbers::NOTHING_STORED * sum {
        return number;
    }
    (((from * from + sum * difference * number).max(0.0).sqrt() - from) / difference).clamp(0.0, BELOW_ONE)
}

/// The index of one of several by what each brings and a number in 0..1, of which another is left; `None` if all bring
/// nothing.
fn choose(brings: &[f64], number: &mut f64) -> Option<usize> {
    let sum: f64 = brings.iter().sum();
    if sum <= 0.0 {
        return None;
    }
    let (mut left, mut chosen) = (*number * sum, 0);
    while chosen + 1 < brings.len() && left >= brings[chosen] {
        left -= brings[chosen];
        chosen += 1;
    }
    *number = (left / brings[chosen].max(f64::MIN_POSITIVE)).clamp(0.0, BELOW_ONE);
    Some(chosen)
}

/// What rays found, and how many were cast.
pub struct Cast {
    /// Lamps that were reached.
    pub shares: Vec<Share>,
    /// Rays.
    pub rays: u64,
}

/// Casts the rays of some rounds to lamps: one of each half from each open place.
#[must_use]
pub fn cast(
    scene: &RayScene<'_>,
    tree: &LightTree,
    node: &Node,
    places: &Places,
    draws: &Draws,
    rounds: std::ops::Range<u16>,
) -> Cast {
    let mut cast = Cast { shares: Vec::new(), rays: 0 };
    if tree.is_empty() {
        return cast;
    }
    let candidates = tree.candidates(node.shape.centre(), node.shape.radius(), node.normal);
    for round in rounds {
        for place in places.each() {
            let from = places.at(place, round);
            let Some(aim) = tree.aim_among(&candidates, from, node.normal) else { continue };
            for half in 0..2 {
                let numbers = draws.draw(half, place, u32::from(round));
                if let Some((lamp, factor)) = tree.reach(scene, &aim, &node.facet(from), numbers, &mut cast.rays) {
                    cast.shares.push(Share {
                        lamp,
                        slot: slot(place, half),
                        round: round as u8,
                        factor: factor as f32,
                    });
                }
            }
        }
    }
    cast
}
