//! Gates: a room with so much in it that what is in sight is surveyed, and lamps too where they are many.

use std::fmt::Write;

use glam::DVec3;

use super::motion::write_box;
use super::solved::{Leaf, Solved, Wrong, grey, irradiance, mean, radiosity, solve_to};
use super::{BALANCE, MEAN, compare_mean_value};

const ROOM: DVec3 = DVec3::new(6.0, 4.0, 3.0);

/// Stands on the floor and is closed, with a box in it.
const CUPBOARD: (DVec3, DVec3) = (DVec3::new(4.03, 2.57, 0.0), DVec3::new(5.21, 3.44, 2.0));

/// A hundred boxes in three layers and a closed cupboard under `lamps` lamps, each an object of its own.
fn cluttered_room(lamps: u32) -> String {
    let mut obj = String::new();
    let mut add = |name: &str, low: DVec3, high: DVec3, inwards: bool| {
        let open_below = !inwards && low.z == 0.0;
        write_box(&mut obj, name, (low, high), (inwards, open_below), |corner| corner);
    };
    add("wall", DVec3::ZERO, ROOM, true);
    add("cupboard", CUPBOARD.0, CUPBOARD.1, false);
    let inside = DVec3::new(4.4, 2.8, 0.6);
    add("box", inside, inside + 0.4, false);
    for i in 0..100u32 {
        let cell = DVec3::new(f64::from(i % 7), f64::from(i / 7 % 5), f64::from(i / 35));
        let size = DVec3::new(0.2, 0.25, 0.1) * (1.0 + 0.13 * f64::from(i * 7 % 11));
        let low = DVec3::new(0.25, 0.25, 0.2) + cell * DVec3::new(0.52, 0.72, 0.7);
        add("box", low, low + size, false);
    }
    for i in 0..lamps {
        let low = DVec3::new(0.3 + 0.7 * f64::from(i % 8), 0.35 + 0.68 * f64::from(i / 8), 2.4);
        add("lamp", low, low + DVec3::new(0.3, 0.3, 0.05), false);
    }
    obj
}

/// Where a wall stands across the room, as thick as that, to a gap at its end.
const ACROSS: [f64; 2] = [3.37, 3.47];

/// The room with a wall across, boxes on both sides of it and a lamp on one; `joints`: where floor, ceiling and the walls
/// along are divided.
fn two_cluttered_rooms(joints: &[f64]) -> String {
    let mut obj = String::from("o shell\nusemtl wall\n");
    let mut quad = |corners: [[f64; 3]; 4], turned: bool| {
        for [x, y, z] in corners {
            writeln!(obj, "v {x} {y} {z}").unwrap();
        }
        writeln!(obj, "f {}", if turned { "-1 -2 -3 -4" } else { "-4 -3 -2 -1" }).unwrap();
    };
    let DVec3 { x: length, y: width, z: height } = ROOM;
    let ends: Vec<f64> = [&[0.0], joints, &[length]].concat();
    for piece in ends.windows(2) {
        let (a, b) = (piece[0], piece[1]);
        for (z, turned) in [(0.0, false), (height, true)] {
            quad([[a, 0.0, z], [b, 0.0, z], [b, width, z], [a, width, z]], turned);
        }
        for (y, turned) in [(0.0, false), (width, true)] {
            quad([[a, y, 0.0], [a, y, height], [b, y, height], [b, y, 0.0]], turned);
        }
    }
    for (x, turned) in [(0.0, false), (length, true)] {
        quad([[x, 0.0, 0.0], [x, width, 0.0], [x, width, height], [x, 0.0, height]], turned);
    }
    let mut add = |name: &str, low: DVec3, high: DVec3| {
        write_box(&mut obj, name, (low, high), (false, false), |corner| corner);
    };
    add("wall", DVec3::new(ACROSS[0], -0.1, -0.1), DVec3::new(ACROSS[1], 3.7, height + 0.1));
    add("lamp", DVec3::new(0.6, 1.6, 2.6), DVec3::new(1.6, 2.4, 2.65));
    for i in 0..96u32 {
        let cell = DVec3::new(f64::from(i % 8), f64::from(i / 8 % 4), f64::from(i / 32));
        let side = if i % 8 < 4 { 0.25 } else { 1.1 };
        let size = DVec3::new(0.2, 0.25, 0.1) * (1.0 + 0.1 * f64::from(i * 7 % 11));
        let low = DVec3::new(side, 0.25, 0.2) + cell * DVec3::new(0.62, 0.8, 0.7);
        add("box", low, low + size);
    }
    obj
}

fn solve_room(codes: &[i32], lamps: u32, materials: &str) -> Solved {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join(format!("{lamps} lamps.obj"));
    std::fs::write(&model, cluttered_room(lamps)).unwrap();
    solve_to(codes, &model, Some(materials), &["--quality", "draft"])
}

