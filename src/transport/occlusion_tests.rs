//! Occluded form factors with exact answers, through refinement and rays: direct light on a receiver
//! from a source of exitance 1 is the visible form factor.

use super::memory_scene::MemoryScene;

type Face = (Vec<[f64; 3]>, f64, f64);

/// A black horizontal rectangle; its front is up or down.
fn level(x: [f64; 2], y: [f64; 2], z: f64, up: bool) -> Face {
    let mut c = vec![[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]];
    if !up {
        c.reverse();
    }
    (c, 0.0, 0.0)
}

/// How finely to look: levels of elements, rounds of each, and what the visible share may err.
type Setting = (u32, u16, f64);
const COARSE: Setting = (2, 2, 0.025);
const FINE: Setting = (4, 8, 0.005);

/// A source seen down to the horizon, where what its places bring changes fastest, comes to 0.009.
const GRAZING: [Setting; 2] = [COARSE, (4, 8, 0.02)];

/// The visible share of an unoccluded factor between a source and a receiver (faces 0 and 1).
fn visible_share(faces: &[Face], unoccluded: f64, (depth, rounds, _): Setting) -> f64 {
    MemoryScene::new(faces).direct(1, depth, rounds) / unoccluded
}

/// Shares that are not what they should be, all of a table's at once.
struct Wrong {
    settings: [Setting; 2],
    shares: Vec<String>,
}

impl Default for Wrong {
    fn default() -> Self {
        Self::at([COARSE, FINE])
    }
}

impl Wrong {
    fn at(settings: [Setting; 2]) -> Self {
        Self { settings, shares: Vec::new() }
    }

    /// Compares a share at both settings.
    fn compare(&mut self, name: &str, faces: &[Face], unoccluded: f64, visible: f64) {
        for setting in self.settings {
            let (share, exact) = (visible_share(faces, unoccluded, setting), visible / unoccluded);
            // The invariant 0 <= V <= 1, but for rounding to f32.
            if !(0.0..=1.0 + 1e-6).contains(&share) || (share - exact).abs() > setting.2 {
                self.shares.push(format!("{name}: share {share} for {exact}, may err {}", setting.2));
            }
        }
    }

    fn assert_none(&self) {
        assert!(self.shares.is_empty(), "{}", self.shares.join("\n"));
    }
}

/// The source square at z = 0, the receiver at z = `distance`.
fn plates(distance: f64) -> Vec<Face> {
    let (mut low, high) = (level([0.0, 1.0], [0.0, 1.0], 0.0, true), level([0.0, 1.0], [0.0, 1.0], distance, false));
    low.2 = 1.0;
    vec![low, high]
}

/// A distance, a height, sizes of the square there, and the visible factors of it as blocker and window.
type Case = (f64, f64, f64, f64, f64);

/// Rows of table BL1 whose blocker is centred.
const CENTRED: [Case; 12] = [
    (1.0, 0.5, 0.1, 0.194_539_624, 0.005_285_272),
    (1.0, 0.5, 0.25, 0.169_474_205, 0.030_350_691),
    (1.0, 0.5, 0.5, 0.099_506_295, 0.100_318_601),
    (1.0, 0.5, 0.75, 0.029_483_545, 0.170_341_351),
    (1.0, 0.25, 0.5, 0.115_620_602, 0.084_204_294),
    (1.0, 0.75, 0.5, 0.115_620_602, 0.084_204_294),
    (1.0, 0.9, 0.5, 0.133_488_791, 0.066_336_105),
    (1.0, 0.99, 0.5, 0.141_867_926, 0.057_956_969),
    (2.0, 1.0, 0.25, 0.056_470_875, 0.012_118_714),
    (2.0, 1.0, 0.5, 0.031_402_694, 0.037_186_895),
    (2.0, 1.0, 0.9, 0.001_466_706, 0.067_122_883),
    (10.0, 5.0, 0.5, 0.001_386_345, 0.001_775_712),
];

/// The same, of plates near each other.
const NEAR: Case = (0.2, 0.1, 0.5, 0.455_647_792, 0.234_596_902);

fn centred(size: f64) -> [f64; 2] {
    [0.5 - 0.5 * size, 0.5 + 0.5 * size]
}

#[test]
fn a_blocker_between_plates_takes_the_known_share() {
    let mut wrong = Wrong::default();
    for (distance, z, size, blocked, window) in CENTRED.into_iter().chain([NEAR]) {
        let mut faces = plates(distance);
        faces.push(level(centred(size), centred(size), z, true));
        wrong.compare(&format!("{size} at {z} of {distance}"), &faces, blocked + window, blocked);
    }
    let mut faces = plates(1.0);
    faces.push(level([0.55, 1.05], [0.35, 0.85], 0.5, true));
    wrong.compare("aside", &faces, 0.199_824_896, 0.143_355_910);
    wrong.assert_none();
}

