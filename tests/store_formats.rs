//! Committed stores: today's format is read, older and newer ones are refused, and damaged ones are described.
//!
//! Each holds a lamp of 1 m2 over a floor of 4 m2, solved with `--tolerance 0.1`; each of `data/broken_stores` has one
//! thing wrong, which its name says.

mod common;

use std::path::{Path, PathBuf};
use std::time::Duration;

use clerestory::base::ClusterId;
use clerestory::model::ExtentKind;
use clerestory::model::light::LightView;
use clerestory::model::links::LinksView;
use clerestory::store::{Snapshot, Store};
use common::{assert_sound, clerestory, finish, write_rooms};

const TODAYS: &str = "old_stores/format_8";
const OLDER: [u32; 7] = [1, 2, 3, 4, 5, 6, 7];

/// A copy of a committed store: opening one makes files beside its catalogue.
fn copy(name: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("data").join(name);
    let to = dir.path().join("copy.clr");
    std::fs::create_dir_all(to.join("segments")).unwrap();
    std::fs::copy(from.join("scene.sqlite"), to.join("scene.sqlite")).unwrap();
    for entry in std::fs::read_dir(from.join("segments")).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), to.join("segments").join(entry.file_name())).unwrap();
    }
    (dir, to)
}

#[test]
fn a_store_of_todays_format_is_sound_and_gives_its_light() {
    let (_dir, path) = copy(TODAYS);
    assert_sound(&path);
    let store = Store::open(&path, Duration::from_secs(5)).unwrap();
    // The lamp's radiance is 3 W/(m2 sr): it emits 3 pi W per m2.
    let newest = Snapshot::newest(&store).unwrap();
    let emitted = store.version_figures(newest.version()).unwrap().unwrap().iteration.power.emitted_w[0];
    assert!((emitted - 3.0 * std::f64::consts::PI).abs() < 1e-5, "{emitted}");
    assert_eq!((newest.version(), newest.clusters().count()), (4, 2));
    let extent = newest.need(ExtentKind::Radiosity, ClusterId(0)).unwrap();
    let floor = extent.parse(LightView::parse).unwrap();
    let arrives = 4.0 * f64::from(floor.elements[0].irradiance[0]);
    assert!(arrives > 0.1 * emitted && arrives < emitted, "{arrives} W of {emitted} W reach the floor");
    let links = newest.links(ClusterId(0)).unwrap();
    assert!(!links.is_empty() && links.iter().all(|l| l.parse(LinksView::parse).is_ok()));
}

#[test]
fn a_store_of_todays_format_can_be_worked_on() {
    let (dir, path) = copy(TODAYS);
    let mut command = clerestory();
    command.current_dir(dir.path()).args(["run", "--store", "copy.clr", "--tolerance", "0.05", "--groups", "2"]);
    let (code, summary) = finish(command.args(["--json", "--progress", "none"]));
    assert_eq!((code, summary["branch"].as_u64()), (0, Some(1)), "{summary}");
    assert_sound(&path);
}

/// The catalogue and the segments.
fn bytes_of(store: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let segments = std::fs::read_dir(store.join("segments")).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<_> = segments.chain([store.join("scene.sqlite")]).collect();
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), std::fs::read(path).unwrap())).collect()
}

#[test]
fn stores_of_older_formats_are_refused_by_name_with_what_to_do_and_nothing_of_them_is_touched() {
    let verbs: [&[&str]; 9] = [
        &["status", "copy.clr"],
        &["check", "copy.clr"],
        &["export", "copy.clr", "-o", "x.csv"],
        &["gc", "copy.clr"],
        &["visibility", "copy.clr"],
        &["solve-group", "copy.clr", "--next"],
        &["merge", "copy.clr"],
        &["ingest", "copy.clr", "rooms.obj"],
        &["run", "rooms.obj", "--store", "copy.clr"],
    ];
    for format in OLDER {
        let (dir, path) = copy(&format!("old_stores/format_{format}"));
        write_rooms(&dir.path().join("rooms.obj"), 1);
        let before = bytes_of(&path);
        for args in verbs {
            let output = clerestory().current_dir(dir.path()).args(args).output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(12), "{format}, {args:?}: {said}");
            let named = format!("copy.clr/scene.sqlite: damaged: its format is {format}, this program reads 8");
            assert!(said.contains(&named), "{format}, {args:?}: {said}");
            assert!(said.contains("help: ") && said.contains("`--fresh`"), "{format}, {args:?}: {said}");
        }
        assert!(bytes_of(&path) == before, "format {format}: something was written");
    }
}

#[test]
fn ingest_with_fresh_makes_stores_of_older_formats_anew() {
    for format in OLDER {
        let (dir, path) = copy(&format!("old_stores/format_{format}"));
        write_rooms(&dir.path().join("rooms.obj"), 1);
        let mut command = clerestory();
        command.current_dir(dir.path()).args(["ingest", "copy.clr", "rooms.obj", "--fresh", "--json"]);
        let (code, summary) = finish(&mut command);
        assert_eq!(code, 0, "{format}: {summary}");
        assert_sound(&path);
    }
}

#[test]
fn check_names_every_damage_with_kind_file_place_and_cause() {
    let expected = [
        ("flipped_bit", "radiosity", "segments/000010-update.seg", "cluster 0, version 4", "checksum is wrong"),
        ("cut_off_segment", "links", "segments/000009-update.seg", "cluster 0, version 3", "cut off"),
        ("missing_segment", "materials", "segments/000004-materials.seg", "cluster 0, version 0", "missing"),
        ("foreign_row", "geometry", "segments/000001-geometry.seg", "cluster 0", "the catalogue says"),
        ("deleted_cluster", "catalogue", "scene.sqlite", "clusters", "has 1 rows where 2 were written"),
        ("changed_model", "catalogue", "scene.sqlite", "model", "is not what was written"),
        ("lost_light", "reference", "scene.sqlite", "cluster 1, version 0", "no radiosity"),
    ];
    for (name, kind, file, id, cause) in expected {
        let (_dir, path) = copy(&format!("broken_stores/{name}"));
        let (code, summary) = finish(clerestory().args(["check", "--json"]).arg(&path));
        assert_eq!(code, 12, "{name}: {summary}");
        let text = |damage: &serde_json::Value, key: &str| damage[key].as_str().unwrap_or_default().to_owned();
        let named = summary["damages"].as_array().unwrap().iter().any(|d| {
            text(d, "kind") == kind
                && text(d, "path").ends_with(file)
                && text(d, "id") == id
                && text(d, "detail").contains(cause)
        });
        assert!(named, "{name}: {}", summary["damages"]);
    }
}

#[test]
fn a_store_of_a_newer_format_is_refused_with_12() {
    let (_dir, path) = copy("broken_stores/newer_format");
    let output = clerestory().args(["status"]).arg(&path).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(12), "{said}");
    assert!(said.contains("its format is 99"), "{said}");
}
