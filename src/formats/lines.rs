//! Text files line by line, as every reader here sees them: a byte order mark is gone, CR, LF and CRLF
//! all end a line, UTF-16 is refused, and what is no regular file is refused before it can hang.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use crate::base::text::{for_shell, shown};
use crate::base::{Error, Result};

/// Longest line that is read, bytes: a polygon of about a million corners.
const LONGEST_LINE: usize = 16 << 20;

/// Bytes read at once.
const BUFFER: usize = 1 << 20;

/// Opens a regular file; a pipe that nobody writes to is refused instead of waited for.
pub fn open(path: &Path) -> Result<File> {
    let failed = |e: io::Error| Error::io(path, &e);
    // Without this flag the opening itself waits; on regular files it does nothing.
    let file = File::options().read(true).custom_flags(libc::O_NONBLOCK).open(path).map_err(failed)?;
    let kind = file.metadata().map_err(failed)?.file_type();
    if kind.is_file() {
        return Ok(file);
    }
    let what = if kind.is_dir() { "a folder" } else { "a pipe or a device" };
    Err(Error::failed(
        format!("{}: {what}, not a file", shown(path)),
        "name a regular file; points are read from stdin with `--points -`",
    ))
}

/// Bytes of a text with LF as the only end of a line.
pub struct PlainText<R> {
    input: R,
    /// What was read to look for a mark.
    start: io::Cursor<Vec<u8>>,
    after_cr: bool,
}

impl<R: Read> PlainText<R> {
    /// Looks at the first bytes; `path` is for the message.
    fn new(mut input: R, path: &Path) -> Result<Self> {
        let mut start = Vec::new();
        input.by_ref().take(3).read_to_end(&mut start).map_err(|e| Error::io(path, &e))?;
        if let Some(encoding) = two_byte_encoding(&start) {
            return Err(utf16_error(path, encoding));
        }
        if start == b"\xef\xbb\xbf" {
            start.clear();
        }
        Ok(Self { input, start: io::Cursor::new(start), after_cr: false })
    }

    /// Turns ends of lines into LF in place; how many bytes are left.
    fn end_lines_alike(&mut self, bytes: &mut [u8]) -> usize {
        if !self.after_cr && !bytes.contains(&b'\r') {
            return bytes.len();
        }
        let mut kept = 0;
        for i in 0..bytes.len() {
            let byte = bytes[i];
            if !(self.after_cr && byte == b'\n') {
                bytes[kept] = if byte == b'\r' { b'\n' } else { byte };
                kept += 1;
            }
            self.after_cr = byte == b'\r';
        }
        kept
    }
}

impl<R: Read> Read for PlainText<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let mut read = self.start.read(buffer)?;
            if read == 0 {
                read = self.input.read(buffer)?;
            }
            let kept = self.end_lines_alike(&mut buffer[..read]);
            // The LF of a CRLF by itself is not the end of the file.
            if kept > 0 || read == 0 {
                return Ok(kept);
            }
        }
    }
}

/// Reads lines, each with its number.
pub struct LineReader<R> {
    input: BufReader<PlainText<R>>,
    path: PathBuf,
    /// The line, without its end.
    pub text: Vec<u8>,
    /// Its number, from 1; the first one of several that are joined.
    pub line: u64,
    /// Lines read.
    lines: u64,
}

impl LineReader<File> {
    /// Opens a file.
    pub fn open(path: &Path) -> Result<Self> {
        Self::new(open(path)?, path)
    }
}

impl<R: Read> LineReader<R> {
    /// Reads from anything; `path` is for messages.
    pub fn new(input: R, path: &Path) -> Result<Self> {
        let input = BufReader::with_capacity(BUFFER, PlainText::new(input, path)?);
        Ok(Self { input, path: path.to_path_buf(), text: Vec::new(), line: 0, lines: 0 })
    }

    /// Fills `text` with the next line; false at the end. A line that ends in a backslash goes on in the next one,
    /// unless it is a comment, if `joins` says so of its text.
    pub fn read_line(&mut self, joins: fn(&[u8]) -> bool) -> Result<bool> {
        self.text.clear();
        self.line = self.lines + 1;
        loop {
            let room = (LONGEST_LINE + 1).saturating_sub(self.text.len());
            let read = (&mut self.input)
                .take(room as u64)
                .read_until(b'\n', &mut self.text)
                .map_err(|e| Error::io(&self.path, &e))?;
            let comment = self.text.trim_ascii_start().first() == Some(&b'#');
            if self.text.len() > LONGEST_LINE {
                if !comment {
                    return Err(self.fault("the line is longer than 16 MiB", HELP));
                }
                self.text.truncate(1);
                self.text[0] = b'#';
                continue;
            }
            if read == 0 {
                return Ok(!self.text.is_empty());
            }
            self.lines += 1;
            self.text.pop_if(|end| *end == b'\n');
            if comment || self.text.last() != Some(&b'\\') || !joins(&self.text) {
                return Ok(true);
            }
            *self.text.last_mut().expect("a backslash") = b' ';
        }
    }

    /// What is wrong with the current line.
    #[must_use]
    pub fn fault(&self, what: &str, help: &str) -> Error {
        Error::failed(format!("{}:{}: {what}", shown(&self.path), self.line), help)
    }

