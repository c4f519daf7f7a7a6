//! Gates: points in the open, on no surface.

use std::f64::consts::PI;
use std::fmt::Write;

use glam::DVec3;

use super::motion::write_box;
use super::solved::{Solved, Wrong, grey, solve_file, solve_with};

/// What a point may be off by, as on surfaces.
const POINT: f64 = 0.01;

/// Half the edge of the lamp, and how high it hangs, m.
const LAMP: (f64, f64) = (0.2, 2.4);

/// Adds a square that faces down, by its middle and half its edge.
pub fn write_lamp(obj: &mut String, [x, y, z]: [f64; 3], half: f64) {
    writeln!(obj, "o lamp\nusemtl lamp").unwrap();
    for (dx, dy) in [(-half, -half), (-half, half), (half, half), (half, -half)] {
        writeln!(obj, "v {} {} {z}", x + dx, y + dy).unwrap();
    }
    writeln!(obj, "f -4 -3 -2 -1").unwrap();
}

/// A room of 4 x 3 x 2.5 m with a square lamp that faces down from its middle, exitance 1 W/m2, and a closed crate, solved.
fn room(rho: f64) -> Solved {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("room.obj");
    let mut obj = String::new();
    write_box(&mut obj, "wall", (DVec3::ZERO, DVec3::new(4.0, 3.0, 2.5)), (true, false), |p| p);
    write_box(&mut obj, "crate", (DVec3::splat(0.2), DVec3::new(1.0, 0.9, 0.8)), (false, false), |p| p);
    write_lamp(&mut obj, [2.0, 1.5, LAMP.1], LAMP.0);
    std::fs::write(&model, obj).unwrap();
    solve_file(&model, Some(&grey(rho, &[("lamp", 1.0)])), &["--quality", "final"])
}

fn points(points: &[[f64; 6]]) -> String {
    let mut text = "x,y,z,nx,ny,nz\n".to_owned();
    for [x, y, z, nx, ny, nz] in points {
        writeln!(text, "{x},{y},{z},{nx},{ny},{nz}").unwrap();
    }
    text
}

/// Form factor from a facet to a parallel rectangle of `a` x `b` heights above it, one of whose corners is right over it.
fn below_a_corner(a: f64, b: f64) -> f64 {
    let term = |x: f64, y: f64| x / (1.0 + x * x).sqrt() * (y / (1.0 + x * x).sqrt()).atan();
    (term(a, b) + term(b, a)) / (2.0 * PI)
}

/// To a parallel rectangle from `low` to `high`, seen from below the origin of its coordinates.
fn below([low, high]: [[f64; 2]; 2], height: f64) -> f64 {
    let corner = |x: f64, y: f64| (x * y).signum() * below_a_corner(x.abs() / height, y.abs() / height);
    corner(high[0], high[1]) - corner(low[0], high[1]) - corner(high[0], low[1]) + corner(low[0], low[1])
}

#[test]
fn a_facet_under_a_small_lamp_in_a_black_room_receives_the_form_factor_and_one_that_faces_down_nothing() {
    let (solved, mut wrong) = (room(0.0), Wrong::default());
    let places = [[2.0, 1.5, 0.8], [2.9, 0.4, 0.8], [0.01, 2.99, 1.2], [2.1, 1.6, 2.35], [2.0, 1.5, 2.399]];
    let facing = |z: f64| points(&places.map(|[x, y, height]| [x, y, height, 0.0, 0.0, z]));
    for ([x, y, z], got) in places.into_iter().zip(solved.irradiance_at(&facing(2.5))) {
        let (half, height) = LAMP;
        let (dx, dy) = (2.0 - x, 1.5 - y);
        let expected = below([[dx - half, dy - half], [dx + half, dy + half]], height - z);
        wrong.relative(&format!("{x} {y} {z}"), got, expected, POINT);
    }
    assert_eq!(solved.irradiance_at(&facing(-1.0)), [0.0; 5]);
    wrong.assert_none();
}

