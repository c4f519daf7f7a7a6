//! Wavefront OBJ: our own streaming reader. Line-stamped, f64, memory bounded whatever the file's
//! size.
//!
//! Records come one at a time in file order; nothing is kept but the current line and the counts
//! that relative indices need. Names are bytes.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::lines::{HELP, LineReader, number, words};
use crate::base::text::shown_name;
use crate::base::{Error, Result};

/// A corner of a face: positions within the file, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corner {
    /// Which `v`. May lie past the end of the file's vertices: only the end of the file tells.
    pub vertex: u64,
    /// Which `vt`, if the face names one that can be.
    pub uv: Option<u64>,
    /// Which `vn`, likewise.
    pub normal: Option<u64>,
}

/// One record of the file.
#[derive(Debug, PartialEq)]
pub enum Record<'a> {
    /// `v`: position in the file's units; not finite where the file says so.
    Vertex([f64; 3]),
    /// `vt`: texture coordinate; NaN where it can't be read.
    Uv([f32; 2]),
    /// `vn`: normal; NaN where it can't be read.
    Normal([f32; 3]),
    /// `f`: three or more corners.
    Face(&'a [Corner]),
    /// `f` that names no polygon, and why not.
    BadFace(String),
    /// `o`: its name.
    Object(Vec<u8>),
    /// `g`: its name.
    Group(Vec<u8>),
    /// `usemtl`: its name.
    Material(Vec<u8>),
    /// `mtllib`: the rest of the line, one or more files.
    Library(Vec<u8>),
    /// A record that has a shape but no area (`l`, `p`) or one that is not read (`curv`, `surf`).
    Ignored(&'static str),
}

/// Reads an OBJ file record by record.
pub struct ObjReader<R> {
    lines: LineReader<R>,
    corners: Vec<Corner>,
    /// `v`, `vt`, `vn` so far.
    counts: [u64; 3],
}

impl ObjReader<File> {
    /// Opens a file.
    pub fn open(path: &Path) -> Result<Self> {
        Ok(Self::over(LineReader::open(path)?))
    }
}

impl<R: Read> ObjReader<R> {
    /// Reads from anything; `path` is only for messages.
    pub fn new(input: R, path: &Path) -> Result<Self> {
        Ok(Self::over(LineReader::new(input, path)?))
    }

    fn over(lines: LineReader<R>) -> Self {
        Self { lines, corners: Vec::new(), counts: [0; 3] }
    }

    /// The next record and its (first) line, from 1; `None` at the end. Fails on unreadable files and
    /// on broken numbers.
    pub fn next_record(&mut self) -> Result<Option<(u64, Record<'_>)>> {
        while self.lines.read_line(goes_on)? {
            // The parser borrows corners mutably, the text not: taken out and put back.
            let text = std::mem::take(&mut self.lines.text);
            let parsed = self.parse(&text);
            self.lines.text = text;
            match parsed? {
                Parsed::Nothing => {}
                Parsed::Face => return Ok(Some((self.lines.line, Record::Face(&self.corners)))),
                Parsed::Other(record) => return Ok(Some((self.lines.line, record))),
            }
        }
        Ok(None)
    }

    fn failed(&self, what: &str) -> Error {
        self.lines.fault(what, HELP)
    }

    fn parse(&mut self, text: &[u8]) -> Result<Parsed> {
        let mut words = words(text);
        let Some(keyword) = words.next() else { return Ok(Parsed::Nothing) };
        let rest = || text.trim_ascii_start()[keyword.len()..].trim_ascii().to_vec();
        Ok(Parsed::Other(match keyword.to_ascii_lowercase().as_slice() {
            b"v" => {
                self.counts[0] += 1;
                Record::Vertex(self.position(&mut words)?)
            }
            b"vt" => {
                self.counts[1] += 1;
                let u = optional_number(words.next());
                Record::Uv([u, words.next().map_or(0.0, |w| optional_number(Some(w)))])
            }
            b"vn" => {
                self.counts[2] += 1;
                Record::Normal(std::array::from_fn(|_| optional_number(words.next())))
            }
            b"f" | b"fo" => match self.face(words) {
                Ok(()) => return Ok(Parsed::Face),
                Err(cause) => Record::BadFace(cause),
            },
            b"o" => Record::Object(rest()),
            b"g" => Record::Group(rest()),
            b"usemtl" => Record::Material(rest()),
            b"mtllib" => Record::Library(rest()),
            b"l" => Record::Ignored("lines"),
            b"p" => Record::Ignored("points"),
            b"curv" | b"curv2" => Record::Ignored("curves"),
            b"surf" => Record::Ignored("free-form surfaces"),
            _ => return Ok(Parsed::Nothing),
        }))
    }

    fn position<'t>(&self, words: &mut impl Iterator<Item = &'t [u8]>) -> Result<[f64; 3]> {
        let mut position = [0.0; 3];
        for (i, value) in position.iter_mut().enumerate() {
            let word = words.next().ok_or_else(|| self.failed(&format!("vertex with {i} of 3 numbers")))?;
            *value = number(word).ok_or_else(|| self.failed(&format!("`{}` is not a number", shown_name(word))))?;
        }
        Ok(position)
    }

    fn face<'t>(&mut self, words: impl Iterator<Item = &'t [u8]>) -> std::result::Result<(), String> {
        self.corners.clear();
        for word in words {
            let mut parts = word.split(|b| *b == b'/');
            let vertex = parts.next().and_then(index);
            let Some(vertex) = vertex else {
                return Err(format!("`{}` is not a corner of a face", shown_name(word)));
            };
            let vertex = self.resolve(vertex, 0).ok_or_else(|| match vertex {
                0 => "face uses vertex 0, but counting starts at 1".to_owned(),
                _ => format!("face uses vertex {vertex} but only {} are defined", self.counts[0]),
            })?;
            let [uv, normal] = [1, 2].map(|kind| parts.next().map_or(Ok(None), |part| self.companion(part, kind)));
            self.corners.push(Corner { vertex, uv: uv?, normal: normal? });
        }
        if self.corners.len() < 3 {
            return Err(format!("face has {} of at least 3 corners", self.corners.len()));
        }
        Ok(())
    }

    /// What a corner names besides its vertex, `vt` (1) or `vn` (2): nothing, or something that may not
    /// be there, but never what could not be in any file.
    fn companion(&self, part: &[u8], kind: usize) -> std::result::Result<Option<u64>, String> {
        let what = ["", "texture coordinate", "normal"][kind];
        match index(part) {
            _ if part.is_empty() => Ok(None),
            Some(i) if i.unsigned_abs() <= u64::from(u32::MAX) => Ok(self.resolve(i, kind)),
            _ => Err(format!("face uses {what} `{}`, but only {} are defined", shown_name(part), self.counts[kind])),
        }
    }

    /// Position from 0 of an index as the file writes it: from 1, or backwards from -1.
    fn resolve(&self, index: i64, kind: usize) -> Option<u64> {
        match index {
            1.. => u64::try_from(index - 1).ok(),
            0 => None,
            _ => self.counts[kind].checked_sub(index.unsigned_abs()),
        }
    }
}

