//! The program as scripts meet it: exit codes, JSON, settings, pipes, interrupts, written files.

mod support;

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use serde_json::Value;
use support::clerestory;

fn box_model(dir: &Path) {
    let obj = "mtllib m.mtl\nv 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nv 0 0 2\nv 4 0 2\nv 4 3 2\nv 0 3 2\nusemtl wall\n\
               f 1 2 3 4\nf 5 6 2 1\nf 6 7 3 2\nf 7 8 4 3\nf 8 5 1 4\nusemtl lamp\nf 8 7 6 5\n";
    std::fs::write(dir.join("box.obj"), obj).unwrap();
    std::fs::write(dir.join("m.mtl"), "newmtl wall\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 1 1 1\n").unwrap();
}

fn code(out: &Output) -> i32 {
    out.status.code().unwrap()
}

fn stderr(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

fn json(out: &Output) -> Value {
    serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{e}: {}", stderr(out)))
}

/// A folder with a solved box.
fn solved() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    box_model(dir.path());
    let out = clerestory(dir.path(), &["run", "box.obj", "--quality", "preview", "--workers", "1", "--groups", "1"]);
    assert_eq!(code(&out), 0, "{}", stderr(&out));
    dir
}

#[test]
fn every_exit_code_comes_with_two_lines_and_with_json_a_document() {
    let dir = tempfile::tempdir().unwrap();
    box_model(dir.path());
    std::fs::create_dir_all(dir.path().join("bad.clr/segments")).unwrap();
    std::fs::write(dir.path().join("bad.clr/scene.sqlite"), vec![7; 9000]).unwrap();
    assert_eq!(code(&clerestory(dir.path(), &["ingest", "a.clr", "box.obj"])), 0);
    for (args, expected) in [
        (&["ingest", "b.clr", "missing.obj"][..], 1),
        (&["ingest", "b.clr"], 2),
        (&["sample", "a.clr", "--points", "-", "-o", "-", "--json"], 2),
        (&["status", "nowhere.clr"], 10),
        (&["status", "bad.clr"], 12),
        (&["partition", "a.clr"], 13),
        (&["ingest", "a.clr", "box.obj", "--units", "cm"], 13),
        (&["ingest", "b.clr", "box.obj", "--memory", "1M"], 14),
    ] {
        let out = clerestory(dir.path(), &[args, &["--json"]].concat());
        let said = stderr(&out);
        let lines: Vec<&str> = said.lines().collect();
        assert_eq!(code(&out), expected, "{args:?}: {said}");
        assert!(lines[0].starts_with("error: ") && lines[1].starts_with("help: "), "{args:?}: {said}");
        let document: Value = serde_json::from_str(lines[2]).unwrap();
        assert_eq!(document["message_type"], "exit_error");
        assert_eq!(document["code"], expected);
        assert!(out.stdout.is_empty(), "{args:?}");
    }
}

#[test]
fn every_document_has_the_common_keys_and_those_of_its_verb() {
    let dir = solved();
    std::fs::write(dir.path().join("p.csv"), "x,y,z,nx,ny,nz\n2,1.5,0,0,0,1\n9,9,9,0,0,1\n").unwrap();
    for (args, keys) in [
        (
            &["status", "box.clr"][..],
            "converged version branch iteration stages groups_done groups_total residual processes",
        ),
        (&["ingest", "box.clr", "box.obj"], "patches clusters emitters area_m2 input_polygons skipped bounds_m up"),
        (&["visibility", "box.clr"], "pairs rays missing_form_factor_mean missing_form_factor_max escape_mean"),
        (&["partition", "box.clr"], "groups intra_group_share predicted_contraction largest_working_set_bytes"),
        (&["solve-group", "box.clr", "--next"], "group converged"),
        (&["merge", "box.clr"], "converged version branch"),
        (
            &["run", "--store", "box.clr"],
            "converged iterations residual contraction estimated_nrms audited_nrms audited_se audited_bias version branch groups patches clusters emitters \
             area_m2 elements links_evaluated links_stored links_reused rays unlinked_mean workers \
             coordinator_anon_bytes emitted_w absorbed_w escaped_w energy_balance",
        ),
        (&["check", "box.clr"], "damages segments bytes_verified"),
        (&["gc", "box.clr"], "versions_removed bytes_freed"),
        (&["sample", "box.clr", "--points", "p.csv", "-o", "out.csv"], "points answered free unanswered"),
        (&["sample", "box.clr", "--points", "p.csv", "--stored", "-o", "stored.csv"], "points answered unanswered"),
        (&["audit", "box.clr", "--places", "64"], "points audited_nrms audited_se audited_bias estimated_nrms worst"),
        (&["export", "box.clr", "-o", "x.glb"], "files elements solution_version"),
        (&["render", "box.clr", "-o", "x.png", "--size", "16x16"], "files"),
    ] {
        let out = clerestory(dir.path(), &[args, &["--json"]].concat());
        assert_eq!(code(&out), 0, "{args:?}: {}", stderr(&out));
        let document = json(&out);
        let common = "command store version_of_program wall_s cpu_s peak_rss_bytes peak_anon_bytes bytes_read \
                      bytes_written warnings next";
        for key in common.split_whitespace().chain(keys.split_whitespace()) {
            assert!(document.get(key).is_some(), "{args:?} lacks {key}: {document}");
        }
        assert_eq!(document["command"], args[0]);
        assert!(document["peak_anon_bytes"].as_u64().unwrap() < 512 << 20);
    }
    // The second point lies outside, where no light comes and nothing is stored.
    for (file, second) in [("out.csv", "9,9,9,0,0,1,0,0,0,0"), ("stored.csv", "9,9,9,0,0,1,,,,")] {
        let lines = std::fs::read_to_string(dir.path().join(file)).unwrap();
        let rows: Vec<&str> = lines.lines().collect();
        assert_eq!(rows[0], "x,y,z,nx,ny,nz,irradiance_r_w_m2,irradiance_g_w_m2,irradiance_b_w_m2,illuminance_lx");
        assert!(!rows[1].ends_with(",,"), "{}", rows[1]);
        assert_eq!(rows[2], second);
    }
}