/// Nothing lies behind these points whose list would name the lamp; far below it, rays around a point do not meet it either.
#[test]
fn a_facet_with_nothing_but_a_lamp_around_receives_the_form_factor() {
    let dir = tempfile::tempdir().unwrap();
    let (model, mut obj) = (dir.path().join("lamp.obj"), String::new());
    write_lamp(&mut obj, [0.0; 3], 1.0);
    std::fs::write(&model, obj).unwrap();
    let (solved, mut wrong) = (solve_file(&model, Some(&grey(0.0, &[("lamp", 1.0)])), &[]), Wrong::default());
    let below_it = [(1.0, POINT), (2.0, POINT), (5.0, 3.0 * POINT)];
    let got = solved.irradiance_at(&points(&below_it.map(|(height, _)| [0.0, 0.0, -height, 0.0, 0.0, 1.0])));
    for ((height, share), got) in below_it.into_iter().zip(got) {
        wrong.relative(&format!("{height} m below"), got, below([[-1.0; 2], [1.0; 2]], height), share);
    }
    wrong.assert_none();
}

#[test]
fn a_facet_between_a_bright_floor_and_black_walls_sees_what_it_faces() {
    let (solved, mut wrong) = (solve_with("closed_cube", &grey(0.0, &[("emit", 1.0)]), &[]), Wrong::default());
    let heights = [0.5, 0.1, 0.9];
    let facing = |z: f64| points(&heights.map(|height| [0.3, 0.5, height, 0.0, 0.0, z]));
    for (height, got) in heights.into_iter().zip(solved.irradiance_at(&facing(-1.0))) {
        wrong.relative(&format!("{height} m above"), got, below([[-0.3, -0.5], [0.7, 0.5]], height), POINT);
    }
    assert_eq!(solved.irradiance_at(&facing(1.0)), [0.0; 3]);
    wrong.assert_none();
}

/// In a closed room where all emits alike the same arrives at every facet, whichever way it faces: exitance / (1 - rho).
/// So it does where a grid ends: in a wall, in an edge, in a corner.
#[test]
fn facets_in_a_furnace_receive_the_same_wherever_they_are_and_whichever_way_they_face() {
    let solved = solve_with("closed_cube", &grey(0.5, &[("wall", 1.0), ("emit", 1.0)]), &["--quality", "final"]);
    let mut wrong = Wrong::default();
    let all = [
        [0.5, 0.5, 0.5, 0.0, 0.0, 1.0],
        [0.2, 0.7, 0.8, -1.0, 0.3, 0.1],
        [0.1, 0.1, 0.001, 0.0, 0.0, 1.0],
        [0.9, 0.3, 0.001, 0.0, 0.0, -1.0],
        [0.0, 0.4, 0.8, 0.0, 0.0, 1.0],
        [0.3, 1.0, 0.8, 0.0, 0.0, -1.0],
        [1.0, 1.0, 0.3, 0.0, 0.0, 1.0],
        [0.4, 0.0, 0.0, 1.0, 0.0, 0.0],
    ];
    for (at, got) in all.iter().zip(solved.irradiance_at(&points(&all))) {
        wrong.relative(&format!("{at:?}"), got, 2.0, POINT);
    }
    wrong.assert_none();
}

#[test]
fn a_facet_just_above_a_surface_receives_what_the_surface_does_and_one_inside_a_closed_solid_nothing() {
    let (solved, mut wrong) = (room(0.5), Wrong::default());
    let places = [[2.0, 1.5, 0.0], [3.5, 0.3, 0.0], [1.1, 1.0, 0.0], [0.6, 0.5, 0.8], [0.95, 0.85, 0.8]];
    let at = |above: f64| points(&places.map(|[x, y, z]| [x, y, z + above, 0.0, 0.0, 1.0]));
    let [on, above] = [0.0, 0.001].map(|height| solved.irradiance_at(&at(height)));
    for ((place, on), above) in places.into_iter().zip(on).zip(above) {
        // Both are measured to the tolerance: two of its standard errors of a difference.
        wrong.relative(&format!("{place:?}"), above, on, 2.0 * 2f64.sqrt() * POINT);
    }
    let inside =
        points(&[[0.5, 0.5, 0.5, 0.0, 0.0, 1.0], [0.201, 0.5, 0.3, 1.0, 0.0, 0.0], [0.9, 0.8, 0.799, 1.0, 2.0, -3.0]]);
    assert_eq!(solved.irradiance_at(&inside), [0.0; 3]);
    wrong.assert_none();
}
