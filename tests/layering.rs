//! Rooms import only the rooms below them, and unsafe code stays where it belongs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What each room may import besides itself.
const TABLE: [(&str, &[&str]); 11] = [
    ("base", &[]),
    ("model", &["base"]),
    ("geom", &["base", "model"]),
    ("rays", &["base", "geom", "model"]),
    ("transport", &["base", "geom", "model", "rays"]),
    ("visibility", &["base", "geom", "model", "rays", "transport"]),
    ("partition", &["base", "geom", "model", "rays", "transport"]),
    ("render", &["base", "geom", "model", "rays", "transport"]),
    ("store", &["base", "geom", "model"]),
    ("formats", &["base", "geom", "model"]),
    ("cli", &["base", "model", "stages"]),
];

const ROOMS_OF_STAGES: [&str; 10] =
    ["base", "model", "geom", "rays", "transport", "visibility", "partition", "render", "store", "formats"];

fn sources(dir: &Path, into: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, into);
        } else if path.extension().is_some_and(|e| e == "rs") {
            into.push(path);
        }
    }
}

/// Every file below `src` that is in a room: (room, path, code without line comments).
fn files() -> Vec<(String, PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    sources(&root, &mut paths);
    let mut files = Vec::new();
    for path in paths {
        let relative = path.strip_prefix(&root).unwrap().to_path_buf();
        if relative.components().count() < 2 {
            continue;
        }
        let room = relative.components().next().unwrap().as_os_str().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&path).unwrap();
        let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or_default()).collect();
        files.push((room, relative, code.join("\n")));
    }
    assert!(files.len() > 40, "{} files", files.len());
    files
}

/// Rooms that some code names as `crate::room`, also inside `crate::{...}`.
fn imports(code: &str, rooms: &[String]) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        let names: Vec<&str> = match rest.strip_prefix('{') {
            Some(list) => list
                .split(['{', '}', ',', ';'])
                .map(|item| item.trim().split("::").next().unwrap_or_default())
                .take(20)
                .collect(),
            None => vec![rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default()],
        };
        found.extend(names.into_iter().filter(|n| rooms.iter().any(|r| r == n)).map(str::to_owned));
    }
    found
}

#[test]
fn rooms_import_only_what_lies_below_them() {
    let mut allowed: BTreeMap<&str, Vec<&str>> = TABLE.iter().map(|(room, below)| (*room, below.to_vec())).collect();
    allowed.insert("stages", ROOMS_OF_STAGES.to_vec());
    let rooms: Vec<String> = allowed.keys().map(ToString::to_string).collect();
    let mut wrong = Vec::new();
    for (room, path, code) in files() {
        let below = allowed.get(room.as_str()).unwrap_or_else(|| panic!("{room} is not in the table"));
        for import in imports(&code, &rooms) {
            if import != room && !below.contains(&import.as_str()) {
                wrong.push(format!("{} imports {import}", path.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_table_would_notice_an_import_upwards() {
    let rooms: Vec<String> = ["store", "stages", "base"].iter().map(ToString::to_string).collect();
    assert_eq!(imports("use crate::store::Store;\nlet x = crate::base::lux(y);", &rooms), ["store", "base"]);
    assert_eq!(imports("use crate::{base::Error, stages::run};", &rooms), ["base", "stages"]);
}

#[test]
fn unsafe_code_stays_in_segments_and_lanes() {
    for (_, path, code) in files() {
        let allowed = ["store/segment.rs", "rays/lanes.rs"].contains(&path.to_str().unwrap());
        let has_unsafe = code.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == "unsafe");
        assert!(allowed || !has_unsafe, "{}", path.display());
    }
}

/// Numbers that a formula may have.
const OF_FORMULAS: [f64; 6] = [0.0, 0.5, 1.0, 2.0, 3.0, 4.0];

/// The numbers with a point or an exponent in a line of code.
fn floats(line: &str) -> Vec<f64> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || ['_', '.', '~'].contains(&c);
    // One word: the minus of an exponent is none between numbers.
    let line = line.replace("e-", "e~");
    let words = line.split(|c: char| !is_part(c)).filter(|word| word.starts_with(|c: char| c.is_ascii_digit()));
    let is_float = |word: &&str| (word.contains('.') && !word.contains("..")) || word.contains('e');
    words
        .filter(is_float)
        .filter_map(|word| word.replace('_', "").replace('~', "-").trim_end_matches("f64").parse().ok())
        .collect()
}

#[test]
fn numbers_that_were_chosen_are_in_one_file() {
    assert_eq!(floats("x1.0 * 0.25 + 1e-9 * a[1].b - 3.0"), [0.25, 1e-9, 3.0]);
    let mut wrong = Vec::new();
    for (room, path, code) in files() {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let is_test = name.ends_with("_tests") || name == "memory_scene";
        if room != "transport" || is_test || name == "numbers" {
            continue;
        }
        let of_program = code.split("#[cfg(test)]\nmod tests").next().unwrap();
        for line in of_program.lines() {
            if floats(line).iter().any(|number| !OF_FORMULAS.contains(number)) {
                wrong.push(format!("{}: {}", path.display(), line.trim()));
            }
        }
    }
    assert!(wrong.is_empty(), "numbers for src/transport/numbers.rs:\n{}", wrong.join("\n"));
}
