//! Flags: which layer wins, what is refused, what a dry run promises.

mod common;
mod support;

use std::path::Path;

use common::{finish, run, write_rooms};
use support::clerestory;

fn scene() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_rooms(&dir.path().join("rooms.obj"), 2);
    dir
}

/// Exit code and all that is said.
fn said(dir: &Path, args: &[&str]) -> (i32, String) {
    let out = clerestory(dir, args);
    let text = [out.stdout, out.stderr].concat();
    (out.status.code().unwrap(), String::from_utf8_lossy(&text).into_owned())
}

#[test]
fn a_quality_beats_a_tolerance_from_a_lower_layer_and_only_that() {
    let dir = scene();
    let worker = |file: &str, environment: Option<(&str, &str)>, flags: &[&str]| {
        std::fs::write(dir.path().join("clerestory.toml"), file).unwrap();
        let mut command = common::clerestory();
        command.current_dir(dir.path()).args(["run", "rooms.obj", "--dry-run"]).args(flags);
        command.env_remove("CLERESTORY_TOLERANCE").env_remove("CLERESTORY_QUALITY");
        if let Some((name, value)) = environment {
            command.env(name, value);
        }
        let out = command.output().unwrap();
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        text.lines().find(|line| line.contains("solve-group")).unwrap_or_else(|| panic!("{text}")).to_owned()
    };
    let file = "tolerance = 0.3\n";
    assert!(worker(file, None, &[]).contains("--tolerance=0.3"));
    let flag = worker(file, None, &["--quality", "final"]);
    assert!(flag.contains("--quality=final") && !flag.contains("--tolerance"), "{flag}");
    let environment = worker(file, Some(("CLERESTORY_QUALITY", "draft")), &[]);
    assert!(environment.contains("--quality=draft") && !environment.contains("--tolerance"), "{environment}");
    let flag = worker("", Some(("CLERESTORY_TOLERANCE", "0.3")), &["--quality", "final"]);
    assert!(flag.contains("--quality=final") && !flag.contains("--tolerance"), "{flag}");
    let higher = worker("quality = \"final\"\n", Some(("CLERESTORY_TOLERANCE", "0.3")), &[]);
    assert!(higher.contains("--tolerance=0.3"), "{higher}");
    assert!(worker("", None, &["--quality", "final", "--tolerance", "0.3"]).contains("--tolerance=0.3"));
}

#[test]
fn flags_that_would_be_ignored_or_contradict_each_other_are_refused() {
    let dir = scene();
    assert_eq!(said(dir.path(), &["ingest", "rooms.clr", "rooms.obj", "-q"]).0, 0);
    for args in [
        &["ingest", "a.clr", "rooms.obj", "--sides", "front", "--emit", "both"][..],
        &["run", "rooms.obj", "--store", "a.clr", "--sides", "front", "--emit", "both", "-q"],
        &["render", "rooms.clr", "-o", "a.png", "--fov", "40"],
        &["render", "rooms.clr", "-o", "a.png", "--view-up", "0,0,1"],
        &["export", "rooms.clr", "-o", "a.ply", "--version", "99", "--dry-run"],
        &["render", "rooms.clr", "-o", "a.png", "--version", "99", "--dry-run"],
        &["run", "--store", "rooms.clr", "--version", "99", "--dry-run"],
    ] {
        let (code, text) = said(dir.path(), args);
        assert_eq!(code, 2, "{args:?}: {text}");
        assert!(text.contains("help: "), "{args:?}: {text}");
    }
    assert!(!dir.path().join("a.clr").exists());
}

#[test]
fn a_dry_run_says_what_would_happen_and_refuses_what_would_be_refused() {
    let dir = scene();
    let ingest =
        |flags: &[&str]| said(dir.path(), &[&["ingest", "rooms.clr", "rooms.obj", "--dry-run"], flags].concat());
    assert!(ingest(&[]).1.contains("a new store"));
    assert!(!dir.path().join("rooms.clr").exists());
    assert_eq!(finish(&mut run(dir.path(), &[])).0, 0);
    assert!(ingest(&[]).1.contains("nothing to do"));
    let (code, text) = ingest(&["--units", "cm"]);
    assert!(code == 13 && text.contains("--units was m, now cm"), "{code}: {text}");
    assert_eq!(said(dir.path(), &["run", "rooms.obj", "--units", "cm", "--dry-run"]).0, 13);
    for (verb, kept, again) in
        [("visibility", "nothing to do", "rays from every cluster"), ("partition", "stay as they are", "at least")]
    {
        assert!(said(dir.path(), &[verb, "rooms.clr", "--dry-run"]).1.contains(kept), "{verb}");
        assert!(said(dir.path(), &[verb, "rooms.clr", "--dry-run", "--fresh"]).1.contains(again), "{verb}");
    }
}

