//! What ingest makes of everyday input, and what a second ingest into the same store does.

mod support;

use std::path::{Path, PathBuf};

use clerestory::stages::ingest::Summary;

const BOX: &str = "v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nv 0 0 2\nv 4 0 2\nv 4 3 2\nv 0 3 2\n";
const SIDES: [[u32; 4]; 6] = [[1, 2, 3, 4], [8, 7, 6, 5], [5, 6, 2, 1], [6, 7, 3, 2], [7, 8, 4, 3], [8, 5, 1, 4]];

fn quads() -> String {
    SIDES.iter().map(|[a, b, c, d]| format!("f {a} {b} {c} {d}\n")).collect()
}

fn write(dir: &Path, name: &str, text: &str) -> PathBuf {
    let path = dir.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

fn ingest_text(text: &str) -> (String, Summary) {
    let dir = tempfile::tempdir().unwrap();
    let model = write(dir.path(), "model.obj", text);
    let (said, done) = support::ingest(&support::options(&dir.path().join("s.clr"), &model));
    (said, done.unwrap())
}

/// All payload bytes of a store that later stages read.
fn segments(store: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all: Vec<(String, Vec<u8>)> = std::fs::read_dir(store.join("segments"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(&p).unwrap()))
        .collect();
    all.sort();
    all
}

#[test]
fn a_box_of_triangles_and_a_box_of_quads_are_the_same_patches() {
    let triangles: String = SIDES.iter().map(|[a, b, c, d]| format!("f {a} {b} {c}\nf {a} {c} {d}\n")).collect();
    let (_, of_quads) = ingest_text(&format!("{BOX}{}", quads()));
    let (_, of_triangles) = ingest_text(&format!("{BOX}{triangles}"));
    assert_eq!((of_quads.patches, of_triangles.patches), (6, 6));
    assert_eq!(of_quads.area_m2, 52.0);
    assert_eq!(of_triangles.area_m2, 52.0);
    assert_eq!((of_triangles.input_polygons, of_triangles.up), (12, 'z'));
    assert_eq!(of_quads.bounds_m, [[0.0; 3], [4.0, 3.0, 2.0]]);
}

#[test]
fn a_quad_that_crosses_itself_is_named_and_one_that_is_bent_or_concave_is_not() {
    let corners = "v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nv 4 3 0.5\nv 1 1 0\n";
    for (face, named) in [("f 1 3 2 4", true), ("f 1 2 3 4", false), ("f 1 2 5 4", false), ("f 1 2 6 4", false)] {
        let (said, _) = ingest_text(&format!("{corners}f 1 2 3\n{face}\n"));
        assert_eq!(said.contains("cross themselves, first") && said.contains("model.obj:8"), named, "{face}: {said}");
    }
}

#[test]
fn units_scale_lengths_and_areas() {
    let dir = tempfile::tempdir().unwrap();
    let model = write(dir.path(), "model.obj", &format!("{BOX}{}", quads()));
    let mut options = support::options(&dir.path().join("s.clr"), &model);
    options.units = clerestory::stages::ingest::Units::Ft;
    let summary = support::ingest(&options).1.unwrap();
    assert!((summary.area_m2 / (52.0 * 0.3048 * 0.3048) - 1.0).abs() < 1e-6, "{}", summary.area_m2);
}

#[test]
fn walls_modelled_from_both_sides_are_one_patch_each() {
    let backs: String = SIDES.iter().map(|[a, b, c, d]| format!("f {d} {c} {b} {a}\n")).collect();
    let (_, summary) = ingest_text(&format!("{BOX}usemtl in\n{}usemtl out\n{backs}", quads()));
    assert_eq!((summary.patches, summary.area_m2), (6, 52.0));
    assert!(summary.skipped.is_empty(), "{:?}", summary.skipped);
}

#[test]
fn what_is_left_out_is_counted_by_cause_and_named_by_line() {
    let bad = "f 1 2 88\nf 1 1 1 2\nv nan 0 0\nf 1 2 -1\nf 1 2 3 4\n";
    let (said, summary) = ingest_text(&format!("{BOX}{}{bad}", quads()));
    assert_eq!(summary.patches, 6);
    for (cause, first) in [
        ("bad_face", "15: face uses vertex 88 but only 9 are defined"),
        ("degenerate", "16: face has no area"),
        ("not_finite", "18: corner at NaN 0 0"),
        ("duplicate", "19: face has the corners and winding of one before it"),
    ] {
        assert_eq!(summary.skipped[cause], 1, "{cause}");
        assert!(said.contains(first), "{first}\n{said}");
    }
}

#[test]
fn a_model_without_lamps_says_how_to_give_them() {
    let (said, summary) = ingest_text(&format!("{BOX}{}", quads()));
    assert!(summary.emitters == 0 && said.contains("--materials"), "{said}");
}

#[test]
fn clusters_follow_objects_and_objects_that_fall_apart_are_split() {
    let far = "v 104 0 0\nv 106 0 0\nv 106 1 0\nf -3 -2 -1\n";
    let (_, whole) = ingest_text(&format!("{BOX}o room\n{}", quads()));
    let (_, apart) = ingest_text(&format!("{BOX}o room\n{}{far}", quads()));
    let (_, named) = ingest_text(&format!("{BOX}g a\n{}g b\nf 1 2 7\n", quads()));
    assert_eq!((whole.clusters, apart.clusters, named.clusters), (1, 2, 2));
}

#[test]
fn a_forward_reference_is_a_face() {
    let (_, summary) = ingest_text("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n");
    assert_eq!((summary.patches, summary.area_m2), (1, 0.5));
}

#[test]
fn a_model_far_from_zero_keeps_its_shape() {
    let shifted: String = BOX
        .lines()
        .map(|l| {
            let p: Vec<f64> = l[2..].split(' ').map(|x| x.parse().unwrap()).collect();
            format!("v {} {} {}\n", p[0] + 5_432_101.25, p[1] + 448_000.5, p[2] + 0.125)
        })
        .collect();
    let (_, summary) = ingest_text(&format!("{shifted}{}", quads()));
    assert_eq!((summary.patches, summary.area_m2), (6, 52.0));
}

/// Many patches of many objects, some interleaved.
fn many() -> String {
    let mut text = String::from("mtllib m.mtl\n");
    for i in 0..3000u32 {
        let (x, y, z) = (f64::from(i % 30), f64::from(i / 30 % 10), f64::from(i / 300) * 3.0);
        text += &format!("o object{}\nusemtl m{}\n", i % 7, i % 3);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            text += &format!("v {} {} {z}\n", x + dx, y + dy);
        }
        text += "f -4 -3 -2\nf -4 -2 -1\n";
    }
    text
}

