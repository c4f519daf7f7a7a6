//! Nodes above patches as geometry: the patch sides below a sector node, and an element as the bundle of
//! one. What a bundle sends and receives is summed over its sides.

use std::cell::RefCell;
use std::num::NonZeroUsize;
use std::ops::Range;
use std::rc::Rc;

use glam::DVec3;
use lru::LruCache;

use super::sectors::sector_of_side;
use super::source::ClusterView;
use crate::base::{NodeName, PatchSide};
use crate::geom::polygon::Polygon;
use crate::geom::quadtree;
use crate::rays::node::Node;

/// A patch side below sector nodes.
#[derive(Clone, Copy, Debug)]
pub struct Side {
    /// The whole of it.
    pub node: Node,
    /// Its area, m2.
    pub area_m2: f64,
}

/// The sides of a cluster that take part, sector by sector, each in the order of the cluster's tree.
pub struct Sides([Vec<Side>; 6]);

impl Sides {
    /// Of one cluster.
    #[must_use]
    pub fn of(view: &ClusterView<'_>) -> Self {
        let mut sectors: [Vec<Side>; 6] = std::array::from_fn(|_| Vec::new());
        for index in (0..2 * view.geometry.patches.len()).filter(|i| view.takes_part(*i)) {
            let at = PatchSide::from_index(index);
            let node = Node::root(view.id, &view.geometry.patches[usize::from(at.patch)], at);
            let sector = sector_of_side(&view.geometry, at);
            sectors[usize::from(sector)].push(Side { node, area_m2: node.shape.area() });
        }
        Self(sectors)
    }

    /// Those below a sector node: a run, since a tree node's patches are.
    #[must_use]
    pub fn below(&self, view: &ClusterView<'_>, name: NodeName) -> Range<usize> {
        let node = &view.geometry.tree[name.tree_node() as usize];
        let sides = &self.0[usize::from(name.sector_digit())];
        let before = |patch: u16| sides.partition_point(|s| u16::from(s.node.name.patch_side().patch) < patch);
        before(node.first_patch)..before(node.first_patch + node.patch_count)
    }
}

/// Clusters whose sides are held: about 40 KiB each.
const HELD: NonZeroUsize = NonZeroUsize::new(192).expect("not 0");

/// Sides of clusters, made as needed.
pub struct SideCache(RefCell<LruCache<u32, Rc<Sides>>>);

impl Default for SideCache {
    fn default() -> Self {
        Self(RefCell::new(LruCache::new(HELD)))
    }
}

impl SideCache {
    /// The sides of a cluster.
    fn of(&self, view: &ClusterView<'_>) -> Rc<Sides> {
        if let Some(known) = self.0.borrow_mut().get(&view.id.0) {
            return known.clone();
        }
        let sides = Rc::new(Sides::of(view));
        self.0.borrow_mut().put(view.id.0, sides.clone());
        sides
    }
}

/// A node that light leaves or reaches, as geometry.
#[derive(Clone)]
pub struct Bundle {
    /// Its name.
    pub name: NodeName,
    parts: Parts,
    /// Area, m2.
    pub area_m2: f64,
    /// Middle of a ball that holds it, m, and its radius.
    pub centre: DVec3,
    /// See `centre`.
    pub radius_m: f64,
}

#[derive(Clone)]
enum Parts {
    One(Box<Side>),
    Many(Rc<Sides>, usize, Range<usize>),
}

impl Bundle {
    /// An element.
    fn element(node: Node) -> Self {
        let area_m2 = node.shape.area();
        let (centre, radius_m) = (node.shape.centre(), node.shape.radius());
        let side = Side { node, area_m2 };
        Self { name: node.name, parts: Parts::One(Box::new(side)), area_m2, centre, radius_m }
    }