/// Whether a line that ends in a backslash goes on: all do but those of names, which may end in one (`C:\lights\`).
fn goes_on(text: &[u8]) -> bool {
    let keyword = words(text).next().unwrap_or_default().to_ascii_lowercase();
    !matches!(keyword.as_slice(), b"o" | b"g" | b"usemtl")
}

enum Parsed {
    Nothing,
    Face,
    Other(Record<'static>),
}

fn optional_number(word: Option<&[u8]>) -> f32 {
    word.and_then(number).map_or(f32::NAN, |x| x as f32)
}

fn index(part: &[u8]) -> Option<i64> {
    std::str::from_utf8(part).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &[u8]) -> Result<Vec<(u64, String)>> {
        let mut reader = ObjReader::new(text, Path::new("model.obj"))?;
        let mut out = Vec::new();
        while let Some((line, record)) = reader.next_record()? {
            out.push((line, format!("{record:?}")));
        }
        Ok(out)
    }

    fn shown(text: &str) -> Vec<(u64, String)> {
        read(text.as_bytes()).unwrap()
    }

    #[test]
    fn every_way_to_write_a_vertex_gives_the_same_numbers() {
        for text in [
            "v 1 2 -.5",
            "v\t1.\t2.e0\t-0.5",
            "  v   1 2 -5e-001   ",
            "v 1 2 -0.5 0.3 0.3 0.3\r\n",
            "v 1 2 \\\n-0.5",
            "\u{feff}v 1 2 -0.5 # comment",
        ] {
            assert_eq!(shown(text).pop().unwrap().1, "Vertex([1.0, 2.0, -0.5])", "{text:?}");
        }
    }

