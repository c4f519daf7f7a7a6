//! Lamps as rays are aimed at them: each is drawn by what it would bring if nothing stood in between.

use std::collections::HashMap;
use std::rc::Rc;

use glam::DVec3;

use super::bundle::{Bundle, SideCache};
use super::lamps;
use super::source::{ClusterView, Clusters};
use crate::base::{ClusterId, NodeName, Result};
use crate::geom::polygon::Polygon;
use crate::rays::node::Node;

/// A lamp, as far as aiming asks.
#[derive(Clone, Copy, Debug)]
pub struct Lamp {
    /// Its name: a sector node or a patch side.
    pub name: NodeName,
    centre: DVec3,
    radius_m: f64,
    /// What leaves it, W (norm over RGB).
    power_w: f64,
    /// Mean normal, and the largest difference of a side's normal from it.
    normal: DVec3,
    normals_differ: f64,
    /// W/m2 (norm over RGB).
    pub exitance: f64,
    /// Distance below which a side of it is close, m.
    close_m: f64,
}

impl Lamp {
    /// Of a bundle whose sides all have that exitance.
    #[must_use]
    pub fn new(bundle: &Bundle, exitance: f64) -> Self {
        let sides = || bundle.sides().iter();
        let normal = sides().fold(DVec3::ZERO, |sum, s| sum + s.node.normal * s.area_m2) / bundle.area_m2;
        let normals_differ = sides().map(|s| s.node.normal.distance(normal)).fold(0.0, f64::max);
        let Bundle { name, centre, radius_m, area_m2, .. } = *bundle;
        let close_m = sides().map(|s| (CLOSE * s.area_m2).sqrt()).fold(0.0, f64::max);
        Self { name, centre, radius_m, power_w: area_m2 * exitance, normal, normals_differ, exitance, close_m }
    }

    /// Two as one that stands for both while rays are shared out.
    fn both(a: &Self, b: &Self) -> Self {
        let power_w = a.power_w + b.power_w;
        let mean = |of: fn(&Self) -> DVec3| (of(a) * a.power_w + of(b) * b.power_w) / power_w;
        let (centre, normal) = (mean(|l| l.centre), mean(|l| l.normal));
        let most = |of: &dyn Fn(&Self) -> f64| of(a).max(of(b));
        let radius_m = most(&|l| l.centre.distance(centre) + l.radius_m);
        let normals_differ = most(&|l| l.normal.distance(normal) + l.normals_differ);
        let close_m = most(&|l| l.close_m);
        Self { centre, radius_m, power_w, normal, normals_differ, close_m, ..*a }
    }

    /// What arrives from it at a place, roughly, if nothing stands in between; 0 only where nothing can.
    fn expected(&self, at: &Place) -> f64 {
        let between = self.centre - at.centre;
        let reach_m = self.radius_m + at.radius_m;
        let distance_m = between.length().max(reach_m);
        let slack = reach_m / distance_m;
        let cos_r = (at.normal.dot(between) / distance_m + slack).clamp(0.0, 1.0);
        let cos_s = (-self.normal.dot(between) / distance_m + self.normals_differ + slack).clamp(0.0, 1.0);
        self.power_w * cos_r * cos_s / (distance_m * distance_m)
    }

    /// Whether a point is so close that parts are to be told apart.
    fn is_near(&self, point: DVec3) -> bool {
        self.radius_m > NEAR * self.centre.distance(point)
    }
}

/// Size of a lamp, in distances, above which parts of it are told apart.
const NEAR: f64 = 0.5;

/// Lamps in a binary tree, those that are near each other together.
#[derive(Default)]
pub struct LampTree {
    /// Nodes, the root first, each with the first of its two children (0: a lamp).
    nodes: Vec<(Lamp, u32)>,
    /// How many lamps.
    pub count: usize,
}

impl LampTree {
    /// The lamps of some clusters.
    pub fn of_clusters(clusters: &dyn Clusters, cache: &SideCache, ids: &[ClusterId]) -> Result<Self> {
        let mut all = Vec::new();
        for &id in ids {
            let loaded = clusters.cluster(id)?;
            let view = loaded.view();
            if view.materials.iter().any(|m| m.exitance != [0.0; 3]) {
                let exitance = |lamp: &Bundle| view.exitance(lamp.sides()[0].node.name);
                all.extend(lamps::of(cache, &view).iter().map(|lamp| Lamp::new(lamp, exitance(lamp))));
            }
        }
        Ok(Self::new(all))
    }

