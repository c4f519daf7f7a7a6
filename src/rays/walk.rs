//! The way of a ray through the hierarchies: which faces it crosses, near ones first.

use glam::DVec3;

use super::lanes::{BoxRay, FaceRay, Lanes};
use super::scene::{RayScene, Structure};
use crate::model::rays::{RayNode, RayPatch};

/// A ray: f64 for faces, f32 for boxes.
pub(super) struct Ray {
    face: FaceRay,
    from: DVec3,
    boxes: BoxRay,
    is_wide: bool,
}

/// Largest coordinate, m, from which a model is wide: boxes are grown by millimetres and more.
const WIDE_M: f32 = 1e4;

/// What is subtracted of planes' coordinates over the direction, by axis: boxes are grown by more than rounding, which the
/// largest coordinate bounds.
fn begins(inverse: [f32; 3], from: DVec3, largest_m: f32) -> [[f32; 2]; 3] {
    let reach_m = from.abs().max_element().max(f64::from(largest_m));
    std::array::from_fn(|axis| {
        let inverse = f64::from(inverse[axis]);
        let (begin, padding) = (from[axis] * inverse, inverse.abs() * (reach_m * 6e-7));
        [(begin + padding) as f32, (begin - padding) as f32]
    })
}

/// A distance as f32, not below it.
fn rounded_up(x: f64) -> f32 {
    (x as f32) * (1.0 + f32::EPSILON) + f32::MIN_POSITIVE
}

impl Ray {
    /// From `low` on; no coordinate of what may be met is larger than `largest_m`.
    pub(super) fn new(from: DVec3, along: DVec3, low: f64, largest_m: f32) -> Self {
        let safe = |x: f64| if x.abs() < 1e-20 { 1e20_f64.copysign(x) } else { 1.0 / x };
        let inverse = along.to_array().map(|x| safe(x) as f32);
        let boxes = BoxRay {
            inverse,
            begins: begins(inverse, from, largest_m),
            first_plane: inverse.map(|x| usize::from(x < 0.0)),
            low: -rounded_up(-low),
        };
        Self { face: FaceRay::new(from, along), from, boxes, is_wide: largest_m > WIDE_M }
    }

    /// As the boxes of a cluster see it: in a wide model those far off cost the others nothing.
    #[inline(always)]
    fn within<'r>(&'r self, nodes: &[RayNode], room: &'r mut BoxRay) -> &'r BoxRay {
        if !self.is_wide {
            return &self.boxes;
        }
        room.begins = begins(self.boxes.inverse, self.from, nodes[0].largest_m());
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

    /// Puts those from `first` on in order, the nearest last.
    #[inline(always)]
    fn sort(&mut self, first: usize) {
        let few = self.few.len().min(self.count);
        for i in first + 1..few {
            let (new, mut place) = (self.few[i], i);
            while place > first && self.few[place - 1].near < new.near {
                self.few[place] = self.few[place - 1];
                place -= 1;
            }
            self.few[place] = new;
        }
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

/// Visits the leaves that a ray enters before `limit`: the nearer child of a node first, where `ORDERED`.
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
        let entered = lanes.entered(&nodes[at as usize], ray, rounded_up(*limit));
        let mut slots = entered.slots;
        let mut take = || {
            let slot = slots.trailing_zeros() & 7;
            slots &= slots.wrapping_sub(1);
            (Waiting { place: at << 3 | slot, near: entered.near[slot as usize] }, slots != 0)
        };
        let mut next = None;
        if entered.slots != 0 {
            let (mut nearest, mut has_more) = take();
            let first = stack.count;
            while has_more {
                let mut child;
                (child, has_more) = take();
                if ORDERED && child.near < nearest.near {
                    std::mem::swap(&mut child, &mut nearest);
                }
                stack.push(child);
            }
            if ORDERED {
                stack.sort(first);
            }
            next = Some(nearest);
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
            for face in faces {
                if let Some(t) = lanes.crosses(face, &ray.face)
                    && t >= low
                    && t <= *limit
                    && met(of, face, t, limit)
                {
                    return true;
                }
            }
            false
        };
        walk::<L, ORDERED>(lanes, self.top.nodes, &ray.boxes, &mut stack, &mut limit, |mut places, stack, limit| {
            places.any(|place| {
                let Some(of) = self.cluster_at(place) else { return false };
                if of.faces.len() == 1 {
                    // The ray has entered its box.
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
