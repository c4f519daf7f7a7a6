//! Unoccluded form factors with closed forms, and those in general position that a 1e-12 contour integral
//! gave: what points of a receiver see, on average. Values have nine digits or so: where they are printed with fewer, the
//! tolerance says it.

use std::f64::consts::PI;

use glam::DVec3;

use super::form_factor::point_to_polygon;
use crate::geom::polygon::Polygon;

/// What every factor must meet, relative.
const REQUIRED: f64 = 1e-4;

fn polygon(points: &[[f64; 3]]) -> Polygon {
    Polygon::new(&points.iter().map(|p| DVec3::from_array(*p)).collect::<Vec<_>>())
}

/// A rectangle in a plane of constant z.
fn level(x: [f64; 2], y: [f64; 2], z: f64, up: bool) -> Polygon {
    let mut c = [[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]];
    if !up {
        c.reverse();
    }
    polygon(&c)
}

/// Points along and across a receiver.
const GRID: u32 = 128;

/// Numbers in 0..1 with their weights, ever denser towards both ends: factors change fastest along edges.
fn towards_the_ends() -> impl Iterator<Item = (f64, f64)> {
    (0..GRID).map(|i| {
        let s = (f64::from(i) + 0.5) / f64::from(GRID);
        (s * s * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * (s * (1.0 - s)).powi(2) / f64::from(GRID))
    })
}

/// The mean over a triangle or parallelogram `a` of what its points see of `b`, which lies in front of it.
fn factor(a: &Polygon, b: &Polygon) -> f64 {
    let points = towards_the_ends().flat_map(|u| towards_the_ends().map(move |v| (u, v)));
    points.map(|((u, du), (v, dv))| du * dv * point_to_polygon(a.point(u, v), a.normal(), b)).sum()
}

/// Half a unit in the last place of values printed with nine decimals.
const PRINTED: f64 = 0.6e-9;

fn close(name: &str, got: f64, expected: f64) {
    assert!((got - expected).abs() <= REQUIRED * expected + PRINTED, "{name}: {got} for {expected}");
}

#[test]
fn opposed_rectangles_have_the_factors_of_the_closed_form() {
    for (x, y, f) in [
        (0.01, 0.01, 0.000_031_828_9),
        (0.1, 0.1, 0.003_162_057),
        (0.5, 0.5, 0.068_589_589),
        (1.0, 1.0, 0.199_824_896),
        (2.0, 2.0, 0.415_253_284),
        (5.0, 5.0, 0.690_244_694),
        (10.0, 10.0, 0.826_994_522),
        (100.0, 100.0, 0.980_416_603),
        (1000.0, 1000.0, 0.998_005_632),
        (0.1, 1.0, 0.024_924_653),
        (0.1, 10.0, 0.046_708_353),
        (0.1, 100.0, 0.049_557_850),
        (0.01, 100.0, 0.004_968_046),
        (1.0, 2.0, 0.285_875_385),
        (1.0, 10.0, 0.386_382_489),
        (1.0, 100.0, 0.411_420_024),
        (1.0, 1000.0, 0.413_934_198),
        (1.0, 10_000.0, 0.414_185_626),
        (10.0, 100.0, 0.897_092_171),
    ] {
        let (a, b) = (level([0.0, x], [0.0, y], 0.0, true), level([0.0, x], [0.0, y], 1.0, false));
        close(&format!("{x} x {y}"), factor(&a, &b), f);
    }
}

#[test]
fn perpendicular_rectangles_with_a_common_edge_have_the_factors_of_the_closed_form() {
    for (h, w, f) in [
        (1.0, 1.0, 0.200_043_776),
        (0.5, 1.0, 0.146_186_679),
        (1.0, 0.5, 0.292_373_358),
        (2.0, 1.0, 0.232_852_603),
        (1.0, 2.0, 0.116_426_301),
        (10.0, 10.0, 0.055_023_980),
        (0.01, 1.0, 0.004_895_849),
        (1.0, 0.01, 0.489_584_927),
        (0.1, 0.1, 0.281_887_807),
        (0.1, 1.0, 0.043_251_369),
        (1.0, 0.1, 0.432_513_694),
        (10.0, 1.0, 0.249_209_486),
        (1.0, 10.0, 0.024_920_949),
        (0.01, 0.01, 0.291_790_067),
        (0.001, 0.001, 0.292_782_901),
        (100.0, 1.0, 0.249_992_043),
    ] {
        let floor = level([0.0, 1.0], [0.0, w], 0.0, true);
        let wall = polygon(&[[0., 0., 0.], [0., 0., h], [1., 0., h], [1., 0., 0.]]);
        close(&format!("h {h} w {w}"), factor(&floor, &wall), f);
    }
}

