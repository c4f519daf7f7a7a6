//! Scenes that tests make for themselves, and the program as they call it.

#![allow(dead_code, reason = "each test file uses a part of it")]

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use clerestory::base::Quiet;
use clerestory::model::ExtentKind;
use clerestory::stages::check;
use clerestory::store::{Snapshot, Store};

/// Adds a box from its low to its high corner, m, with front sides inwards or outwards, as an object of OBJ.
pub fn write_box(obj: &mut String, name: &str, material: &str, (low, high): ([f64; 3], [f64; 3]), inwards: bool) {
    writeln!(obj, "o {name}\nusemtl {material}").expect("a string takes all");
    for i in 0..8u32 {
        let at = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
        writeln!(obj, "v {} {} {}", at(0), at(1), at(2)).expect("a string takes all");
    }
    for mut face in [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
        if !inwards {
            face.reverse();
        }
        let [a, b, c, d] = face.map(|corner: i32| corner - 8);
        writeln!(obj, "f {a} {b} {c} {d}").expect("a string takes all");
    }
}

/// Writes `count` sealed rooms in a row, each 4 x 3 x 2.5 m, front sides inwards, with a lamp below the
/// ceiling and a table, as an OBJ with its MTL.
pub fn write_rooms(model: &Path, count: u32) {
    let mut obj = String::from("mtllib rooms.mtl\n");
    for room in 0..count {
        let x = f64::from(room) * 5.0;
        let (walls, lamp, table) = (
            ([x, 0.0, 0.0], [x + 4.0, 3.0, 2.5]),
            ([x + 1.5, 1.0, 2.4], [x + 2.5, 2.0, 2.45]),
            ([x + 1.0, 0.5, 0.7], [x + 3.0, 1.5, 0.8]),
        );
        for (name, material, (low, high), inwards) in
            [("walls", "wall", walls, true), ("lamp", "light", lamp, false), ("table", "wood", table, false)]
        {
            write_box(&mut obj, &format!("{name}{room}"), material, (low, high), inwards);
        }
    }
    let mtl = "newmtl wall\nKd 0.7 0.7 0.6\nnewmtl wood\nKd 0.4 0.3 0.2\nnewmtl light\nKd 0 0 0\nKe 10 10 9\n";
    std::fs::write(model, obj).expect("a test may write its scene");
    std::fs::write(model.with_file_name("rooms.mtl"), mtl).expect("a test may write its scene");
}

/// The program, ready for arguments.
pub fn clerestory() -> Command {
    Command::new(env!("CARGO_BIN_EXE_clerestory"))
}

/// The command line that solves `rooms.obj` in a folder into `rooms.clr`, quickly.
pub fn run(dir: &Path, more: &[&str]) -> Command {
    let mut command = clerestory();
    command.current_dir(dir).args(["run", "rooms.obj", "--tolerance", "0.1", "--groups", "4", "--json"]).args(more);
    command.args(["--progress", "none"]);
    command
}

/// Exit code and JSON document of a command; the document is null if there is none.
pub fn finish(command: &mut Command) -> (i32, serde_json::Value) {
    let output = command.stderr(Stdio::inherit()).output().expect("the program starts");
    let text = String::from_utf8_lossy(&output.stdout);
    (output.status.code().unwrap_or(-1), serde_json::from_str(&text).unwrap_or_default())
}

/// The light of every cluster in the newest end of an iteration, byte for byte.
pub fn light_of(store: &Path) -> Vec<Vec<u8>> {
    let store = Store::open(store, Duration::from_secs(10)).expect("a store");
    let snapshot = Snapshot::at(&store, store.newest_iteration_end().expect("a version")).expect("it is kept");
    let light = |id| snapshot.need(ExtentKind::Radiosity, id).expect("every cluster has light").payload().to_vec();
    snapshot.clusters().map(|c| light(c.expect("a cluster").id)).collect()
}

/// Fails if `check` finds anything.
pub fn assert_sound(store: &Path) {
    let store = Store::open(store, Duration::from_secs(10)).expect("a store");
    let summary = check::execute(&store, &Quiet).expect("check runs");
    assert_eq!(summary.damages, []);
}