#[test]
fn every_method_makes_at_least_as_many_groups_as_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    write_rooms(&dir.path().join("rooms.obj"), 12);
    for verb in [&["ingest", "rooms.clr", "rooms.obj", "-q"][..], &["visibility", "rooms.clr", "-q"]] {
        assert_eq!(said(dir.path(), verb).0, 0);
    }
    for method in ["merge", "split", "region", "random"] {
        for groups in [7u64, 36] {
            let out = clerestory(
                dir.path(),
                &["partition", "rooms.clr", "--method", method, "--groups", &groups.to_string(), "--json", "-q"],
            );
            let made: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
            assert!(made["groups"].as_u64().unwrap() >= groups, "{method}: {made}");
        }
    }
}

#[test]
fn a_radiance_picture_says_what_is_up_in_it() {
    let dir = scene();
    assert_eq!(said(dir.path(), &["ingest", "rooms.clr", "rooms.obj", "--up", "y", "-q"]).0, 0);
    let view = |flags: &[&str]| {
        let eye =
            ["render", "rooms.clr", "-o", "a.hdr", "--force", "--size", "4x3", "--eye", "1,1,1", "--look", "3,1,1"];
        let (code, text) = said(dir.path(), &[&eye, flags].concat());
        assert_eq!(code, 0, "{text}");
        let bytes = std::fs::read(dir.path().join("a.hdr")).unwrap();
        String::from_utf8_lossy(&bytes).lines().find(|line| line.starts_with("VIEW=")).unwrap().to_owned()
    };
    assert!(view(&[]).contains(" -vu 0 1 0 "), "{}", view(&[]));
    assert!(view(&["--view-up", "0,0,1"]).contains(" -vu 0 0 1 "));
}

#[test]
fn what_is_written_never_lies_in_a_store_nor_on_what_is_read_and_devices_stay_devices() {
    let dir = scene();
    assert_eq!(said(dir.path(), &["ingest", "rooms.clr", "rooms.obj", "-q"]).0, 0);
    assert_eq!(said(dir.path(), &["visibility", "rooms.clr", "-q"]).0, 0);
    std::fs::write(dir.path().join("p.csv"), "x,y,z,nx,ny,nz\n1,1,0,0,0,1\n").unwrap();
    std::fs::write(dir.path().join("kept.csv"), "kept").unwrap();
    std::os::unix::fs::symlink("rooms.clr/scene.sqlite", dir.path().join("link.csv")).unwrap();
    std::os::unix::fs::symlink("kept.csv", dir.path().join("good.csv")).unwrap();
    std::os::unix::fs::symlink("nothing.csv", dir.path().join("dangling.csv")).unwrap();
    let sample =
        |output: &str| said(dir.path(), &["sample", "rooms.clr", "--points", "p.csv", "-o", output, "--force", "-q"]);
    for output in ["rooms.clr/scene.sqlite", "rooms.clr/new.csv", "rooms.clr/segments/a.csv", "link.csv", "./p.csv"] {
        assert_eq!(sample(output).0, 2, "{output}");
    }
    assert_eq!(sample("dangling.csv").0, 1);
    assert_eq!((sample("good.csv").0, sample("/dev/null").0), (0, 0));
    assert!(std::fs::read_to_string(dir.path().join("kept.csv")).unwrap().lines().count() == 2, "through the link");
    assert!(dir.path().join("good.csv").is_symlink() && !std::path::Path::new("/dev/null").is_file());
    for (verb, output) in [("render", "rooms.clr/a.png"), ("export", "rooms.clr/a.csv")] {
        assert_eq!(said(dir.path(), &[verb, "rooms.clr", "-o", output]).0, 2, "{verb}");
    }
    assert_eq!(said(dir.path(), &["check", "rooms.clr", "-q"]).0, 0);
}

#[test]
fn a_fresh_run_that_cannot_work_empties_no_store() {
    let dir = scene();
    let (_, solved) = finish(&mut run(dir.path(), &[]));
    for (flags, expected) in [(&["--fresh", "--memory", "48M"][..], 14), (&["--fresh", "--version", "1"], 2)] {
        assert_eq!(finish(&mut run(dir.path(), flags)).0, expected, "{flags:?}");
        assert_eq!(finish(&mut run(dir.path(), &[flags, &["--dry-run"]].concat())).0, expected, "{flags:?}");
    }
    assert_eq!(finish(&mut run(dir.path(), &[])).1["version"], solved["version"]);
    let (code, text) = said(dir.path(), &["run", "rooms.obj", "--store", "new.clr", "--version", "5", "-q"]);
    assert!(code == 2 && !dir.path().join("new.clr").exists(), "{code}: {text}");
}

#[test]
fn lengths_and_numbers_beyond_all_models_are_refused() {
    let dir = scene();
    for args in [
        &["ingest", "a.clr", "rooms.obj", "--snap", "1e300"][..],
        &["ingest", "a.clr", "rooms.obj", "--snap", "1m"],
        &["run", "rooms.obj", "--version", "18446744073709551615"],
        &["gc", "a.clr", "--keep", "18446744073709551615"],
    ] {
        assert_eq!(said(dir.path(), args).0, 2, "{args:?}");
    }
    std::fs::create_dir(dir.path().join("clerestory.toml")).unwrap();
    assert_eq!(said(dir.path(), &["ingest", "a.clr", "rooms.obj"]).0, 2, "a folder for a file of flags");
}
