//! Gates: scenes whose light is known exactly, solved by the program at its default settings unless a
//! test says otherwise. Beside it: points in the open, leaks, what links must keep to, rigid motion.

#[path = "gates/clutter.rs"]
mod clutter;
#[path = "gates/contact.rs"]
mod contact;
#[path = "gates/free.rs"]
mod free;
#[path = "gates/leaks.rs"]
mod leaks;
#[path = "gates/links.rs"]
mod links;
#[path = "gates/motion.rs"]
mod motion;
#[path = "gates/panels.rs"]
mod panels;
#[path = "gates/reading.rs"]
mod reading;
#[path = "gates/solved.rs"]
mod solved;

use std::collections::BTreeSet;

use solved::{
    Leaf, Solved, Wrong, column, grey, irradiance, mean, mean_on, radiosity, solve, solve_file, solve_with, table,
};

/// What a point may be off by (accepted practice with these cases is 5 %).
const POINT: f64 = 0.01;

/// What means may be off by at `--quality standard`.
const MEAN: f64 = 0.005;

/// What `energy_balance` may be. Gains make up for what is missed beyond that, so that it tells of broken books, not of how
/// right the light is: the theorem's means and audits by paths do.
const BALANCE: f64 = 0.001;

/// Models that light leaves.
const OPEN: [&str; 2] = ["cornell_box", "parallel_plates_with_blocker"];

/// Compares `data/MODEL.expected.csv` at `data/MODEL.points.csv`; where 0 is expected, exactly 0.
fn compare_points(model: &str, sampled: &str, expected: &str) {
    // Points are answered as well as the tolerance asks for: that of `final` is 1 %.
    let (solved, mut wrong) = (solve(model, &["--quality", "final"]), Wrong::default());
    let got = solved.sample(&table(&format!("{model}.points.csv")), sampled);
    let expected = column(&table(&format!("{model}.expected.csv")), expected);
    assert_eq!(got.len(), expected.len());
    for (i, (got, expected)) in got.into_iter().zip(expected).enumerate() {
        wrong.relative(&format!("point {}", char::from(b'A' + i as u8)), got, expected, POINT);
    }
    wrong.assert_none();
}

#[test]
fn cie_5_3_area_source_gives_the_exact_illuminances() {
    compare_points("cie_5_3", "illuminance_lx", "illuminance_lx");
}

#[test]
fn cie_5_6_floor_that_reflects_gives_the_exact_irradiances() {
    compare_points("cie_5_6", "irradiance_r_w_m2", "irradiance_w_m2");
}

#[test]
fn cie_5_7_wall_behind_an_obstruction_gives_the_exact_irradiances() {
    compare_points("cie_5_7", "irradiance_r_w_m2", "irradiance_w_m2");
}

/// The shadow's edge just reaches the top of the wall.
#[test]
fn cie_5_7_points_in_full_shadow_receive_exactly_nothing() {
    let solved = solve("cie_5_7", &[]);
    let got = solved.irradiance_at(&table("cie_5_7.points.csv"));
    assert_eq!(got[9..], [0.0, 0.0], "J and K");
}

/// Area mean of the irradiance on all that any light reaches: in a scene without leaks, on the sides
/// that face its rooms.
fn mean_of_the_lit(solved: &Solved) -> f64 {
    mean(solved.leaves().iter().filter(|l| irradiance(l) > 0.0), irradiance)
}

/// CIE 5.8: a 4 m cube with a small lamp in the middle. By the mean value theorem the area mean is
/// Phi / (S (1 - rho)), rho of that reflected. Points differ from it; means do not.
fn compare_mean_values(reflectances: &[f64]) {
    let mut wrong = Wrong::default();
    // The lamp is 0.24 m2 of exitance 1 W/m2, and reflects too.
    let (power_w, area_m2) = (0.24, 96.24);
    for rho in reflectances {
        let solved = solve_with("mean_value_cube", &grey(*rho, &[("lamp", 1.0)]), &[]);
        let expected = power_w / (area_m2 * (1.0 - rho));
        wrong.relative(&format!("rho {rho}"), mean_of_the_lit(&solved), expected, MEAN);
    }
    wrong.assert_none();
}

