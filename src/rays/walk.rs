//! The way of a ray through the hierarchies: which faces it crosses, near ones first.

use glam::DVec3;

use super::lanes::{AT_ONCE, BoxRay, FaceRay, Lanes, Swaps};
use super::scene::{RayScene, Structure};
use crate::model::rays::{RayNode, RayPatch};

/// A ray: f64 for faces, f32 for boxes.
pub(super) struct Ray {
    face: FaceRay,
    boxes: BoxRay,
    is_wide: bool,
}

/// Largest coordinate, m, from which a model is wide: boxes are grown by millimetres and more.
const WIDE_M: f32 = 1e4;

/// What boxes are grown by, in lengths of the ray: more than the rounding of differences, which the largest
/// coordinate bounds.
fn padding(inverse: DVec3, from: DVec3, largest_m: f32) -> [f32; 3] {
    let reach_m = from.abs().max_element().max(f64::from(largest_m));
    (inverse.abs() * (reach_m * 4e-7)).as_vec3().to_array()
}

/// A distance as f32, not below it.
fn rounded_up(x: f64) -> f32 {
    (x as f32) * (1.0 + f32::EPSILON) + f32::MIN_POSITIVE
}

impl Ray {
    /// From `low` on; no coordinate of what may be met is larger than `largest_m`.
    pub(super) fn new(from: DVec3, along: DVec3, low: f64, largest_m: f32) -> Self {
        let safe = |x: f64| if x.abs() < 1e-30 { 1e30_f64.copysign(x) } else { 1.0 / x };
        let inverse = DVec3::new(safe(along.x), safe(along.y), safe(along.z));
        let boxes = BoxRay {
            from_m: from.as_vec3().to_array(),
            inverse: inverse.as_vec3().to_array(),
            padding: padding(inverse, from, largest_m),
            first_plane: inverse.to_array().map(|x| usize::from(x < 0.0)),
            low: -rounded_up(-low),
        };
        Self { face: FaceRay { from, along }, boxes, is_wide: largest_m > WIDE_M }
    }

    /// As the boxes of a cluster see it: in a wide model those far off cost the others nothing.
    #[inline(always)]
    fn within<'r>(&'r self, nodes: &[RayNode], room: &'r mut BoxRay) -> &'r BoxRay {
        if !self.is_wide {
            return &self.boxes;
        }
        let inverse = DVec3::from_array(self.boxes.inverse.map(f64::from));
        room.padding = padding(inverse, self.face.from, nodes[0].largest_m());
        room
    }
}

/// A child still to visit: its node and slot, and where the ray enters it.
#[derive(Clone, Copy, Default)]
struct Waiting {
    place: u32,
    near: f32,
}

/// Children that wait without the allocator.
const FEW: usize = 40;

/// Children still to visit, nearest last.
struct Stack {
    few: [Waiting; FEW],
    more: Vec<Waiting>,
    count: usize,
}

impl Stack {
    fn new() -> Self {
        Self { few: [Waiting::default(); FEW], more: Vec::new(), count: 0 }
    }

    #[inline(always)]
    fn push(&mut self, waiting: Waiting) {
        match self.few.get_mut(self.count) {
            Some(place) => *place = waiting,
            None => self.more.push(waiting),
        }
        self.count += 1;
    }

    /// The nearest that begins before `limit`, while there are more than `floor`.
    #[inline(always)]
    fn pop(&mut self, floor: usize, limit: f32) -> Option<Waiting> {
        while self.count > floor {
            self.count -= 1;
            let waiting = match self.few.get(self.count) {
                Some(waiting) => *waiting,
                None => self.more.pop()?,
            };
            if waiting.near <= limit {
                return Some(waiting);
            }
        }
        None
    }
}

/// Slots of a node by place in the order that they are visited in, four bits each; indexed by [`Swaps::index`].
const ORDERS: [u32; 128] = {
    let mut orders = [0; 128];
    let mut index = 0;
    while index < 128 {
        let mut place = 0;
        while place < 8 {
            let half = place >> 2 & 1 ^ index & 1;
            let pair = half << 1 | (place >> 1 & 1 ^ index >> (1 + half) & 1);
            let slot = pair << 1 | (place & 1 ^ index >> (3 + pair) & 1);
            orders[index] |= (slot as u32) << (4 * place);
            place += 1;
        }
        index += 1;
    }
    orders
};

