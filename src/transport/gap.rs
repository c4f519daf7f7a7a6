//! Gaps that elements are too large for: paths are followed until they have left them.

use glam::DVec3;

use super::source::Clusters;
use crate::base::{ClusterId, NodeName, Result, Rgb};
use crate::geom::sequence::{Sequence, cosine_direction, mix, mix_point};
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::rays::traverse::Nearest;

/// Smallest elements up to which what is seen is too close for them to tell how its light changes.
const NEAR_ELEMENTS: f64 = 2.0;

/// Share of what is seen that is close in a gap.
const GAP_SHARE: f64 = 0.85;

/// Whether a place whose `count` rays `met` this lies in a gap.
pub(super) fn is_gap(met: &[Met], count: u64, min_element_m: f64) -> bool {
    let near = met.iter().filter(|found| found.is_near(min_element_m)).count();
    near as f64 > GAP_SHARE * count as f64
}

/// Rays that tell whether a place that a path met lies in a gap.
const PROBES: u64 = 8;

/// Reflections of a path within a gap: what is left after that is black.
const MOST_REFLECTIONS: u64 = 16;

/// What a ray met.
#[derive(Clone, Copy)]
pub(super) struct Met {
    pub(super) side: NodeName,
    /// The smallest element there.
    pub(super) element: Node,
    pub(super) to: DVec3,
    distance_m: f64,
}

impl Met {
    /// Whether the place is too close for elements to tell how its light changes; none is larger than twice
    /// `min_element_m` there unless its light hardly changes.
    fn is_near(&self, min_element_m: f64) -> bool {
        self.distance_m < NEAR_ELEMENTS * self.element.shape.longest_edge().min(min_element_m)
    }
}

/// What elements are, and what rays between them meet.
#[derive(Clone, Copy)]
pub(super) struct Surroundings<'a> {
    pub(super) scene: &'a RayScene<'a>,
    pub(super) clusters: &'a dyn Clusters,
    /// No element edge is below this, m.
    pub(super) min_element_m: f64,
}

impl Surroundings<'_> {
    /// What a ray from an element meets; `None` where nothing takes part.
    fn meet(&self, from: DVec3, direction: DVec3, element: &Node) -> Result<Option<Met>> {
        let Nearest::Met(hit) = self.scene.nearest(from, direction, Some(&element.end)) else { return Ok(None) };
        let loaded = self.clusters.cluster(ClusterId(hit.key.cluster))?;
        let (view, at) = (loaded.view(), hit.side());
        let to = from + direction * hit.t;
        Ok(view.takes_part(at.index()).then(|| Met {
            side: NodeName::root(view.id, at),
            element: view.smallest_at(at, to, self.min_element_m),
            to,
            distance_m: hit.t,
        }))
    }

    /// What `count` cosine-weighted rays from a place of an element meet, and the sequence that they follow. Counts them
    /// in `rays`.
    pub(super) fn cast(&self, from: DVec3, element: &Node, count: u64, rays: &mut u64) -> Result<(Vec<Met>, Sequence)> {
        let sequence = Sequence::new(mix(mix_point(from)));
        let mut met = Vec::new();
        for index in 0..count {
            let [_, _, c, d] = sequence.point(index);
            *rays += 1;
            met.extend(self.meet(from, cosine_direction(element.normal, c, d), element)?);
        }
        Ok((met, sequence))
    }
}

/// A gap in which paths from a point begin.
pub(super) struct Gap<'a> {
    pub(super) around: Surroundings<'a>,
    /// The point's.
    pub(super) sequence: Sequence,
    /// How many begin there.
    pub(super) paths: u64,
}

impl Gap<'_> {
    /// Light that leaves a place towards where path `index` met it from, W/m2: that of its leaf, unless it is too close
    /// for that or lies in a gap itself, as what is met along a gap does.
    pub(super) fn follow(&self, index: u64, mut met: Met, rays: &mut u64) -> Result<Rgb> {
        let mut through = Rgb::grey(1.0);
        for reflection in 0..MOST_REFLECTIONS {
            let leaf = met.element;
            let loaded = self.around.clusters.cluster(met.side.cluster())?;
            let view = loaded.view();
            if view.emits(leaf.name) || !self.holds(&met, &leaf, rays)? {
                return Ok(through.times(view.source(leaf.name).radiosity));
            }
            through = through.times(Rgb::from_f32(view.materials[leaf.name.patch_side().index()].rho));
            let [_, _, c, d] = self.sequence.point((reflection + 1) * self.paths + index);
            *rays += 1;
            let direction = cosine_direction(leaf.normal, c, d);
            let Some(next) = self.around.meet(met.to, direction, &leaf)? else { return Ok(Rgb::BLACK) };
            met = next;
        }
        Ok(Rgb::BLACK)
    }

    /// Whether a path is still in the gap where it met a leaf.
    fn holds(&self, met: &Met, leaf: &Node, rays: &mut u64) -> Result<bool> {
        let min_element_m = self.around.min_element_m;
        if met.is_near(min_element_m) {
            return Ok(true);
        }
        let (probed, _) = self.around.cast(met.to, leaf, PROBES, rays)?;
        Ok(is_gap(&probed, PROBES, min_element_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::memory_scene::MemoryScene;

    /// A floor with a sheet 3 cm above a quarter of it, and a wall along its end.
    fn floor_with_sheet() -> MemoryScene {
        let floor = vec![[0.0; 3], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 4.0, 0.0]];
        let sheet = vec![[0.0, 0.0, 0.03], [0.0, 2.0, 0.03], [2.0, 2.0, 0.03], [2.0, 0.0, 0.03]];
        let wall = vec![[4.0, 0.0, 0.0], [4.0, 0.0, 3.0], [4.0, 4.0, 3.0], [4.0, 4.0, 0.0]];
        MemoryScene::new(&[floor, sheet, wall].map(|corners| (corners, 0.5, 0.0)))
    }

    #[test]
    fn what_a_ray_meets_far_along_a_gap_lies_in_it() {
        let scene = floor_with_sheet();
        let rays = scene.rays();
        let around = Surroundings { scene: &rays, clusters: &scene, min_element_m: 0.1 };
        let loaded = scene.cluster(ClusterId(0)).unwrap();
        let side = crate::base::PatchSide { patch: 0, side: 0 };
        let floor = Node::root(ClusterId(0), &loaded.view().geometry.patches[0], side);
        let gap = Gap { around, sequence: Sequence::new(1), paths: 1 };
        let holds = |from: DVec3, to: DVec3| {
            let met = around.meet(from, (to - from).normalize(), &floor).unwrap().expect("something is there");
            assert!(met.to.distance(to) < 1e-3 && !met.is_near(0.1), "{} for {to}", met.to);
            gap.holds(&met, &met.element, &mut 0).unwrap()
        };
        assert!(holds(DVec3::new(0.2, 0.2, 0.0), DVec3::new(1.7, 1.2, 0.03)), "at the sheet, from below it");
        assert!(!holds(DVec3::new(3.0, 1.0, 0.0), DVec3::new(4.0, 1.2, 1.0)), "at the wall");
        assert!(!holds(DVec3::new(1.9, 1.0, 0.0), DVec3::new(4.0, 1.0, 0.02)), "at the wall, out of the gap");
    }
}