/// What arrives in the room that is lit through the gap, W/m2: area mean over floor, ceiling and walls, without what
/// the wall cuts.
fn irradiance_behind_the_wall(joints: &[f64]) -> f64 {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join(format!("joints {joints:?}.obj"));
    std::fs::write(&model, two_cluttered_rooms(joints)).unwrap();
    let flags = ["--quality", "draft", "--min-element", "0.3"];
    // Elements this large cannot be as good as `draft` asks for.
    let solved = solve_to(&[0, 3], &model, Some(&grey(0.5, &[("lamp", 1.0)])), &flags);
    let is_behind = |l: &&Leaf| l.name[0] == 0 && l.name[2] == 0 && l.centre[0] > ACROSS[1] + 0.6;
    mean(solved.leaves().iter().filter(is_behind), irradiance)
}

/// Whether a leaf's side looks into the cupboard; leaves of the floor across its walls may stand for what is outside.
fn is_in_the_cupboard(leaf: &Leaf) -> bool {
    let before = DVec3::from_array(leaf.centre) + 1e-4 * DVec3::from_array(leaf.normal);
    let margin = if leaf.centre[2] == 0.0 { DVec3::new(1.0, 1.0, 0.0) * leaf.area_m2.sqrt() } else { DVec3::ZERO };
    before.cmpgt(CUPBOARD.0 + margin).all() && before.cmplt(CUPBOARD.1 - margin).all()
}

/// `draft` for the time it takes.
fn expect_right(lamps: u32) {
    let solved = solve_room(&[0], lamps, &grey(0.5, &[("lamp", 1.0)]));
    let closed: Vec<Leaf> = solved.leaves().into_iter().filter(is_in_the_cupboard).collect();
    assert!(closed.len() >= 10, "{} leaves in the cupboard", closed.len());
    let brightest = closed.iter().map(irradiance).fold(0.0, f64::max);
    assert_eq!(brightest, 0.0, "{lamps} lamps: light in the closed cupboard");
    let balance = solved.summary["energy_balance"].as_f64().unwrap();
    assert!(balance <= BALANCE, "{lamps} lamps: energy balance {balance}");
    compare_mean_value(&solved, 0.5, MEAN);
}

#[test]
fn a_cluttered_room_keeps_its_light_and_its_cupboard_dark() {
    expect_right(1);
}

#[test]
fn a_cluttered_room_under_many_lamps_keeps_its_light_and_its_cupboard_dark() {
    expect_right(8);
}

/// Where all emits alike, what arrives is the same at any point, whatever is in sight. `draft` for the time it takes.
#[test]
fn what_arrives_in_a_cluttered_furnace_is_the_same_everywhere() {
    let emitters = ["wall", "box", "lamp", "cupboard"].map(|name| (name, 1.0));
    // Emitters count in no error: what is estimated here is that of the few sides that do not emit.
    let solved = solve_room(&[0, 3], 1, &grey(0.5, &emitters));
    let (expected, mut wrong) = (1.0 / (1.0 - 0.5), Wrong::default());
    let mut points = String::from("x,y,z,nx,ny,nz\n");
    for i in 0..10 {
        let along = 0.5 * f64::from(i) + 0.17;
        writeln!(points, "{along},0.11,0,0,0,1\n{along},4,1.3,0,-1,0\n0,{},2.1,1,0,0", 0.4 * along + 0.2).unwrap();
    }
    // A point may err by the tolerance, all of them by little.
    let arriving = solved.irradiance_at(&points);
    wrong.relative("points", arriving.iter().sum::<f64>() / arriving.len() as f64, expected, 0.02);
    for (i, got) in arriving.into_iter().enumerate() {
        wrong.relative(&format!("point {i}"), got, expected, 3.0 * 0.05);
    }
    let is_box = |l: &&Leaf| l.name[0] >= 2 && l.name[2] == 0 && !is_in_the_cupboard(l);
    let leaves = solved.leaves();
    wrong.relative("boxes and lamps", mean(leaves.iter().filter(is_box), radiosity), expected, 0.02);
    wrong.assert_none();
}

/// Nodes and elements on both sides of the wall would carry light through it: at `draft` one of the two rooms is far
/// below what matters to the mean. With what the wall cuts in pieces from the start it gets 1.7 times what 300,000
/// traced photons bring, 1.9e-4 W/m2.
#[test]
fn a_wall_across_a_floor_leaves_the_room_behind_it_about_as_dark_as_one_between_two_floors() {
    let (whole, divided) = (irradiance_behind_the_wall(&[]), irradiance_behind_the_wall(&ACROSS));
    assert!(divided > 0.0, "light comes through the gap");
    let mut wrong = Wrong::default();
    wrong.at_most(whole, 4.0 * divided, || format!("one floor: {whole} W/m2, two: {divided}"));
    wrong.assert_none();
}
