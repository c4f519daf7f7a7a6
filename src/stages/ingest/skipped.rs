//! Faces that are left out: counted by cause, listed with file and line.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use super::piece::Source;
use crate::base::text::shown;
use crate::base::{Error, Result};

/// Why a face is left out; also the keys of `skipped` in the summary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Its record can't be read or names what is not there.
    BadFace,
    /// Cutting it up would take for ever.
    TooManyCorners,
    /// A corner is NaN or infinite.
    NotFinite,
    /// It has no area.
    Degenerate,
    /// So far from the rest of the model that rounding leaves nothing of it.
    TooFar,
    /// Same corners and winding as a face before it.
    Duplicate,
}

impl Cause {
    fn key(self) -> &'static str {
        match self {
            Self::BadFace => "bad_face",
            Self::TooManyCorners => "too_many_corners",
            Self::NotFinite => "not_finite",
            Self::Degenerate => "degenerate",
            Self::TooFar => "too_far",
            Self::Duplicate => "duplicate",
        }
    }
}

/// The list, on disk, and the counts.
pub struct Skipped {
    out: BufWriter<File>,
    path: PathBuf,
    counts: BTreeMap<&'static str, u64>,
    first: BTreeMap<&'static str, (u32, u32, String)>,
}

impl Skipped {
    /// An empty list in a new file.
    pub fn create(dir: &Path) -> Result<Self> {
        let path = dir.join("skipped");
        let file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(&path)
            .map_err(|e| Error::io(&path, &e))?;
        Ok(Self { out: BufWriter::new(file), path, counts: BTreeMap::new(), first: BTreeMap::new() })
    }

    /// Adds a face.
    pub fn add(&mut self, cause: Cause, source: Source, detail: &str) -> Result<()> {
        *self.counts.entry(cause.key()).or_default() += 1;
        // Passes follow each other: what comes first in the file need not come first here.
        let first = self.first.entry(cause.key()).or_insert((u32::MAX, u32::MAX, String::new()));
        if (source.file, source.line) < (first.0, first.1) {
            *first = (source.file, source.line, detail.to_owned());
        }
        let detail = detail.replace(['\n', '\r'], " ");
        writeln!(self.out, "{} {} {}: {detail}", source.file, source.line, cause.key())
            .map_err(|e| Error::io(&self.path, &e))
    }

    /// Cause -> how many.
    #[must_use]
    pub fn counts(&self) -> BTreeMap<String, u64> {
        self.counts.iter().map(|(k, v)| ((*k).to_owned(), *v)).collect()
    }

    /// One line per cause, naming its first face.
    #[must_use]
    pub fn warnings(&self, files: &[PathBuf]) -> Vec<String> {
        self.first
            .iter()
            .map(|(key, (file, line, detail))| {
                let n = self.counts[key];
                let faces = if n == 1 { "1 face".to_owned() } else { format!("{n} faces") };
                format!("{faces} skipped, first {}:{line}: {detail}", shown(&files[*file as usize]))
            })
            .collect()
    }

    /// Every face: (file, line, cause).
    pub fn for_each(&mut self, mut visit: impl FnMut(u32, u64, &str) -> Result<()>) -> Result<()> {
        let io = |e: std::io::Error| Error::io(&self.path, &e);
        self.out.flush().map_err(io)?;
        let file = self.out.get_mut();
        file.rewind().map_err(io)?;
        let mut lines = BufReader::new(file);
        let mut line = String::new();
        while lines.read_line(&mut line).map_err(io)? > 0 {
            let mut words = line.trim_end().splitn(3, ' ');
            let mut number = || words.next().and_then(|w| w.parse().ok()).unwrap_or(0);
            let (file, at) = (number(), number());
            visit(file as u32, at, words.next().unwrap_or_default())?;
            line.clear();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipped_faces_are_counted_and_listed_in_order() {
        let dir = tempfile::tempdir().unwrap();
        let mut skipped = Skipped::create(dir.path()).unwrap();
        let at = |line| Source { file: 0, line, face: 0 };
        skipped.add(Cause::BadFace, at(7), "face uses vertex 88 but only 80 are defined").unwrap();
        skipped.add(Cause::Degenerate, at(11), "face has no area at all").unwrap();
        skipped.add(Cause::Degenerate, at(9), "face has no area").unwrap();
        assert_eq!(skipped.counts()["degenerate"], 2);
        let mut seen = Vec::new();
        skipped
            .for_each(|_, line, cause| {
                seen.push(format!("{line} {cause}"));
                Ok(())
            })
            .unwrap();
        assert_eq!(seen[0], "7 bad_face: face uses vertex 88 but only 80 are defined");
        assert_eq!(seen.len(), 3);
        let warnings = skipped.warnings(&[PathBuf::from("model.obj")]);
        assert_eq!(warnings[1], "2 faces skipped, first model.obj:9: face has no area");
    }
}
