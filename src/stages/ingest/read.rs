//! First pass: OBJ files into record files of vertices and faces, names into tables.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use super::objects::Objects;
use super::piece::{FaceCorner, NONE, Source};
use super::record_file::RecordFile;
use super::skipped::{Cause, Skipped};
use crate::base::text::shown;
use crate::base::{Error, Progress, Result};
use crate::formats::obj::{Corner, ObjReader, Record};

/// An OBJ file that has been read.
pub struct InputFile {
    /// As named on the command line.
    pub path: PathBuf,
    /// Row of its first vertex, then the row behind its last.
    pub vertices: (u64, u64),
    /// The rest of each `mtllib` line.
    pub libraries: Vec<Vec<u8>>,
    /// Whether it holds an `f` record, good or bad.
    pub has_faces: bool,
}

/// A material as faces name it.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct MaterialUse {
    /// Input file, in order of the command line.
    pub file: u32,
    /// As `usemtl` gives it; `None` before the first.
    pub name: Option<Vec<u8>>,
}

/// A face as read.
pub struct Face {
    /// Its record.
    pub source: Source,
    /// Its object.
    pub object: u32,
    /// Its material's number.
    pub material: u32,
    /// Its corners.
    pub corners: Vec<FaceCorner>,
}

/// Everything that was read, on disk.
pub struct Spilled {
    /// The files, in order of the command line.
    pub files: Vec<InputFile>,
    /// `v` of all files, in model units.
    pub positions: RecordFile<[f64; 3]>,
    /// `vt`.
    pub uvs: RecordFile<[f32; 2]>,
    /// `vn`.
    pub normals: RecordFile<[f32; 3]>,
    /// Faces as words: file, line, face, object, material, n, then n times (v, vt, vn).
    faces: RecordFile<u32>,
    /// Materials by number.
    pub materials: Vec<MaterialUse>,
    /// OBJ objects by number.
    pub objects: Objects,
    /// `f` records, good or bad.
    pub polygons: u64,
    /// Faces left out so far.
    pub skipped: Skipped,
    /// Records without area -> how many.
    pub ignored: BTreeMap<&'static str, u64>,
    /// Faces that cross themselves: how many, and the first.
    pub crossing: Option<(u64, Source)>,
}

/// What holds at a place in a file.
struct Place {
    /// The last face's record.
    source: Source,
    /// Rows of the file's first `v`, `vt`, `vn`.
    start: [u64; 3],
    /// `o`, once there was one; else `g`.
    object: Option<Vec<u8>>,
    named_by_o: bool,
    /// Numbers of both, looked up when a face needs them.
    object_number: Option<u32>,
    material_number: Option<u32>,
    material: Option<Vec<u8>>,
    known: HashMap<Option<Vec<u8>>, u32>,
}

impl Spilled {
    /// Empty record files in `dir`; each may hold about `cache_bytes` in memory.
    pub fn create(dir: &Path, cache_bytes: u64) -> Result<Self> {
        Ok(Self {
            files: Vec::new(),
            positions: RecordFile::create(dir, "positions", cache_bytes)?,
            uvs: RecordFile::create(dir, "uvs", cache_bytes / 4)?,
            normals: RecordFile::create(dir, "normals", cache_bytes / 4)?,
            faces: RecordFile::create(dir, "faces", 0)?,
            materials: Vec::new(),
            objects: Objects::create(dir)?,
            polygons: 0,
            skipped: Skipped::create(dir)?,
            ignored: BTreeMap::new(),
            crossing: None,
        })
    }

    /// Reads one OBJ file.
    pub fn read(&mut self, path: &Path, progress: &dyn Progress) -> Result<()> {
        let file = self.files.len();
        let start = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let polygons = self.polygons;
        let path = path.to_path_buf();
        let mut reader = ObjReader::open(&path)?;
        self.files.push(InputFile { path, vertices: (start[0], start[0]), libraries: Vec::new(), has_faces: false });
        let mut place = Place {
            source: Source { file: file as u32, line: 0, face: 0 },
            start,
            object: None,
            named_by_o: false,
            object_number: None,
            material_number: None,
            material: None,
            known: HashMap::new(),
        };
        progress.begin("read", "records", None);
        let mut records = 0u64;
        while let Some((line, record)) = reader.next_record()? {
            place.source.line = u32::try_from(line).map_err(|_| self.too_many("lines", line))?;
            self.take(&mut place, record)?;
            records += 1;
            if records.is_multiple_of(65_536) {
                progress.step(records)?;
            }
        }
        self.files[file].vertices.1 = self.positions.len();
        self.files[file].has_faces = self.polygons > polygons;
        Ok(())
    }

