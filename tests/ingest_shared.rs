//! Every shared scene ingests at defaults, and the reader agrees with tobj.

mod support;

use std::path::PathBuf;

use clerestory::formats::obj::{ObjReader, Record};

const SCENES: [&str; 10] = [
    "cornell-box/cornell_box.obj",
    "soda-floor5/soda-floor5.obj",
    "soda-hall/soda-hall.obj",
    "tall-building/tall-building.obj",
    "duplex/duplex.obj",
    "large-building/large-building.obj",
    "staircase2/staircase2.obj",
    "classroom/classroom.obj",
    "living-room/living-room.obj",
    "hospital3/hospital3.obj",
];

fn scenes() -> Vec<PathBuf> {
    SCENES.iter().filter_map(|s| support::shared(&format!("scenes/{s}"))).collect()
}

/// Corner positions of every face, as f32, and where faces are.
fn ours(path: &std::path::Path) -> Vec<Vec<[f32; 3]>> {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    let mut reader = ObjReader::open(path).unwrap();
    while let Some((_, record)) = reader.next_record().unwrap() {
        match record {
            Record::Vertex(v) => vertices.push(v.map(|x| x as f32)),
            Record::Face(corners) => faces.push(corners.iter().map(|c| vertices[c.vertex as usize]).collect()),
            _ => {}
        }
    }
    faces
}

fn tobjs(path: &PathBuf) -> Vec<Vec<[f32; 3]>> {
    let (models, _) = tobj::load_obj(path, &tobj::LoadOptions::default()).unwrap();
    let mut faces = Vec::new();
    for model in models {
        let mesh = model.mesh;
        let at = |i: u32| [0, 1, 2].map(|k| mesh.positions[3 * i as usize + k]);
        let mut from = 0;
        let arities =
            if mesh.face_arities.is_empty() { vec![3; mesh.indices.len() / 3] } else { mesh.face_arities.clone() };
        for n in arities {
            faces.push(mesh.indices[from..from + n as usize].iter().map(|i| at(*i)).collect());
            from += n as usize;
        }
    }
    faces
}

#[test]
fn the_reader_finds_the_faces_that_tobj_finds() {
    for scene in scenes() {
        let (ours, tobjs) = (ours(&scene), tobjs(&scene));
        assert_eq!(ours.len(), tobjs.len(), "{}", scene.display());
        // tobj gives faces by object and material, and so may change their order.
        let sorted = |mut faces: Vec<Vec<[f32; 3]>>| {
            faces.sort_by(|a, b| a.partial_cmp(b).unwrap());
            faces
        };
        assert!(sorted(ours) == sorted(tobjs), "{}", scene.display());
    }
}

#[test]
fn every_scene_ingests_at_defaults() {
    for scene in scenes() {
        let dir = tempfile::tempdir().unwrap();
        let began = std::time::Instant::now();
        let (said, done) = support::ingest(&support::options(&dir.path().join("s.clr"), &scene));
        let summary = done.unwrap_or_else(|e| panic!("{}: {e}", scene.display()));
        println!("{} {summary:?} {:.1?}\n{said}", scene.display(), began.elapsed());
        assert!(summary.patches > 0 && summary.emitters > 0, "{}", scene.display());
    }
}