    fn new(mut lamps: Vec<Lamp>) -> Self {
        let mut tree = Self { nodes: Vec::with_capacity(2 * lamps.len()), count: lamps.len() };
        if let Some(first) = lamps.first() {
            tree.nodes.push((*first, 0));
            tree.build(0, &mut lamps);
        }
        tree
    }

    fn build(&mut self, at: usize, lamps: &mut [Lamp]) {
        if let [only] = lamps {
            self.nodes[at] = (*only, 0);
            return;
        }
        let (low, high) = lamps.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), lamp| {
            (low.min(lamp.centre), high.max(lamp.centre))
        });
        let extent = high - low;
        let axis = (0..3).fold(0, |widest, axis| if extent[axis] > extent[widest] { axis } else { widest });
        lamps.sort_by(|a, b| a.centre[axis].total_cmp(&b.centre[axis]).then(a.name.cmp(&b.name)));
        let (left, right) = lamps.split_at_mut(lamps.len() / 2);
        let children = self.nodes.len();
        self.nodes.extend([(left[0], 0), (right[0], 0)]);
        self.build(children, left);
        self.build(children + 1, right);
        self.nodes[at] = (Lamp::both(&self.nodes[children].0, &self.nodes[children + 1].0), children as u32);
    }
}

/// Where rays to lamps begin: part of a receiver.
#[derive(Clone, Copy)]
pub struct Place {
    centre: DVec3,
    radius_m: f64,
    normal: DVec3,
}

impl Place {
    /// A polygon.
    #[must_use]
    pub fn polygon(shape: &Polygon, normal: DVec3) -> Self {
        Self { centre: shape.centre(), radius_m: shape.radius(), normal }
    }

    /// A point.
    #[must_use]
    pub fn point(at: DVec3, normal: DVec3) -> Self {
        Self { centre: at, radius_m: 0.0, normal }
    }
}

/// Lamps that rays from a place are shared out among, those that are far together.
pub struct Aim {
    /// Nodes of the tree.
    among: Vec<u32>,
    /// Shares of the rays, summed up.
    upto: Vec<f64>,
    /// Whether it is as good for any point of the place.
    pub holds_all_over: bool,
    /// Whether a lamp may be so close that rays to it do not tell ([`is_close`]).
    pub may_be_close: bool,
}

/// Radius of a place, in distances to a lamp, up to which its points see the lamp alike.
const ALIKE: f64 = 0.25;

/// A lamp that a ray goes to.
pub struct Drawn {
    /// The lamp.
    pub lamp: Lamp,
    /// The same as geometry.
    pub bundle: Rc<Bundle>,
    /// Share of the rays that it gets.
    pub share: f64,
    /// What is left of the number that drew it, in 0..1.
    pub rest: f64,
}

/// Lamps in sight, each as geometry once a ray goes to it.
pub struct Lamps<'a> {
    clusters: &'a dyn Clusters,
    sides: &'a SideCache,
    tree: &'a LampTree,
    bundles: HashMap<NodeName, Rc<Bundle>>,
}

impl<'a> Lamps<'a> {
    /// Of these.
    #[must_use]
    pub fn new(clusters: &'a dyn Clusters, sides: &'a SideCache, tree: &'a LampTree) -> Self {
        Self { clusters, sides, tree, bundles: HashMap::new() }
    }

    /// How rays from a place are shared out; `None` if no lamp can be seen.
    pub fn aim(&self, at: &Place) -> Option<Aim> {
        let mut aim = Aim { among: Vec::new(), upto: Vec::new(), holds_all_over: true, may_be_close: false };
        let mut sum = 0.0;
        let mut open = if self.tree.nodes.is_empty() { Vec::new() } else { vec![0] };
        while let Some(node) = open.pop() {
            let (lamp, children) = &self.tree.nodes[node as usize];
            let expected = lamp.expected(at);
            if expected == 0.0 {
                continue;
            }
            if *children > 0 && lamp.is_near(at.centre) {
                open.extend([*children, children + 1]);
            } else {
                sum += expected;
                aim.among.push(node);
                aim.upto.push(sum);
                let distance_m = lamp.centre.distance(at.centre) - lamp.radius_m;
                aim.holds_all_over &= at.radius_m <= ALIKE * distance_m;
                aim.may_be_close |= distance_m - at.radius_m <= lamp.close_m;
            }
        }
        aim.upto.iter_mut().for_each(|x| *x /= sum);
        (sum > 0.0).then_some(aim)
    }