#[test]
fn cie_5_8_mean_irradiance_is_that_of_the_theorem() {
    compare_mean_values(&[0.05, 0.3, 0.5]);
}

#[test]
fn cie_5_8_mean_irradiance_is_that_of_the_theorem_for_bright_walls() {
    compare_mean_values(&[0.7, 0.8, 0.9, 0.95]);
}

/// Mean radiosity of the emitting, the opposite and a side face of the cube.
fn cube_means(leaves: &[Leaf]) -> [f64; 3] {
    let inside = |normal: [f64; 3]| {
        mean(
            leaves.iter().filter(|l| l.name[2] == 0 && (0..3).all(|i| (l.normal[i] - normal[i]).abs() < 0.1)),
            radiosity,
        )
    };
    [inside([0.0, 0.0, 1.0]), inside([0.0, 0.0, -1.0]), inside([1.0, 0.0, 0.0])]
}

/// CU2: a point in a black cube receives the form factor to the emitting floor.
#[test]
fn points_in_a_black_cube_receive_the_form_factor_to_its_floor() {
    let solved = solve_with("closed_cube", &grey(0.0, &[("emit", 1.0)]), &[]);
    let points = "x,y,z,nx,ny,nz\n0.5,0.5,1,0,0,-1\n0,0,1,0,0,-1\n0.5,0,1,0,0,-1\n0,0.5,0.5,1,0,0\n\
                  0,0.5,0.25,1,0,0\n0,0.5,0.01,1,0,0\n0,0.5,1,1,0,0\n";
    let expected =
        [0.239_456_470, 0.138_531_606, 0.180_368_741, 0.190_135_882, 0.317_549_609, 0.492_158_952, 0.071_093_439];
    let mut wrong = Wrong::default();
    for (i, (got, expected)) in solved.irradiance_at(points).into_iter().zip(expected).enumerate() {
        wrong.relative(&format!("point {i}"), got, expected, POINT);
    }
    wrong.assert_none();
}

/// CU3: means of the converged Galerkin solution within the balance, centres within what points may be.
fn compare_cube(rho: f64, means: [f64; 3], centres: [f64; 3], quality: &str, seeds: u64) {
    let mut wrong = Wrong::default();
    let mut found = [0.0; 3];
    for seed in 1..=seeds {
        let flags = ["--quality", quality, "--seed", &seed.to_string()];
        let solved = solve_with("closed_cube", &grey(rho, &[("emit", 1.0)]), &flags);
        let points = "x,y,z,nx,ny,nz\n0.5,0.5,0,0,0,1\n0.5,0.5,1,0,0,-1\n0,0.5,0.5,1,0,0\n";
        let (of_faces, arriving) = (cube_means(&solved.leaves()), solved.irradiance_at(points));
        for face in 0..3 {
            found[face] += of_faces[face] / seeds as f64;
            let got = rho * arriving[face] + if face == 0 { 1.0 } else { 0.0 };
            wrong.relative(&format!("rho {rho}, seed {seed}, centre of face {face}"), got, centres[face], POINT);
        }
    }
    for face in 0..3 {
        wrong.relative(&format!("rho {rho}, mean of face {face}"), found[face], means[face], MEAN);
    }
    wrong.assert_none();
}

/// Seeds whose mean is compared at `standard`: what that lets be off differs by 0.26 % from seed to seed for the mean of a
/// face, half of the limit.
const SEEDS: u64 = 4;

#[test]
fn a_cube_has_the_means_and_centres_of_the_continuous_solution() {
    compare_cube(0.5, [1.10436, 0.17122, 0.18111], [1.0918, 0.1976, 0.1776], "standard", SEEDS);
    compare_cube(0.8, [1.58751, 0.66098, 0.68788], [1.5523, 0.7131, 0.6837], "final", 1);
}

