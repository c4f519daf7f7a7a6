//! A store that one may only read (somebody else's, a read-only mount) answers every reading verb, and nothing
//! is written to it.

mod common;

use std::collections::BTreeMap;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::SystemTime;

use common::{assert_sound, finish, run, write_rooms};

/// Somebody who owns nothing.
const NOBODY: u32 = 65534;

/// A solved store, its files readable by all and writable by nobody; a folder to write results to, and a copy
/// of the program that anybody may start.
struct Scene {
    dir: tempfile::TempDir,
}

fn allow(path: &Path, mode: u32) {
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
}

fn everything_below(dir: &Path) -> Vec<PathBuf> {
    let mut all = vec![dir.to_path_buf()];
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { all.extend(everything_below(&path)) } else { all.push(path) }
    }
    all
}

fn is_root() -> bool {
    std::fs::metadata("/proc/self").unwrap().uid() == 0
}

impl Scene {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        write_rooms(&dir.path().join("rooms.obj"), 2);
        assert_eq!(finish(&mut run(dir.path(), &[])).0, 0);
        std::fs::write(dir.path().join("points.csv"), "x,y,z,nx,ny,nz\n2,1.5,0,0,0,1\n").unwrap();
        std::fs::create_dir(dir.path().join("out")).unwrap();
        // By another process: a file that this one has open for writing while a thread forks cannot be run.
        let copied =
            Command::new("cp").arg(env!("CARGO_BIN_EXE_clerestory")).arg(dir.path().join("clerestory")).status();
        assert!(copied.unwrap().success());
        allow(dir.path(), 0o755);
        allow(&dir.path().join("points.csv"), 0o644);
        allow(&dir.path().join("out"), 0o777);
        Self { dir }
    }

    fn store(&self) -> PathBuf {
        self.dir.path().join("rooms.clr")
    }

    fn lock_up(&self) {
        for path in everything_below(&self.store()) {
            allow(&path, if path.is_dir() { 0o555 } else { 0o444 });
        }
    }

    fn unlock(&self) {
        for path in everything_below(&self.store()) {
            allow(&path, if path.is_dir() { 0o755 } else { 0o644 });
        }
    }

    /// Runs the program as somebody whom permissions bind.
    fn as_nobody(&self, args: &[&str]) -> Output {
        let mut command = Command::new(self.dir.path().join("clerestory"));
        command.current_dir(self.dir.path()).args(args);
        if is_root() {
            command.uid(NOBODY).gid(NOBODY);
        }
        command.output().unwrap()
    }

    /// Names, lengths and times of the store's files and folders.
    fn state(&self) -> BTreeMap<PathBuf, (u64, SystemTime)> {
        let state = |path: PathBuf| {
            let meta = std::fs::metadata(&path).unwrap();
            (path, (meta.len(), meta.modified().unwrap()))
        };
        everything_below(&self.store()).into_iter().map(state).collect()
    }

    fn reads(&self, how: &str) {
        let before = self.state();
        let verbs: [&[&str]; 8] = [
            &["status", "rooms.clr", "--settings"],
            &["status", "rooms.clr", "--json"],
            &["check", "rooms.clr"],
            &["sample", "rooms.clr", "--points", "points.csv", "-o", "out/light.csv", "--force"],
            &["audit", "rooms.clr", "--places", "64"],
            &["render", "rooms.clr", "-o", "out/x.png", "--size", "20x15", "--force"],
            &["export", "rooms.clr", "-o", "out/x.csv", "--force"],
            &["export", "rooms.clr", "-o", "-", "--version", "0"],
        ];
        for args in verbs {
            let output = self.as_nobody(args);
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(0), "{how}, {args:?}: {said}");
        }
        let light = std::fs::read_to_string(self.dir.path().join("out/light.csv")).unwrap();
        assert!(light.lines().nth(1).is_some_and(|line| !line.ends_with(",,,")), "{how}: {light}");
        assert_eq!(self.state(), before, "{how}: something was written");
    }
}

#[test]
fn every_reading_verb_works_on_a_store_that_may_only_be_read_and_writes_nothing() {
    let scene = Scene::new();
    scene.lock_up();
    scene.reads("closed");
    for name in ["readers.lock", "run.lock", "publish.lock"] {
        let path = scene.store().join(name);
        allow(&scene.store(), 0o755);
        std::fs::remove_file(path).unwrap();
        allow(&scene.store(), 0o555);
    }
    scene.reads("without lock files");
    scene.unlock();
    assert_sound(&scene.store());
}

