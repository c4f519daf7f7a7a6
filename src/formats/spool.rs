//! Unnamed temporary files: what has to be counted before it can be written lies there.

use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::Path;

/// An empty file that has its name for a moment only: it is gone when the program is, however that ends.
pub fn unnamed(path: &Path) -> io::Result<File> {
    let file = File::options().read(true).write(true).create(true).truncate(true).open(path)?;
    std::fs::remove_file(path)?;
    Ok(file)
}

/// Bytes on disk that are gone with the program.
pub struct Spool {
    file: BufWriter<File>,
    bytes: u64,
}

impl Spool {
    /// An empty one in `dir`; `name` is its name for the moment that it has one.
    pub fn create(dir: &Path, name: &str) -> io::Result<Self> {
        let file = unnamed(&dir.join(format!(".{name}-{}.spool", std::process::id())))?;
        Ok(Self { file: BufWriter::with_capacity(64 << 10, file), bytes: 0 })
    }

    /// Bytes written.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Copies all of it.
    pub fn copy_to(self, out: &mut dyn Write) -> io::Result<()> {
        let mut file = self.file.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.rewind()?;
        io::copy(&mut file, out).map(|_| ())
    }
}

impl Write for Spool {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
