//! What a ray meets: the smallest element that stands for the place.
//!
//! An element on which a wall stands has one value, that of the part round its anchor (see
//! [`crate::rays::region`]). A ray that meets its other part is answered by an element beside it: each part is
//! stood for by as many elements as it takes up, so on average what is met is what is sent. Where none does, the place
//! is taken to be as bright as others beside walls near by: see [`weights`].

use glam::DVec3;

use super::source::ClusterView;
use crate::base::name::MAX_DEPTH;
use crate::base::{ClusterId, PatchSide};
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

/// What answers a ray that met a place.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    /// The smallest element that stands for the place; `None` if none near by does.
    pub element: Option<Node>,
    /// Whether a wall stands on the element that was met.
    pub is_beside_wall: bool,
}

/// The answer of a place of a patch side to a ray from `from`, a little above where it began.
///
/// As small as elements get, not as they are stored: what is divided later is seen where it was met.
#[must_use]
pub fn answer(cuts: &Cuts<'_>, view: &ClusterView<'_>, side: PatchSide, from: DVec3, place: DVec3) -> Answer {
    let root = Node::root(view.id, &view.geometry.patches[usize::from(side.patch)], side);
    let met = smallest_at(view, root, place, cuts.min_element_m());
    if !cuts.is_cut(&met) {
        return Answer { element: Some(met), is_beside_wall: false };
    }
    let corners = met.shape.corners();
    let (u, v) = (corners[1] - corners[0], corners[corners.len() - 1] - corners[0]);
    let beside = || BESIDE.iter().map(|(a, b)| smallest_at(view, root, place + u * *a + v * *b, cuts.min_element_m()));
    let mut sharing = beside().filter(|beside| cuts.shares_part(beside, place));
    // One on which the wall stands too is as dark; what lies in the open does where there is none.
    let first = sharing.next();
    let element = first.filter(|first| cuts.is_cut(first)).or_else(|| sharing.find(|next| cuts.is_cut(next))).or(first);
    // What the ray's beginning sees as well lies on the same side, though something stands in between.
    let element = element.or_else(|| beside().find(|beside| cuts.sees_part(beside, from)));
    Answer { element, is_beside_wall: true }
}

/// How a place is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// By the element that was met, on which no wall stands.
    Open,
    /// By an element that stands for one side of a wall.
    BesideWall,
    /// By none.
    Unanswered,
}

impl Answer {
    /// How the place is answered.
    #[must_use]
    pub fn kind(&self) -> Kind {
        match (self.element, self.is_beside_wall) {
            (None, _) => Kind::Unanswered,
            (_, true) => Kind::BesideWall,
            (_, false) => Kind::Open,
        }
    }
}

