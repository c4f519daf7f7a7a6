//! Regions of a small element: a wall that stands on it cuts it in parts that exchange no light.
//!
//! One value for all parts would carry light through the wall: out of the lit part, into the sealed
//! one. So the smallest elements, which cannot be split to tell the parts apart, stand for the part
//! that holds their anchor, as receivers and as sources. What lies on the far side of the wall is
//! another element's to tell; on average as much is lost to either side as is won.

use glam::DVec3;

use super::node::Node;
use super::scene::RayScene;
use crate::geom::bounds::Bounds;

/// The part of an element that stands for it.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    anchor: DVec3,
    lift: DVec3,
}

impl Region {
    /// The part of `node` round its anchor; `None` if nothing cuts the element.
    ///
    /// What stands on the element is met a little above it, where what lies in its plane is not.
    #[must_use]
    pub fn of(scene: &RayScene<'_>, node: &Node) -> Option<Self> {
        is_cut(scene, node).then(|| {
            let lift = node.normal * (2.0 * scene.snap_m());
            // Off the middle, where symmetric models put their walls.
            Self { anchor: node.shape.point(0.483_7, 0.523_1) + lift, lift }
        })
    }

    /// Whether a point of the element lies in the part.
    #[must_use]
    pub fn holds(&self, scene: &RayScene<'_>, point: DVec3) -> bool {
        !scene.blocked_between(point + self.lift, self.anchor)
    }
}

/// Whether a patch crosses the inside of an element, a little above it on its side.
#[must_use]
pub fn is_cut(scene: &RayScene<'_>, node: &Node) -> bool {
    let lift = 2.0 * scene.snap_m();
    let corners = node.shape.corners();
    let reach = 2.0 * lift;
    let bounds = Bounds::of(corners);
    let bounds = Bounds { min: bounds.min - reach, max: bounds.max + reach };
    scene.any_in_box(&bounds, |patch| {
        let c = patch.corners_m.map(|c| DVec3::from_array(c.map(f64::from)));
        let c = &c[..patch.corner_count as usize];
        let height = |p: DVec3| node.height(p) - lift;
        let mut crossing = [DVec3::ZERO; 2];
        let mut count = 0;
        for i in 0..c.len() {
            let (a, b) = (c[i], c[(i + 1) % c.len()]);
            let (ha, hb) = (height(a), height(b));
            if (ha >= 0.0) != (hb >= 0.0) && count < 2 {
                crossing[count] = a + (b - a) * (ha / (ha - hb));
                count += 1;
            }
        }
        count == 2 && enters(corners, node.shape.normal(), crossing, scene.snap_m())
    })
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
