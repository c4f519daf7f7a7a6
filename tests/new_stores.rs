//! Making a store: in which folders, what a failure leaves behind, and what becomes of who waits for it.

mod common;
mod support;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::Mutex;
use std::time::Duration;

use clerestory::base::{Progress, Quiet};
use clerestory::stages::ingest;
use common::{assert_sound, clerestory, finish, run, write_rooms};

fn scene() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_rooms(&dir.path().join("rooms.obj"), 1);
    std::fs::write(dir.path().join("bad.obj"), "v 0 0 0\n").unwrap();
    dir
}

fn files(dir: &Path) -> BTreeSet<PathBuf> {
    let mut all = BTreeSet::new();
    for entry in std::fs::read_dir(dir).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            all.extend(files(&path));
        }
        all.insert(path);
    }
    all
}

#[test]
fn a_folder_that_holds_other_files_is_refused_and_keeps_them() {
    for (name, text) in [
        ("rooms.clr/notes.txt", "mine"),
        ("rooms.clr/segments/photo.jpg", "mine"),
        ("rooms.clr", "file"),
        // Names of ours do not make files ours.
        ("rooms.clr/reserve", "mine"),
        ("rooms.clr/run.lock", "mine"),
        ("rooms.clr/visibility.spool", "mine"),
        ("rooms.clr/scratch-ingest/thesis.txt", "mine"),
        ("rooms.clr/logs/diary.txt", "mine"),
        ("rooms.clr/segments/000001-photo.seg", "mine"),
        ("rooms.clr/scene.sqlite", "no database"),
        ("rooms.clr/scene.sqlite-wal", "mine"),
    ] {
        let dir = scene();
        let path = dir.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        let before = files(dir.path());
        for verb in [&["ingest", "rooms.clr", "rooms.obj"][..], &["run", "rooms.obj"]] {
            for fresh in [&[][..], &["--fresh"]] {
                let output = clerestory().current_dir(dir.path()).args(verb).args(fresh).output().unwrap();
                let said = String::from_utf8_lossy(&output.stderr);
                assert_eq!(output.status.code(), Some(2), "{name}, {verb:?} {fresh:?}: {said}");
                assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
                assert_eq!(files(dir.path()), before, "{name}, {verb:?} {fresh:?}");
            }
        }
    }
}

#[test]
fn another_programs_database_is_refused_and_nothing_is_made_beside_it() {
    let dir = scene();
    let store = dir.path().join("rooms.clr");
    std::fs::create_dir(&store).unwrap();
    let catalogue = rusqlite::Connection::open(store.join("scene.sqlite")).unwrap();
    catalogue.execute_batch("CREATE TABLE songs (name TEXT); PRAGMA user_version = 2").unwrap();
    drop(catalogue);
    let (before, bytes) = (files(dir.path()), std::fs::read(store.join("scene.sqlite")).unwrap());
    for args in [&["ingest", "rooms.clr", "rooms.obj"][..], &["run", "rooms.obj"]] {
        for fresh in [&[][..], &["--fresh"]] {
            let output = clerestory().current_dir(dir.path()).args(args).args(fresh).output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{args:?} {fresh:?}: {said}");
            assert_eq!(files(dir.path()), before, "{args:?} {fresh:?}");
            assert!(std::fs::read(store.join("scene.sqlite")).unwrap() == bytes, "{args:?} {fresh:?}");
        }
    }
}

#[test]
fn gc_takes_no_file_named_reserve_from_a_folder_that_is_no_store_nor_one_that_is_not_ours() {
    let dir = scene();
    let gc = |name: &str| clerestory().current_dir(dir.path()).args(["gc", name, "-q"]).status().unwrap().code();
    assert_eq!(finish(&mut run(dir.path(), &[])).0, 0);
    let ours = std::fs::read(dir.path().join("rooms.clr/reserve")).unwrap();
    std::fs::create_dir(dir.path().join("papers")).unwrap();
    let reserve = dir.path().join("papers/reserve");
    let catalogue = dir.path().join("papers/scene.sqlite");
    for (database, code) in [("", 10), ("noise, not a database", 12)] {
        if !database.is_empty() {
            std::fs::write(&catalogue, database).unwrap();
        }
        for text in [&b"mine"[..], &vec![7; ours.len()]] {
            std::fs::write(&reserve, text).unwrap();
            assert_eq!(gc("papers"), Some(code), "{database}");
            assert!(std::fs::read(&reserve).unwrap() == text, "{database}");
        }
    }
    // In a store of ours, somebody else's.
    for text in [&b"mine"[..], &vec![7; ours.len()]] {
        std::fs::write(dir.path().join("rooms.clr/reserve"), text).unwrap();
        assert_eq!(gc("rooms.clr"), Some(0));
        assert!(std::fs::read(dir.path().join("rooms.clr/reserve")).unwrap() == text);
    }
}