/// What each place that was met counts for: 1, and what no element stands for is made up by what stands beside walls
/// of the same cluster, or where nothing does by all alike. Places beside walls are darker than others, but near lamps.
#[must_use]
pub fn weights(met: &[(ClusterId, Kind)]) -> Vec<f64> {
    let is_unanswered = |kind: Kind| kind == Kind::Unanswered;
    let mut weights: Vec<f64> = met.iter().map(|(_, kind)| if is_unanswered(*kind) { 0.0 } else { 1.0 }).collect();
    let mut unanswered: Vec<ClusterId> =
        met.iter().filter(|(_, kind)| is_unanswered(*kind)).map(|(cluster, _)| *cluster).collect();
    unanswered.sort_unstable();
    for run in unanswered.chunk_by(|a, b| a == b) {
        let mut takers: Vec<usize> = (0..met.len()).filter(|&i| met[i] == (run[0], Kind::BesideWall)).collect();
        if takers.is_empty() {
            takers = (0..met.len()).filter(|&i| !is_unanswered(met[i].1)).collect();
        }
        for &taker in &takers {
            weights[taker] += run.len() as f64 / takers.len() as f64;
        }
    }
    weights
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

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;
    use crate::model::geometry::PatchRecord;
    use crate::transport::memory_scene::MemoryScene;
    use crate::transport::source::Clusters;

    const FLOOR: PatchSide = PatchSide { patch: 0, side: 0 };

    /// A floor of 16 elements of 1 m2, on which a wall stands at x = 1.3 m.
    fn floor_with_wall() -> MemoryScene {
        let floor = vec![[0.0; 3], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 4.0, 0.0]];
        let wall = vec![[1.3, -1.0, 0.0], [1.3, 5.0, 0.0], [1.3, 5.0, 2.0], [1.3, -1.0, 2.0]];
        MemoryScene::new(&[(floor, 0.5, 0.0), (wall, 0.5, 0.0)])
    }

    #[test]
    fn a_place_beside_a_wall_is_answered_from_its_own_side_of_it() {
        let scene = floor_with_wall();
        let cuts = Cuts::new(scene.rays(), 1.0);
        let loaded = scene.cluster(ClusterId(0)).unwrap();
        let mut answered_by_others = 0;
        for (row, x) in (0..4).flat_map(|row| [1.1, 1.25, 1.4, 1.7].map(|x| (row, x))) {
            let place = DVec3::new(x, f64::from(row) + 0.4, 0.0);
            let found = answer(&cuts, &loaded.view(), FLOOR, place + DVec3::Z, place);
            assert!(found.is_beside_wall);
            let element = found.element.expect("elements in the open are near");
            let region = cuts.region(&element);
            let lies_there = match &region {
                Some(region) => region.holds(cuts.scene(), place),
                None => (element.shape.centre().x < 1.3) == (x < 1.3),
            };
            assert!(lies_there, "{place} answered by what is round {}", element.shape.centre());
            answered_by_others += usize::from((element.shape.centre().y - place.y).abs() > 0.5);
        }
        assert!(answered_by_others > 0, "each part is stood for by some elements only");
    }

    #[test]
    fn another_element_on_which_the_wall_stands_answers_before_one_in_the_open() {
        let scene = floor_with_wall();
        let cuts = Cuts::new(scene.rays(), 1.0);
        let loaded = scene.cluster(ClusterId(0)).unwrap();
        for x in [1.1, 1.6] {
            let answers: Vec<Node> = (0..4)
                .map(|row| DVec3::new(x, f64::from(row) + 0.5, 0.0))
                .map(|place| answer(&cuts, &loaded.view(), FLOOR, place + DVec3::Z, place).element.unwrap())
                .collect();
            let is_own = |element: &Node| cuts.is_cut(element);
            assert!(answers.iter().all(is_own) || !answers.iter().any(is_own), "{x}");
            assert!(answers.iter().any(is_own) || x < 1.3);
        }
    }

    #[test]
    fn a_place_in_the_open_is_answered_by_what_is_met() {
        let scene = floor_with_wall();
        let cuts = Cuts::new(scene.rays(), 1.0);
        let loaded = scene.cluster(ClusterId(0)).unwrap();
        let place = DVec3::new(2.5, 0.5, 0.0);
        let found = answer(&cuts, &loaded.view(), FLOOR, place + DVec3::Z, place);
        assert!(!found.is_beside_wall);
        assert!(found.element.unwrap().shape.centre().distance(place) < 1e-6);
    }

    #[test]
    fn what_stands_beside_walls_makes_up_for_places_that_nothing_stands_for() {
        let patch = PatchRecord {
            corners_m: [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
            corner_count: 4,
            ..PatchRecord::zeroed()
        };
        let element = Some(Node::root(ClusterId(0), &patch, PatchSide { patch: 0, side: 0 }));
        let answers = |cluster: u32, open: usize, beside_wall: usize, unanswered: usize| {
            let each = [(open, element, false), (beside_wall, element, true), (unanswered, None, true)];
            each.into_iter().flat_map(move |(count, element, is_beside_wall)| {
                std::iter::repeat_n((ClusterId(cluster), Answer { element, is_beside_wall }.kind()), count)
            })
        };
        let weights = |all: Vec<_>| weights(&all);
        assert_eq!(weights(answers(0, 1, 2, 0).collect()), [1.0; 3]);
        assert_eq!(weights(answers(0, 1, 2, 1).collect()), [1.0, 1.5, 1.5, 0.0]);
        let elsewhere = answers(1, 1, 0, 2);
        assert_eq!(weights(answers(0, 1, 2, 0).chain(elsewhere).collect()), [1.5, 1.5, 1.5, 1.5, 0.0, 0.0]);
        assert_eq!(weights(answers(0, 0, 0, 2).collect()), [0.0; 2]);
    }
}
