//! Regions of a small element: a wall that stands on it cuts it in parts that exchange no light.
//!
//! One value for all parts would carry light through the wall: out of the lit part, into the sealed
//! one. So the smallest elements, which cannot be split to tell the parts apart, stand for the part
//! that holds their anchor, as receivers and as sources. What lies on the far side of the wall is
//! another element's to tell: the anchor lies anywhere, so on average nothing is lost to either side. A patch
//! that is one element has no others: it stands for its largest part.

use glam::DVec3;

use super::node::Node;
use super::recent::Recent;
use super::scene::RayScene;
use crate::geom::bounds::Bounds;
use crate::geom::sequence::mix;

/// The part of an element that stands for it.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    anchor: DVec3,
    lifts: [DVec3; 2],
}

/// Which nodes walls stand on, asked over and over while links are made: of the smallest elements and of
/// bright sources for every link.
pub struct Cuts<'a> {
    scene: RayScene<'a>,
    min_element_m: f64,
    /// Numbers of the anchors of what is cut.
    known: Recent<Option<u8>, KNOWN>,
}

const KNOWN: usize = 1 << 17;

impl<'a> Cuts<'a> {
    /// Nothing known yet. No element edge is below `min_element_m`.
    #[must_use]
    pub fn new(scene: RayScene<'a>, min_element_m: f64) -> Self {
        Self { scene, min_element_m, known: Recent::default() }
    }

    /// What rays can meet.
    #[must_use]
    pub fn scene(&self) -> &RayScene<'a> {
        &self.scene
    }

    /// No element edge is below this, m.
    #[must_use]
    pub fn min_element_m(&self) -> f64 {
        self.min_element_m
    }

    /// Whether walls stand on a node.
    #[must_use]
    pub fn is_cut(&self, node: &Node) -> bool {
        self.anchor(node).is_some()
    }

    fn anchor(&self, node: &Node) -> Option<u8> {
        if let Some(known) = self.known.get(node.name) {
            return known;
        }
        let anchor = anchor(&self.scene, node, self.min_element_m);
        self.known.put(node.name, anchor);
        anchor
    }

    /// Whether a place lies in the part that stands for a node, or for a node that nothing cuts round its anchor,
    /// as far as a straight line tells.
    #[must_use]
    pub fn shares_part(&self, node: &Node, place: DVec3) -> bool {
        self.part(node).holds(&self.scene, place)
    }

    /// Whether the place that stands for a node is seen from a point.
    #[must_use]
    pub fn sees_part(&self, node: &Node, from: DVec3) -> bool {
        let part = self.part(node);
        !self.scene.blocked_between(from, part.anchor + part.lifts[1])
    }

    /// The part round a node's anchor, whether anything cuts the node or not.
    fn part(&self, node: &Node) -> Region {
        Region::round(&self.scene, node, self.anchor(node).unwrap_or(0), self.min_element_m)
    }

    /// Whether a straight line just above a node joins two of its places.
    #[must_use]
    pub fn joins(&self, node: &Node, from: DVec3, to: DVec3) -> bool {
        Region { anchor: to, lifts: lifts(&self.scene, node, self.min_element_m) }.holds(&self.scene, from)
    }

    /// The first of a node's places that a straight line just above it joins with a point of it, and its number.
    #[must_use]
    pub fn place_beside(&self, node: &Node, point: DVec3) -> Option<(u8, DVec3)> {
        (0..PLACES_BESIDE)
            .map(|number| (number, place(node, number)))
            .find(|(_, place)| self.joins(node, *place, point))
    }

    /// A point just above a place, where it is clear of what lies in the same plane.
    #[must_use]
    pub fn above(&self, place: DVec3, normal: DVec3) -> DVec3 {
        place + normal * clear_m(&self.scene)
    }

    /// The part that stands for a node; `None` if nothing cuts it.
    #[must_use]
    pub fn region(&self, node: &Node) -> Option<Region> {
        self.anchor(node).map(|anchor| Region::round(&self.scene, node, anchor, self.min_element_m))
    }
}

/// Height above an element, as a share of the smallest element's edge, up to which a wall that does not
/// touch it still stands on it: real walls end some millimetres above their floors.
const GAP_SHARE: f64 = 0.05;

/// Highest that this is, m: a tube stands no farther before its reflector.
const HIGHEST_GAP_M: f64 = 0.01;

/// Height at which a point is clear of what lies in the plane below it, m.
fn clear_m(scene: &RayScene<'_>) -> f64 {
    2.0 * scene.snap_m()
}

/// Heights over an element at which something that stands on it is met: just above what lies in its
/// plane, and above gaps too narrow for elements of this size to tell.
fn heights(scene: &RayScene<'_>, min_element_m: f64) -> [f64; 2] {
    let low = clear_m(scene);
    [low, low.max((GAP_SHARE * min_element_m).min(HIGHEST_GAP_M))]
}