    /// Draws a lamp for a ray from a point by a number in 0..1; `None` if it cannot be seen from there.
    pub fn draw(&mut self, aim: &Aim, from: DVec3, normal: DVec3, x: f64) -> Result<Option<Drawn>> {
        let index = aim.upto.partition_point(|upto| *upto <= x).min(aim.upto.len() - 1);
        let before = if index > 0 { aim.upto[index - 1] } else { 0.0 };
        let mut share = aim.upto[index] - before;
        let mut rest = ((x - before) / share).clamp(0.0, BELOW_ONE);
        let (mut lamp, mut children) = self.tree.nodes[aim.among[index] as usize];
        let at = Place::point(from, normal);
        while children > 0 {
            let [first, second] = [0, 1].map(|i| &self.tree.nodes[children as usize + i]);
            let (one, two) = (first.0.expected(&at), second.0.expected(&at));
            if one + two == 0.0 {
                return Ok(None);
            }
            let of_first = one / (one + two);
            if rest < of_first {
                (share, rest, (lamp, children)) = (share * of_first, rest / of_first, *first);
            } else {
                let of_second = 1.0 - of_first;
                (share, rest, (lamp, children)) = (share * of_second, (rest - of_first) / of_second, *second);
            }
            rest = rest.clamp(0.0, BELOW_ONE);
        }
        Ok(Some(Drawn { lamp, bundle: self.bundle(lamp.name)?, share, rest }))
    }

    fn bundle(&mut self, name: NodeName) -> Result<Rc<Bundle>> {
        if let Some(known) = self.bundles.get(&name) {
            return Ok(known.clone());
        }
        let bundle = Rc::new(Bundle::of(self.sides, &self.clusters.cluster(name.cluster())?.view(), name));
        self.bundles.insert(name, bundle.clone());
        Ok(bundle)
    }
}

/// The largest number below 1.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON;

/// A place of a lamp that a ray goes to.
pub struct Target {
    /// The side or element that it lies on.
    pub on: Node,
    /// The place, m.
    pub to: DVec3,
    /// Form factor that the ray stands for if it arrives, were all rays to go to this lamp.
    pub form_factor: f64,
}

/// Squared distance, in areas of a side, below which it is close.
const CLOSE: f64 = 4.0;

/// Whether a lamp's side is so close that few rays to it would bring more than all others: what arrives from there is
/// counted by cosine-weighted rays, which meet it often, and rays to it count nothing.
fn is_close(from: DVec3, to: DVec3, side_area_m2: f64) -> bool {
    from.distance_squared(to) < CLOSE * side_area_m2
}

/// Whether `to` lies on a side of a lamp that is close to `from`.
#[must_use]
pub fn is_close_lamp(view: &ClusterView<'_>, side: NodeName, from: DVec3, to: DVec3) -> bool {
    let area_m2 = f64::from(view.geometry.patches[usize::from(side.patch_side().patch)].area_m2);
    view.emits(side) && is_close(from, to, area_m2)
}

/// Draws a place of a lamp by two numbers in 0..1; `None` if it and `from` do not face each other, or it is close.
#[must_use]
pub fn target(lamp: &Bundle, from: DVec3, normal: DVec3, [c, d]: [f64; 2]) -> Option<Target> {
    let (side, along) = lamp.draw(c);
    let to = side.node.shape.point(along, d);
    let between = to - from;
    let (cos_r, cos_s) = (normal.dot(between), -side.node.normal.dot(between));
    if cos_r <= 0.0 || cos_s <= 0.0 || is_close(from, to, side.area_m2) {
        return None;
    }
    let distance_squared = between.length_squared();
    let kernel = cos_r * cos_s / (std::f64::consts::PI * distance_squared * distance_squared);
    Some(Target { on: side.node, to, form_factor: kernel * lamp.area_m2 })
}
