//! Gates: what stands on a large floor, hovers over it or pierces it. What is *stored* beside its foot is what a gather
//! gives there, and beneath it all is dark.

use std::f64::consts::{PI, TAU};
use std::fmt::Write;

use glam::{DMat3, DVec3};

use super::motion::write_box;
use super::solved::{Leaf, Solved, Wrong, irradiance, mean, solve_file};

const MATERIALS: &str = "newmtl *\nKd 0.6 0.6 0.6\nnewmtl lamp\nKd 0 0 0\nKe 8 8 8\n";

/// A room of one large floor patch with a lamp below its ceiling, and what `add` writes into it, solved.
fn solve_with(name: &str, add: impl Fn(&mut String)) -> Solved {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join(format!("{name}.obj"));
    let mut obj = String::new();
    let room = (DVec3::ZERO, DVec3::new(6.0, 5.0, 3.0));
    let lamp = (DVec3::new(3.4, 2.9, 2.9), DVec3::new(4.4, 3.9, 2.95));
    write_box(&mut obj, "wall", room, (true, false), |p| p);
    write_box(&mut obj, "lamp", lamp, (false, false), |p| p);
    add(&mut obj);
    std::fs::write(&model, obj).unwrap();
    solve_file(&model, Some(MATERIALS), &[])
}

/// A box of 1 x 1 x 0.6 m about its middle on the floor.
fn crate_at(low: f64, motion: impl Fn(DVec3) -> DVec3) -> impl Fn(&mut String) {
    let bounds = (DVec3::new(-0.5, -0.5, low), DVec3::new(0.5, 0.5, low + 0.6));
    move |obj| write_box(obj, "crate", bounds, (false, false), &motion)
}

fn at(leaf: &Leaf) -> DVec3 {
    DVec3::from_array(leaf.centre)
}

/// Leaves of the floor's upper side where `holds` says so.
fn floor(solved: &Solved, holds: impl Fn(DVec3) -> bool) -> Vec<Leaf> {
    let is_floor = |l: &Leaf| l.name[0] == 0 && l.normal[2] > 0.9 && l.centre[2].abs() < 1e-4;
    solved.leaves().into_iter().filter(|l| is_floor(l) && holds(at(l))).collect()
}

/// What a gather gives at the leaves' centres, W/m2.
fn gathered(solved: &Solved, leaves: &[Leaf]) -> Vec<f64> {
    let mut points = "x,y,z,nx,ny,nz\n".to_owned();
    for leaf in leaves {
        let [x, y, _] = leaf.centre;
        writeln!(points, "{x},{y},0,0,0,1").unwrap();
    }
    solved.irradiance_at(&points)
}

/// Root of the mean squared difference of stored light from a gather's, relative to the gather's mean.
fn off(solved: &Solved, leaves: &[Leaf]) -> f64 {
    let (mut squares, mut sum, mut area) = (0.0, 0.0, 0.0);
    for (leaf, there) in leaves.iter().zip(gathered(solved, leaves)) {
        squares += leaf.area_m2 * (irradiance(leaf) - there).powi(2);
        sum += leaf.area_m2 * there;
        area += leaf.area_m2;
    }
    (squares / area).sqrt() / (sum / area)
}

/// Expects stored light beside a foot to be what is gathered there, and nothing beneath.
fn expect(solved: &Solved, beneath: impl Fn(DVec3) -> bool, beside: impl Fn(DVec3) -> bool) {
    let covered = floor(solved, beneath);
    assert!(!covered.is_empty(), "{}: leaves beneath", solved.title);
    let brightest = covered.iter().map(irradiance).fold(0.0, f64::max);
    let around = floor(solved, beside);
    assert!(around.len() > 20, "{}: {} leaves beside", solved.title, around.len());
    let mut wrong = Wrong::default();
    let off = off(solved, &around);
    wrong.at_most(brightest, 0.0, || format!("{}: {brightest} W/m2 beneath", solved.title));
    wrong.at_most(off, 0.1, || format!("{}: {:.1} % off beside the foot", solved.title, 100.0 * off));
    wrong.assert_none();
}

/// Distance in the plane from a square of 1 m about `middle`, turned by `turn`; below 0 inside.
fn from_square(p: DVec3, middle: DVec3, turn: DMat3) -> f64 {
    let own = (turn.transpose() * (p - middle)).abs();
    own.x.max(own.y) - 0.5
}

fn expect_crate(name: &str, low: f64, middle: DVec3, turn: DMat3) {
    let solved = solve_with(name, crate_at(low, |p| turn * p + middle));
    let from = |p: DVec3| from_square(p, middle, turn);
    expect(&solved, |p| from(p) < -1e-3, |p| from(p) > 0.0 && from(p) < 0.3);
}

const MIDDLE: DVec3 = DVec3::new(2.4, 2.2, 0.0);

#[test]
fn beside_a_box_on_a_large_floor_stored_light_is_what_is_gathered_and_beneath_it_is_none() {
    expect_crate("standing", 0.0, MIDDLE, DMat3::IDENTITY);
}

#[test]
fn the_same_where_the_box_is_moved_by_a_third_of_an_element() {
    expect_crate("moved", 0.0, MIDDLE + DVec3::new(0.033, 0.021, 0.0), DMat3::IDENTITY);
}

#[test]
fn the_same_where_the_box_is_turned() {
    expect_crate("turned", 0.0, MIDDLE, DMat3::from_rotation_z(PI / 6.0));
}

#[test]
fn the_same_where_the_box_pierces_the_floor() {
    expect_crate("piercing", -0.2, MIDDLE, DMat3::IDENTITY);
}

