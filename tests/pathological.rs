//! Every broken file that two importers collected ends with exit 0 or a clear error, and never with
//! half a store.

mod support;

use std::path::PathBuf;

fn models() -> Vec<PathBuf> {
    let Some(root) = support::shared("scenes/pathological") else { return Vec::new() };
    let mut models = Vec::new();
    for folder in ["assimp", "tinyobjloader"] {
        for entry in std::fs::read_dir(root.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "obj") {
                models.push(path);
            }
        }
    }
    models.sort();
    assert!(models.len() > 60, "{} models", models.len());
    models
}

#[test]
fn every_broken_file_ends_well_or_is_named_in_the_error() {
    for model in models() {
        let dir = tempfile::tempdir().unwrap();
        let out = support::clerestory(dir.path(), &["ingest", "s.clr", model.to_str().unwrap(), "--json"]);
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        let name = model.display();
        println!("{name}: {:?}\n{said}", out.status.code());
        assert!(!said.contains("panicked"), "{name}: {said}");
        match out.status.code() {
            Some(0) => {
                let summary: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
                assert!(summary["patches"].as_u64().unwrap() > 0, "{name}: {summary}");
                let check = support::clerestory(dir.path(), &["check", "s.clr"]);
                assert_eq!(check.status.code(), Some(0), "{name}: {}", String::from_utf8_lossy(&check.stdout));
            }
            Some(1) => {
                let file = model.file_name().unwrap().to_string_lossy().into_owned();
                let first = said.lines().find(|l| l.starts_with("error: ")).unwrap();
                assert!(first.contains(&file), "{name}: {first}");
                assert!(said.lines().any(|l| l.starts_with("help: ")), "{name}: {said}");
                assert!(!dir.path().join("s.clr").exists(), "{name}: half a store");
            }
            other => panic!("{name}: exit {other:?}: {said}"),
        }
    }
}