/// The same as steps off a node.
fn lifts(scene: &RayScene<'_>, node: &Node, min_element_m: f64) -> [DVec3; 2] {
    heights(scene, min_element_m).map(|height| node.normal * height)
}

/// Places that a patch's largest part is looked for with.
const PLACES: u8 = 8;

/// Places that the part round a point is looked for with.
const PLACES_BESIDE: u8 = 64;

/// The place that stands for an element that is cut: the first, and of a patch that has no other elements the first
/// from which most others are seen. `None` if nothing cuts it.
fn anchor(scene: &RayScene<'_>, node: &Node, min_element_m: f64) -> Option<u8> {
    if !is_cut(scene, node, min_element_m) {
        return None;
    }
    if node.name.depth() > 0 || !node.is_smallest(min_element_m) {
        return Some(0);
    }
    let seen = |anchor: u8| {
        let part = Region::round(scene, node, anchor, min_element_m);
        (0..PLACES).filter(|other| part.holds(scene, place(node, *other))).count()
    };
    let (mut best, mut most) = (0, 0);
    for anchor in 0..PLACES {
        let seen = seen(anchor);
        if seen > most {
            (best, most) = (anchor, seen);
        }
        if 2 * most > usize::from(PLACES) {
            break;
        }
    }
    Some(best)
}

/// One of an element's places. The first lies anywhere, by the name, so that each part of a surface is stood for by as
/// many elements as it takes up of their area; the others lie evenly round it.
fn place(node: &Node, number: u8) -> DVec3 {
    let bits = mix(node.name.0);
    let share = |bits: u64, step: f64| {
        let first = (bits & 0xffff_ffff) as f64 / f64::from(u32::MAX);
        0.02 + 0.96 * (first + f64::from(number) * step).fract()
    };
    node.shape.point(share(bits, STEPS[0]), share(bits >> 32, STEPS[1]))
}

/// Steps that fill the unit square evenly. Source: Roberts 2018, the R2 sequence.
const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

impl Region {
    fn round(scene: &RayScene<'_>, node: &Node, anchor: u8, min_element_m: f64) -> Self {
        Self { anchor: place(node, anchor), lifts: lifts(scene, node, min_element_m) }
    }

    /// Whether a point of the element lies in the part.
    #[must_use]
    pub fn holds(&self, scene: &RayScene<'_>, point: DVec3) -> bool {
        self.lifts.iter().all(|lift| !scene.blocked_between(point + *lift, self.anchor + *lift))
    }
}

/// Whether a patch crosses the inside of an element, a little above it on its side.
fn is_cut(scene: &RayScene<'_>, node: &Node, min_element_m: f64) -> bool {
    let heights = heights(scene, min_element_m);
    let corners = node.shape.corners();
    let reach = 2.0 * heights[1];
    let bounds = Bounds::of(corners);
    let bounds = Bounds { min: bounds.min - reach, max: bounds.max + reach };
    let normal = node.shape.normal();
    scene.any_in_box(&bounds, |patch| {
        let c = patch.corners_m.map(|c| DVec3::from_array(c.map(f64::from)));
        let c = &c[..patch.corner_count as usize];
        heights.iter().any(|height| {
            crossing(c, |p| node.height(p) - height)
                .is_some_and(|segment| enters(corners, normal, segment, scene.snap_m()))
        })
    })
}

/// Where a convex polygon crosses the plane at which `height` is 0.
fn crossing(corners: &[DVec3], height: impl Fn(DVec3) -> f64) -> Option<[DVec3; 2]> {
    let mut ends = [DVec3::ZERO; 2];
    let mut count = 0;
    for i in 0..corners.len() {
        let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
        let (ha, hb) = (height(a), height(b));
        if (ha >= 0.0) != (hb >= 0.0) && count < 2 {
            ends[count] = a + (b - a) * (ha / (ha - hb));
            count += 1;
        }
    }
    (count == 2).then_some(ends)
}

/// Whether a segment runs inside a convex polygon, further than `margin` from its edges.
fn enters(corners: &[DVec3], normal: DVec3, [from, to]: [DVec3; 2], margin: f64) -> bool {
    let (mut low, mut high) = (0.0f64, 1.0f64);
    for i in 0..corners.len() {
        let inward = normal.cross(corners[(i + 1) % corners.len()] - corners[i]).normalize_or_zero();
        let a = inward.dot(from - corners[i]) - margin;
        let b = inward.dot(to - corners[i]) - margin;
        match (a >= 0.0, b >= 0.0) {
            (true, true) => {}
            (false, false) => return false,
            (true, false) => high = high.min(a / (a - b)),
            (false, true) => low = low.max(a / (a - b)),
        }
    }
    low < high
}