impl Swaps {
    /// Bits of slots as bits of their places in the order.
    #[inline(always)]
    fn places(&self, slots: u32) -> u32 {
        let swapped = |bits: u32, step: u32, which: u32| {
            let differ = (bits ^ bits >> step) & which;
            bits ^ differ ^ differ << step
        };
        let pairs = swapped(slots, 1, self.pairs & 0x55);
        swapped(swapped(pairs, 2, self.fours & 0x11 | (self.fours & 0x11) << 1), 4, 0xf * (self.eight & 1))
    }

    #[inline(always)]
    fn index(&self) -> usize {
        let (pairs, fours) = (self.pairs, self.fours);
        let pairs = pairs & 1 | pairs >> 1 & 2 | pairs >> 2 & 4 | pairs >> 3 & 8;
        (self.eight & 1 | (fours & 1) << 1 | (fours >> 4 & 1) << 2 | pairs << 3) as usize
    }
}

/// Visits the leaves that a ray enters before `limit`: those of the nearer half of a tree first, where `ORDERED`.
/// `leaf` is told which items, may lower the limit, and stops the visit by returning true; so does this.
#[inline(always)]
fn walk<L: Lanes, const ORDERED: bool>(
    lanes: L,
    nodes: &[RayNode],
    ray: &BoxRay,
    stack: &mut Stack,
    limit: &mut f64,
    mut leaf: impl FnMut(std::ops::Range<usize>, &mut Stack, &mut f64) -> bool,
) -> bool {
    let floor = stack.count;
    let mut at = 0;
    loop {
        let (entered, swaps) = lanes.entered(&nodes[at as usize], ray, rounded_up(*limit));
        let (mut places, order) = match swaps {
            Some(swaps) if ORDERED => (swaps.places(entered.slots), ORDERS[swaps.index()]),
            _ => (entered.slots, ORDERS[0]),
        };
        let mut next = None;
        while places != 0 {
            let place = places.ilog2();
            places ^= 1 << place;
            let slot = order >> (4 * place) & 7;
            let child = Waiting { place: at << 3 | slot, near: entered.near[slot as usize] };
            if places == 0 {
                next = Some(child);
            } else {
                stack.push(child);
            }
        }
        at = loop {
            let Some(Waiting { place, .. }) = next.take().or_else(|| stack.pop(floor, rounded_up(*limit))) else {
                return false;
            };
            let (node, slot) = (&nodes[place as usize >> 3], place as usize & 7);
            let (first, items) = (node.first[slot], node.items[slot]);
            if items > 0 {
                if leaf(first as usize..(first + items) as usize, stack, limit) {
                    return true;
                }
            } else if first > 0 {
                // An empty slot leads to the root.
                break first;
            }
        };
    }
}

impl<'a> RayScene<'a> {
    /// Visits every face that the ray crosses within `low..=limit`, near boxes first where `ORDERED`; `met` may
    /// lower the limit, and stops the visit by returning true.
    #[inline(always)]
    pub(super) fn visit<L: Lanes, const ORDERED: bool>(
        &self,
        lanes: L,
        ray: &Ray,
        (low, mut limit): (f64, f64),
        mut met: impl FnMut(&Structure<'a>, &'a RayPatch, f64, &mut f64) -> bool,
    ) {
        let (mut stack, mut room) = (Stack::new(), ray.boxes);
        let mut test = |of: &Structure<'a>, faces: &'a [RayPatch], limit: &mut f64| {
            for faces in faces.chunks(AT_ONCE) {
                let crossed = lanes.crossed(faces, &ray.face);
                let mut left = crossed.faces;
                while left != 0 {
                    let at = left.trailing_zeros() as usize & 3;
                    left &= left - 1;
                    let t = crossed.at[at];
                    if t >= low && t <= *limit && met(of, &faces[at], t, limit) {
                        return true;
                    }
                }
            }
            false
        };
        walk::<L, ORDERED>(lanes, self.top.nodes, &ray.boxes, &mut stack, &mut limit, |mut places, stack, limit| {
            places.any(|place| {
                let Some(of) = self.cluster_at(place) else { return false };
                if of.faces.len() <= AT_ONCE {
                    // One look at all of them costs less than one at their boxes.
                    return test(&of, of.faces, limit);
                }
                let boxes = ray.within(of.nodes, &mut room);
                walk::<L, ORDERED>(lanes, of.nodes, boxes, stack, limit, |faces, _, limit| {
                    test(&of, &of.faces[faces], limit)
                })
            })
        });
    }
}
