//! Versions that are kept stay readable: during a run, after gc, and as what another run goes on from.

mod common;

use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use common::{assert_sound, clerestory, finish, run, write_rooms};
use rusqlite::{Connection, OpenFlags};

fn scene() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_rooms(&dir.path().join("rooms.obj"), 2);
    dir
}

/// A catalogue as `sqlite3` opens it.
fn catalogue(dir: &Path) -> rusqlite::Result<Connection> {
    Connection::open_with_flags(dir.join("rooms.clr/scene.sqlite"), OpenFlags::SQLITE_OPEN_READ_ONLY)
}

/// The leaves of a version, as CSV.
fn exported(dir: &Path, version: u64) -> Vec<u8> {
    let mut command = clerestory();
    let output = command
        .current_dir(dir)
        .args(["export", "rooms.clr", "-o", "-", "--version", &version.to_string(), "-q"])
        .output()
        .unwrap();
    assert!(!output.stdout.is_empty(), "version {version}: {}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

fn kept_versions(dir: &Path) -> Vec<u64> {
    let catalogue = catalogue(dir).unwrap();
    let mut query =
        catalogue.prepare("SELECT version FROM v_solution_versions WHERE is_kept = 1 ORDER BY version").unwrap();
    query.query_map([], |row| row.get(0)).unwrap().collect::<Result<_, _>>().unwrap()
}

#[test]
fn after_gc_every_kept_version_exports_the_same_bytes_and_can_be_drawn_and_gone_on_from() {
    let dir = scene();
    assert_eq!(finish(&mut run(dir.path(), &[])).0, 0);
    assert_eq!(finish(&mut run(dir.path(), &["--inner", "2"])).0, 0);
    let all = kept_versions(dir.path());
    let before: Vec<_> = all.iter().map(|&v| exported(dir.path(), v)).collect();
    let (code, removed) =
        finish(clerestory().current_dir(dir.path()).args(["gc", "rooms.clr", "--keep", "2", "--json"]));
    assert_eq!(code, 0);
    assert!(removed["bytes_freed"].as_u64().unwrap() > 0, "{removed}");
    let kept = kept_versions(dir.path());
    assert!(kept.len() > 2 && kept.len() < all.len(), "{kept:?} of {all:?}");
    for version in &kept {
        let at = all.iter().position(|v| v == version).unwrap();
        assert!(exported(dir.path(), *version) == before[at], "version {version} differs after gc");
    }
    assert_sound(&dir.path().join("rooms.clr"));
    let old = kept[1].to_string();
    let draw = ["render", "rooms.clr", "-o", "old.png", "--size", "40x30", "--version", &old, "-q"];
    assert_eq!(clerestory().current_dir(dir.path()).args(draw).status().unwrap().code(), Some(0));
    let (code, summary) = finish(&mut run(dir.path(), &["--version", &old]));
    assert_eq!((code, summary["branch"].as_u64()), (0, Some(2)), "{summary}");
    assert_sound(&dir.path().join("rooms.clr"));
}

#[test]
fn a_version_that_gc_removed_is_listed_as_not_kept_and_asking_for_it_names_those_that_are() {
    let dir = scene();
    assert_eq!(finish(&mut run(dir.path(), &[])).0, 0);
    let all = kept_versions(dir.path());
    let listed = || -> u64 {
        let catalogue = catalogue(dir.path()).unwrap();
        catalogue.query_row("SELECT count(*) FROM v_solution_versions", [], |r| r.get(0)).unwrap()
    };
    // More than `all` where the run itself removed some.
    let made = listed();
    let gc = clerestory().current_dir(dir.path()).args(["gc", "rooms.clr", "--keep", "1", "-q"]).status().unwrap();
    assert_eq!(gc.code(), Some(0));
    let kept = kept_versions(dir.path());
    assert!(kept.len() < all.len(), "{kept:?} of {all:?}");
    assert_eq!(listed(), made, "figures stay");
    std::fs::write(dir.path().join("points.csv"), "x,y,z,nx,ny,nz\n2,1.5,0,0,0,1\n").unwrap();
    let sample = |version: &str| {
        let args = ["sample", "rooms.clr", "--points", "points.csv", "-o", "-", "--version", version];
        clerestory().current_dir(dir.path()).args(args).output().unwrap()
    };
    for version in all.iter().filter(|version| !kept.contains(version)).chain(&[999]) {
        let output = sample(&version.to_string());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "version {version}: {said}");
        assert!(output.stdout.is_empty());
        let newest = said.split("`--version ").nth(1).and_then(|rest| rest.split('`').next()).expect("it names one");
        assert_eq!(newest, kept.last().unwrap().to_string(), "{said}");
    }
    for version in kept {
        assert_eq!(sample(&version.to_string()).status.code(), Some(0), "version {version}");
    }
}

#[test]
fn the_views_answer_while_a_run_is_going() {
    let dir = scene();
    let mut child = run(dir.path(), &["--workers", "2"]).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let end = Instant::now() + Duration::from_secs(120);
    let mut answered = std::collections::BTreeSet::new();
    while child.try_wait().unwrap().is_none() {
        assert!(Instant::now() < end, "it hangs");
        std::thread::sleep(Duration::from_millis(5));
        // Before the catalogue is made there is nothing to ask.
        let Ok(reader) = catalogue(dir.path()) else { continue };
        reader.busy_timeout(Duration::from_secs(5)).unwrap();
        let Ok(mut names) = reader.prepare("SELECT name FROM sqlite_schema WHERE type = 'view'") else { continue };
        let names: Vec<String> = names.query_map([], |row| row.get(0)).unwrap().collect::<Result<_, _>>().unwrap();
        for name in names {
            let mut view = reader.prepare(&format!("SELECT * FROM {name}")).unwrap();
            let rows = view.query_map([], |_| Ok(())).unwrap().map(|row| row.unwrap()).count();
            if rows > 0 {
                answered.insert(name);
            }
        }
    }
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(answered.len() >= 8, "only {answered:?} had rows while it ran");
}
