//! Solutions with closed forms, solved in memory.

use super::memory_scene::{MemoryScene, room};

/// Mean value theorem: any geometry, any occlusion, any mesh.
#[test]
fn a_furnace_has_the_same_radiosity_everywhere() {
    for rho in [0.2, 0.5, 0.8, 0.95] {
        let mut cube = room([0.0; 3], [1.0; 3], rho);
        for face in &mut cube {
            face.2 = 1.0;
        }
        let mut scene = MemoryScene::new(&cube);
        scene.solve(0.01);
        for i in 0..6 {
            let (got, expected) = (scene.radiosity(i), 1.0 / (1.0 - rho));
            assert!((got / expected - 1.0).abs() < 1e-5, "rho {rho}, face {i}: {got} for {expected}");
        }
    }
}

/// CU3: the continuous cube with one emitting face. Brighter ones are gates of the program: here nothing keeps power.
#[test]
fn a_cube_with_one_emitting_face_has_the_means_of_the_converged_galerkin_solution() {
    let mut cube = room([0.0; 3], [1.0; 3], 0.5);
    cube[0].2 = 1.0;
    let mut scene = MemoryScene::new(&cube);
    scene.solve(0.015);
    for (face, expected) in [(0, 1.10436), (1, 0.17122), (2, 0.18111), (4, 0.18111)] {
        let got = scene.radiosity(face);
        assert!((got / expected - 1.0).abs() < 6e-3, "face {face}: {got} for {expected}");
    }
}

#[test]
fn nothing_gets_into_a_sealed_dark_room() {
    let mut model = room([0.0; 3], [1.0; 3], 0.5);
    model[0].2 = 1.0;
    model.extend(room([1.0, 0.0, 0.0], [2.0, 1.0, 1.0], 0.5));
    let mut scene = MemoryScene::new(&model);
    scene.solve(0.02);
    for i in 6..12 {
        assert_eq!(scene.irradiance(i), 0.0, "face {i}");
    }
    assert!(scene.irradiance(1) > 0.0);
}