#[test]
fn a_window_lets_through_what_its_pane_would_block() {
    let mut wrong = Wrong::default();
    for (distance, z, size, blocked, window) in CENTRED.into_iter().chain([NEAR]) {
        let ([low, high], mut faces) = (centred(size), plates(distance));
        // The wall around the window reaches past all rays between the plates.
        for (x, y) in [
            ([-1.0, 2.0], [-1.0, low]),
            ([-1.0, 2.0], [high, 2.0]),
            ([-1.0, low], [low, high]),
            ([high, 2.0], [low, high]),
        ] {
            faces.push(level(x, y, z, true));
        }
        wrong.compare(&format!("{size} at {z} of {distance}"), &faces, blocked + window, window);
    }
    wrong.assert_none();
}

#[test]
fn a_blocker_as_large_as_the_plates_leaves_nothing() {
    let mut faces = plates(1.0);
    faces.push(level([0.0, 1.0], [0.0, 1.0], 0.5, true));
    for setting in [COARSE, FINE] {
        assert_eq!(visible_share(&faces, 0.199_824_896, setting), 0.0);
    }
}

/// Nothing but the estimate tells when to end: it must fall, however little of an element a shadow takes.
#[test]
fn light_beside_a_small_blocker_is_refined_until_the_tolerance_is_met() {
    let mut faces = plates(1.0);
    faces.push(level(centred(0.1), centred(0.1), 0.5, true));
    let mut scene = MemoryScene::new(&faces);
    let iterated = scene.solve(0.01);
    assert!(iterated.error.rays < 1e6, "{} rays", iterated.error.rays);
    let (got, expected) = (scene.irradiance(1), 0.194_539_624);
    assert!((got / expected - 1.0).abs() < 0.02, "{got} for {expected}");
}

/// Distance of strips of width 1, width of a blocker half way, visible factor: crossed strings around
/// the blocker.
const STRIPS: [(f64, f64, f64); 8] = [
    (1.0, 0.1, 0.345_362_405),
    (1.0, 0.25, 0.25),
    (1.0, 0.5, 0.118_033_989),
    (1.0, 0.75, 0.030_776_406),
    (1.0, 1.0, 0.0),
    (2.0, 0.5, 0.061_552_813),
    (0.5, 0.5, 0.207_106_781),
    (0.1, 0.5, 0.409_901_951),
];

/// Compares a square half way along strips of a length, in widths.
fn compare_strips(half_length: f64, cases: &[(f64, f64, f64)]) {
    let mut wrong = Wrong::default();
    for &(h, size, visible) in cases {
        let along = [-half_length, half_length];
        let mut strip = level([0.0, 1.0], along, 0.0, true);
        strip.2 = 1.0;
        let receiver = level([0.0, 1.0], [-0.5, 0.5], h, false);
        let blocker = level(centred(size), along, 0.5 * h, true);
        let unoccluded = (1.0 + h * h).sqrt() - h;
        wrong.compare(&format!("{size} of {h}"), &[strip, receiver, blocker], unoccluded, visible);
    }
    wrong.assert_none();
}

/// What lies beyond 10 distances either way is 2e-4 of what is seen, and less.
#[test]
fn a_centred_blocker_between_strips_a_distance_apart_leaves_what_crossed_strings_give() {
    compare_strips(10.0, &STRIPS[..5]);
    compare_strips(20.0, &STRIPS[5..6]);
}

#[test]
fn a_centred_blocker_between_strips_near_each_other_leaves_what_crossed_strings_give() {
    compare_strips(10.0, &STRIPS[6..]);
}

/// A wall reaches far below a strip on the ground and a little above it; a step in between hides its foot.
#[test]
fn of_a_source_that_lies_behind_the_receiver_what_reaches_above_it_is_seen() {
    let (near, far, step, height, top): (f64, f64, f64, f64, f64) = (0.5, 1.5, 0.2, 0.1, 0.66);
    let along = [-20.0, 20.0];
    let upright = |x: f64, z: [f64; 2], exitance: f64| -> Face {
        let c = [[x, along[0], z[0]], [x, along[1], z[0]], [x, along[1], z[1]], [x, along[0], z[1]]];
        (c.to_vec(), 0.0, exitance)
    };
    let faces = [
        upright(0.0, [-30.0, top], 1.0),
        level([near, far], [-0.5, 0.5], 0.0, true),
        upright(step, [0.0, height], 0.0),
    ];
    // Crossed strings, round the step's edge and straight.
    let above = near.hypot(top) - far.hypot(top);
    let visible = 0.5 * (above + (far - step).hypot(height) - (near - step).hypot(height));
    let mut wrong = Wrong::at(GRAZING);
    wrong.compare("step", &faces, 0.5 * (above + far - near), visible);
    wrong.assert_none();
}