    /// What is left to read.
    #[must_use]
    pub fn into_rest(self) -> BufReader<PlainText<R>> {
        self.input
    }
}

/// What helps with a line that cannot be read.
pub const HELP: &str = "correct that line, or write the file again from the program that made it";

/// Words of a line up to a comment.
pub fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).take_while(|w| w[0] != b'#')
}

/// A decimal number, or one of the spellings of "not finite", Microsoft's `1.#IND` among them.
#[must_use]
pub fn number(word: &[u8]) -> Option<f64> {
    const NOT_FINITE: [&[u8]; 4] = [b"#IND", b"#INF", b"#QNAN", b"#SNAN"];
    if let Some(at) = word.iter().position(|b| *b == b'#') {
        // What a comment without a blank before it leaves is a number too.
        return if NOT_FINITE.iter().any(|w| word[at..].starts_with(w)) { Some(f64::NAN) } else { number(&word[..at]) };
    }
    std::str::from_utf8(word).ok()?.parse().ok()
}

fn two_byte_encoding(start: &[u8]) -> Option<&'static str> {
    match start {
        [0xff, 0xfe, ..] | [_, 0, ..] => Some("UTF-16LE"),
        [0xfe, 0xff, ..] | [0, _, ..] => Some("UTF-16BE"),
        _ => None,
    }
}

fn utf16_error(path: &Path, encoding: &str) -> Error {
    let ending = path.extension().map(|e| format!(".{}", shown(e))).unwrap_or_default();
    Error::failed(
        format!("{}:1: the text is {encoding}, not UTF-8", shown(path)),
        format!(
            "convert it: `iconv -f {encoding} -t UTF-8 {} > {}`",
            for_shell(path),
            for_shell(format!("converted{ending}"))
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &[u8], joins: fn(&[u8]) -> bool) -> Vec<(u64, String)> {
        let mut reader = LineReader::new(text, Path::new("model.obj")).unwrap();
        let mut out = Vec::new();
        while reader.read_line(joins).unwrap() {
            out.push((reader.line, String::from_utf8_lossy(&reader.text).into_owned()));
        }
        out
    }

    /// Hands out one byte at a time, so that every CRLF is torn apart.
    struct Drop<'a>(&'a [u8]);

    impl Read for Drop<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let n = self.0.len().min(buffer.len()).min(1);
            buffer[..n].copy_from_slice(&self.0[..n]);
            self.0 = &self.0[n..];
            Ok(n)
        }
    }

    #[test]
    fn cr_lf_and_crlf_end_a_line_also_mixed_and_torn_apart() {
        let text = b"\xef\xbb\xbfa\rb\nc\r\n\r\n\n\rd";
        let expected: Vec<(u64, String)> =
            [(1, "a"), (2, "b"), (3, "c"), (4, ""), (5, ""), (6, ""), (7, "d")].map(|(n, s)| (n, s.to_owned())).into();
        assert_eq!(lines(text, |_| false), expected);
        let mut torn = String::new();
        PlainText::new(Drop(text), Path::new("a")).unwrap().read_to_string(&mut torn).unwrap();
        assert_eq!(torn, "a\nb\nc\n\n\n\nd");
    }

    #[test]
    fn a_backslash_joins_lines_however_they_end() {
        for end in ["\r", "\n", "\r\n"] {
            let text = format!("v 1 \\{end}2{end}# C:\\{end}w");
            let expected = [(1, "v 1  2"), (3, "# C:\\"), (4, "w")].map(|(n, s)| (n, s.to_owned()));
            assert_eq!(lines(text.as_bytes(), |_| true), expected, "{end:?}");
        }
    }

    #[test]
    fn utf16_is_refused_with_the_command_that_converts_it() {
        let refused = |text: &[u8]| LineReader::new(text, Path::new("my model.obj")).err().unwrap();
        let error = refused(b"\xfe\xff\0v\0 ");
        assert_eq!(error.to_string(), "my model.obj:1: the text is UTF-16BE, not UTF-8");
        assert!(error.remedy().contains("iconv -f UTF-16BE -t UTF-8 'my model.obj' > converted.obj"), "{error:?}");
        assert!(refused(b"v\0 \0").to_string().contains("UTF-16LE"));
    }

    #[test]
    fn a_line_without_end_is_refused_before_it_fills_memory() {
        let mut reader = LineReader::new(io::repeat(b'1').take(1 << 30), Path::new("model.obj")).unwrap();
        assert!(
            reader.read_line(|_| true).unwrap_err().to_string().contains("model.obj:1: the line is longer than 16 MiB")
        );
        assert!(reader.text.capacity() < 64 << 20);
        let mut comment = LineReader::new((&b" #"[..]).chain(io::repeat(b'1').take(40 << 20)), Path::new("a")).unwrap();
        assert!(comment.read_line(|_| true).unwrap() && !comment.read_line(|_| true).unwrap());
    }

    #[test]
    fn a_pipe_and_a_folder_are_refused_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let pipe = dir.path().join("pipe.mtl");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let said = open(&pipe).unwrap_err().to_string();
        assert!(said.ends_with("pipe.mtl: a pipe or a device, not a file"), "{said}");
        assert!(open(dir.path()).unwrap_err().to_string().ends_with("a folder, not a file"));
    }
}
