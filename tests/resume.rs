//! The same command resumes; workers, memory and order of work do not change the light.

mod common;

use common::{assert_sound, clerestory, finish, light_of, run, write_rooms};

fn scene() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_rooms(&dir.path().join("rooms.obj"), 3);
    dir
}

#[test]
fn a_run_converges_and_the_same_command_then_has_nothing_to_do() {
    let dir = scene();
    let (code, first) = finish(&mut run(dir.path(), &["--workers", "2"]));
    assert_eq!(code, 0, "{first}");
    assert_eq!((first["converged"].as_bool(), first["groups"].as_u64()), (Some(true), Some(4)), "{first}");
    assert!(first["energy_balance"].as_f64().unwrap() < 0.01);
    assert!(first["coordinator_anon_bytes"].as_u64().unwrap() < 20 << 20, "{}", first["coordinator_anon_bytes"]);
    assert!(first["peak_anon_bytes"].as_u64() >= first["coordinator_anon_bytes"].as_u64());
    let (code, again) = finish(&mut run(dir.path(), &["--workers", "1", "--memory", "256M"]));
    assert_eq!((code, &again["version"], &again["branch"]), (0, &first["version"], &first["branch"]));
    assert_sound(&dir.path().join("rooms.clr"));
}

#[test]
fn one_worker_four_workers_or_a_shell_loop_give_the_same_bytes() {
    let one = scene();
    assert_eq!(finish(&mut run(one.path(), &["--workers", "1"])).0, 0);
    let four = scene();
    assert_eq!(finish(&mut run(four.path(), &["--workers", "4", "--link-cache", "1M"])).0, 0);
    assert_eq!(light_of(&one.path().join("rooms.clr")), light_of(&four.path().join("rooms.clr")));
    let hand = scene();
    let verb =
        |args: &[&str]| finish(clerestory().current_dir(hand.path()).args(args).args(["--json", "--progress", "none"]));
    assert_eq!(verb(&["ingest", "rooms.clr", "rooms.obj"]).0, 0);
    assert_eq!(verb(&["visibility", "rooms.clr"]).0, 0);
    assert_eq!(verb(&["partition", "rooms.clr", "--groups", "4"]).0, 0);
    for _ in 0..50 {
        let solve = ["solve-group", "rooms.clr", "--until-done", "--tolerance", "0.1"];
        let both: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..2).map(|_| scope.spawn(|| verb(&solve).0)).collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        });
        assert_eq!(both, [0, 0]);
        if verb(&["merge", "rooms.clr"]).1["converged"] == true {
            break;
        }
    }
    assert_eq!(light_of(&one.path().join("rooms.clr")), light_of(&hand.path().join("rooms.clr")));
}

#[test]
fn groups_solved_in_any_order_each_by_a_process_of_its_own_give_the_same_bytes() {
    let calm = scene();
    assert_eq!(finish(&mut run(calm.path(), &["--schedule", "ffd"])).0, 0);
    let dir = scene();
    assert_eq!(finish(&mut run(dir.path(), &["--max-iterations", "1", "--schedule", "ws", "--delta", "1"])).0, 3);
    let verb = |args: &[&str]| finish(clerestory().current_dir(dir.path()).args(args).args(["--json", "-q"]));
    for iteration in 0..50 {
        for turn in [3, 1, 0, 2] {
            let group = ((turn + iteration) % 4).to_string();
            let solve = ["solve-group", "rooms.clr", "--group", &group, "--tolerance", "0.1", "--link-cache", "16K"];
            assert_eq!(verb(&solve).0, 0);
        }
        if verb(&["merge", "rooms.clr"]).1["converged"] == true {
            break;
        }
    }
    assert_eq!(light_of(&calm.path().join("rooms.clr")), light_of(&dir.path().join("rooms.clr")));
}

