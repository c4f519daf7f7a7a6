//! Ingests a furnished floor of the generator's on one core: `cargo bench --bench ingest`. One JSON line a figure.

mod common;

use std::path::Path;
use std::process::Command;

use clerestory::base::{Error, Quiet, Result};
use clerestory::formats::obj::ObjReader;
use clerestory::stages::ingest;

fn write_building(folder: &Path) {
    let mut building = Command::new(env!("CARGO_BIN_EXE_building"));
    building.arg("-o").arg(folder).args(["--furnished", "--json"]);
    let output = building.output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn read(model: &Path) -> Result<()> {
    let mut reader = ObjReader::open(model)?;
    while reader.next_record()?.is_some() {}
    Ok(())
}

fn main() -> Result<()> {
    let dir = tempfile::tempdir().expect("a place for a model");
    let model = dir.path().join("model").join("floor_001.obj");
    write_building(&dir.path().join("model"));
    let bytes = std::fs::metadata(&model).map_err(|e| Error::io(&model, &e))?.len() as f64;
    let mut stores = 0;
    let (faces, cpu_s) = common::best(|| {
        stores += 1;
        let options = common::support::options(&dir.path().join(format!("{stores}.clr")), &model);
        Ok(ingest::execute(ingest::plan(&options)?, &Quiet)?.input_polygons as f64)
    })?;
    common::print("building", "faces", faces, "1");
    common::print("building", "ingest_faces_per_s_core", faces / cpu_s, "1/s");
    common::print("building", "ingest_bytes_per_s_core", bytes / cpu_s, "B/s");
    let ((), read_s) = common::best(|| read(&model))?;
    common::print("building", "obj_bytes_read_per_s_core", bytes / read_s, "B/s");
    Ok(())
}