#[test]
fn a_bright_cube_has_the_means_and_centres_of_the_continuous_solution() {
    compare_cube(0.8, [1.58751, 0.66098, 0.68788], [1.5523, 0.7131, 0.6837], "standard", SEEDS);
}

#[test]
fn a_gather_takes_the_tolerance_of_its_version_or_its_own() {
    let solved = solve_with("closed_cube", &grey(0.5, &[("emit", 1.0)]), &["--quality", "preview"]);
    solved.write("points.csv", "x,y,z,nx,ny,nz\n0.3,0.5,1,0,0,-1\n0,0.4,0.6,1,0,0\n");
    let with = |flags: &[&str]| {
        solved.ask(&[&["sample", "s.clr", "--points", "points.csv", "-o", "-", "--quiet"], flags].concat())
    };
    assert_eq!(with(&[]), with(&["--tolerance", "0.1"]));
    assert_ne!(with(&[]), with(&["--tolerance", "0.002"]), "more rays give another answer");
}

/// In a closed room where all emits alike, radiosity is exitance / (1 - rho): 0.1 % everywhere.
fn compare_furnaces(reflectances: &[f64], quality: &str) {
    let mut wrong = Wrong::default();
    for rho in reflectances {
        let materials = grey(*rho, &[("wall", 1.0), ("emit", 1.0)]);
        let leaves = solve_with("closed_cube", &materials, &["--quality", quality]).leaves();
        for leaf in leaves.iter().filter(|l| l.name[2] == 0) {
            wrong.relative(&format!("rho {rho}, {:?}", leaf.centre), radiosity(leaf), 1.0 / (1.0 - rho), 1e-3);
        }
    }
    wrong.assert_none();
}

/// `final` stops where 0.1 % is left.
#[test]
fn a_furnace_has_the_same_radiosity_everywhere_up_to_a_reflectance_of_0_95() {
    compare_furnaces(&[0.2, 0.5], "standard");
    compare_furnaces(&[0.8, 0.95], "final");
}

#[test]
fn a_bright_furnace_has_the_same_radiosity_everywhere_at_standard() {
    compare_furnaces(&[0.8, 0.95], "standard");
}

/// The boxes of `furnace_furnished`: low and high corners, m.
const FURNITURE: [([f64; 3], [f64; 3]); 3] =
    [([1.0, 1.0, 0.0], [1.8, 1.6, 0.9]), ([2.6, 1.0, 1.1], [3.2, 1.8, 1.5]), ([0.0, 2.2, 0.0], [0.7, 3.0, 1.2])];

/// Whether a point lies within `margin` of a box, m.
fn is_at_furniture(point: [f64; 3], margin: f64) -> bool {
    let near =
        |low: [f64; 3], high: [f64; 3]| (0..3).all(|i| low[i] - margin <= point[i] && point[i] <= high[i] + margin);
    FURNITURE.iter().any(|(low, high)| near(*low, *high))
}

/// 1 % among furniture: on the fronts of furniture that stands free, and on the room's shell but where a box stands on
/// it.
#[test]
fn a_furnished_furnace_has_the_same_radiosity_on_the_sides_that_face_the_room() {
    let (leaves, mut wrong) = (solve("furnace_furnished", &[]).leaves(), Wrong::default());
    let expected = std::f64::consts::PI / (1.0 - 0.95);
    let sides: BTreeSet<[u32; 3]> = leaves.iter().map(|l| [l.name[0], l.name[1], l.name[2]]).collect();
    let mut beneath = 0;
    for side in sides.into_iter().filter(|side| side[0] != 3 && side[2] == 0) {
        let of: Vec<&Leaf> = leaves.iter().filter(|l| l.name[..3] == side).collect();
        // What a box stands on is cut from the rest.
        let is_beneath = side[0] == 0 && of.iter().all(|l| is_at_furniture(l.centre, 1e-3));
        beneath += u32::from(is_beneath);
        if is_beneath {
            continue;
        }
        wrong.relative(&format!("{side:?}"), mean(of, radiosity), expected, 0.01);
    }
    assert!(beneath >= 4, "{beneath} parts of the shell beneath boxes");
    wrong.assert_none();
}

