//! Wavefront OBJ: our own streaming reader. Line-stamped, f64, memory bounded whatever the file's
//! size.
//!
//! Records come one at a time in file order; nothing is kept but the current line and the counts
//! that relative indices need.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use crate::base::{Error, Result};

/// Longest line that is read, bytes: a polygon of about a million corners.
const LONGEST_LINE: usize = 16 << 20;

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
    Object(String),
    /// `g`: its name.
    Group(String),
    /// `usemtl`: its name.
    Material(String),
    /// `mtllib`: the rest of the line, one or more files.
    Library(String),
    /// A record that has a shape but no area (`l`, `p`) or one that is not read (`curv`, `surf`).
    Ignored(&'static str),
}

/// Reads an OBJ file record by record.
pub struct ObjReader<R> {
    input: R,
    path: PathBuf,
    text: Vec<u8>,
    corners: Vec<Corner>,
    /// First line of the current record, from 1.
    line: u64,
    /// Lines read.
    lines: u64,
    /// `v`, `vt`, `vn` so far.
    counts: [u64; 3],
    begun: bool,
}

impl ObjReader<BufReader<File>> {
    /// Opens a file.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io(path, &e))?;
        Ok(Self::new(BufReader::with_capacity(1 << 20, file), path))
    }
}

impl<R: BufRead> ObjReader<R> {
    /// Reads from anything; `path` is only for messages.
    pub fn new(input: R, path: &Path) -> Self {
        Self {
            input,
            path: path.to_path_buf(),
            text: Vec::new(),
            corners: Vec::new(),
            line: 0,
            lines: 0,
            counts: [0; 3],
            begun: false,
        }
    }

    /// How many `v` records there were so far.
    #[must_use]
    pub fn vertices(&self) -> u64 {
        self.counts[0]
    }

    /// The next record and its (first) line, from 1; `None` at the end. Fails on unreadable files and
    /// on broken numbers.
    pub fn next_record(&mut self) -> Result<Option<(u64, Record<'_>)>> {
        while self.read_line()? {
            // The parser borrows corners mutably, the text not: taken out and put back.
            let text = std::mem::take(&mut self.text);
            let parsed = self.parse(&text);
            self.text = text;
            match parsed? {
                Parsed::Nothing => {}
                Parsed::Face => return Ok(Some((self.line, Record::Face(&self.corners)))),
                Parsed::Other(record) => return Ok(Some((self.line, record))),
            }
        }
        Ok(None)
    }

    fn failed(&self, what: &str) -> Error {
        Error::failed(
            format!("{}:{}: {what}", self.path.display(), self.line),
            "correct that line, or write the model again from the program that made it",
        )
    }

    /// Fills `text` with the next line, continuations joined; false at the end.
    fn read_line(&mut self) -> Result<bool> {
        if !self.begun {
            self.begun = true;
            self.read_byte_order_mark()?;
        }
        self.text.clear();
        self.line = self.lines + 1;
        loop {
            let room = (LONGEST_LINE + 1).saturating_sub(self.text.len());
            let read = (&mut self.input)
                .take(room as u64)
                .read_until(b'\n', &mut self.text)
                .map_err(|e| Error::io(&self.path, &e))?;
            if self.text.len() > LONGEST_LINE {
                if self.text.trim_ascii_start().first() != Some(&b'#') {
                    return Err(self.failed("the line is longer than 16 MiB"));
                }
                self.text.truncate(1);
                continue;
            }
            if read == 0 {
                return Ok(!self.text.is_empty());
            }
            self.lines += 1;
            while matches!(self.text.last(), Some(b'\n' | b'\r')) {
                self.text.pop();
            }
            let comment = self.text.trim_ascii_start().first() == Some(&b'#');
            if self.text.last() != Some(&b'\\') || comment {
                // An empty line is a line, not the end.
                self.text.push(b' ');
                return Ok(true);
            }
            *self.text.last_mut().expect("a backslash") = b' ';
        }
    }

    fn read_byte_order_mark(&mut self) -> Result<()> {
        self.line = 1;
        let start = self.input.fill_buf().map_err(|e| Error::io(&self.path, &e))?;
        if let Some(why) = not_utf8(start) {
            return Err(utf16_error(&self.path, why));
        }
        if start.starts_with(b"\xef\xbb\xbf") {
            self.input.consume(3);
        }
        Ok(())
    }