    /// A sector node; with one side below it, that side.
    fn sector(sides: Rc<Sides>, view: &ClusterView<'_>, name: NodeName) -> Self {
        let run = sides.below(view, name);
        let sector = usize::from(name.sector_digit());
        let below = &sides.0[sector][run.clone()];
        if let [only] = below {
            return Self::element(only.node);
        }
        let area_m2: f64 = below.iter().map(|s| s.area_m2).sum();
        let sum = below.iter().fold(DVec3::ZERO, |sum, s| sum + s.node.shape.centre() * s.area_m2);
        let centre = sum / area_m2.max(f64::MIN_POSITIVE);
        let corners = || below.iter().flat_map(|s| s.node.shape.corners());
        let radius_m = corners().map(|c| c.distance(centre)).fold(0.0, f64::max);
        Self { name, parts: Parts::Many(sides, sector, run), area_m2, centre, radius_m }
    }

    /// The node of that name.
    #[must_use]
    pub fn of(cache: &SideCache, view: &ClusterView<'_>, name: NodeName) -> Self {
        if name.is_sector() {
            return Self::sector(cache.of(view), view, name);
        }
        Self::element(Node::at(view.id, &view.geometry.patches[usize::from(name.patch_side().patch)], name))
    }

    /// Its sides.
    #[must_use]
    pub fn sides(&self) -> &[Side] {
        match &self.parts {
            Parts::One(side) => std::slice::from_ref(side),
            Parts::Many(sides, sector, run) => &sides.0[*sector][run.clone()],
        }
    }

    /// The element that it is, if it is one.
    #[must_use]
    pub fn as_element(&self) -> Option<&Node> {
        match &self.parts {
            Parts::One(side) => Some(&side.node),
            Parts::Many(..) => None,
        }
    }

    /// Names of the nodes below: of a sector node one or two sector nodes, or the sides of a leaf of the
    /// tree; of an element its quarters.
    #[must_use]
    pub fn children(&self, view: &ClusterView<'_>) -> Vec<NodeName> {
        if self.as_element().is_some() {
            return (0..4).map(|quarter| self.name.child(quarter)).collect();
        }
        let node = &view.geometry.tree[self.name.tree_node() as usize];
        let sector = |tree_node: u32| NodeName::sector(view.id, self.name.sector_digit(), u64::from(tree_node));
        let known = |name: &NodeName| view.geometry.sectors.binary_search_by_key(&name.0, |s| s.name).is_ok();
        let below: Vec<NodeName> = [node.left, node.right]
            .into_iter()
            .filter(|child| *child != crate::model::geometry::NONE)
            .map(sector)
            .filter(known)
            .collect();
        if below.is_empty() { self.sides().iter().map(|s| s.node.name).collect() } else { below }
    }

    /// A side by a number in 0..1, in proportion to area, and what is left of the number.
    #[must_use]
    pub fn draw(&self, x: f64) -> (&Side, f64) {
        let (index, along) = self.draw_index(x);
        (&self.sides()[index], along)
    }

    fn draw_index(&self, x: f64) -> (usize, f64) {
        let mut before = 0.0;
        for (index, side) in self.sides().iter().enumerate() {
            let share = side.area_m2 / self.area_m2;
            if x < before + share {
                return (index, ((x - before) / share).clamp(0.0, 1.0));
            }
            before += share;
        }
        (self.sides().len() - 1, 0.5)
    }
}

/// Where rays of an element begin, quarter by quarter.
pub struct Starts([Polygon; 4]);

impl Starts {
    /// Of an element.
    #[must_use]
    pub fn new(of: &Node) -> Self {
        Self(std::array::from_fn(|q| quadtree::quarter(&of.shape, q as u32)))
    }

    /// One of its quarters.
    #[must_use]
    pub fn shape(&self, quarter: usize) -> &Polygon {
        &self.0[quarter]
    }

    /// A place of a quarter by two numbers in 0..1.
    #[must_use]
    pub fn draw(&self, quarter: usize, [a, b]: [f64; 2]) -> DVec3 {
        self.0[quarter].point(a, b)
    }
}
