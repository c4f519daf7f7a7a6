//! What the generator of buildings writes: as much as it says, the same again, and nothing that lets light out but windows.

mod support;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use clerestory::geom::sequence::Sequence;
use clerestory::rays::traverse::Nearest;
use clerestory::stages::ingest::{Summary, Units};
use clerestory::stages::ray_scene::with_scene;
use clerestory::stages::working_set::WorkingSet;
use clerestory::store::{Snapshot, Store};
use glam::DVec3;
use serde_json::Value;

fn building(dir: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_building"));
    command.current_dir(dir).args(line.split(' ')).output().unwrap()
}

/// Writes a building into `dir/model`: what the generator says of it.
fn written(dir: &Path, line: &str) -> Value {
    let output = building(dir, &format!("-o model --json {line}"));
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The OBJ files of `dir/model`, in order of floors.
fn floors(dir: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(dir.join("model")).unwrap().map(|entry| entry.unwrap().path());
    let mut models: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|e| e == "obj")).collect();
    models.sort();
    models
}

/// Ingests `dir/model` into `dir/store.clr`. Nothing of it may lie on or pass through anything else.
fn ingested(dir: &Path, units: Units) -> Summary {
    let mut options = support::options(&dir.join("store.clr"), Path::new(""));
    (options.models, options.units) = (floors(dir), units);
    let (said, done) = support::ingest(&options);
    let summary = done.unwrap();
    assert_eq!(said, "");
    assert!(summary.skipped.is_empty(), "{:?}", summary.skipped);
    assert_eq!((summary.pieces["crossing"], summary.pieces["outline"]), (0, 0));
    assert_eq!((summary.up, summary.up_is_sure), ('z', true));
    summary
}