/// The mean value theorem holds for any closed scene of one reflectance.
fn compare_mean_value(solved: &Solved, rho: f64, share: f64) {
    let lit: Vec<Leaf> = solved.leaves().into_iter().filter(|l| irradiance(l) > 0.0).collect();
    assert!(lit.len() > 100, "{}: {} leaves are lit", solved.title, lit.len());
    let area: f64 = lit.iter().map(|l| l.area_m2).sum();
    let power = solved.summary["emitted_w"][0].as_f64().unwrap();
    let mut wrong = Wrong::default();
    wrong.relative(&solved.title, mean(&lit, irradiance), power / (area * (1.0 - rho)), share);
    wrong.assert_none();
}

#[test]
fn mean_irradiance_of_two_rooms_with_a_door_is_that_of_the_theorem() {
    let solved = solve_with("two_rooms_one_door", &grey(0.5, &[("lamp", 1.0)]), &[]);
    compare_mean_value(&solved, 0.5, MEAN);
}

/// 1 % among furniture: elements that furniture stands on belong to the room in part.
#[test]
fn mean_irradiance_of_a_furnished_room_is_that_of_the_theorem() {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("room.obj");
    motion::write_room(&model, |corner| corner);
    let solved = solve_file(&model, Some(&grey(0.5, &[("lamp", 1.0)])), &[]);
    compare_mean_value(&solved, 0.5, 0.01);
}

/// `draft` for the time it takes; its tolerance is 2.5 times that of `standard`, what the mean may be off by twice.
#[test]
fn mean_irradiance_of_an_office_is_that_of_the_theorem() {
    let solved = solve_with("office", &grey(0.5, &[("panel", 1.0)]), &["--quality", "draft"]);
    compare_mean_value(&solved, 0.5, 2.0 * MEAN);
}

/// Means of `data/MODEL.expected.csv`, each with its own materials.
fn compare_means(model: &str, tolerance: &str) {
    let mut wrong = Wrong::default();
    let expected = table(&format!("{model}.expected.csv"));
    let mut leaves: Option<(String, Vec<Leaf>)> = None;
    for line in expected.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let (materials, object, value) = (cells[0], cells[1], cells[2].parse::<f64>().unwrap());
        if leaves.as_ref().is_none_or(|l| l.0 != materials) {
            // A face far from lamps is dim, and a tolerance is that of the whole model.
            let tolerance = if materials.contains("black") { "0.004" } else { tolerance };
            let solved = solve_with(model, &table(materials), &["--tolerance", tolerance]);
            leaves = Some((materials.to_owned(), solved.leaves()));
        }
        let (_, all) = leaves.as_ref().unwrap();
        let got = if object == "all" {
            mean(all.iter().filter(|l| irradiance(l) > 0.0), irradiance)
        } else {
            mean_on(model, object, all)
        };
        wrong.relative(&format!("{materials}, {object}"), got, value, MEAN);
    }
    wrong.assert_none();
}

#[test]
fn the_walls_of_a_long_corridor_have_their_exact_means() {
    compare_means("corridor", "0.02");
}

#[test]
fn two_rooms_with_a_window_have_their_exact_means() {
    compare_means("two_zone", "0.02");
}

#[test]
fn a_plate_behind_a_blocker_has_its_exact_mean() {
    compare_means("parallel_plates_with_blocker", "0.01");
}

/// TZ1's stand-in: half way along, the plane problem's light, within the tolerance asked for: nRMS 0.02.
#[test]
fn two_long_rooms_with_a_slot_have_the_light_of_the_plane_problem() {
    let solved = solve("two_zone_long", &[]);
    let got = solved.irradiance_at(&table("two_zone_long.points.csv"));
    let expected = column(&table("two_zone_long.expected.csv"), "irradiance_w_m2");
    let count = expected.len() as f64;
    let squares: f64 = got.iter().zip(&expected).map(|(g, e)| (g - e) * (g - e)).sum();
    let nrms = (squares / count).sqrt() / (expected.iter().sum::<f64>() / count);
    assert!(nrms <= 0.02, "nRMS {nrms}: {got:?} for {expected:?}");
}