#[test]
fn offset_rectangles_have_the_factors_of_the_closed_form() {
    for (x, y, z, f) in [
        ([1.0, 2.0], [0.0, 1.0], 1.0, 0.086_050_489),
        ([1.0, 2.0], [1.0, 2.0], 1.0, 0.043_327_410),
        ([5.0, 6.0], [0.0, 1.0], 1.0, 0.000_494_444),
        ([10.0, 11.0], [10.0, 11.0], 1.0, 0.000_007_931),
        ([0.25, 0.75], [0.25, 0.75], 0.1, 0.239_392_118),
        ([1.0, 2.0], [0.0, 1.0], 0.01, 0.004_813_110),
        ([0.0, 1.0], [0.0, 1.0], 0.001, 0.998_005_632),
        ([-10.0, 11.0], [-10.0, 11.0], 1.0, 0.992_615_668),
    ] {
        let (a, b) = (level([0.0, 1.0], [0.0, 1.0], 0.0, true), level(x, y, z, false));
        close(&format!("{x:?} x {y:?} at {z}"), factor(&a, &b), f);
    }
}

#[test]
fn a_point_sees_rectangles_by_the_closed_forms() {
    for (a, b, c, f) in [
        (1.0, 1.0, 1.0, 0.138_531_606),
        (2.0, 2.0, 1.0, 0.207_757_125),
        (10.0, 10.0, 1.0, 0.247_971_408),
        (0.1, 0.1, 1.0, 0.003_141_243),
        (1.0, 1.0, 0.01, 0.249_979_544),
        (100.0, 0.1, 1.0, 0.024_875_919),
    ] {
        let above = level([0.0, a], [0.0, b], c, false);
        close(&format!("parallel {a} x {b} at {c}"), point_to_polygon(DVec3::ZERO, DVec3::Z, &above), f);
    }
    for (high, wide, c, f) in [
        (1.0, 1.0, 1.0, 0.055_734_197),
        (2.0, 1.0, 1.0, 0.095_067_941),
        (1.0, 2.0, 1.0, 0.068_697_299),
        (10.0, 10.0, 1.0, 0.221_738_671),
        (1.0, 1.0, 0.01, 0.247_158_606),
        (1.0, 1.0, 1e-4, 0.249_971_585),
        (1.0, 1.0, 10.0, 0.000_156_543),
    ] {
        let wall = polygon(&[[c, 0., 0.], [c, wide, 0.], [c, wide, high], [c, 0., high]]);
        close(&format!("upright {high} x {wide} at {c}"), point_to_polygon(DVec3::ZERO, DVec3::Z, &wall), f);
    }
}

#[test]
fn a_point_sees_polygons_by_lamberts_formula_clipped_to_its_horizon() {
    let tilted = DVec3::new(0.6, 0.0, 0.8);
    let ring = |i: usize| [(PI / 3.0 * i as f64).cos(), (PI / 3.0 * i as f64).sin(), 1.0];
    let hexagon: [_; 6] = std::array::from_fn(ring);
    let triangle = [[1., 0., 1.], [0., 1., 1.], [-1., -1., 2.]];
    for (name, points, normal, f) in [
        ("triangle", &triangle[..], DVec3::Z, 0.218_875_413),
        ("triangle from a tilted point", &triangle, tilted, 0.190_955_524),
        (
            "quad across the horizon",
            &[[1., -1., -1.], [1., 1., -1.], [1., 1., 1.], [1., -1., 1.]],
            DVec3::Z,
            0.111_468_394,
        ),
        ("triangle across the horizon", &[[1., 0., -1.], [1., 1., 1.], [1., -1., 1.]], DVec3::Z, 0.098_030_907),
        (
            "quad that almost touches",
            &[[-1., -1., 1e-3], [1., -1., 1e-3], [1., 1., 1e-3], [-1., 1., 1e-3]],
            DVec3::Z,
            0.999_999_182,
        ),
        ("hexagon", &hexagon, DVec3::Z, 0.451_816_019),
    ] {
        close(name, point_to_polygon(DVec3::ZERO, normal, &polygon(points)), f);
    }
    // Known to three digits: 2.05e-7.
    let strip = polygon(&[[1., -1., 0.], [1., 1., 0.], [1., 1., 1e-3], [1., -1., 1e-3]]);
    let grazing = point_to_polygon(DVec3::ZERO, DVec3::Z, &strip);
    assert!((grazing - 2.05e-7).abs() < 0.005e-7, "grazing strip: {grazing}");
}

#[test]
fn squares_that_share_an_edge_at_an_angle_have_known_factors() {
    for (degrees, f) in [
        (5.0, 0.920_261_908),
        (10.0, 0.849_606_125),
        (15.0, 0.785_176_664),
        (30.0, 0.619_028_323),
        (45.0, 0.483_347_695),
        (60.0, 0.370_905_321),
        (90.0, 0.200_043_776),
        (120.0, 0.086_615_001),
        (135.0, 0.048_309_448),
        (150.0, 0.021_345_325),
        (170.0, 0.002_362_057),
        (175.0, 0.000_590_291),
    ] {
        let (sine, cosine) = f64::to_radians(degrees).sin_cos();
        let a = level([0.0, 1.0], [0.0, 1.0], 0.0, true);
        let b = polygon(&[[0., 0., 0.], [0., cosine, sine], [1., cosine, sine], [1., 0., 0.]]);
        close(&format!("{degrees} degrees"), factor(&a, &b), f);
    }
}

