//! Catalogues whose tables or rows are not what they must be: every verb says so with 12, and `--fresh` makes the
//! store anew.

mod common;

use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

use common::{assert_sound, clerestory, write_rooms};
use rusqlite::Connection;

/// A store's name that a shell must be told with quotes.
const NAME: &str = "my copy.clr";

/// A copy of a committed store, and a model beside it.
struct Scene(tempfile::TempDir);

impl Scene {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/old_stores/format_8");
        let to = dir.path().join(NAME);
        std::fs::create_dir_all(to.join("segments")).unwrap();
        std::fs::copy(from.join("scene.sqlite"), to.join("scene.sqlite")).unwrap();
        for entry in std::fs::read_dir(from.join("segments")).unwrap() {
            let entry = entry.unwrap();
            std::fs::copy(entry.path(), to.join("segments").join(entry.file_name())).unwrap();
        }
        write_rooms(&dir.path().join("rooms.obj"), 1);
        Self(dir)
    }

    fn store(&self) -> PathBuf {
        self.0.path().join(NAME)
    }

    fn change(&self, sql: &str) {
        let catalogue = Connection::open(self.store().join("scene.sqlite")).unwrap();
        catalogue.pragma_update(None, "foreign_keys", false).unwrap();
        catalogue.execute_batch(sql).unwrap();
    }

    /// Runs a command, which must end within half a minute.
    fn said(&self, args: &[&str]) -> (i32, String) {
        let mut command = clerestory();
        command.current_dir(self.0.path()).args(args).args(["--progress", "none"]);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let end = Instant::now() + Duration::from_secs(30);
        while child.try_wait().unwrap().is_none() {
            if Instant::now() > end {
                child.kill().unwrap();
                panic!("{args:?} hangs");
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let Output { status, stderr, .. } = child.wait_with_output().unwrap();
        (status.code().unwrap_or(-1), String::from_utf8_lossy(&stderr).into_owned())
    }

    fn all_find_damage(&self, what: &str, verbs: &[&[&str]]) {
        for args in verbs {
            let (code, said) = self.said(args);
            assert_eq!(code, 12, "{what}: {args:?}: {said}");
            assert!(said.contains("help: ") && said.contains("'my copy.clr"), "{what}: {args:?}: {said}");
        }
    }
}

const CHECK: &[&str] = &["check", NAME];
const STATUS: &[&str] = &["status", NAME];
const EXPORT: &[&str] = &["export", NAME, "-o", "x.csv"];
const GC: &[&str] = &["gc", NAME];
const FRESH: &[&str] = &["ingest", NAME, "rooms.obj", "--fresh"];

#[test]
fn a_table_that_is_missing_or_has_other_columns_is_damage_that_names_it_and_fresh_mends_it() {
    for (table, sql) in [
        ("stages", "DROP TABLE stages"),
        ("seals", "DROP TABLE seals"),
        ("processes", "DROP TABLE processes"),
        ("metrics", "DROP TABLE metrics"),
        ("residency", "DROP TABLE residency"),
        ("tasks", "ALTER TABLE tasks RENAME COLUMN deaths TO lives"),
        ("model", "ALTER TABLE model DROP COLUMN max_reflectance"),
    ] {
        let scene = Scene::new();
        scene.change(sql);
        scene.all_find_damage(sql, &[STATUS, CHECK, EXPORT, GC]);
        let (_, said) = scene.said(CHECK);
        assert!(said.contains(&format!("table {table} ")), "{sql}: {said}");
        let (code, said) = scene.said(FRESH);
        assert_eq!(code, 0, "{sql}: {said}");
        assert_sound(&scene.store());
        assert!(scene.store().join("scene.sqlite.damaged").exists(), "{sql}");
    }
}

#[test]
fn tables_of_others_do_no_harm() {
    let scene = Scene::new();
    scene.change("CREATE TABLE notes (text)");
    assert_eq!(scene.said(CHECK), (0, String::new()));
}

#[test]
fn rows_without_which_no_store_is_are_damage_for_every_verb() {
    for sql in ["DELETE FROM branches", "DELETE FROM solution_versions", "UPDATE solution_versions SET branch = 9"] {
        let scene = Scene::new();
        scene.change(sql);
        scene.all_find_damage(sql, &[STATUS, CHECK, EXPORT, GC]);
    }
    let scene = Scene::new();
    scene.change("DELETE FROM seals");
    scene.all_find_damage("no seals", &[CHECK, EXPORT, GC]);
    assert_eq!(scene.said(FRESH).0, 0);
    assert_sound(&scene.store());
}

#[test]
fn rows_that_cannot_be_are_damage_for_every_verb_that_reads_them() {
    for sql in [
        "UPDATE model SET metres_per_unit = 0",
        "UPDATE model SET snap_m = -1",
        "UPDATE model SET origin_x = 9e999",
        "UPDATE model SET max_reflectance = 1e300",
        "UPDATE model SET patches = patches + 1024",
        "DELETE FROM clusters WHERE id = 1",
        "UPDATE clusters SET id = 4000000000 WHERE id = 1",
        "UPDATE clusters SET group_id = 77",
        "UPDATE clusters SET geometry_segment = 77",
        "UPDATE solution_versions SET parent = id",
        "UPDATE branches SET base_version = 4000000000",
    ] {
        let scene = Scene::new();
        scene.change(sql);
        scene.all_find_damage(sql, &[CHECK, EXPORT, GC]);
    }
}