#[test]
fn out_of_iterations_is_exit_3_and_the_rest_follows_from_there() {
    let whole = scene();
    assert_eq!(finish(&mut run(whole.path(), &[])).0, 0);
    let halves = scene();
    let (code, summary) = finish(&mut run(halves.path(), &["--max-iterations", "1"]));
    assert_eq!((code, summary["iterations"].as_u64()), (3, Some(1)), "the document is printed all the same");
    assert_eq!(finish(&mut run(halves.path(), &[])).0, 0);
    assert_eq!(light_of(&whole.path().join("rooms.clr")), light_of(&halves.path().join("rooms.clr")));
}

#[test]
fn other_settings_and_older_versions_open_branches_and_other_geometry_is_refused() {
    let dir = scene();
    let (_, first) = finish(&mut run(dir.path(), &["--keep", "100"]));
    let (code, finer) = finish(&mut run(dir.path(), &["--inner", "2", "--keep", "100"]));
    assert_eq!((code, finer["branch"].as_u64()), (0, Some(1)), "{finer}");
    let (code, old) = finish(&mut run(dir.path(), &["--version", "1"]));
    assert_eq!((code, old["branch"].as_u64()), (0, Some(2)), "{old}");
    assert_eq!(old["converged"], first["converged"]);
    assert_sound(&dir.path().join("rooms.clr"));
    write_rooms(&dir.path().join("rooms.obj"), 4);
    assert_eq!(finish(&mut run(dir.path(), &[])).0, 13);
}

#[test]
fn a_brighter_lamp_keeps_geometry_and_links_and_opens_a_branch() {
    let dir = scene();
    let (_, first) = finish(&mut run(dir.path(), &[]));
    let mtl = dir.path().join("rooms.mtl");
    let text = std::fs::read_to_string(&mtl).unwrap().replace("Ke 10 10 9", "Ke 20 20 18");
    std::fs::write(&mtl, text).unwrap();
    let (code, brighter) = finish(&mut run(dir.path(), &[]));
    assert_eq!((code, brighter["branch"].as_u64()), (0, Some(1)), "{brighter}");
    let watts = |summary: &serde_json::Value| summary["absorbed_w"][0].as_f64().unwrap();
    assert!((watts(&brighter) / watts(&first) - 2.0).abs() < 0.1, "{} {}", watts(&brighter), watts(&first));
    assert!(brighter["links_reused"].as_u64().unwrap() > 0);
    assert_sound(&dir.path().join("rooms.clr"));
}

#[test]
fn replace_and_sequential_converge_to_the_same_light_within_tolerance() {
    let absorbed = |order: &str| {
        let dir = scene();
        let (code, summary) = finish(&mut run(dir.path(), &["--order", order, "--workers", "2"]));
        assert_eq!(code, 0, "{order}: {summary}");
        summary["absorbed_w"][0].as_f64().unwrap()
    };
    let jacobi = absorbed("jacobi");
    for order in ["replace", "sequential"] {
        let other = absorbed(order);
        assert!((other / jacobi - 1.0).abs() < 0.02, "{order}: {other} where jacobi has {jacobi}");
    }
}

#[test]
fn a_second_run_waits_and_then_names_the_first() {
    let dir = scene();
    let store = dir.path().join("rooms.clr");
    let holder = clerestory::store::Store::create(&store, std::time::Duration::ZERO).unwrap();
    let _lock = clerestory::store::RunLock::take(&holder, "clerestory run by somebody else").unwrap();
    // Our own process holds the lock, so the child is one of ours and would work under it: a shell
    // in between makes it a stranger.
    let program = env!("CARGO_BIN_EXE_clerestory");
    let line = format!("{program} run rooms.obj --wait 0; exit $?");
    let output = std::process::Command::new("/bin/sh").current_dir(dir.path()).args(["-c", &line]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(11), "{said}");
    assert!(said.contains("somebody else") && said.contains(&format!("pid {}", std::process::id())), "{said}");
}