    #[test]
    fn relative_indices_count_back_from_the_line_that_uses_them() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf -3/-1 -2 -1//-1\nv 9 9 9\nf -4 2 3";
        let records = shown(text);
        assert!(records[4].1.contains("vertex: 0, uv: Some(0), normal: None"), "{}", records[4].1);
        assert!(records[4].1.contains("vertex: 2, uv: None, normal: None"), "{}", records[4].1);
        assert!(records[6].1.contains("vertex: 0"), "{}", records[6].1);
        assert_eq!(records[6].0, 7);
    }

    #[test]
    fn a_bad_face_says_why_and_the_reading_goes_on() {
        let records = shown("v 0 0 0\nf -4 -3 -2\nf 0 1 2\nf 1 2\nf a b c\nf 1 1 1");
        let causes: Vec<_> = records[1..5].iter().map(|r| r.1.as_str()).collect();
        assert!(causes[0].contains("uses vertex -4 but only 1 are defined"), "{}", causes[0]);
        assert!(causes[1].contains("vertex 0"), "{}", causes[1]);
        assert!(causes[2].contains("2 of at least 3"), "{}", causes[2]);
        assert!(causes[3].contains("`a` is not a corner"), "{}", causes[3]);
        assert!(records[5].1.starts_with("Face"));
    }

    #[test]
    fn lines_are_counted_through_continuations_and_comments() {
        let records = shown("# path C:\\\nv 0 0 0\r\nv 1 \\\r\n 0 0\n\nv 0 1 0");
        assert_eq!(records.iter().map(|r| r.0).collect::<Vec<_>>(), [2, 3, 6]);
    }

    #[test]
    fn names_keep_their_blanks_and_every_byte() {
        let text = b"usemtl  white wall \ng  caf\xe9\no a#b";
        let mut reader = ObjReader::new(&text[..], Path::new("model.obj")).unwrap();
        let mut names = Vec::new();
        while let Some((_, record)) = reader.next_record().unwrap() {
            names.push(match record {
                Record::Material(name) | Record::Group(name) | Record::Object(name) => name,
                other => panic!("{other:?}"),
            });
        }
        assert_eq!(names, [&b"white wall"[..], b"caf\xe9", b"a#b"]);
    }

    #[test]
    fn an_index_that_no_file_could_have_costs_the_face_and_is_named_with_its_line() {
        let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        for (corner, what) in [
            ("1/99999999999/1", "texture coordinate `99999999999`"),
            ("1//4294967296", "normal `4294967296`"),
            ("1/1/-99999999999999999999", "normal `-99999999999999999999`"),
            ("1/x", "texture coordinate `x`"),
            ("99999999999999999999", "`99999999999999999999` is not a corner"),
        ] {
            let records = shown(&format!("{triangle}f {corner} 2 3"));
            assert!(
                records[3].0 == 4 && records[3].1.starts_with("BadFace") && records[3].1.contains(what),
                "{records:?}"
            );
        }
        // Exporters that leave out `vt` often keep its indices.
        assert!(shown(&format!("{triangle}f 1/1 2/2/ 3/4000000000/7"))[3].1.starts_with("Face"));
    }

    #[test]
    fn a_file_reads_the_same_whatever_ends_its_lines() {
        let text = "o a\nv 0 0 0\nv 1 0 0\nv 0 \\\n1 0\nf 1 2 3\n";
        for end in ["\r", "\r\n"] {
            assert_eq!(shown(&text.replace('\n', end)), shown(text), "{end:?}");
        }
    }

    #[test]
    fn a_broken_number_names_file_and_line_and_nan_is_passed_on() {
        let error = read(b"v 0 0 0\nv 1 2,5 3").unwrap_err();
        assert_eq!(error.to_string(), "model.obj:2: `2,5` is not a number");
        assert!(read(b"v 1 2").unwrap_err().to_string().contains("model.obj:1: vertex with 2 of 3"));
        assert_eq!(shown("v nan -inf 1.#IND")[0].1, "Vertex([NaN, -inf, NaN])");
    }
}
