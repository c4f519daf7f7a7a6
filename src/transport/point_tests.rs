//! Points in the open, where the light is known on paper.

use glam::DVec3;

use super::kernel::form_factor::point_to_polygon;
use super::measure::lamps::LightTree;
use super::measure::path::InSight;
use super::measure::point::Gather;
use super::memory_scene::{MemoryScene, room};
use crate::base::ClusterId;
use crate::geom::polygon::Polygon;
use crate::rays::node::Facet;

/// The lamp of [`black_room`].
const LAMP: ClusterId = ClusterId(6);

/// A black room with a lamp of 1 x 0.5 m that faces down, exitance 1 W/m2.
fn black_room() -> (MemoryScene, Vec<DVec3>) {
    let corners = [[1.5, 1.25], [1.5, 1.75], [2.5, 1.75], [2.5, 1.25]].map(|[x, y]| [x, y, 2.4]);
    let mut faces = room([0.0; 3], [4.0, 3.0, 2.5], 0.0);
    faces.push((corners.to_vec(), 0.0, 1.0));
    (MemoryScene::new(&faces), corners.map(DVec3::from_array).to_vec())
}

/// A lamp that is in no list is met by the rays over the hemisphere; one that is in the list counts once.
#[test]
fn a_lamp_counts_once_whether_rays_are_sent_to_it_or_not() {
    let (scene, corners) = black_room();
    let gather = Gather { scene: scene.rays(), clusters: &scene, lights: &scene, tolerance: 0.01 };
    for place in [DVec3::new(2.0, 1.5, 0.8), DVec3::new(3.0, 1.0, 1.5)] {
        let facet = Facet { place, normal: DVec3::Z, on: None };
        let expected = point_to_polygon(place, DVec3::Z, &Polygon::new(&corners));
        for (listed, off) in [(vec![LAMP], 0.002), (vec![], 0.03)] {
            let tree = LightTree::of_clusters(&scene, &listed).unwrap();
            let got = gather.at(&facet, &InSight { clusters: listed, tree }, &mut 0).unwrap().0[0];
            assert!((got / expected - 1.0).abs() < off, "{place}: {got} for {expected}");
        }
    }
}

/// What sees a lamp past a point lies behind it.
#[test]
fn the_clusters_around_a_point_are_those_before_and_behind_it() {
    let (scene, _) = black_room();
    let gather = Gather { scene: scene.rays(), clusters: &scene, lights: &scene, tolerance: 0.01 };
    let facet = Facet { place: DVec3::new(2.0, 1.5, 0.8), normal: DVec3::Z, on: None };
    let around = gather.around(&facet, &mut 0).unwrap();
    let expected: Vec<ClusterId> = (0..6).map(ClusterId).collect();
    assert!(expected.iter().all(|wall| around.contains(wall)), "{around:?}");
}
