//! The MTL files that a model names: found, however they are named, and read.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use super::read::InputFile;
use crate::base::text::{shown, shown_name};
use crate::base::{Error, Progress, Result};
use crate::formats::mtl::{self, Library};

/// What the models' `mtllib` lines led to.
pub struct Libraries {
    /// Per model, in the order of its lines, each file once.
    pub of_model: Vec<Vec<Library>>,
    /// Whether a file is missing: it may be there the next time.
    pub incomplete: bool,
}

/// Reads the MTL files that the models name; missing ones, and those found elsewhere, are warned of.
pub fn read(models: &[InputFile], progress: &dyn Progress) -> Result<Libraries> {
    let mut libraries = Libraries { of_model: Vec::new(), incomplete: false };
    for model in models {
        let mut found: Vec<Library> = Vec::new();
        let folder = model.path.parent().unwrap_or(Path::new(""));
        for names in &model.libraries {
            for name in resolve(folder, names)? {
                let said = format!("{}: material file `{}`", shown(&model.path), shown_name(name.written));
                let Some(path) = name.path else {
                    progress.warn(&format!("{said} is missing: its materials reflect 0.5"));
                    libraries.incomplete = true;
                    continue;
                };
                if name.is_elsewhere {
                    progress.warn(&format!("{said} is not there: {} is read instead", shown(&path)));
                }
                if found.iter().all(|f| f.path != path) {
                    found.push(mtl::read(&path)?);
                }
            }
        }
        libraries.of_model.push(found);
    }
    Ok(libraries)
}

/// A name on an `mtllib` line.
#[derive(Debug, PartialEq)]
struct Name<'a> {
    written: &'a [u8],
    /// The file, if there is one.
    path: Option<PathBuf>,
    /// Whether it was found only beside the model, or in other letters.
    is_elsewhere: bool,
}

/// The files that the rest of an `mtllib` line names. Blanks in names and between them are alike: a
/// name is what is quoted, or the longest run of words that is a file. Runs of other words, each up to
/// an ending `.mtl`, are looked for by their last part alone.
fn resolve<'a>(folder: &Path, line: &'a [u8]) -> Result<Vec<Name<'a>>> {
    if let Some(path) = as_written(folder, line)? {
        return Ok(vec![Name { written: line, path: Some(path), is_elsewhere: false }]);
    }
    let words = words(line);
    let mut names = Vec::new();
    let mut unknown = None;
    let mut from = 0;
    while from < words.len() {
        let start = unknown.unwrap_or(words[from].start);
        let mut known = None;
        for last in (from..words.len()).rev() {
            let written = unquoted(&line[words[from].start..words[last].end]);
            if let Some(path) = as_written(folder, written)? {
                known = Some((last + 1, Name { written, path: Some(path), is_elsewhere: false }));
                break;
            }
        }
        let end = words[from].end;
        match known {
            Some((next, name)) => {
                if let Some(start) = unknown.take() {
                    names.push(elsewhere(folder, line[start..words[from].start].trim_ascii())?);
                }
                names.push(name);
                from = next;
            }
            None if from + 1 == words.len() || ends_a_name(&line[..end]) => {
                names.push(elsewhere(folder, unquoted(&line[start..end]))?);
                unknown = None;
                from += 1;
            }
            None => {
                unknown = Some(start);
                from += 1;
            }
        }
    }
    // What looks like a comment behind names, and is no file, is one.
    let comment = names.iter().position(|n| n.path.is_none() && n.written.starts_with(b"#")).filter(|at| *at > 0);
    names.truncate(comment.unwrap_or(names.len()));
    Ok(names)
}

/// Where the words of a line lie; what is quoted is one word.
fn words(line: &[u8]) -> Vec<std::ops::Range<usize>> {
    let mut words = Vec::new();
    let mut at = 0;
    while at < line.len() {
        if line[at].is_ascii_whitespace() {
            at += 1;
            continue;
        }
        let quote = line[at];
        let closing = QUOTES.contains(&quote).then(|| line[at + 1..].iter().position(|b| *b == quote)).flatten();
        let blank = || line[at..].iter().position(u8::is_ascii_whitespace);
        let end = closing.map_or_else(|| blank().map_or(line.len(), |n| at + n), |n| at + n + 2);
        words.push(at..end);
        at = end;
    }
    words
}

const QUOTES: &[u8] = b"\"'";

fn unquoted(name: &[u8]) -> &[u8] {
    match name {
        [first, inner @ .., last] if first == last && QUOTES.contains(first) => inner,
        _ => name,
    }
}

fn ends_a_name(text: &[u8]) -> bool {
    let text = match text {
        [before @ .., last] if QUOTES.contains(last) => before,
        _ => text,
    };
    text.len() >= 4 && text[text.len() - 4..].eq_ignore_ascii_case(b".mtl")
}

/// The file of that name, also with the separators of Windows; a pipe or device is refused, since it
/// might never end.
fn as_written(folder: &Path, name: &[u8]) -> Result<Option<PathBuf>> {
    let slashes: Vec<u8> = name.iter().map(|b| if *b == b'\\' { b'/' } else { *b }).collect();
    for name in [name, &slashes] {
        let path = folder.join(OsStr::from_bytes(name));
        match std::fs::metadata(&path) {
            Ok(kind) if kind.is_file() => return Ok(Some(path)),
            Ok(kind) if !kind.is_dir() => {
                return Err(Error::failed(
                    format!("{}: the material file is a pipe or a device", shown(&path)),
                    "put a regular file in its place",
                ));
            }
            _ => {}
        }
    }
    Ok(None)
}

