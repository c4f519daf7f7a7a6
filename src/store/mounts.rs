//! Which file system a folder lies on: SQLite's write-ahead log needs memory shared by all its
//! users, which network file systems do not give.

use std::path::Path;

use crate::base::text::shown;
use crate::base::{Error, Result};

const NETWORK: [&str; 18] = [
    "nfs",
    "nfs4",
    "cifs",
    "smb3",
    "smbfs",
    "afs",
    "ceph",
    "ncpfs",
    "coda",
    "gfs",
    "gfs2",
    "ocfs2",
    "lustre",
    "gpfs",
    "beegfs",
    "fuse.sshfs",
    "fuse.glusterfs",
    "fuse.ceph-fuse",
];

/// The type of the file system at an absolute path, from the text of `/proc/self/mountinfo`.
fn type_at<'a>(mountinfo: &'a str, path: &Path) -> Option<&'a str> {
    let mounts = mountinfo.lines().filter_map(|line| {
        let (place, source) = line.split_once(" - ")?;
        let point = place.split(' ').nth(4)?.replace("\\040", " ");
        Some((point, source.split(' ').next()?))
    });
    // The deepest mount point holds the path; of two at one point, the later hides the earlier.
    mounts.filter(|(point, _)| path.starts_with(point)).max_by_key(|(point, _)| point.len()).map(|(_, kind)| kind)
}

/// Refuses a folder (which must exist) on a network file system.
pub fn refuse_network(dir: &Path) -> Result<()> {
    let path = dir.canonicalize().map_err(|e| Error::io(dir, &e))?;
    let Ok(mountinfo) = std::fs::read_to_string("/proc/self/mountinfo") else { return Ok(()) };
    match type_at(&mountinfo, &path) {
        Some(kind) if NETWORK.contains(&kind) => Err(Error::failed(
            format!("{}: lies on a network file system ({kind}), where a store cannot be shared safely", shown(dir)),
            "put the store on a local disk with `--store /LOCAL/PATH.clr`",
        )),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_deepest_mount_point_decides() {
        let text = "21 1 8:1 / / rw,relatime - ext4 /dev/sda1 rw\n\
                    22 21 0:40 / /home rw shared:7 - nfs4 server:/home rw\n\
                    23 22 0:41 / /home/local\\040disk rw - ext4 /dev/sdb rw\n";
        assert_eq!(type_at(text, Path::new("/var/x")), Some("ext4"));
        assert_eq!(type_at(text, Path::new("/home/a/b.clr")), Some("nfs4"));
        assert_eq!(type_at(text, Path::new("/homely")), Some("ext4"), "not below /home");
        assert_eq!(type_at(text, Path::new("/home/local disk/b.clr")), Some("ext4"));
        assert!(NETWORK.contains(&"nfs4"));
    }
}