/// Figures by the names that both sides have for them.
fn figures(summary: &Summary) -> [(&'static str, f64); 4] {
    let counts = [summary.patches_uncut, summary.clusters, summary.emitters].map(|n| n as f64);
    [("patches", counts[0]), ("clusters", counts[1]), ("emitters", counts[2]), ("area_m2", summary.area_m2)]
}

/// Fails if a preset is over 1 % off its figures, or ingest counts other things than the generator.
fn assert_preset(preset: &str, wanted: [f64; 4]) -> (tempfile::TempDir, Summary) {
    let dir = tempfile::tempdir().unwrap();
    let said = written(dir.path(), &format!("--preset {preset}"));
    let summary = ingested(dir.path(), Units::M);
    for ((name, is), wanted) in figures(&summary).into_iter().zip(wanted) {
        assert!((is / wanted - 1.0).abs() < 0.01, "{preset}: {name} {is} for {wanted}");
        // Stored coordinates are f32.
        assert!((said[name].as_f64().unwrap() / is - 1.0).abs() < 1e-6, "{preset}: {name} {} says {is}", said[name]);
    }
    (dir, summary)
}

#[test]
fn soda_floor_is_as_large_as_the_test_floor_of_the_paper_and_each_lamp_is_a_cluster() {
    let (dir, summary) = assert_preset("soda-floor", [6418.0, 1667.0, 242.0, 6726.0]);
    let catalogue = rusqlite::Connection::open(dir.path().join("store.clr/scene.sqlite")).unwrap();
    let count = "SELECT count(*) FROM v_clusters WHERE emitters = patches";
    let emissive: u64 = catalogue.query_row(count, [], |row| row.get(0)).unwrap();
    assert_eq!(emissive, summary.emitters);
}

#[test]
fn soda_5_is_as_large_as_the_building_of_the_paper() {
    assert_preset("soda-5", [280_836.0, 14_234.0, 8542.0, 48_998.0]);
}

#[test]
fn inches_are_the_same_building_and_an_odd_number_of_rooms_is_one_as_well() {
    let of = |units: &str, read: Units| {
        let dir = tempfile::tempdir().unwrap();
        let said = written(dir.path(), &format!("--floors 2 --rooms-per-floor 9 --furnished --units {units}"));
        assert!(said["next"].as_str().unwrap().ends_with("--units in") == (units == "in"), "{}", said["next"]);
        figures(&ingested(dir.path(), read))
    };
    for ((name, metres), (_, inches)) in of("m", Units::M).into_iter().zip(of("in", Units::In)) {
        assert!((metres / inches - 1.0).abs() < 1e-4, "{name}: {metres} in metres, {inches} in inches");
    }
}

/// Every file of `dir/model` by name.
fn files(dir: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let entries = std::fs::read_dir(dir.join("model")).unwrap().map(|entry| entry.unwrap().path());
    let mut all: Vec<_> =
        entries.map(|p| (p.strip_prefix(dir).unwrap().to_owned(), std::fs::read(&p).unwrap())).collect();
    all.sort();
    all
}

#[test]
fn the_same_options_write_the_same_bytes_and_another_seed_writes_others() {
    let of = |seed: u64| {
        let dir = tempfile::tempdir().unwrap();
        written(dir.path(), &format!("--floors 2 --rooms-per-floor 7 --furnished --seed {seed}"));
        files(dir.path())
    };
    let first = of(3);
    assert_eq!(first.len(), 4);
    assert!(first == of(3), "the same seed");
    assert!(first != of(4), "another seed");
}

#[test]
fn a_floor_between_others_is_the_same_in_a_higher_building_and_floors_beyond_it_are_as_large() {
    let of = |floors: u64, furnished: &str| {
        let dir = tempfile::tempdir().unwrap();
        let said = written(dir.path(), &format!("--floors {floors} --rooms-per-floor 12{furnished}"));
        (std::fs::read(dir.path().join("model/floor_002.obj")).unwrap(), said["patches"].as_u64().unwrap())
    };
    assert!(of(3, " --furnished").0 == of(5, " --furnished").0);
    let [three, four, fifty] = [3, 4, 50].map(|floors| of(floors, "").1);
    assert_eq!(fifty - three, 47 * (four - three));
}

#[test]
fn no_object_has_more_than_64_faces_and_all_lamps_look_down() {
    let dir = tempfile::tempdir().unwrap();
    written(dir.path(), "--preset soda-5");
    for floor in floors(dir.path()) {
        let text = std::fs::read_to_string(&floor).unwrap();
        let (mut object, mut faces, mut is_lamp) = ("", 0, false);
        let mut corners: Vec<DVec3> = Vec::new();
        for line in text.lines() {
            let (key, rest) = line.split_once(' ').unwrap();
            match key {
                "o" => (object, faces) = (rest, 0),
                "usemtl" => is_lamp = rest == "lamp",
                "v" => {
                    let at: Vec<f64> = rest.split(' ').map(|x| x.parse().unwrap()).collect();
                    corners.push(DVec3::from_slice(&at));
                }
                "f" => {
                    let [a, b, c, _] = corners[..] else { panic!("{object}: no quad") };
                    assert!(!is_lamp || (b - a).cross(c - a).normalize().z < -0.999, "{object}");
                    corners.clear();
                    faces += 1;
                    assert!(faces <= 64, "{object}: {faces} faces");
                }
                _ => assert_eq!(key, "mtllib"),
            }
        }
    }
}

#[test]
fn light_leaves_the_building_by_its_windows_alone() {
    const RAYS: u64 = 2_000_000;
    const STOREY_M: f64 = 3.6;
    let dir = tempfile::tempdir().unwrap();
    written(dir.path(), "--floors 3 --rooms-per-floor 9");
    let [low, high] = ingested(dir.path(), Units::M).bounds_m.map(DVec3::from_array);
    // Inner faces of the facades, which are 0.3 m thick, and the lowest floor, 0.6 m over the facade's foot.
    let (low, high) = (low + DVec3::new(0.3, 0.3, 0.6), high - DVec3::new(0.3, 0.3, 0.0));
    let store = Store::open(&dir.path().join("store.clr"), Duration::from_secs(5)).unwrap();
    let facts = store.facts().unwrap();
    let origin = DVec3::from_array(facts.origin) * facts.metres_per_unit;
    let set = WorkingSet::open(&store, Snapshot::newest(&store).unwrap().version()).unwrap();
    let done = with_scene(&set, |open| {
        let (sequence, mut escaped) = (Sequence::new(5), 0);
        for i in 0..RAYS {
            let [a, b, c, d] = sequence.point(i);
            let (storey, height) = ((i % 3) as f64, 0.1 + 2.8 * (i as f64 * 0.618_033_988_749_894_9).fract());
            // In a corridor or in the rooms along a facade, of the south or of the north.
            let (from_facade, is_north) =
                (if b < 0.5 { 0.1 + 10.0 * b } else { 5.4 + 3.8 * (b - 0.5) }, i / 3 % 2 == 0);
            let y = if is_north { high.y - from_facade } else { low.y + from_facade };
            let bays = ((high.x - low.x) / 4.1).round();
            let x = 4.1 * ((a * bays).floor() + 0.03 + 0.94 * (a * bays).fract());
            let from = DVec3::new(x, y, storey * STOREY_M + height);
            let (z, angle) = (2.0 * c - 1.0, std::f64::consts::TAU * d);
            let flat = (1.0 - z * z).sqrt();
            let along = DVec3::new(flat * angle.cos(), flat * angle.sin(), z);
            if matches!(open.scene.nearest(from - origin, along, None), Nearest::Escaped) {
                escaped += 1;
                let walls = DVec3::select(along.cmpgt(DVec3::ZERO), high, low);
                let to_walls = (walls - from) / along;
                let out = from + along * to_walls.min_element();
                let over_floor = out.z.rem_euclid(STOREY_M);
                assert!(to_walls.z > to_walls.min_element(), "from {from} through a floor or the roof at {out}");
                assert!((0.9..2.5).contains(&over_floor), "from {from} beside a window at {out}");
            }
        }
        Ok(escaped)
    });
    let escaped = done.unwrap();
    assert!(escaped > RAYS / 100, "{escaped} of {RAYS} rays found a window");
}

#[test]
fn what_cannot_be_built_is_refused_with_what_to_do() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("full")).unwrap();
    std::fs::write(dir.path().join("full/floor_009.obj"), "").unwrap();
    for (line, code, said) in [
        ("-o full", 1, "error: full: not empty\nhelp: name a new folder, or an empty one\n"),
        ("--preset soda-5", 2, "--output <DIR>"),
        ("-o new --preset soda-5 --floors 2", 2, "cannot be used with"),
        ("-o new --rooms-per-floor 5", 2, "5 is not in 6..=1000"),
        ("-o new --units ft", 2, "help: see `building --help`"),
    ] {
        let output = building(dir.path(), line);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{line}: {text}");
        assert!(text.contains(said) && text.contains("\nhelp: "), "{line}: {text}");
        assert!(!dir.path().join("new").exists(), "{line}");
    }
}
