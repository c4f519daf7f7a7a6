//! A floor's OBJ file, written as it is drawn, and what has been drawn.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::AddAssign;
use std::path::{Path, PathBuf};

use clerestory::base::{Error, Result};
use serde::Serialize;

use super::material::Material;

/// What was written. Every quad is a patch to `ingest`, every object a cluster.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Counts {
    /// Quads.
    pub patches: u64,
    /// Objects.
    pub clusters: u64,
    /// Quads that emit.
    pub emitters: u64,
    /// Area of all quads, m2.
    pub area_m2: f64,
    /// Length of the files.
    pub bytes: u64,
}

impl AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.patches += other.patches;
        self.clusters += other.clusters;
        self.emitters += other.emitters;
        self.area_m2 += other.area_m2;
        self.bytes += other.bytes;
    }
}

/// An OBJ file on its way to the disk. The first error of the disk is kept until the end, so that what draws need not
/// ask after every quad.
pub struct Obj {
    path: PathBuf,
    out: BufWriter<File>,
    units_per_m: f64,
    material: Option<Material>,
    counts: Counts,
    failure: Option<std::io::Error>,
}

impl Obj {
    /// A new file that uses a library of materials.
    pub fn create(path: &Path, library: &str, units_per_m: f64) -> Result<Self> {
        let out = File::create_new(path).map_err(|e| Error::io(path, &e))?;
        let (path, out) = (path.to_path_buf(), BufWriter::with_capacity(1 << 16, out));
        let mut obj = Self { path, out, units_per_m, material: None, counts: Counts::default(), failure: None };
        obj.line(&format!("mtllib {library}\n"));
        Ok(obj)
    }

    /// Begins an object.
    pub fn object(&mut self, name: &str) {
        self.counts.clusters += 1;
        self.line(&format!("o {name}\n"));
    }

    /// Draws a quad, m, anticlockwise seen from its front.
    pub fn quad(&mut self, material: Material, corners: [[f64; 3]; 4]) {
        if self.material != Some(material) {
            self.material = Some(material);
            self.line(&format!("usemtl {}\n", material.name()));
        }
        let mut text = String::with_capacity(160);
        for corner in corners {
            let [x, y, z] = corner.map(|m| rounded(m * self.units_per_m));
            writeln!(text, "v {x} {y} {z}").expect("a string takes all");
        }
        text.push_str("f -4 -3 -2 -1\n");
        self.line(&text);
        self.counts.patches += 1;
        self.counts.emitters += u64::from(material == Material::Lamp);
        self.counts.area_m2 += area_m2(corners);
    }

    /// Brings all to the file; what was drawn.
    pub fn finish(mut self) -> Result<Counts> {
        let flushed = self.out.flush();
        match self.failure.map_or(flushed, Err) {
            Ok(()) => Ok(self.counts),
            Err(error) => Err(Error::io(&self.path, &error)),
        }
    }

    fn line(&mut self, text: &str) {
        self.counts.bytes += text.len() as u64;
        if self.failure.is_none() {
            self.failure = self.out.write_all(text.as_bytes()).err();
        }
    }
}

/// To a tenth of a thousandth: equal lengths stay equal, and numbers short. No negative zero.
fn rounded(x: f64) -> f64 {
    (x * 1e4).round() / 1e4 + 0.0
}

/// Area of a planar convex quad: half the cross product of its diagonals.
fn area_m2(corners: [[f64; 3]; 4]) -> f64 {
    let diagonal = |i: usize| glam::DVec3::from_array(corners[i + 2]) - glam::DVec3::from_array(corners[i]);
    0.5 * diagonal(0).cross(diagonal(1)).length()
}
