//! Whatever was interrupted, edited or asked for next, a run goes on, and to the light of a fresh store.

mod common;

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use common::{assert_sound, clerestory, finish, light_of, run, write_rooms};
use serde_json::Value;

/// Two rooms; lamp and table of the second are of materials of their own.
fn scene() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("rooms.obj");
    write_rooms(&model, 2);
    let obj = std::fs::read_to_string(&model).unwrap();
    let (first, second) = obj.split_once("o walls1").unwrap();
    let second = second.replace("usemtl light", "usemtl light2").replace("usemtl wood", "usemtl wood2");
    std::fs::write(&model, format!("{first}o walls1{second}")).unwrap();
    materials(dir.path(), "Ke 10 10 9", "Ke 10 10 9", "");
    dir
}

/// Writes the MTL: what the lamps and the second table emit.
fn materials(dir: &Path, lamp: &str, lamp2: &str, table2: &str) {
    let text = format!(
        "newmtl wall\nKd 0.7 0.7 0.6\nnewmtl wood\nKd 0.4 0.3 0.2\nnewmtl wood2\nKd 0.4 0.3 0.2\n{table2}\n\
         newmtl light\nKd 0 0 0\n{lamp}\nnewmtl light2\nKd 0 0 0\n{lamp2}\n"
    );
    std::fs::write(dir.join("rooms.mtl"), text).unwrap();
}

fn store(dir: &Path) -> std::path::PathBuf {
    dir.join("rooms.clr")
}

/// Runs in `dir` and in a fresh store with the same model; both summaries, of the fresh one the light too.
fn beside_fresh(dir: &Path, flags: &[&str]) -> (Value, Value, Vec<Vec<u8>>) {
    let (code, here) = finish(&mut run(dir, flags));
    let fresh = tempfile::tempdir().unwrap();
    for file in ["rooms.obj", "rooms.mtl"] {
        std::fs::copy(dir.join(file), fresh.path().join(file)).unwrap();
    }
    let (fresh_code, there) = finish(&mut run(fresh.path(), flags));
    assert_eq!(code, fresh_code, "{here}\n{there}");
    assert_sound(&store(dir));
    (here, there, light_of(&store(fresh.path())))
}

fn watts(summary: &Value) -> f64 {
    summary["absorbed_w"][0].as_f64().unwrap()
}

#[test]
fn what_begins_or_ceases_to_emit_on_a_solved_store_gives_the_light_of_a_fresh_one() {
    let bright = "Ke 10 10 9";
    for (name, before, after, flags) in [
        ("a lamp goes on", [bright, "", ""], [bright, bright, ""], &[][..]),
        ("a lamp goes off", [bright, bright, ""], [bright, "", ""], &[]),
        ("a dark model is lit", ["", "", ""], [bright, bright, ""], &[]),
        ("a table begins to glow", [bright, bright, ""], [bright, bright, "Ke 2 1 1"], &[]),
        ("lamps shine both ways", [bright, bright, ""], [bright, bright, ""], &["--emit", "both"]),
    ] {
        let dir = scene();
        materials(dir.path(), before[0], before[1], before[2]);
        assert_eq!(finish(&mut run(dir.path(), &[])).0, 0, "{name}");
        materials(dir.path(), after[0], after[1], after[2]);
        let (here, there, fresh) = beside_fresh(dir.path(), flags);
        assert!((watts(&here) / watts(&there) - 1.0).abs() < 1e-9, "{name}: {} of {} W", watts(&here), watts(&there));
        assert!(light_of(&store(dir.path())) == fresh, "{name}: the light differs");
        assert_eq!(here["branch"], 1, "{name}");
    }
}

#[test]
fn rows_stay_where_lamps_change_little_beside_each_other_and_a_lamp_a_thousand_times_as_bright_is_found() {
    for (dim, starts_afresh) in [("Ke 0.01 0.01 0.009", true), ("Ke 2 2 1.8", true), ("Ke 4 4 3.6", false)] {
        let dir = scene();
        materials(dir.path(), "Ke 10 10 9", dim, "");
        assert_eq!(finish(&mut run(dir.path(), &[])).0, 0);
        materials(dir.path(), "Ke 10 10 9", "Ke 10 10 9", "");
        let (here, there, fresh) = beside_fresh(dir.path(), &[]);
        assert!((watts(&here) / watts(&there) - 1.0).abs() < 0.01, "{dim}: {} of {} W", watts(&here), watts(&there));
        assert_eq!(light_of(&store(dir.path())) == fresh, starts_afresh, "{dim}");
    }
}

#[test]
fn a_model_without_lamps_is_black_at_once_and_sound() {
    let dir = scene();
    materials(dir.path(), "", "", "");
    let (code, said) = finish(&mut run(dir.path(), &[]));
    assert_eq!((code, said["rays"].as_u64(), watts(&said)), (0, Some(0), 0.0), "{said}");
    assert_sound(&store(dir.path()));
}