#[test]
fn points_are_answered_from_the_elements_where_links_were_discarded() {
    let dir = tempfile::tempdir().unwrap();
    box_model(dir.path());
    std::fs::write(dir.path().join("p.csv"), "x,y,z,nx,ny,nz\n2,1.5,0,0,0,1\n").unwrap();
    let lux = |links: &str| -> f64 {
        let store = format!("{links}.clr");
        let solve = ["run", "box.obj", "--store", &store, "--quality", "preview", "--groups", "1", "--links", links];
        assert_eq!(code(&clerestory(dir.path(), &solve)), 0);
        let out = clerestory(dir.path(), &["sample", &store, "--points", "p.csv", "-o", "-", "-q"]);
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        text.trim().rsplit(',').next().unwrap().parse().unwrap()
    };
    let (kept, discarded) = (lux("keep"), lux("discard"));
    assert!((discarded / kept - 1.0).abs() < 0.1, "{discarded} lx where kept links give {kept} lx");
}

/// Where `status --settings` says that a flag of a verb comes from, and its value.
fn setting(dir: &Path, environment: &[(&str, &str)], verb: &str, flag: &str) -> (String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_clerestory"));
    command.args(["status", "box.clr", "--settings", "--json"]).current_dir(dir);
    let out = command.envs(environment.iter().copied()).output().unwrap();
    let document = json(&out);
    let all = document["settings"].as_array().unwrap();
    let found = all.iter().find(|s| s["verb"] == verb && s["flag"] == flag).unwrap();
    (found["value"].as_str().unwrap().to_owned(), found["source"].as_str().unwrap().to_owned())
}

#[test]
fn a_flag_beats_the_environment_the_file_the_store_and_the_default() {
    let dir = tempfile::tempdir().unwrap();
    box_model(dir.path());
    let here = dir.path();
    assert_eq!(code(&clerestory(here, &["ingest", "box.clr", "box.obj", "--max-cluster-patches", "32"])), 0);
    let of = |environment: &[(&str, &str)]| setting(here, environment, "ingest", "max-cluster-patches");
    let pair = |value: &str, source: &str| (value.to_owned(), source.to_owned());
    assert_eq!(setting(here, &[], "ingest", "units"), pair("m", "default"));
    assert_eq!(of(&[]), pair("32", "store"));
    // The store's value holds without a flag, so nothing has changed.
    assert_eq!(json(&clerestory(here, &["ingest", "box.clr", "box.obj", "--json"]))["unchanged"], true);
    std::fs::write(here.join("clerestory.toml"), "max-cluster-patches = 16\n").unwrap();
    assert_eq!(of(&[]), pair("16", "clerestory.toml"));
    assert_eq!(of(&[("CLERESTORY_MAX_CLUSTER_PATCHES", "8")]), pair("8", "environment"));
    let out = clerestory(here, &["ingest", "box.clr", "box.obj", "--max-cluster-patches", "32", "--json"]);
    assert_eq!(json(&out)["unchanged"], true, "the flag beats the file");
}

#[test]
fn a_quality_chosen_now_beats_a_tolerance_remembered_from_before() {
    let dir = solved();
    let of = |flag: &str| setting(dir.path(), &[], "solve-group", flag);
    let run = |args: &[&str]| {
        let out = clerestory(dir.path(), &[&["solve-group", "box.clr", "--next"], args].concat());
        assert_eq!(code(&out), 0, "{}", stderr(&out));
    };
    run(&["--tolerance", "0.09"]);
    assert_eq!(of("tolerance").0, "0.09");
    run(&["--quality", "preview"]);
    let out = clerestory(dir.path(), &["status", "box.clr", "--settings"]);
    assert!(!String::from_utf8_lossy(&out.stdout).contains("tolerance "), "forgotten");
}