    /// Says which files hold no face, where others do.
    pub fn warn_of_faceless_files(&self, progress: &dyn Progress) {
        if self.polygons == 0 {
            return; // an error by itself
        }
        for file in self.files.iter().filter(|f| !f.has_faces) {
            progress.warn(&format!("{}: the file holds no face (`f` record)", shown(&file.path)));
        }
    }

    fn too_many(&self, what: &str, line: u64) -> Error {
        let path = self.files.last().map(|f| shown(&f.path)).unwrap_or_default();
        Error::TooLarge {
            message: format!("{path}:{line}: the model has more than 4,294,967,294 {what}"),
            help: "split the model into several stores".to_owned(),
        }
    }

    fn take(&mut self, place: &mut Place, record: Record<'_>) -> Result<()> {
        match record {
            Record::Vertex(position) => {
                self.positions.push(position)?;
                self.check_count("vertices", self.positions.len(), place)?;
            }
            Record::Uv(uv) => {
                self.uvs.push(uv)?;
                self.check_count("texture coordinates", self.uvs.len(), place)?;
            }
            Record::Normal(normal) => {
                self.normals.push(normal)?;
                self.check_count("normals", self.normals.len(), place)?;
            }
            Record::Face(corners) => {
                self.push_face(place, corners)?;
                self.polygons += 1;
                place.source.face += 1;
            }
            Record::BadFace(detail) => {
                self.skipped.add(Cause::BadFace, place.source, &detail)?;
                self.polygons += 1;
                place.source.face += 1;
            }
            Record::Object(name) => {
                place.named_by_o = true;
                place.rename(name);
            }
            Record::Group(name) => {
                if !place.named_by_o {
                    place.rename(name);
                }
            }
            Record::Material(name) => {
                place.material = Some(name);
                place.material_number = None;
            }
            Record::Library(names) => {
                let libraries = &mut self.files[place.source.file as usize].libraries;
                if !libraries.contains(&names) {
                    libraries.push(names);
                }
            }
            Record::Ignored(what) => *self.ignored.entry(what).or_default() += 1,
        }
        Ok(())
    }

    /// Rows have numbers below [`NONE`].
    fn check_count(&self, what: &str, count: u64, place: &Place) -> Result<()> {
        if count > u64::from(NONE) { Err(self.too_many(what, u64::from(place.source.line))) } else { Ok(()) }
    }

    fn push_face(&mut self, place: &mut Place, corners: &[Corner]) -> Result<()> {
        let object = match place.object_number {
            Some(number) => number,
            None => {
                let name = place.object.as_deref().unwrap_or_default();
                *place.object_number.insert(self.objects.number(place.source.file, name)?)
            }
        };
        let material = match place.material_number {
            Some(number) => number,
            None => self.material_number(place),
        };
        let Source { file, line, face } = place.source;
        for word in [file, line, face, object, material, corners.len() as u32] {
            self.faces.push(word)?;
        }
        // What lies past the end of the file is as good as any that is not there.
        let row = |start: u64, index: u64| u32::try_from(start.saturating_add(index)).unwrap_or(NONE);
        for corner in corners {
            self.faces.push(row(place.start[0], corner.vertex))?;
            for (start, index) in [(place.start[1], corner.uv), (place.start[2], corner.normal)] {
                self.faces.push(index.map_or(NONE, |i| row(start, i)))?;
            }
        }
        Ok(())
    }

    fn material_number(&mut self, place: &mut Place) -> u32 {
        let next = self.materials.len() as u32;
        let number = *place.known.entry(place.material.clone()).or_insert(next);
        if number == next {
            self.materials.push(MaterialUse { file: place.source.file, name: place.material.clone() });
        }
        place.material_number = Some(number);
        number
    }

    /// Visits every face with three or more corners, in order.
    pub fn for_each_face(
        &mut self,
        mut visit: impl FnMut(&mut Self, &Face) -> Result<()>,
        progress: &dyn Progress,
    ) -> Result<()> {
        let mut at = 0;
        let mut face =
            Face { source: Source { file: 0, line: 0, face: 0 }, object: 0, material: 0, corners: Vec::new() };
        let mut seen = 0u64;
        while at < self.faces.len() {
            let mut word = || {
                at += 1;
                self.faces.get(at - 1)
            };
            face.source = Source { file: word()?, line: word()?, face: word()? };
            face.object = word()?;
            face.material = word()?;
            let count = word()?;
            face.corners.clear();
            for _ in 0..count {
                face.corners.push(FaceCorner { vertex: word()?, uv: word()?, normal: word()? });
            }
            visit(self, &face)?;
            seen += 1;
            if seen.is_multiple_of(16_384) {
                progress.step(seen)?;
            }
        }
        Ok(())
    }
}

impl Place {
    fn rename(&mut self, name: Vec<u8>) {
        self.object = Some(name);
        self.object_number = None;
    }
}