/// A wall of the Cornell box: cluster, area, mean irradiance (RGB) and its standard error by an independent
/// path tracer. The ceiling's mean includes the lamp's hole, where nothing arrives. The red wall is left out: the
/// published one leans and is no plane, and how the reference cut it in triangles is not known.
type Wall = (u32, f64, [f64; 3], [f64; 3]);

const WALLS: [Wall; 4] = [
    (0, 0.0, [0.4792, 0.3255, 0.0922], [0.0018, 0.0015, 0.0003]),
    (1, 0.556 * 0.5592, [0.4170, 0.2542, 0.0624], [0.0027, 0.0016, 0.0004]),
    (3, 0.0, [0.7266, 0.4872, 0.1373], [0.0013; 3]),
    (4, 0.0, [0.7822, 0.5282, 0.1574], [0.0015; 3]),
];

fn compare_walls(walls: &[Wall]) {
    // The reference's lamp reflects nothing.
    let leaves = solve_with("cornell_box", "newmtl light\nKd 0 0 0\nKe 17 12 4\n", &[]).leaves();
    let mut wrong = Wrong::default();
    for (cluster, area_m2, expected, error) in walls {
        let wall: Vec<&Leaf> = leaves.iter().filter(|l| l.name[0] == *cluster && l.name[2] == 0).collect();
        let area: f64 = wall.iter().map(|l| l.area_m2).sum();
        for channel in 0..3 {
            let got = mean(wall.iter().copied(), |l| l.irradiance[channel]) * area / area_m2.max(area);
            // As accurate as points, and three standard errors of the reference.
            let share = POINT + 3.0 * error[channel] / expected[channel];
            wrong.relative(&format!("cluster {cluster}, channel {channel}"), got, expected[channel], share);
        }
    }
    wrong.assert_none();
}

#[test]
fn the_walls_of_a_cornell_box_have_the_means_of_a_path_tracer() {
    compare_walls(&WALLS);
}

fn expect_balance(models: &[&str], quality: &str) {
    let mut wrong = Wrong::default();
    for model in models {
        let solved = solve(model, &["--quality", quality]);
        let balance = solved.summary["energy_balance"].as_f64().unwrap();
        wrong.at_most(balance, BALANCE, || format!("{}: energy balance {balance}", solved.title));
    }
    wrong.assert_none();
}

#[test]
fn energy_balances_within_a_tenth_of_a_percent_at_standard() {
    let rooms = ["closed_cube", "two_zone", "corridor", "leak_abutting", "coplanar_overlap", "two_rooms_one_door"];
    expect_balance(&rooms, "standard");
    expect_balance(&["cie_5_3", "cie_5_6"], "standard");
}

#[test]
fn energy_balances_within_a_tenth_of_a_percent_at_standard_around_what_stands_in_a_room() {
    expect_balance(&["mean_value_cube", "cie_5_7", "doubled_wall", "leak_overlapping"], "standard");
}

#[test]
fn energy_balances_within_a_tenth_of_a_percent_at_final() {
    expect_balance(&["closed_cube", "cie_5_3", "mean_value_cube", "cie_5_6", "cie_5_7", "two_zone"], "final");
}

/// Gains take what leaves a model to be missed as what arrives is: paths, which read no stored light, tell whether light is
/// off by that.
#[test]
fn light_of_open_models_balances_and_is_not_off_as_a_whole() {
    for quality in ["standard", "final"] {
        expect_balance(&OPEN, quality);
    }
    let mut wrong = Wrong::default();
    for model in OPEN {
        let solved = solve(model, &[]);
        let audit = solved.ask(&["audit", "s.clr", "--places", "30000", "--json", "-q"]);
        let bias = serde_json::from_str::<serde_json::Value>(&audit).unwrap()["audited_bias"].as_f64().unwrap();
        wrong.at_most(bias.abs(), MEAN, || format!("{model}: bias {bias}"));
    }
    wrong.assert_none();
}
