//! Pictures show the light of every place, also where the element there stands for another.

mod common;

use common::{clerestory, write_box};

/// Two thirds of a book's cover lie under another: what is left is as bright as the floor beside it, though the cover is
/// one element that stands for its largest part.
#[test]
fn what_is_left_of_a_cover_under_a_book_is_not_black() {
    let dir = tempfile::tempdir().unwrap();
    let mut obj = String::from("mtllib room.mtl\n");
    write_box(&mut obj, "room", "white", ([0.0; 3], [3.0, 3.0, 2.5]), true);
    write_box(&mut obj, "lamp", "lamp", ([1.2, 1.2, 2.4], [1.8, 1.8, 2.45]), false);
    write_box(&mut obj, "book", "white", ([1.5, 1.5, 0.0], [1.8, 1.7, 0.03]), false);
    write_box(&mut obj, "upper", "white", ([1.45, 1.45, 0.03], [1.7, 1.75, 0.06]), false);
    std::fs::write(dir.path().join("room.obj"), obj).unwrap();
    let mtl = "newmtl white\nKd 0.7 0.7 0.7\nnewmtl lamp\nKd 0 0 0\nKe 9 9 9\n";
    std::fs::write(dir.path().join("room.mtl"), mtl).unwrap();
    let call = |arguments: &[&str]| {
        assert!(clerestory().current_dir(dir.path()).args(arguments).arg("-q").status().unwrap().success());
    };
    call(&["run", "room.obj", "--quality", "preview", "--workers", "1"]);
    let view = ["--eye", "1.75,0.9,1.4", "--look", "1.75,1.6,0.03", "--fov", "20", "--size", "33x33"];
    call(&[&["render", "room.clr", "-o", "room.png"][..], &view].concat());
    let picture = image::open(dir.path().join("room.png")).unwrap().to_rgb8();
    let (cover, floor) = (picture.get_pixel(16, 16)[0], picture.get_pixel(30, 16)[0]);
    assert!(cover > floor / 2 && floor > 50, "cover {cover}, floor {floor}");
}