#[test]
fn beneath_a_box_that_hovers_by_a_tenth_of_a_millimetre_it_is_dark() {
    let solved = solve_with("hovering_0_1_mm", crate_at(1e-4, |p| p + MIDDLE));
    let from = |p: DVec3| from_square(p, MIDDLE, DMat3::IDENTITY);
    let beneath = floor(&solved, |p| from(p) < -0.05);
    let lit = mean(&floor(&solved, |p| from(p) > 0.0), irradiance);
    let brightest = beneath.iter().map(irradiance).fold(0.0, f64::max);
    assert!(brightest < 1e-3 * lit, "{brightest} W/m2 beneath, {lit} W/m2 elsewhere");
}

#[test]
fn beneath_a_box_that_hovers_by_five_millimetres_there_is_what_is_gathered() {
    let solved = solve_with("hovering", crate_at(5e-3, |p| p + MIDDLE));
    let from = |p: DVec3| from_square(p, MIDDLE, DMat3::IDENTITY);
    let beneath = floor(&solved, |p| from(p) < 0.0);
    let there = gathered(&solved, &beneath);
    let area: f64 = beneath.iter().map(|l| l.area_m2).sum();
    let expected = beneath.iter().zip(there).map(|(l, h)| l.area_m2 * h).sum::<f64>() / area;
    let lit = mean(&floor(&solved, |p| from(p) > 0.0), irradiance);
    let stored = mean(&beneath, irradiance);
    let mut wrong = Wrong::default();
    wrong.at_most((stored - expected).abs(), 1e-2 * lit, || format!("{stored} W/m2 stored, {expected} gathered"));
    wrong.assert_none();
}

/// A prism of `n` facets from the floor up.
fn write_column(obj: &mut String, n: u32, radius: f64, height: f64) {
    writeln!(obj, "o column\nusemtl column").unwrap();
    for i in 0..n {
        let angle = TAU * f64::from(i) / f64::from(n);
        let (x, y) = (MIDDLE.x + radius * angle.cos(), MIDDLE.y + radius * angle.sin());
        writeln!(obj, "v {x} {y} 0\nv {x} {y} {height}").unwrap();
    }
    let n = i64::from(n);
    for i in 0..n {
        let (a, b) = (2 * i - 2 * n, 2 * ((i + 1) % n) - 2 * n);
        writeln!(obj, "f {a} {b} {} {}", b + 1, a + 1).unwrap();
    }
}

#[test]
fn beside_a_column_of_48_facets_stored_light_is_what_is_gathered() {
    let solved = solve_with("column", |obj| write_column(obj, 48, 0.15, 3.0));
    let from = |p: DVec3| (p - MIDDLE).truncate().length() - 0.15;
    // Its foot is cut to within a centimetre: a strip of it lies in the open.
    let (inside, around) = (floor(&solved, |p| from(p) < -0.02), floor(&solved, |p| from(p) > 0.0 && from(p) < 0.3));
    let (beneath, beside) = (mean(&inside, irradiance), mean(&around, irradiance));
    let off = off(&solved, &around);
    let mut wrong = Wrong::default();
    wrong.at_most(beneath, 1e-2 * beside, || format!("{beneath} W/m2 beneath, {beside} beside"));
    wrong.at_most(off, 0.1, || format!("{:.1} % off beside the foot", 100.0 * off));
    wrong.assert_none();
}

/// A wall along a quarter of a circle of 1 m, in facets of 2 cm.
#[test]
fn beside_a_curved_wall_of_small_facets_stored_light_is_what_is_gathered() {
    let solved = solve_with("curved", |obj| {
        writeln!(obj, "o curved\nusemtl curved").unwrap();
        let n = 79i64;
        for i in 0..=n {
            let angle = 0.5 * PI * i as f64 / n as f64;
            let (x, y) = (MIDDLE.x - 0.5 + angle.cos(), MIDDLE.y - 0.5 + angle.sin());
            writeln!(obj, "v {x} {y} 0\nv {x} {y} 2.2").unwrap();
        }
        for i in 0..n {
            let (a, b) = (2 * i - 2 * (n + 1), 2 * (i + 1) - 2 * (n + 1));
            writeln!(obj, "f {a} {b} {} {}", b + 1, a + 1).unwrap();
        }
    });
    let from = |p: DVec3| ((p - MIDDLE + DVec3::new(0.5, 0.5, 0.0)).truncate().length() - 1.0).abs();
    let is_along = |p: DVec3| p.x > MIDDLE.x - 0.5 && p.y > MIDDLE.y - 0.5;
    let around = floor(&solved, |p| is_along(p) && from(p) > 0.02 && from(p) < 0.3);
    assert!(around.len() >= 10, "{} leaves along the wall", around.len());
    let off = off(&solved, &around);
    assert!(off < 0.1, "{:.1} % off beside the wall", 100.0 * off);
}

/// Sixteen steps round a pole, each a slab that touches the next.
#[test]
fn a_spiral_stair_is_solved_and_stored_light_round_it_is_what_is_gathered() {
    let solved = solve_with("stair", |obj| {
        write_column(obj, 12, 0.08, 3.0);
        for step in 0..16 {
            let turn = DMat3::from_rotation_z(TAU * f64::from(step) / 16.0);
            let low = DVec3::new(0.08, -0.25, 0.18 * f64::from(step));
            let bounds = (low, DVec3::new(1.0, 0.25, low.z + 0.05));
            write_box(obj, "step", bounds, (false, false), |p| turn * p + MIDDLE);
        }
    });
    let from = |p: DVec3| (p - MIDDLE).truncate().length();
    let around = floor(&solved, |p| from(p) > 0.1 && from(p) < 1.5);
    let off = off(&solved, &around);
    assert!(off < 0.15, "{:.1} % off round the stair", 100.0 * off);
}