/// The file that is named like the last part of `name` in any letters, in the folder that it names or
/// beside the model.
fn elsewhere<'a>(folder: &Path, name: &'a [u8]) -> Result<Name<'a>> {
    let cut = name.iter().rposition(|b| b"/\\".contains(b)).map_or(0, |at| at + 1);
    let (before, last) = name.split_at(cut);
    let before: Vec<u8> = before.iter().map(|b| if *b == b'\\' { b'/' } else { *b }).collect();
    let mut found = Name { written: name, path: None, is_elsewhere: true };
    for folder in [folder.join(OsStr::from_bytes(&before)), folder.to_path_buf()] {
        let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
        // A folder that cannot be listed holds nothing for us.
        let entries = std::fs::read_dir(listed).into_iter().flatten().filter_map(std::result::Result::ok);
        let same = |name: &OsStr| name.as_bytes().eq_ignore_ascii_case(last);
        let mut names: Vec<_> = entries.map(|e| e.file_name()).filter(|n| same(n)).collect();
        // Letters as written come first.
        names.sort_by_key(|n| (n.as_bytes() != last, n.clone()));
        for name in names {
            if let Some(path) = as_written(&folder, name.as_bytes())? {
                found.path = Some(path);
                return Ok(found);
            }
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with those files.
    fn folder(files: &[&[u8]]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for name in files {
            let path = dir.path().join(OsStr::from_bytes(name));
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        dir
    }

    /// What a line names: file by file, `~` where it was found elsewhere, `!` where it is missing.
    fn names(dir: &Path, line: &str) -> String {
        let found = resolve(dir, line.as_bytes()).unwrap();
        let text = found.iter().map(|name| match &name.path {
            None => format!("!{}", shown_name(name.written)),
            Some(path) => {
                let path = shown(path.strip_prefix(dir).unwrap().components().as_path());
                format!("{}{path}", if name.is_elsewhere { "~" } else { "" })
            }
        });
        text.collect::<Vec<_>>().join("|")
    }

    #[test]
    fn a_library_line_names_files_with_blanks_or_several_files() {
        let dir = folder(&[b"a b.mtl", b"c.mtl", b"d.mtl"]);
        let names = |line| names(dir.path(), line);
        assert_eq!(names("a b.mtl"), "a b.mtl");
        assert_eq!(names("./c.mtl d.mtl"), "c.mtl|d.mtl");
        assert_eq!(names("x.mtl a b.mtl y.mtl"), "!x.mtl|a b.mtl|!y.mtl");
        assert_eq!(names("no such one c.mtl"), "!no such one|c.mtl");
        assert_eq!(names("my own.mtl"), "!my own.mtl");
        assert_eq!(names(".\\c.mtl"), "c.mtl");
        assert_eq!(names("c.mtl # by hand"), "c.mtl");
        assert_eq!(names(""), "");
    }

    #[test]
    fn quotes_are_no_part_of_a_name_unless_a_file_has_them() {
        let dir = folder(&[b"floor 1.mtl", b"c.mtl", b"\"q\".mtl"]);
        let names = |line| names(dir.path(), line);
        assert_eq!(names("\"floor 1.mtl\""), "floor 1.mtl");
        assert_eq!(names("\"floor 1.mtl\" c.mtl \"c.mtl\""), "floor 1.mtl|c.mtl|c.mtl");
        assert_eq!(names("'floor 1.mtl' c.mtl"), "floor 1.mtl|c.mtl");
        assert_eq!(names("\"q\".mtl"), "\"q\".mtl");
        assert_eq!(names("\"c.mtl"), "!\"c.mtl");
    }

    #[test]
    fn a_path_of_another_machine_leads_to_the_file_beside_the_model_in_any_letters() {
        let dir = folder(&[b"Plain.MTL", b"two words.mtl", b"sub/Deep.mtl", b"caf\xe9.mtl"]);
        let names = |line| names(dir.path(), line);
        assert_eq!(names(r"C:\Users\me\My Desktop\plain.mtl"), "~Plain.MTL");
        assert_eq!(names(r#""C:\Users\me\plain.mtl""#), "~Plain.MTL");
        assert_eq!(names(r"C:\a b\plain.mtl D:\c d\Two Words.mtl"), "~Plain.MTL|~two words.mtl");
        assert_eq!(names("/home/me/plain.mtl"), "~Plain.MTL");
        assert_eq!(names(r"sub\deep.mtl"), "~sub/Deep.mtl");
        let latin1 = resolve(dir.path(), b"/x/CAF\xe9.mtl").unwrap();
        assert_eq!(latin1[0].path.as_ref().unwrap().file_name().unwrap().as_bytes(), b"caf\xe9.mtl");
    }

    #[test]
    fn a_pipe_is_refused_instead_of_waited_for_and_a_folder_is_not_a_file() {
        let dir = folder(&[b"textures/x.png"]);
        let pipe = dir.path().join("p.mtl");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let said = resolve(dir.path(), b"p.mtl").unwrap_err().to_string();
        assert!(said.ends_with("p.mtl: the material file is a pipe or a device"), "{said}");
        assert!(resolve(dir.path(), b"C:\\P.mtl").is_err());
        assert_eq!(names(dir.path(), "textures"), "!textures");
    }
}