#[test]
fn what_still_lies_in_the_catalogues_log_is_read_too_or_said_to_be_out_of_reach() {
    let scene = Scene::new();
    let catalogue = scene.store().join("scene.sqlite");
    // Somebody who has the store open: the last change is in the log, and the catalogue does not hold it.
    let writer = rusqlite::Connection::open(&catalogue).unwrap();
    writer.pragma_update(None, "wal_autocheckpoint", 0).unwrap();
    writer.execute("UPDATE metrics SET value = value + 1", []).unwrap();
    assert!(std::fs::metadata(scene.store().join("scene.sqlite-wal")).unwrap().len() > 0);
    scene.lock_up();
    scene.reads("open elsewhere");
    // A copy of all but the index of the log: what the log holds can't be had without writing.
    let copy = scene.dir.path().join("copy.clr");
    std::fs::create_dir(&copy).unwrap();
    for name in ["scene.sqlite", "scene.sqlite-wal"] {
        std::fs::copy(scene.store().join(name), copy.join(name)).unwrap();
        allow(&copy.join(name), 0o444);
    }
    allow(&copy, 0o555);
    let output = scene.as_nobody(&["status", "copy.clr"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("cp -r copy.clr"), "{said}");
    scene.unlock();
    allow(&copy, 0o755);
}

#[test]
fn verbs_that_write_say_that_the_store_may_only_be_read_and_what_to_do() {
    let scene = Scene::new();
    scene.lock_up();
    let before = scene.state();
    let verbs: [&[&str]; 6] = [
        &["visibility", "rooms.clr", "--fresh"],
        &["partition", "rooms.clr", "--fresh"],
        &["solve-group", "rooms.clr", "--next"],
        &["merge", "rooms.clr"],
        &["gc", "rooms.clr"],
        &["run", "--store", "rooms.clr", "--tolerance", "0.05"],
    ];
    for args in verbs {
        let output = scene.as_nobody(args);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{args:?}: {said}");
        assert!(said.contains("you may read this store") && said.contains("cp -r rooms.clr"), "{args:?}: {said}");
    }
    assert_eq!(scene.state(), before);
    scene.unlock();
}

#[test]
fn the_copy_that_is_advised_takes_a_free_name_and_can_be_written() {
    let scene = Scene::new();
    scene.lock_up();
    std::fs::create_dir(scene.dir.path().join("copy.clr")).unwrap();
    allow(scene.dir.path(), 0o777);
    let said = String::from_utf8_lossy(&scene.as_nobody(&["gc", "rooms.clr"]).stderr).into_owned();
    let advice = said.split('`').nth(1).unwrap_or_else(|| panic!("{said}"));
    assert!(advice.contains("copy-2.clr"), "{said}");
    let mut shell = Command::new("sh");
    shell.current_dir(scene.dir.path()).args(["-c", advice]);
    if is_root() {
        shell.uid(NOBODY).gid(NOBODY);
    }
    assert!(shell.status().unwrap().success(), "{advice}");
    let output = scene.as_nobody(&["gc", "copy-2.clr"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    scene.unlock();
}

#[test]
fn a_store_that_one_may_not_even_read_is_said_to_be_one() {
    let scene = Scene::new();
    for (name, mode) in [("", 0o600), ("scene.sqlite", 0o000)] {
        scene.unlock();
        allow(&scene.store().join(name), mode);
        for verb in ["status", "check", "gc"] {
            let output = scene.as_nobody(&[verb, "rooms.clr"]);
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{name}, {verb}: {said}");
            assert!(said.contains("permission"), "{name}, {verb}: {said}");
            assert!(!said.contains("has room"), "{name}, {verb}: {said}");
        }
    }
    scene.unlock();
}

#[test]
fn a_store_of_an_older_format_that_may_only_be_read_is_refused_by_name() {
    let scene = Scene::new();
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/old_stores/format_1");
    std::fs::remove_dir_all(scene.store()).unwrap();
    std::fs::create_dir_all(scene.store().join("segments")).unwrap();
    std::fs::copy(from.join("scene.sqlite"), scene.store().join("scene.sqlite")).unwrap();
    for entry in std::fs::read_dir(from.join("segments")).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), scene.store().join("segments").join(entry.file_name())).unwrap();
    }
    scene.lock_up();
    let before = scene.state();
    for args in [["check", "rooms.clr"], ["status", "rooms.clr"]] {
        let output = scene.as_nobody(&args);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(12), "{args:?}: {said}");
        assert!(said.contains("its format is 1, this program reads 8"), "{args:?}: {said}");
    }
    assert_eq!(scene.state(), before);
    scene.unlock();
}
