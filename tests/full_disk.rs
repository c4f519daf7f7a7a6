//! `gc` makes room on a disk that is full: the store's reserve is enough for it to work.
//!
//! Needs a small file system of its own, which only root can mount; elsewhere it says that it did nothing.

mod common;

use std::path::Path;
use std::process::Command;

use common::{assert_sound, clerestory, finish, write_rooms};

/// A small file system in memory, taken away in the end.
struct Disk(tempfile::TempDir);

impl Disk {
    fn mount(size: &str) -> Option<Self> {
        let dir = tempfile::tempdir().unwrap();
        let mount = Command::new("mount").args(["-t", "tmpfs", "-o", size, "tmpfs"]).arg(dir.path()).output().ok()?;
        mount.status.success().then_some(Self(dir))
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

/// Fills a disk to the last byte.
fn fill(dir: &Path) {
    use std::io::Write;
    let mut file = std::fs::File::create(dir.join("filler")).unwrap();
    for size in [64 << 10, 4096, 512, 1] {
        while file.write_all(&vec![1; size]).is_ok() {}
    }
}

#[test]
fn gc_works_on_a_full_disk_and_gives_back_more_than_its_reserve() {
    let Some(disk) = Disk::mount("size=64m") else {
        println!("no file system could be mounted: nothing was tested");
        return;
    };
    let dir = disk.0.path();
    write_rooms(&dir.join("rooms.obj"), 3);
    let solve = |tolerance: &str| {
        let mut command = clerestory();
        command.current_dir(dir).args(["run", "rooms.obj", "--groups", "4", "--json", "--progress", "none"]);
        finish(command.args(["--keep", "100", "--tolerance", tolerance])).0
    };
    assert_eq!((solve("0.1"), solve("0.05")), (0, 0));
    fill(dir);
    let store = dir.join("rooms.clr");
    // Who only reads needs no room.
    let elsewhere = tempfile::tempdir().unwrap();
    std::fs::write(elsewhere.path().join("points.csv"), "x,y,z,nx,ny,nz\n2,1.5,0,0,0,1\n").unwrap();
    let reading: [&[&str]; 4] = [
        &["status", "STORE"],
        &["check", "STORE"],
        &["export", "STORE", "-o", "x.csv"],
        &["sample", "STORE", "--points", "points.csv", "-o", "-"],
    ];
    for args in reading {
        let args = args.iter().map(|arg| if *arg == "STORE" { store.as_os_str() } else { arg.as_ref() });
        let output = clerestory().current_dir(elsewhere.path()).args(args).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let (code, freed) = finish(clerestory().args(["gc", "--keep", "1", "--json"]).arg(&store));
    assert_eq!(code, 0, "{freed}");
    assert!(freed["versions_removed"].as_u64().unwrap() > 0, "{freed}");
    assert!(freed["bytes_freed"].as_u64().unwrap() > 256 << 10, "{freed}");
    assert!(store.join("reserve").exists(), "the reserve is there for the next time");
    assert_sound(&store);
}
