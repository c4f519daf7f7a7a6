//! PLY out: binary little-endian, doubles for places, floats for light, bytes for display.

use std::io::{self, Write};
use std::path::Path;

use super::spool::Spool;
use crate::base::NodeName;

/// A vertex.
pub struct PlyVertex {
    /// Place, model coordinates and units.
    pub position: [f64; 3],
    /// Unit normal.
    pub normal: [f64; 3],
    /// sRGB-encoded.
    pub display: [u8; 3],
    /// What leaves the surface, W/m2.
    pub radiosity: [f32; 3],
}

/// Collects vertices and faces, then writes them.
pub struct PlyWriter {
    vertices: Spool,
    faces: Spool,
    vertex_count: u64,
    face_count: u64,
}

impl PlyWriter {
    /// An empty one; `dir` takes unnamed temporary files.
    pub fn create(dir: &Path) -> io::Result<Self> {
        Ok(Self {
            vertices: Spool::create(dir, "ply-vertices")?,
            faces: Spool::create(dir, "ply-faces")?,
            vertex_count: 0,
            face_count: 0,
        })
    }

    /// Adds a vertex; its number.
    pub fn vertex(&mut self, v: &PlyVertex) -> io::Result<u64> {
        for x in v.position {
            self.vertices.write_all(&x.to_le_bytes())?;
        }
        for x in v.normal {
            self.vertices.write_all(&(x as f32).to_le_bytes())?;
        }
        self.vertices.write_all(&v.display)?;
        for x in v.radiosity {
            self.vertices.write_all(&x.to_le_bytes())?;
        }
        self.vertex_count += 1;
        Ok(self.vertex_count - 1)
    }

    /// Adds a face of three or four vertices: a leaf, or part of one.
    pub fn face(&mut self, vertices: &[u32], leaf: NodeName) -> io::Result<()> {
        self.faces.write_all(&[vertices.len() as u8])?;
        for v in vertices {
            self.faces.write_all(&v.to_le_bytes())?;
        }
        let at = leaf.patch_side();
        for x in [leaf.cluster().0, u32::from(at.patch), u32::from(at.side), leaf.path()] {
            self.faces.write_all(&x.to_le_bytes())?;
        }
        self.face_count += 1;
        Ok(())
    }

    /// Writes the file. `comments` explain units and colours.
    pub fn finish(self, comments: &[String], out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "ply\nformat binary_little_endian 1.0")?;
        for comment in comments {
            writeln!(out, "comment {comment}")?;
        }
        writeln!(out, "element vertex {}", self.vertex_count)?;
        for axis in ["x", "y", "z"] {
            writeln!(out, "property double {axis}")?;
        }
        for axis in ["nx", "ny", "nz"] {
            writeln!(out, "property float {axis}")?;
        }
        for channel in ["red", "green", "blue"] {
            writeln!(out, "property uchar {channel}")?;
        }
        for channel in ["r", "g", "b"] {
            writeln!(out, "property float radiosity_{channel}")?;
        }
        writeln!(out, "element face {}", self.face_count)?;
        writeln!(out, "property list uchar uint vertex_indices")?;
        writeln!(out, "property int cluster\nproperty int patch\nproperty int side\nproperty uint path\nend_header")?;
        self.vertices.copy_to(out)?;
        self.faces.copy_to(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, PatchSide};

    #[test]
    fn the_header_counts_what_follows() {
        let dir = tempfile::tempdir().unwrap();
        let mut ply = PlyWriter::create(dir.path()).unwrap();
        for i in 0..3 {
            let position = [f64::from(i), 1e7 + 0.001, 0.0];
            let v = PlyVertex { position, normal: [0., 0., 1.], display: [1, 2, 3], radiosity: [0.5; 3] };
            assert_eq!(ply.vertex(&v).unwrap(), i as u64);
        }
        let leaf = NodeName::root(ClusterId(7), PatchSide { patch: 2, side: 1 }).child(3);
        ply.face(&[0, 1, 2], leaf).unwrap();
        let mut out = Vec::new();
        ply.finish(&["W/m2".to_owned()], &mut out).unwrap();
        let end = out.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&out[..end]).unwrap();
        assert!(header.contains("element vertex 3\n") && header.contains("element face 1\n"), "{header}");
        assert_eq!(out.len() - end, 3 * (24 + 12 + 3 + 12) + 1 + 12 + 16);
        let names: Vec<u32> =
            out[out.len() - 16..].chunks(4).map(|x| u32::from_le_bytes(x.try_into().unwrap())).collect();
        assert_eq!(names, [7, 2, 1, 0b1_11]);
        assert_eq!(f64::from_le_bytes(out[end + 8..end + 16].try_into().unwrap()), 1e7 + 0.001);
    }
}
