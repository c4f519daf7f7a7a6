//! Kills at random instants lose at most the running task: rerun, the light is the same, byte for byte.
//!
//! `CLERESTORY_KILLS` sets how many kills; the seed is printed.

mod common;

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::{assert_sound, finish, light_of, run, write_rooms};

/// A small generator of random numbers (splitmix64).
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ (z >> 31)) % end
    }
}

fn kill(target: &str) {
    // The target may be gone already.
    let _ = Command::new("kill").args(["-KILL", "--", target]).stderr(Stdio::null()).status();
}

/// Starts a run in a process group of its own.
fn start(dir: &Path) -> Child {
    run(dir, &["--workers", "2"]).process_group(0).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

fn children_of(pid: u32) -> Vec<String> {
    let path = format!("/proc/{pid}/task/{pid}/children");
    std::fs::read_to_string(path).unwrap_or_default().split_whitespace().map(str::to_owned).collect()
}

fn scene() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_rooms(&dir.path().join("rooms.obj"), 3);
    dir
}

fn kills() -> u64 {
    std::env::var("CLERESTORY_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(12)
}

#[test]
fn a_run_killed_again_and_again_ends_with_the_same_bytes() {
    let calm = scene();
    let started = Instant::now();
    assert_eq!(finish(&mut run(calm.path(), &["--workers", "2"])).0, 0);
    let whole_ms = started.elapsed().as_millis() as u64;
    let expected = light_of(&calm.path().join("rooms.clr"));
    let mut random = Random(std::process::id().into());
    println!("seed {}", random.0);
    let mut left = kills();
    while left > 0 {
        let dir = scene();
        let store = dir.path().join("rooms.clr");
        // A few kills per store, so that all phases are hit.
        for _ in 0..left.min(4) {
            let mut child = start(dir.path());
            std::thread::sleep(Duration::from_millis(random.below(whole_ms)));
            kill(&format!("-{}", child.id()));
            child.wait().unwrap();
            if store.join("scene.sqlite").exists()
                && clerestory::store::Store::open(&store, Duration::from_secs(5)).is_ok()
            {
                assert_sound(&store);
            }
            left -= 1;
        }
        let (code, summary) = finish(&mut run(dir.path(), &["--workers", "2"]));
        assert_eq!(code, 0, "{summary}");
        assert!(light_of(&store) == expected, "the light differs");
        assert_sound(&store);
    }
}

#[test]
fn a_run_whose_workers_are_killed_replaces_them_and_ends_by_itself() {
    let calm = scene();
    assert_eq!(finish(&mut run(calm.path(), &["--workers", "2"])).0, 0);
    let expected = light_of(&calm.path().join("rooms.clr"));
    let mut random = Random(u64::from(std::process::id()) + 1);
    println!("seed {}", random.0);
    for _ in 0..kills() / 4 {
        let dir = scene();
        let mut child = start(dir.path());
        // Two kills, so that no group dies three times.
        for _ in 0..2 {
            std::thread::sleep(Duration::from_millis(50 + random.below(300)));
            let workers = children_of(child.id());
            if !workers.is_empty() {
                kill(&workers[random.below(workers.len() as u64) as usize]);
            }
        }
        let end = Instant::now() + Duration::from_secs(120);
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < end, "it hangs");
            std::thread::sleep(Duration::from_millis(20));
        };
        assert_eq!(status.code(), Some(0));
        assert!(light_of(&dir.path().join("rooms.clr")) == expected, "the light differs");
        assert_sound(&dir.path().join("rooms.clr"));
    }
}

#[test]
fn workers_end_when_their_coordinator_is_gone() {
    let dir = scene();
    let mut child = start(dir.path());
    let end = Instant::now() + Duration::from_secs(60);
    let workers = loop {
        let workers = children_of(child.id());
        if !workers.is_empty() {
            break workers;
        }
        assert!(Instant::now() < end, "no child appears");
    };
    kill(&child.id().to_string());
    child.wait().unwrap();
    let end = Instant::now() + Duration::from_secs(10);
    while workers.iter().any(|pid| is_running(pid)) {
        assert!(Instant::now() < end, "a worker lives on");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Whether a process lives and is not only waiting to be collected.
fn is_running(pid: &str) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with('Z'))
}
