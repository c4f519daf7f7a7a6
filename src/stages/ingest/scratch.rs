//! The folder for what an ingest keeps on disk while it works.

use std::path::{Path, PathBuf};

use crate::base::{Error, Result};

const NAME: &str = "scratch-ingest";

/// A folder in the store, removed when dropped.
pub struct Scratch {
    dir: PathBuf,
}

impl Scratch {
    /// Makes it; what a killed ingest left there goes first (the store's lock is ours).
    pub fn create(store: &Path) -> Result<Self> {
        let dir = store.join(NAME);
        if dir.exists() {
            std::fs::remove_dir_all(&dir).map_err(|e| Error::io(&dir, &e))?;
        }
        std::fs::create_dir(&dir).map_err(|e| Error::io(&dir, &e))?;
        Ok(Self { dir })
    }

    /// Where it is.
    #[must_use]
    pub fn dir(&self) -> &Path {
        &self.dir
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What can't be removed now goes with the next ingest.
        let _ = std::fs::remove_dir_all(&self.dir);
    }
}