/// Runs and interrupts or kills the whole process group once so many tasks are solved in an iteration under way.
fn stop_in_an_iteration(dir: &Path, signal: &str, solved: u64) -> bool {
    let mut child =
        run(dir, &["--workers", "1"]).process_group(0).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let end = Instant::now() + Duration::from_secs(60);
    let reached = loop {
        let catalogue = rusqlite::Connection::open_with_flags(
            store(dir).join("scene.sqlite"),
            rusqlite::OpenFlags::SQLITE_OPEN_READ_ONLY,
        );
        let sql = "SELECT count(*) FROM tasks WHERE state IN ('done', 'merged')";
        let count = catalogue.and_then(|c| c.query_row(sql, [], |r| r.get::<_, u64>(0)));
        if count.is_ok_and(|count| count >= solved) {
            break true;
        }
        if child.try_wait().unwrap().is_some() || Instant::now() > end {
            break false;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    Command::new("kill").args([signal, "--", &format!("-{}", child.id())]).stderr(Stdio::null()).status().unwrap();
    child.wait().unwrap();
    reached
}

#[test]
fn after_a_kill_or_an_interrupt_another_quality_materials_or_side_goes_on() {
    let fresh_flags: [&[&str]; 6] = [
        &["--inner", "2"],
        &["--min-element", "0.5"],
        &["--emit", "both"],
        &["--partition", "region"],
        &["--seed", "7"],
        &[],
    ];
    for (i, flags) in fresh_flags.into_iter().enumerate() {
        let dir = scene();
        let signal = if i % 2 == 0 { "-KILL" } else { "-INT" };
        // Four groups: a part of an iteration is solved and waits.
        assert!(stop_in_an_iteration(dir.path(), signal, 1 + 2 * i as u64), "{flags:?}: it had ended");
        if flags.is_empty() {
            materials(dir.path(), "Ke 10 10 9", "", "");
        }
        let (here, there, _) = beside_fresh(dir.path(), flags);
        let error = watts(&here) / watts(&there) - 1.0;
        assert!(error.abs() < 0.02, "{flags:?}: {error}");
    }
}

#[test]
fn stages_by_hand_go_on_with_other_options_than_those_that_left_a_part_behind() {
    let dir = scene();
    let verb = |args: &[&str]| finish(clerestory().current_dir(dir.path()).args(args).args(["--json", "-q"]));
    assert_eq!(finish(&mut run(dir.path(), &["--max-iterations", "1"])).0, 3);
    assert_eq!(verb(&["solve-group", "rooms.clr", "--next", "--tolerance", "0.1"]).0, 0);
    for _ in 0..50 {
        assert_eq!(verb(&["solve-group", "rooms.clr", "--until-done", "--tolerance", "0.09"]).0, 0);
        let (code, merged) = verb(&["merge", "rooms.clr"]);
        assert_eq!(code, 0, "{merged}");
        if merged["converged"] == true {
            assert_eq!(merged["branch"], 1);
            assert_sound(&store(dir.path()));
            return;
        }
    }
    panic!("it does not converge");
}

#[test]
fn without_a_version_the_materials_on_disk_decide_whatever_was_gone_on_from_before() {
    let dir = scene();
    let (_, first) = finish(&mut run(dir.path(), &["--keep", "100"]));
    materials(dir.path(), "Ke 20 20 18", "Ke 20 20 18", "");
    let (_, brighter) = finish(&mut run(dir.path(), &["--keep", "100"]));
    let (code, older) = finish(&mut run(dir.path(), &["--version", "1"]));
    assert_eq!((code, older["branch"].as_u64()), (0, Some(2)), "{older}");
    assert!((watts(&older) / watts(&first) - 1.0).abs() < 0.02, "{} {}", watts(&older), watts(&first));
    assert!(older["warnings"].to_string().contains("materials"), "{}", older["warnings"]);
    let (code, again) = finish(&mut run(dir.path(), &[]));
    assert_eq!(code, 0, "{again}");
    assert!((watts(&again) / watts(&brighter) - 1.0).abs() < 0.02, "{} {}", watts(&again), watts(&brighter));
    assert_ne!(again["branch"], older["branch"]);
    let newest = light_of(&store(dir.path()));
    assert_eq!(finish(&mut run(dir.path(), &[])).1["version"], again["version"], "then there is nothing to do");
    assert!(light_of(&store(dir.path())) == newest);
}

#[test]
fn other_options_do_not_get_between_a_run_and_its_branch() {
    let dir = scene();
    let mut child = run(dir.path(), &["--workers", "1", "--min-element", "0.1"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut refused = 0;
    while child.try_wait().unwrap().is_none() {
        let mut other = clerestory();
        other.current_dir(dir.path()).args(["solve-group", "rooms.clr", "--next", "--tolerance", "0.2", "--wait", "0"]);
        refused += u64::from(other.args(["-q", "--json"]).output().unwrap().status.code() == Some(11));
    }
    assert!(child.wait().unwrap().success() && refused > 0, "{refused} refused");
    assert_sound(&store(dir.path()));
}
