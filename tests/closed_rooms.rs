//! Out of closed rooms whose faces contact lines cut no ray escapes: rays meet whole faces, however they are cut.

mod common;
mod support;

use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

use clerestory::geom::sequence::Sequence;
use clerestory::rays::traverse::Nearest;
use clerestory::stages::ray_scene::with_scene;
use clerestory::stages::working_set::WorkingSet;
use clerestory::store::{Snapshot, Store};
use glam::{DMat3, DVec3};

const RAYS: u64 = 10_000_000;

/// A box of four-cornered faces, turned.
fn write_box(obj: &mut String, low: DVec3, high: DVec3, turn: DMat3) {
    for i in 0..8u32 {
        let pick = DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
        let p = turn * (low + (high - low) * pick);
        writeln!(obj, "v {} {} {}", p.x, p.y, p.z).unwrap();
    }
    for face in [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
        let [a, b, c, d] = face.map(|corner: i32| corner - 8);
        writeln!(obj, "f {a} {b} {c} {d}").unwrap();
    }
}

fn turn() -> DMat3 {
    DMat3::from_rotation_z(0.31) * DMat3::from_rotation_x(0.47)
}

/// Casts rays from inside a box of `size` m in all directions.
fn none_escapes(dir: &Path, obj: &str, size: DVec3, cuts: u64) {
    let model = dir.join("rooms.obj");
    std::fs::write(&model, obj).unwrap();
    let (said, done) = support::ingest(&support::options(&dir.join("rooms.clr"), &model));
    done.unwrap_or_else(|error| panic!("{error} {said}"));
    let store = Store::open(&dir.join("rooms.clr"), Duration::from_secs(5)).unwrap();
    let facts = store.facts().unwrap();
    assert!(facts.patches > facts.patches_uncut + cuts, "{} patches of {}", facts.patches, facts.patches_uncut);
    common::assert_sound(&dir.join("rooms.clr"));
    let set = WorkingSet::open(&store, Snapshot::newest(&store).unwrap().version()).unwrap();
    let origin = DVec3::from_array(facts.origin) * facts.metres_per_unit;
    let escaped = with_scene(&set, |open| {
        let sequence = Sequence::new(7);
        let mut escaped = 0;
        for i in 0..RAYS {
            let [a, b, c, d] = sequence.point(i);
            let height = (i as f64 * 0.618_033_988_749_894_9).fract();
            let from = turn() * (size * (0.001 + 0.998 * DVec3::new(a, b, height))) - origin;
            let (z, angle) = (2.0 * c - 1.0, std::f64::consts::TAU * d);
            let flat = (1.0 - z * z).sqrt();
            let along = DVec3::new(flat * angle.cos(), flat * angle.sin(), z);
            escaped += u64::from(matches!(open.scene.nearest(from, along, None), Nearest::Escaped));
        }
        Ok(escaped)
    });
    assert_eq!(escaped.unwrap(), 0);
}

#[test]
fn no_ray_escapes_from_a_turned_box_of_100_m_in_which_so_many_stand_that_its_floor_spreads_over_clusters() {
    let dir = tempfile::tempdir().unwrap();
    let mut obj = String::new();
    write_box(&mut obj, DVec3::ZERO, DVec3::splat(100.0), turn());
    for i in 0..196u32 {
        let low = DVec3::new(2.0 + 6.9 * f64::from(i % 14), 3.0 + 6.8 * f64::from(i / 14), 0.0);
        write_box(&mut obj, low, low + DVec3::new(1.3, 2.1, 0.9), turn());
    }
    none_escapes(dir.path(), &obj, DVec3::splat(100.0), 300);
}

#[test]
fn no_ray_escapes_from_a_hundred_rooms_in_one_turned_box() {
    let dir = tempfile::tempdir().unwrap();
    let mut obj = String::new();
    let size = DVec3::new(50.0, 50.0, 3.0);
    write_box(&mut obj, DVec3::ZERO, size, turn());
    for i in 1..10u32 {
        let at = 5.0 * f64::from(i);
        for (low, high) in [
            (DVec3::new(at, 0.0, 0.0), DVec3::new(at + 0.1, 50.0, 3.0)),
            (DVec3::new(0.0, at, 0.0), DVec3::new(50.0, at + 0.1, 3.0)),
        ] {
            write_box(&mut obj, low, high, turn());
        }
    }
    none_escapes(dir.path(), &obj, size, 150);
}
