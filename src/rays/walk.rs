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
    fn within(&self, nodes: &[RayNode]) -> BoxRay {
        if !self.is_wide {
            return self.boxes;
        }
        let inverse = DVec3::from_array(self.boxes.inverse.map(f64::from));
        BoxRay { padding: padding(inverse, self.face.from, nodes[0].largest_m()), ..self.boxes }
    }

    /// Distance to the plane of a triangle of a face, where the ray crosses that.
    #[inline(always)]
    fn distance(&self, face: &RayPatch, corners: [usize; 3]) -> Option<f64> {
        let [a, b, c] = corners.map(|i| self.face.corner(face, i));
        let normal = (b - a).cross(c - a);
        let speed = normal.dot(self.face.along);
        (speed != 0.0).then(|| normal.dot(a) / speed)
    }
}

/// A child still to visit.
#[derive(Clone, Copy, Default)]
struct Waiting {
    first: u32,
    items: u32,
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

    #[inline(always)]
    fn pop(&mut self) -> Waiting {
        self.count -= 1;
        match self.few.get(self.count) {
            Some(waiting) => *waiting,
            None => self.more.pop().unwrap_or_default(),
        }
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
    let mut node = &nodes[0];
    loop {
        let (entered, swaps) = lanes.entered(node, ray, rounded_up(*limit));
        let mut push = |slot: usize| {
            let (first, items, near) = (node.first[slot], node.items[slot], entered.near[slot]);
            stack.push(Waiting { first, items, near });
        };
        match swaps {
            Some(swaps) if ORDERED => {
                let order = ORDERS[swaps.index()];
                for place in (0..8).rev() {
                    let slot = order >> (4 * place) & 7;
                    if entered.slots >> slot & 1 == 1 {
                        push(slot as usize);
                    }
                }
            }
            _ => {
                let mut slots = entered.slots;
                while slots != 0 {
                    push(slots.trailing_zeros() as usize & 7);
                    slots &= slots - 1;
                }
            }
        }
        node = loop {
            if stack.count == floor {
                return false;
            }
            let Waiting { first, items, near } = stack.pop();
            if near > rounded_up(*limit) {
                continue;
            }
            if items > 0 {
                if leaf(first as usize..(first + items) as usize, stack, limit) {
                    return true;
                }
            } else if first > 0 {
                // An empty slot leads to the root.
                break &nodes[first as usize];
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
        let mut stack = Stack::new();
        walk::<L, ORDERED>(lanes, self.top.nodes, &ray.boxes, &mut stack, &mut limit, |places, stack, limit| {
            for place in places {
                let Some(of) = self.cluster_at(place) else { continue };
                let boxes = ray.within(of.nodes);
                let stops = walk::<L, ORDERED>(lanes, of.nodes, &boxes, stack, limit, |faces, _, limit| {
                    for faces in of.faces[faces].chunks(AT_ONCE) {
                        let crossed = lanes.crossed(faces, &ray.face);
                        let mut left = (crossed | crossed >> AT_ONCE) & 0xf;
                        while left != 0 {
                            let at = left.trailing_zeros();
                            left &= left - 1;
                            let face = &faces[at as usize];
                            let corners = if crossed >> at & 1 == 1 { [0, 1, 2] } else { [0, 2, 3] };
                            if let Some(t) = ray.distance(face, corners)
                                && t >= low
                                && t <= *limit
                                && met(&of, face, t, limit)
                            {
                                return true;
                            }
                        }
                    }
                    false
                });
                if stops {
                    return true;
                }
            }
            false
        });
    }
}
