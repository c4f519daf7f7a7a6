//! Places measured anew where the light is known on paper.

use std::rc::Rc;

use super::light::lit::{Lights, LitCluster};
use super::measure::audit::{Audit, Finding, Known, Leaf, Measured, Tally};
use super::measure::lamps::LightTree;
use super::measure::path::InSight;
use super::memory_scene::{MemoryScene, room};
use super::nodes::mesh::Mesh;
use super::norm::Norm;
use super::source::Clusters;
use crate::base::{ClusterId, PatchSide, Result, Rgb};
use crate::geom::sequence::{mix, unit};
use crate::rays::node::Node;

/// Light that is the same on all sides, W/m2.
struct Even<'a>(&'a MemoryScene, f64);

impl Lights for Even<'_> {
    fn lit(&self, id: ClusterId) -> Result<Rc<LitCluster>> {
        let loaded = self.0.cluster(id)?;
        let view = loaded.view();
        let mut mesh = Mesh::new(id, view.geometry.patches);
        mesh.elements.iter_mut().for_each(|element| element.line.mean = Rgb::grey(self.1));
        Ok(Rc::new(LitCluster::of(&mesh, view.geometry.patches, view.materials)))
    }
}

/// The six faces of a cube.
const FACES: [ClusterId; 6] = [ClusterId(0), ClusterId(1), ClusterId(2), ClusterId(3), ClusterId(4), ClusterId(5)];

/// Calls `visit` with what places of all six faces of a cube measure, each face with so many; rays are sent to the lamps of
/// the clusters `in_sight`.
fn measure((scene, in_sight): (&MemoryScene, &[ClusterId]), stored: f64, places: u64, mut visit: impl FnMut(Measured)) {
    let tree = LightTree::of_clusters(scene, in_sight).unwrap();
    let all = Rc::new(InSight { clusters: in_sight.to_vec(), tree });
    let lights = Even(scene, stored);
    let audit = Audit { scene: scene.rays(), clusters: scene, lights: &lights, lamps: &|_| Ok(all.clone()) };
    for face in FACES {
        let loaded = scene.cluster(face).unwrap();
        let front = PatchSide { patch: 0, side: 0 };
        let node = Node::root(face, &loaded.view().geometry.patches[0], front);
        for turn in 0..places {
            let seed = mix(turn ^ mix(u64::from(face.0) + 7));
            let place = node.shape.even_point(unit(mix(seed)), unit(mix(seed ^ 1)));
            visit(audit.measure(&node, place, seed).unwrap());
        }
    }
}

/// Audits light of `stored` W/m2 on all sides of a cube whose faces reflect half, and emit 1 W/m2: true is 2.
fn furnace(stored: f64) -> (Known, Known) {
    let faces: Vec<_> =
        room([0.0; 3], [1.0; 3], 0.5).into_iter().map(|(corners, rho, _)| (corners, rho, 1.0)).collect();
    let (scene, norm, mut tally) = (MemoryScene::new(&faces), Norm::of_mean(2.0), Tally::default());
    let leaf = Leaf { element: 0, area_m2: 1.0, expected: 1.0, norm: 3.0 * stored * stored };
    measure((&scene, &FACES), stored, 40, |measured| {
        tally.add(&Finding::new(Rgb::grey(stored), &measured, &leaf, &norm), 1.0);
    });
    tally.verdict(leaf.norm, 240).unwrap()
}

#[test]
fn exact_light_has_no_error_and_no_bias() {
    let (error, bias) = furnace(2.0);
    assert!(error.value <= 3.0 * error.error && error.value < 1e-3, "{error:?}");
    assert!(bias.value.abs() <= 3.0 * bias.error && bias.error < 0.01, "{bias:?}");
}

#[test]
fn what_all_light_is_off_by_shows_in_the_bias_and_not_all_of_it_where_gathers_read_it() {
    let (error, bias) = furnace(1.9);
    // Lamps bring 1, and half of 1.9 comes back.
    assert!((error.value - 0.05 / 1.95).abs() < 1e-3, "{error:?}");
    assert!((bias.value + 0.05).abs() <= 3.0 * bias.error && bias.error < 0.01, "{bias:?}");
}

/// In a closed room of one reflectance what arrives is, on average, what is emitted over 1 - rho.
fn compare_with_what_goes_round(in_sight: &[ClusterId], share: f64) {
    let mut faces = room([0.0; 3], [1.0; 3], 0.8);
    faces[1].2 = 1.0;
    let (mut sum, mut squares, mut n) = (0.0, 0.0, 0.0);
    measure((&MemoryScene::new(&faces), in_sight), 0.0, 400, |measured| {
        let light = measured.carried.0[0];
        (sum, squares, n) = (sum + light, squares + light * light, n + 1.0);
    });
    let (mean, expected) = (sum / n, 1.0 / (6.0 * 0.2));
    let error = ((squares / n - mean * mean) / n).sqrt();
    assert!((mean - expected).abs() <= 3.0 * error && error < share * expected, "{mean} +- {error} for {expected}");
}

#[test]
fn paths_bring_what_goes_round() {
    compare_with_what_goes_round(&FACES, 0.01);
}

#[test]
fn a_lamp_that_visibility_has_missed_is_found_by_who_meets_it() {
    compare_with_what_goes_round(&[], 0.02);
}
