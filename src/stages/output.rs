//! Files that verbs write: whole or not at all, never over an existing one without `--force`.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::base::text::{for_shell, shown};
use crate::base::{Error, Result};

/// A file on its way; gone again unless finished.
pub struct Output {
    out: Box<dyn Write>,
    /// What messages call it.
    name: PathBuf,
    /// Where it is written, and the name that it takes when finished; of stdout, a device or a pipe nothing.
    part: Option<(PathBuf, PathBuf)>,
}

/// Looks before any work is done whether the file may be made: nothing is overwritten unasked, and
/// its folder is there. `-` is stdout.
pub fn check(path: &Path, force: bool) -> Result<()> {
    if path.as_os_str() == "-" {
        return Ok(());
    }
    if path.is_dir() {
        return Err(Error::failed(format!("{}: a folder, not a file", shown(path)), "name a file in it"));
    }
    if is_stream(path) {
        return Ok(());
    }
    if path.is_symlink() && !path.exists() {
        return Err(Error::failed(format!("{}: a link to nothing", shown(path)), "name a file"));
    }
    if path.exists() && !force {
        return Err(Error::failed(
            format!("{}: the file is there already", shown(path)),
            "give `--force` to overwrite it, or another name",
        ));
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(Error::failed(
            format!("{}: there is no folder {}", shown(path), shown(folder)),
            format!("make it with `mkdir -p {}`, or name another file", for_shell(folder)),
        ));
    }
    Ok(())
}

/// Whether something is there that is neither a file nor a folder.
fn is_stream(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|meta| !meta.is_file() && !meta.is_dir())
}

/// Refuses to write into a store, or over what the verb reads.
pub fn keep_off(path: &Path, store: &Path, inputs: &[&Path]) -> Result<()> {
    let usage = |what: &str| Error::Usage {
        message: format!("{}: {what}", shown(path)),
        help: "name another file for the output".to_owned(),
    };
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (Ok(folder), Ok(store)) = (folder.canonicalize(), store.canonicalize()) else { return Ok(()) };
    let same = |other: &&Path| path.canonicalize().is_ok_and(|p| other.canonicalize().is_ok_and(|o| o == p));
    if folder.starts_with(&store) || path.canonicalize().is_ok_and(|p| p.starts_with(&store)) {
        return Err(usage("lies in the store"));
    }
    if inputs.iter().any(same) && !is_stream(path) {
        return Err(usage("is what is read"));
    }
    Ok(())
}

impl Output {
    /// Starts a file; `-` is stdout. It takes its name when finished; where that is a link, the name that it leads to.
    pub fn create(path: &Path, force: bool) -> Result<Self> {
        check(path, force)?;
        if path.as_os_str() == "-" {
            return Ok(Self { out: Box::new(io::stdout()), name: "stdout".into(), part: None });
        }
        if is_stream(path) {
            // Written as it is, since nothing can take its place.
            let stream = File::options().write(true).open(path).map_err(|e| Error::io(path, &e))?;
            return Ok(Self { out: Box::new(stream), name: "the output".into(), part: None });
        }
        let real = path.canonicalize();
        let path = real.as_deref().unwrap_or(path);
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(format!(".part-{}", std::process::id()));
        let part = path.with_file_name(name);
        let file = File::create(&part).map_err(|e| Error::io(path, &e))?;
        let out = Box::new(BufWriter::with_capacity(256 << 10, file));
        Ok(Self { out, name: part.clone(), part: Some((part, path.to_path_buf())) })
    }

    /// Gives the file its name.
    pub fn finish(mut self) -> Result<()> {
        self.out.flush().map_err(|e| Error::io(&self.name, &e))?;
        if let Some((part, path)) = &self.part {
            std::fs::rename(part, path).map_err(|e| Error::io(path, &e))?;
            self.part = None;
        }
        Ok(())
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.out.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if let Some((part, _)) = &self.part {
            // The error that led here is what matters.
            let _ = std::fs::remove_file(part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_whole_or_not_at_all_and_is_not_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.csv");
        let mut dropped = Output::create(&path, false).unwrap();
        dropped.write_all(b"half").unwrap();
        drop(dropped);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        let mut whole = Output::create(&path, false).unwrap();
        whole.write_all(b"whole").unwrap();
        whole.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"whole");
        assert!(Output::create(&path, false).is_err());
        Output::create(&path, true).unwrap().finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"");
    }
    #[test]
    fn a_file_that_cannot_be_made_is_refused_before_anything_is_written() {
        let dir = tempfile::tempdir().unwrap();
        let error = check(&dir.path().join("no dir/x.csv"), true).unwrap_err();
        assert!(error.to_string().contains("no dir/x.csv: there is no folder "), "{error}");
        assert!(error.remedy().contains("/no dir'`"), "{}", error.remedy());
        assert!(check(dir.path(), true).unwrap_err().to_string().ends_with("a folder, not a file"));
        check(&dir.path().join("x.csv"), false).unwrap();
        check(Path::new("-"), false).unwrap();
    }
}