    fn parse(&mut self, text: &[u8]) -> Result<Parsed> {
        let mut words = words(text);
        let Some(keyword) = words.next() else { return Ok(Parsed::Nothing) };
        let rest = || name(&text[keyword.as_ptr() as usize - text.as_ptr() as usize + keyword.len()..]);
        Ok(Parsed::Other(match keyword {
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
            *value = number(word)
                .ok_or_else(|| self.failed(&format!("`{}` is not a number", String::from_utf8_lossy(word))))?;
        }
        Ok(position)
    }

    fn face<'t>(&mut self, words: impl Iterator<Item = &'t [u8]>) -> std::result::Result<(), String> {
        self.corners.clear();
        for word in words {
            let mut parts = word.split(|b| *b == b'/');
            let vertex = parts.next().and_then(index);
            let Some(vertex) = vertex else {
                return Err(format!("`{}` is not a corner of a face", String::from_utf8_lossy(word)));
            };
            let vertex = self.resolve(vertex, 0).ok_or_else(|| match vertex {
                0 => "face uses vertex 0, but counting starts at 1".to_owned(),
                _ => format!("face uses vertex {vertex} but only {} are defined", self.counts[0]),
            })?;
            let uv = parts.next().and_then(index).and_then(|i| self.resolve(i, 1));
            let normal = parts.next().and_then(index).and_then(|i| self.resolve(i, 2));
            self.corners.push(Corner { vertex, uv, normal });
        }
        if self.corners.len() < 3 {
            return Err(format!("face has {} of at least 3 corners", self.corners.len()));
        }
        Ok(())
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

enum Parsed {
    Nothing,
    Face,
    Other(Record<'static>),
}

/// Words of a line up to a comment.
fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).take_while(|w| w[0] != b'#')
}

/// The rest of a line as a name: may hold blanks and even `#`.
fn name(text: &[u8]) -> String {
    String::from_utf8_lossy(text.trim_ascii()).into_owned()
}

/// A decimal number, or one of the spellings of "not finite", Microsoft's `1.#IND` among them.
fn number(word: &[u8]) -> Option<f64> {
    if word.contains(&b'#') {
        return Some(f64::NAN);
    }
    std::str::from_utf8(word).ok()?.parse().ok()
}

fn optional_number(word: Option<&[u8]>) -> f32 {
    word.and_then(number).map_or(f32::NAN, |x| x as f32)
}

fn index(part: &[u8]) -> Option<i64> {
    std::str::from_utf8(part).ok()?.parse().ok()
}

/// Why bytes at the start of a file are not UTF-8 or plain text.
#[must_use]
pub fn not_utf8(start: &[u8]) -> Option<&'static str> {
    match start {
        [0xff, 0xfe, ..] | [_, 0, ..] => Some("UTF-16LE"),
        [0xfe, 0xff, ..] | [0, _, ..] => Some("UTF-16BE"),
        _ => None,
    }
}

/// The error for text in two-byte characters.
#[must_use]
pub fn utf16_error(path: &Path, encoding: &str) -> Error {
    let shown = path.display();
    Error::failed(
        format!("{shown}:1: the text is {encoding}, not UTF-8"),
        format!("convert it: `iconv -f {encoding} -t UTF-8 '{shown}' > converted{}`", {
            path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default()
        }),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &[u8]) -> Result<Vec<(u64, String)>> {
        let mut reader = ObjReader::new(text, Path::new("model.obj"));
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
    fn names_keep_their_blanks_and_bytes_that_are_not_utf8_do_no_harm() {
        let records = read(b"usemtl  white wall \ng  caf\xe9\no a#b").unwrap();
        assert_eq!(records[0].1, "Material(\"white wall\")");
        assert_eq!(records[1].1, "Group(\"caf\u{fffd}\")");
        assert_eq!(records[2].1, "Object(\"a#b\")");
    }

    #[test]
    fn a_broken_number_names_file_and_line_and_nan_is_passed_on() {
        let error = read(b"v 0 0 0\nv 1 2,5 3").unwrap_err();
        assert_eq!(error.to_string(), "model.obj:2: `2,5` is not a number");
        assert!(read(b"v 1 2").unwrap_err().to_string().contains("model.obj:1: vertex with 2 of 3"));
        assert_eq!(shown("v nan -inf 1.#IND")[0].1, "Vertex([NaN, -inf, NaN])");
    }

    #[test]
    fn utf16_is_refused_with_the_command_that_converts_it() {
        let error = read(b"\xfe\xff\0v\0 ").unwrap_err();
        assert!(error.to_string().contains("UTF-16BE"), "{error}");
        assert!(error.remedy().contains("iconv -f UTF-16BE"), "{}", error.remedy());
        assert!(read(b"v\0 \0").is_err());
    }

    #[test]
    fn a_line_without_end_is_refused_before_it_fills_memory() {
        let long = std::io::repeat(b'1').take(1 << 30);
        let mut reader = ObjReader::new(BufReader::new(long), Path::new("model.obj"));
        assert!(reader.next_record().unwrap_err().to_string().contains("16 MiB"));
        assert!(reader.text.capacity() < 64 << 20);
    }
}