#[test]
fn the_store_is_the_same_bytes_whatever_the_memory() {
    let dir = tempfile::tempdir().unwrap();
    let model = write(dir.path(), "model.obj", &many());
    write(dir.path(), "m.mtl", "newmtl m0\nKe 1 1 1\nnewmtl m1\nKd 0.1 0.2 0.3\nnewmtl m2\n");
    let stores: Vec<_> = [48u64 << 20, 1 << 30]
        .iter()
        .map(|bytes| {
            let store = dir.path().join(format!("{bytes}.clr"));
            let mut options = support::options(&store, &model);
            options.memory.limit_bytes = *bytes;
            let summary = support::ingest(&options).1.unwrap();
            assert_eq!((summary.patches, summary.emitters), (3000, 1000));
            segments(&store)
        })
        .collect();
    assert!(stores[0] == stores[1]);
    assert_eq!(stores[0].len(), 5);
}

#[test]
fn a_second_ingest_does_nothing_opens_a_branch_or_refuses() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.clr");
    let text = format!("mtllib m.mtl\n{BOX}usemtl wall\n{}", quads());
    let model = write(dir.path(), "model.obj", &text);
    write(dir.path(), "m.mtl", "newmtl wall\nKd 0.5 0.5 0.5\n");
    let options = support::options(&store, &model);
    let again = |options: &clerestory::stages::ingest::Options| support::ingest(options).1;
    assert!(!again(&options).unwrap().unchanged);
    let before = segments(&store);
    assert!(again(&options).unwrap().unchanged);

    write(dir.path(), "model.obj", &format!("# a comment\n{text}"));
    assert!(again(&options).unwrap().unchanged, "a comment changes nothing");

    write(dir.path(), "m.mtl", "newmtl wall\nKd 0.5 0.5 0.5\nKe 3 3 3\n");
    let lit = again(&options).unwrap();
    assert_eq!((lit.materials_version, lit.emitters), (Some(1), 6));
    let after = segments(&store);
    assert!(before.iter().all(|s| after.contains(s)), "geometry stays");

    let mut scaled = options.clone();
    scaled.max_cluster_patches = 3;
    let error = again(&scaled).unwrap_err();
    assert!(error.exit_code() == 13 && error.to_string().contains("--max-cluster-patches was 64, now 3"), "{error}");
    write(dir.path(), "model.obj", &format!("{text}f 1 2 7\n"));
    let error = again(&options).unwrap_err();
    assert!(error.exit_code() == 13 && error.remedy().contains("--fresh"), "{error}");
    scaled.fresh = true;
    let fresh = again(&scaled).unwrap();
    assert_eq!((fresh.patches_uncut, fresh.materials_version), (7, None));
}

#[test]
fn an_ingest_that_fails_leaves_no_store_and_no_scratch() {
    let dir = tempfile::tempdir().unwrap();
    let model = write(dir.path(), "model.obj", "v 0 0 0\nv 1 x 0\n");
    let store = dir.path().join("s.clr");
    let error = support::ingest(&support::options(&store, &model)).1.unwrap_err();
    assert!(error.to_string().ends_with("model.obj:2: `x` is not a number"), "{error}");
    assert!(!store.exists());
    let model = write(dir.path(), "model.obj", &format!("{BOX}{}", quads()));
    support::ingest(&support::options(&store, &model)).1.unwrap();
    let names: Vec<_> =
        std::fs::read_dir(&store).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    assert!(!names.iter().any(|n| n.contains("scratch")), "{names:?}");
}
