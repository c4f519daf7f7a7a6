//! Gates: where a model lies, how it is turned and which unit it is written in make no difference.

use std::fmt::Write;
use std::path::Path;

use glam::{DMat3, DVec3};

use super::solved::{Leaf, Solved, Wrong, irradiance, mean, solve, solve_file};

/// Corners of the faces of a box: floor, ceiling, then the walls.
const FACES: [[i32; 4]; 6] = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];

/// Writes a box as an object with a material of its name, each corner moved by `motion`; `inwards` shows its fronts to
/// the inside, `open_below` leaves its floor out.
pub fn write_box(
    obj: &mut String,
    name: &str,
    (low, high): (DVec3, DVec3),
    (inwards, open_below): (bool, bool),
    motion: impl Fn(DVec3) -> DVec3,
) {
    writeln!(obj, "o {name}\nusemtl {name}").unwrap();
    for i in 0..8u32 {
        let pick = DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
        let corner = motion(low + (high - low) * pick);
        writeln!(obj, "v {} {} {}", corner.x, corner.y, corner.z).unwrap();
    }
    for face in &FACES[usize::from(open_below)..] {
        let mut face = face.map(|corner| corner - 8);
        if !inwards {
            face.reverse();
        }
        writeln!(obj, "f {} {} {} {}", face[0], face[1], face[2], face[3]).unwrap();
    }
}

/// A small room with a table and a lamp, each corner moved by `motion`, m.
pub fn write_room(model: &Path, motion: impl Fn(DVec3) -> DVec3) {
    let mut obj = String::new();
    for (name, bounds, inwards) in [
        ("wall", (DVec3::ZERO, DVec3::new(4.0, 3.0, 2.5)), true),
        ("lamp", (DVec3::new(1.5, 1.0, 2.4), DVec3::new(2.5, 2.0, 2.45)), false),
        ("table", (DVec3::new(1.0, 0.5, 0.7), DVec3::new(3.0, 1.5, 0.8)), false),
    ] {
        write_box(&mut obj, name, bounds, (inwards, false), &motion);
    }
    std::fs::write(model, obj).unwrap();
}

const MATERIALS: &str =
    "newmtl wall\nKd 0.7 0.7 0.7\nnewmtl table\nKd 0.3 0.3 0.3\nnewmtl lamp\nKd 0 0 0\nKe 10 10 10\n";

/// Points on floor, walls, ceiling and table, with normals.
const POINTS: [(DVec3, DVec3); 9] = [
    (DVec3::new(0.5, 0.5, 0.0), DVec3::Z),
    (DVec3::new(2.1, 2.3, 0.0), DVec3::Z),
    (DVec3::new(2.0, 1.0, 0.0), DVec3::Z),
    (DVec3::new(0.0, 1.3, 1.1), DVec3::X),
    (DVec3::new(1.2, 3.0, 0.4), DVec3::NEG_Y),
    (DVec3::new(3.1, 0.0, 1.9), DVec3::Y),
    (DVec3::new(0.7, 2.2, 2.5), DVec3::NEG_Z),
    (DVec3::new(1.9, 1.1, 0.8), DVec3::Z),
    (DVec3::new(1.7, 0.9, 0.7), DVec3::NEG_Z),
];

/// Irradiance at the points of a room that is turned and then moved.
fn light_of(turn: DMat3, shift: DVec3) -> (Solved, Vec<f64>) {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("room.obj");
    write_room(&model, |p| turn * p + shift);
    let solved = solve_file(&model, Some(MATERIALS), &["--quality", "final"]);
    let mut points = String::from("x,y,z,nx,ny,nz\n");
    for (point, normal) in POINTS {
        let (p, n) = (turn * point + shift, turn * normal);
        writeln!(points, "{},{},{},{},{},{}", p.x, p.y, p.z, n.x, n.y, n.z).unwrap();
    }
    let light = solved.irradiance_at(&points);
    assert!(light.iter().all(|l| *l > 0.1), "{light:?}");
    (solved, light)
}

/// Corners are rounded anew and rays are others, so both answers differ by what either may err: 1 % at `final`, three
/// standard errors of both.
#[test]
fn a_room_that_is_turned_and_moved_has_the_same_light() {
    let (still, expected) = light_of(DMat3::IDENTITY, DVec3::ZERO);
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    let (moved, got) = light_of(turn, DVec3::new(30.0, -20.0, 10.0));
    let mut wrong = Wrong::default();
    for (i, (got, expected)) in got.into_iter().zip(expected).enumerate() {
        wrong.relative(&format!("point {i}"), got, expected, 0.042);
    }
    let absorbed = |s: &Solved| s.summary["absorbed_w"][0].as_f64().unwrap();
    wrong.relative("absorbed", absorbed(&moved), absorbed(&still), 0.005);
    wrong.assert_none();
}

/// Two models whose leaves are at corresponding places, scaled and moved.
fn compare_leaves(here: &[Leaf], there: &[Leaf]) {
    let mut wrong = Wrong::default();
    let lit = |leaves: &[Leaf]| mean(leaves.iter().filter(|l| irradiance(l) > 0.0), irradiance);
    // Rounding of corners to f32 may tip a decision of the oracle on one link.
    let limit = 1e-3 * lit(here);
    assert_eq!(here.len(), there.len(), "leaves");
    for (a, b) in here.iter().zip(there) {
        assert_eq!(a.name, b.name);
        wrong.at_most((irradiance(a) - irradiance(b)).abs(), limit, || {
            format!("{:?}: {} and {}", a.name, irradiance(a), irradiance(b))
        });
    }
    wrong.assert_none();
}

#[test]
fn a_model_far_from_zero_has_the_light_of_the_same_model_at_zero() {
    let flags = ["--quality", "draft"];
    compare_leaves(&solve("two_rooms_one_door", &flags).leaves(), &solve("georeferenced_room", &flags).leaves());
}

/// Corners that are rounded at another place let rays be drawn otherwise, so that both differ by what either may err.
#[test]
fn a_model_in_inches_has_the_light_of_the_same_model_in_metres() {
    let mean_of = |flags: &[&str]| mean(&solve("closed_cube", flags).leaves(), irradiance);
    let mut wrong = Wrong::default();
    wrong.relative("mean", mean_of(&["--units", "in"]), mean_of(&[]), 0.005);
    wrong.assert_none();
}