/// Pairs in general position: name, both shapes, factor there and, where known, back.
fn general() -> Vec<(&'static str, Polygon, Polygon, f64, Option<f64>)> {
    let corner = || polygon(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]);
    let strip = || level([0.0, 10.0], [0.0, 0.05], 0.0, true);
    let sine = f64::to_radians(1.0).sin();
    vec![
        (
            "triangles",
            corner(),
            polygon(&[[0., 0., 1.], [0., 1., 2.], [1., 0., 1.5]]),
            0.065_362_750,
            Some(0.043_575_167),
        ),
        (
            "triangles with a common corner",
            corner(),
            polygon(&[[0., 0., 0.], [0., 1., 1.], [1., 0., 1.]]),
            0.281_525_989,
            Some(0.162_539_105),
        ),
        (
            "triangle and a far small quad",
            corner(),
            level([5.0, 5.1], [5.0, 5.1], 10.0, false),
            0.000_015_233,
            Some(0.000_761_639),
        ),
        (
            "skirting board",
            strip(),
            polygon(&[[0., 0., 0.], [0., 0., 0.05], [10., 0., 0.05], [10., 0., 0.]]),
            0.292_341_633,
            None,
        ),
        (
            "almost coplanar plates",
            level([0.0, 1.0], [0.0, 1.0], 0.0, true),
            polygon(&[[1.001, 0., 0.], [2.0008, 0., sine], [2.0008, 1., sine], [1.001, 1., 0.]]),
            0.000_023_542,
            None,
        ),
        (
            "squares 1 mm apart, half a side aside",
            level([0.0, 1.0], [0.0, 1.0], 0.0, true),
            level([0.5, 1.5], [0.0, 1.0], 1e-3, false),
            0.499_500_105,
            None,
        ),
    ]
}

#[test]
fn polygons_in_general_position_have_known_factors_both_ways() {
    for (name, a, b, there, back) in general() {
        close(name, factor(&a, &b), there);
        if let Some(back) = back {
            close(&format!("{name}, back"), factor(&b, &a), back);
        }
    }
}

#[test]
fn a_concave_floor_in_two_convex_parts_has_the_factor_of_the_whole() {
    let parts = [level([0.0, 2.0], [0.0, 1.0], 0.0, true), level([0.0, 1.0], [1.0, 2.0], 0.0, true)];
    let ceiling = level([0.0, 1.0], [0.0, 1.0], 1.0, false);
    let there = parts.iter().map(|p| p.area() * factor(p, &ceiling)).sum::<f64>() / 3.0;
    close("L to the ceiling", there, 0.123_975_291);
    close("the ceiling to L", parts.iter().map(|p| factor(&ceiling, p)).sum(), 0.371_925_874);
}

#[test]
fn what_two_polygons_exchange_is_the_same_both_ways() {
    for (name, a, b, there, _) in general() {
        let back = there * a.area() / b.area();
        close(name, factor(&b, &a), back);
    }
}

#[test]
fn the_floors_of_boxes_see_their_other_faces_by_the_closed_forms_and_rows_close() {
    for (a, b, c, ceiling, low_y, low_x) in [
        (1.0, 1.0, 1.0, 0.199_824_896, 0.200_043_776, 0.200_043_776),
        (4.0, 4.0, 3.0, 0.282_732_787, 0.179_316_803, 0.179_316_803),
        (10.0, 6.0, 3.0, 0.488_700_936, 0.162_387_355, 0.093_262_177),
        (100.0, 2.0, 3.0, 0.296_814_793, 0.345_419_953, 0.006_172_650),
        (1000.0, 1000.0, 2.7, 0.994_636_447, 0.001_340_888, 0.001_340_888),
    ] {
        let floor = level([0.0, a], [0.0, b], 0.0, true);
        let others = [
            (level([0.0, a], [0.0, b], c, false), ceiling),
            (polygon(&[[0., 0., 0.], [0., 0., c], [a, 0., c], [a, 0., 0.]]), low_y),
            (polygon(&[[0., b, 0.], [a, b, 0.], [a, b, c], [0., b, c]]), low_y),
            (polygon(&[[0., 0., 0.], [0., b, 0.], [0., b, c], [0., 0., c]]), low_x),
            (polygon(&[[a, 0., 0.], [a, 0., c], [a, b, c], [a, b, 0.]]), low_x),
        ];
        let mut sum = 0.0;
        for (face, expected) in others {
            let got = factor(&floor, &face);
            close(&format!("{a} x {b} x {c}"), got, expected);
            sum += got;
        }
        // Five factors, each within a millionth of itself.
        assert!((sum - 1.0).abs() < 1e-5, "{a} x {b} x {c}: the floor's row sums to {sum}");
    }
}
