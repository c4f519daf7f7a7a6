//! Gates: what is read of a version is one light, in meshes as at points, and needs no row of it.

use std::fmt::Write;
use std::path::Path;

use rusqlite::Connection;

use super::solved::{Solved, column, grey, solve_with};

/// Places of the mesh that are asked for.
const PLACES: usize = 10_000;

/// What everything reflects, and what lamps emit, W/m2.
const RHO: f64 = 0.5;
const EXITANCE: f64 = 1000.0;

/// Bytes of an extent's header.
const HEADER: u64 = 64;

/// Vertices (place, normal, radiosity) and faces of an exported PLY.
struct Mesh {
    vertices: Vec<([f64; 3], [f32; 3], [f32; 3])>,
    faces: Vec<Vec<u32>>,
}

fn mesh(path: &Path) -> Mesh {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let count = |what: &str| -> usize {
        let line = header.lines().find_map(|line| line.strip_prefix(&format!("element {what} ")));
        line.unwrap().parse().unwrap()
    };
    let mut rest = &bytes[end..];
    let mut take = |n: usize| {
        let (taken, left) = rest.split_at(n);
        rest = left;
        taken
    };
    let float = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
    let vertices = (0..count("vertex"))
        .map(|_| {
            let place: Vec<f64> = take(24).chunks(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
            let normal: Vec<f32> = take(12).chunks(4).map(float).collect();
            take(3);
            let light: Vec<f32> = take(12).chunks(4).map(float).collect();
            (place.try_into().unwrap(), normal.try_into().unwrap(), light.try_into().unwrap())
        })
        .collect();
    let faces = (0..count("face"))
        .map(|_| {
            let n = usize::from(take(1)[0]);
            let of = take(4 * n).chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
            take(16);
            of
        })
        .collect();
    Mesh { vertices, faces }
}

fn office() -> Solved {
    solve_with("office", &grey(RHO, &[("panel", EXITANCE)]), &["--quality", "preview"])
}

#[test]
fn places_of_the_exported_mesh_have_the_light_that_is_stored_there() {
    let solved = office();
    solved.ask(&["export", "s.clr", "-o", "mesh.ply", "-q"]);
    let mesh = mesh(&solved.store().with_file_name("mesh.ply"));
    let (mut points, mut expected) = ("x,y,z,nx,ny,nz\n".to_owned(), Vec::new());
    for i in 0..PLACES {
        let face = &mesh.faces[i * 7919 % mesh.faces.len()];
        let corners: Vec<_> = face.iter().map(|v| mesh.vertices[*v as usize]).collect();
        // Inside, off the middle where it has three corners; in the middle where it has four.
        let weights: &[f64] = if face.len() == 3 { &[0.5, 0.3, 0.2] } else { &[0.25; 4] };
        let sum = |of: &dyn Fn(usize) -> f64| weights.iter().enumerate().map(|(k, w)| w * of(k)).sum::<f64>();
        let at: [f64; 3] = std::array::from_fn(|c| sum(&|k| corners[k].0[c]));
        let [nx, ny, nz] = corners[0].1;
        writeln!(points, "{},{},{},{nx},{ny},{nz}", at[0], at[1], at[2]).unwrap();
        let radiosity = sum(&|k| f64::from(corners[k].2[0]));
        expected.push((if radiosity >= EXITANCE { radiosity - EXITANCE } else { radiosity }) / RHO);
    }
    solved.write("places.csv", &points);
    let table = solved.ask(&["sample", "s.clr", "--points", "places.csv", "--stored", "-o", "-", "-q"]);
    let stored = column(&table, "irradiance_r_w_m2");
    let mean = expected.iter().sum::<f64>() / PLACES as f64;
    let off: Vec<f64> = stored.iter().zip(&expected).map(|(s, e)| (s - e).abs() / mean).collect();
    let worst = off.iter().copied().fold(0.0, f64::max);
    assert!(
        worst <= 1e-3,
        "{worst} of the mean, at {} of {PLACES} places more",
        off.iter().filter(|x| **x > 1e-3).count()
    );
}

#[test]
fn nothing_that_is_read_needs_rows() {
    let solved = office();
    let read = || -> Vec<Vec<u8>> {
        solved.write("points.csv", "x,y,z,nx,ny,nz\n2,2,0,0,0,1\n5,3,0,0,0,1\n");
        for name in ["a.csv", "a.ply", "a.glb"] {
            solved.ask(&["export", "s.clr", "-o", name, "-q", "--force"]);
        }
        solved.ask(&["render", "s.clr", "-o", "a.png", "--size", "160x120", "-q", "--force"]);
        solved.ask(&["sample", "s.clr", "--points", "points.csv", "--stored", "-o", "a.txt", "-q", "--force"]);
        let names = ["a.csv", "a.ply", "a.glb", "a.png", "a.txt"];
        names.iter().map(|name| std::fs::read(solved.store().with_file_name(name)).unwrap()).collect()
    };
    let before = read();
    let catalogue = Connection::open(solved.store().join("scene.sqlite")).unwrap();
    let sql = "SELECT file, offset, l.bytes FROM cluster_links l JOIN segments s ON s.id = l.segment";
    let mut links = catalogue.prepare(sql).unwrap();
    let rows = links.query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?))).unwrap();
    let extents: Vec<(String, i64, i64)> = rows.map(Result::unwrap).collect();
    assert!(extents.len() > 10, "{} extents of links", extents.len());
    for (file, offset, bytes) in extents {
        let path = solved.store().join("segments").join(file);
        let mut segment = std::fs::read(&path).unwrap();
        let from = offset as usize + HEADER as usize;
        segment[from..from + bytes as usize].fill(0);
        std::fs::write(path, segment).unwrap();
    }
    assert!(read() == before, "something was read otherwise");
    let out =
        std::process::Command::new(env!("CARGO_BIN_EXE_clerestory")).arg("check").arg(solved.store()).output().unwrap();
    assert_eq!(out.status.code(), Some(12), "rows are gone");
}