#[test]
fn a_reader_who_goes_away_is_no_error() {
    let dir = solved();
    for args in [&["export", "box.clr", "-o", "-"][..], &["man"], &["help"], &["status", "box.clr"]] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_clerestory"))
            .args(args)
            .current_dir(dir.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let out = child.wait_with_output().unwrap();
        assert_eq!(code(&out), 0, "{args:?}: {}", stderr(&out));
        assert!(!stderr(&out).contains("panicked"), "{args:?}");
    }
}

#[test]
fn files_are_not_overwritten_unless_forced() {
    let dir = solved();
    for name in ["x.csv", "x.ply", "x.glb"] {
        let export =
            |more: &[&str]| code(&clerestory(dir.path(), &[&["export", "box.clr", "-o", name], more].concat()));
        let read = || std::fs::read(dir.path().join(name)).unwrap();
        assert_eq!(export(&[]), 0);
        let first = read();
        assert_eq!(export(&[]), 1);
        assert_eq!(export(&["--force"]), 0);
        assert!(read() == first, "{name} is a function of model, options and version");
    }
    let rest: Vec<_> =
        std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    assert!(!rest.iter().any(|n| n.contains("part") || n.contains("spool")), "{rest:?}");
}

#[test]
fn a_dry_run_changes_nothing() {
    let dir = tempfile::tempdir().unwrap();
    box_model(dir.path());
    let out = clerestory(dir.path(), &["run", "box.obj", "--dry-run"]);
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    for verb in ["ingest box.clr", "visibility box.clr", "partition box.clr", "solve-group box.clr"] {
        assert!(text.contains(&format!("clerestory {verb}")), "{verb}: {text}");
    }
    assert_eq!(code(&clerestory(dir.path(), &["ingest", "box.clr", "box.obj", "--dry-run"])), 0);
    assert!(!dir.path().join("box.clr").exists());
}

#[test]
fn ctrl_c_ends_with_130_and_the_same_command_finishes() {
    let dir = tempfile::tempdir().unwrap();
    let mut obj = String::new();
    for i in 0..200_000 {
        let (x, y) = (f64::from(i % 500), f64::from(i / 500));
        obj += &format!("v {x} {y} 0\nv {} {y} 0\nv {x} {} 0\nf -3 -2 -1\n", x + 0.9, y + 0.9);
    }
    std::fs::write(dir.path().join("many.obj"), obj).unwrap();
    let args = ["ingest", "many.clr", "many.obj"];
    let child = Command::new(env!("CARGO_BIN_EXE_clerestory"))
        .args(args)
        .current_dir(dir.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_millis(150));
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let out = child.wait_with_output().unwrap();
    assert_eq!(code(&out), 130, "{}", stderr(&out));
    assert!(stderr(&out).contains("help: run the same command again"), "{}", stderr(&out));
    assert!(!dir.path().join("many.clr").exists());
    assert_eq!(code(&clerestory(dir.path(), &args)), 0);
}

#[test]
fn help_pages_and_completions_come_from_the_flags() {
    let dir = tempfile::tempdir().unwrap();
    let text = |args: &[&str]| {
        let out = clerestory(dir.path(), args);
        assert_eq!(code(&out), 0, "{args:?}");
        String::from_utf8_lossy(&out.stdout).into_owned()
    };
    assert!(text(&["help", "exit-codes"]).contains("130"));
    assert!(text(&["help", "render"]).contains("--view-up"));
    assert!(text(&["render", "--help"]).contains("--view-up"));
    assert!(text(&["completions", "bash"]).contains("--max-cluster-patches"));
    assert!(text(&["man"]).contains("max\\-cluster\\-patches"));
    assert!(text(&["--version"]).starts_with("clerestory "));
    assert!(text(&["--help"]).contains("Look after the store:"));
    assert_eq!(code(&clerestory(dir.path(), &["help", "fly"])), 2);
}

/// A shell or `cargo run` that becomes this program has had children of its own.
#[test]
fn figures_tell_what_the_program_used_not_what_ran_before_it_in_the_same_process() {
    let dir = tempfile::tempdir().unwrap();
    box_model(dir.path());
    let script = "head -c 100000000 /dev/zero > /dev/null; exec \"$0\" ingest box.clr box.obj --json";
    let mut shell = Command::new("sh");
    shell.args(["-c", script, env!("CARGO_BIN_EXE_clerestory")]).current_dir(dir.path());
    let out = shell.output().unwrap();
    assert_eq!(code(&out), 0, "{}", stderr(&out));
    let summary = json(&out);
    for key in ["bytes_read", "bytes_written"] {
        let bytes = summary[key].as_u64().unwrap();
        assert!(0 < bytes && bytes < 50_000_000, "{key}: {bytes}");
    }
}
