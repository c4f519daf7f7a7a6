//! What a ray meets: the smallest element that stands for the place.
//!
//! An element on which a wall stands has one value, that of the part round its anchor (see
//! [`crate::rays::region`]). A ray that meets its other part is answered by an element beside it: each part is
//! stood for by as many elements as it takes up, so on average what is met is what is sent.

use glam::DVec3;

use super::source::ClusterView;
use crate::base::PatchSide;
use crate::base::name::MAX_DEPTH;
use crate::geom::quadtree;
use crate::rays::node::Node;
use crate::rays::region::Cuts;

/// Elements that are asked, in steps along two edges: the one that was met, then those beside it.
const BESIDE: [(f64, f64); 13] = [
    (0.0, 0.0),
    (1.0, 0.0),
    (-1.0, 0.0),
    (0.0, 1.0),
    (0.0, -1.0),
    (1.0, 1.0),
    (-1.0, 1.0),
    (1.0, -1.0),
    (-1.0, -1.0),
    (2.0, 0.0),
    (-2.0, 0.0),
    (0.0, 2.0),
    (0.0, -2.0),
];

/// The smallest element that stands for a place of a patch side; `None` if none near by does.
///
/// As small as elements get, not as they are stored: what is divided later is seen where it was met.
#[must_use]
pub fn element_at(cuts: &Cuts<'_>, view: &ClusterView<'_>, side: PatchSide, place: DVec3) -> Option<Node> {
    let root = Node::root(view.id, &view.geometry.patches[usize::from(side.patch)], side);
    let met = smallest_at(view, root, place, cuts.min_element_m());
    if !cuts.is_cut(&met) {
        return Some(met);
    }
    let corners = met.shape.corners();
    let (u, v) = (corners[1] - corners[0], corners[corners.len() - 1] - corners[0]);
    BESIDE.iter().find_map(|(a, b)| {
        let beside = smallest_at(view, root, place + u * *a + v * *b, cuts.min_element_m());
        cuts.shares_part(&beside, place).then_some(beside)
    })
}

fn smallest_at(view: &ClusterView<'_>, root: Node, place: DVec3, min_element_m: f64) -> Node {
    let mut element = root;
    while element.name.depth() < MAX_DEPTH
        && (!element.is_smallest(min_element_m) || view.light.has_children(element.name))
    {
        element = element.child(quadtree::child_at(&element.shape, place));
    }
    element
}