#[test]
fn a_catalogue_that_was_set_aside_is_never_overwritten() {
    let dir = scene();
    assert_eq!(finish(&mut run(dir.path(), &[])).0, 0);
    let store = dir.path().join("rooms.clr");
    for noise in [1u8, 2] {
        std::fs::write(store.join("scene.sqlite"), vec![noise; 8192]).unwrap();
        let args = ["ingest", "rooms.clr", "rooms.obj", "--fresh", "-q"];
        assert_eq!(clerestory().current_dir(dir.path()).args(args).status().unwrap().code(), Some(0));
    }
    for (name, noise) in [("scene.sqlite.damaged", 1), ("scene.sqlite.damaged2", 2)] {
        assert!(std::fs::read(store.join(name)).unwrap() == vec![noise; 8192], "{name}");
    }
    assert_sound(&store);
}

#[test]
fn an_empty_folder_becomes_a_store() {
    let dir = scene();
    std::fs::create_dir(dir.path().join("rooms.clr")).unwrap();
    let output = clerestory().current_dir(dir.path()).args(["ingest", "rooms.clr", "rooms.obj"]).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn fresh_and_gc_remove_only_what_is_named_as_we_name_files() {
    let dir = scene();
    assert_eq!(finish(&mut run(dir.path(), &[])).0, 0);
    let mine = ["segments/photo.jpg", "segments/000001.seg", "notes.txt"].map(|n| dir.path().join("rooms.clr").join(n));
    for path in &mine {
        std::fs::write(path, "mine").unwrap();
    }
    let command = |args: &[&str]| clerestory().current_dir(dir.path()).args(args).status().unwrap().code();
    assert_eq!(command(&["gc", "rooms.clr", "-q"]), Some(0));
    assert_eq!(command(&["ingest", "rooms.clr", "rooms.obj", "--fresh", "-q"]), Some(0));
    for path in &mine {
        assert_eq!(std::fs::read_to_string(path).unwrap(), "mine", "{}", path.display());
    }
    assert_sound(&dir.path().join("rooms.clr"));
}

#[test]
fn a_failing_ingest_leaves_no_folder_behind_and_no_other_file_goes() {
    let dir = scene();
    let before = files(dir.path());
    for verb in [&["ingest", "new.clr", "bad.obj"][..], &["run", "bad.obj", "--store", "new.clr"]] {
        assert_eq!(clerestory().current_dir(dir.path()).args(verb).arg("-q").status().unwrap().code(), Some(1));
        assert_eq!(files(dir.path()), before, "{verb:?}");
    }
    // A store that was there stays, and so does an empty folder.
    assert_eq!(finish(&mut run(dir.path(), &[])).0, 0);
    let fail = ["ingest", "rooms.clr", "bad.obj", "--fresh", "-q"];
    assert_eq!(clerestory().current_dir(dir.path()).args(fail).status().unwrap().code(), Some(1));
    assert_sound(&dir.path().join("rooms.clr"));
    assert_eq!(finish(&mut run(dir.path(), &[])).0, 0);
}

/// While a bad model is being read, lets a good one be ingested into the same store.
struct Meanwhile {
    dir: PathBuf,
    args: Vec<&'static str>,
    good: Mutex<Option<Child>>,
}

impl Progress for Meanwhile {
    fn begin(&self, stage: &str, unit: &str, total: Option<u64>) {
        Quiet.begin(stage, unit, total);
        let mut good = self.good.lock().unwrap();
        if good.is_none() {
            let mut command = clerestory();
            command.current_dir(&self.dir).args(&self.args).stdout(Stdio::piped()).stderr(Stdio::piped());
            *good = Some(command.spawn().unwrap());
            // By then it has opened the store, and waits for its lock.
            std::thread::sleep(Duration::from_millis(400));
        }
    }

    fn at(&self, _done: u64) {}

    fn warn(&self, _message: &str) {}

    fn interrupted(&self) -> bool {
        false
    }
}

#[test]
fn who_waits_while_an_ingest_into_the_same_new_store_fails_gets_its_store() {
    for args in
        [vec!["ingest", "new.clr", "rooms.obj"], vec!["run", "rooms.obj", "--store", "new.clr", "--quality", "preview"]]
    {
        let dir = scene();
        let bad = ingest::Options {
            wait: Duration::from_secs(5),
            ..support::options(&dir.path().join("new.clr"), &dir.path().join("bad.obj"))
        };
        let progress = Meanwhile { dir: dir.path().to_path_buf(), args: args.clone(), good: Mutex::new(None) };
        let failed = ingest::execute(ingest::plan(&bad).unwrap(), &progress);
        assert!(failed.is_err());
        let good = progress.good.into_inner().unwrap().expect("it was started").wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&good.stderr);
        assert_eq!(good.status.code(), Some(0), "{args:?}: {said}");
        assert_sound(&bad.store);
    }
}

#[test]
fn many_good_and_bad_ingests_at_once_leave_one_good_store() {
    for round in 0..4 {
        let dir = scene();
        let start = |model: &str| {
            let mut command = clerestory();
            command.current_dir(dir.path()).args(["ingest", "new.clr", model, "-q"]).stderr(Stdio::piped());
            command.spawn().unwrap()
        };
        let children: Vec<(Child, i32)> =
            (0..6).map(|i| if i % 2 == round % 2 { (start("bad.obj"), 1) } else { (start("rooms.obj"), 0) }).collect();
        for (child, expected) in children {
            let output = child.wait_with_output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(expected), "round {round}: {said}");
        }
        assert_sound(&dir.path().join("new.clr"));
    }
}
