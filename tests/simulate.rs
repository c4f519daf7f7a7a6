//! The simulator on a store that has really been solved: it says what the catalogue says, changes nothing, and refuses
//! what it cannot replay.

mod support;

use std::path::Path;
use std::process::{Command, Output};

use clerestory::store::Store;
use serde_json::Value;
use support::clerestory;

fn simulate(dir: &Path, line: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_simulate")).current_dir(dir).args(line.split(' ')).output().unwrap()
}

fn simulated(dir: &Path, line: &str) -> Value {
    let output = simulate(dir, line);
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A folder with `two_rooms_one_door.clr`, solved.
fn solved(order: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/data/two_rooms_one_door.obj");
    let flags = "--store rooms.clr --quality preview --workers 1 --groups 4 --audit 0 --order";
    let line = format!("run {model} {flags} {order}");
    let output = clerestory(dir.path(), &line.split(' ').collect::<Vec<_>>());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    dir
}

#[test]
fn a_replay_holds_the_recorded_tasks_and_is_the_same_every_time() {
    let dir = solved("jacobi");
    let catalogue = || std::fs::read(dir.path().join("rooms.clr/scene.sqlite")).unwrap();
    let before = catalogue();
    let line = "rooms.clr --workers 1,2,64 --bandwidth 1M --latency 0.001 --csv table.csv --json";
    let found = simulated(dir.path(), line);
    assert_eq!(found, simulated(dir.path(), line));
    assert!(before == catalogue(), "the catalogue has changed");

    let store = Store::open(&dir.path().join("rooms.clr"), std::time::Duration::ZERO).unwrap();
    let branch = store.newest_branch().unwrap();
    let tasks: Vec<_> = (1..100).flat_map(|iteration| store.tasks(branch, iteration).unwrap()).collect();
    let work_s: f64 = tasks.iter().map(|task| task.wall_s.unwrap()).sum();
    assert_eq!(found["tasks"], tasks.len());
    assert!((found["work_s"].as_f64().unwrap() - work_s).abs() < 1e-9 && work_s > 0.0);

    let rows = found["replays"].as_array().unwrap();
    let groups = found["groups"].as_f64().unwrap();
    for row in rows {
        let speedup = row["speedup"].as_f64().unwrap();
        assert!(speedup <= row["workers"].as_f64().unwrap() && speedup <= groups, "{row}");
    }
    assert!(rows[2]["download_bytes"].as_u64() > rows[0]["download_bytes"].as_u64(), "more workers download more");
    let table = std::fs::read_to_string(dir.path().join("table.csv")).unwrap();
    assert!(table.starts_with("workers,makespan_s,speedup,share_of_linear,download_bytes,"), "{table}");
    assert_eq!(table.lines().count(), 4);
}

#[test]
fn a_timeline_has_a_line_for_each_task_of_the_last_number_of_workers() {
    let dir = solved("jacobi");
    let line = "rooms.clr --workers 8,2 --bandwidth 1M --latency 0.001 --json";
    let found = simulated(dir.path(), &format!("{line} --timeline tasks.csv"));
    assert_eq!(found, simulated(dir.path(), line), "what is found stays the same");
    let mut reader = csv::Reader::from_path(dir.path().join("tasks.csv")).unwrap();
    let heads = "workers worker iteration group download_begin_s begin_s end_s download_bytes upload_bytes";
    assert!(reader.headers().unwrap().iter().eq(heads.split(' ')));
    let rows: Vec<Vec<f64>> = reader.deserialize().map(|row| row.unwrap()).collect();
    assert_eq!(found["tasks"], rows.len());
    let two = &found["replays"][1];
    let sum = |column: usize| rows.iter().map(|row| row[column]).sum::<f64>();
    assert_eq!((Some(sum(7)), Some(sum(8))), (two["download_bytes"].as_f64(), two["upload_bytes"].as_f64()));
    let work_s = found["work_s"].as_f64().unwrap();
    assert!((sum(6) - sum(5) - work_s).abs() < 1e-9 * work_s, "rounding alone: {} of {work_s} s", sum(6) - sum(5));
    assert!(rows.iter().all(|row| row[0] == 2.0 && row[1] < 2.0 && row[6] <= two["makespan_s"].as_f64().unwrap()));
}

#[test]
fn what_cannot_be_replayed_is_refused_with_what_to_do() {
    let dir = solved("sequential");
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/data/two_rooms_one_door.obj");
    assert!(clerestory(dir.path(), &["ingest", "new.clr", model]).status.success());
    for (line, code, said) in [
        ("absent.clr", 10, "error: absent.clr: no store here\nhelp: "),
        ("new.clr", 13, "help: run `clerestory"),
        ("rooms.clr", 2, "help: solve with `--order jacobi`"),
        ("rooms.clr --workers 0", 2, "0 is not in 1..=1024"),
        ("rooms.clr --bandwidth 0", 2, "give at least a byte a second"),
        ("rooms.clr --latency -1", 2, "help: see `simulate --help`"),
    ] {
        let output = simulate(dir.path(), line);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{line}: {text}");
        assert!(text.contains(said) && text.contains("\nhelp: "), "{line}: {text}");
    }
}
