//! The flags of an ingest, and what it would do.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use super::rerun;
use crate::base::memory::MemoryBudget;
use crate::base::text::shown;
use crate::base::{Error, Result};
use crate::store::{Stage, Store};

/// Least memory that an ingest runs in, bytes.
const LEAST_MEMORY: u64 = 48 << 20;

/// Length units of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Units {
    /// Metres.
    M,
    /// Centimetres.
    Cm,
    /// Millimetres.
    Mm,
    /// Inches.
    In,
    /// Feet.
    Ft,
}

impl Units {
    /// Metres per unit.
    #[must_use]
    pub fn metres(self) -> f64 {
        match self {
            Self::M => 1.0,
            Self::Cm => 0.01,
            Self::Mm => 0.001,
            Self::In => 0.0254,
            Self::Ft => 0.3048,
        }
    }

    /// As typed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::M => "m",
            Self::Cm => "cm",
            Self::Mm => "mm",
            Self::In => "in",
            Self::Ft => "ft",
        }
    }
}

/// The flags of `ingest`.
#[derive(Clone, Debug)]
pub struct Options {
    /// Store folder.
    pub store: PathBuf,
    /// OBJ files.
    pub models: Vec<PathBuf>,
    /// `--units`.
    pub units: Units,
    /// `--up`: 'y' or 'z'; `None` is auto.
    pub up: Option<char>,
    /// `--sides both`.
    pub both_sides: bool,
    /// `--materials`.
    pub materials: Option<PathBuf>,
    /// `--emit both`.
    pub emit_both: bool,
    /// `--max-cluster-patches`, 1..=256.
    pub max_cluster_patches: u32,
    /// `--snap`, m; `None` is 1e-5 of the bounding diagonal, at most 1 mm.
    pub snap_m: Option<f64>,
    /// `--contact`, m.
    pub contact_m: f64,
    /// `--least-contact`, m.
    pub least_contact_m: f64,
    /// `--memory`.
    pub memory: MemoryBudget,
    /// `--fresh`.
    pub fresh: bool,
    /// `--wait`.
    pub wait: Duration,
}

/// What an ingest would do.
pub struct Plan {
    pub(super) options: Options,
    model_bytes: u64,
}

/// Checks that inputs are there and memory suffices.
pub fn plan(options: &Options) -> Result<Plan> {
    if options.memory.limit_bytes < LEAST_MEMORY {
        return Err(Error::TooLarge {
            message: format!(
                "ingest needs {} MiB, over the limit of {} MiB",
                LEAST_MEMORY >> 20,
                options.memory.limit_bytes >> 20
            ),
            help: format!("give `--memory {}M` or more", LEAST_MEMORY >> 20),
        });
    }
    if options.emit_both && !options.both_sides {
        return Err(Error::Usage {
            message: "`--emit both` and `--sides front` contradict each other: a back that is not there emits nothing"
                .to_owned(),
            help: "leave out one of them".to_owned(),
        });
    }
    let mut model_bytes = 0;
    for path in options.models.iter().chain(&options.materials) {
        let meta = std::fs::metadata(path).map_err(|e| Error::io(path, &e))?;
        if !meta.is_file() {
            return Err(Error::failed(format!("{}: not a file", shown(path)), "name an OBJ file"));
        }
        model_bytes += meta.len();
    }
    Ok(Plan { options: options.clone(), model_bytes })
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        writeln!(f, "ingest {} files, {} MiB", self.options.models.len(), mib(self.model_bytes))?;
        writeln!(f, "memory: at most {} MiB", mib(self.options.memory.limit_bytes))?;
        writeln!(f, "disk: about {} MiB while it works", mib(8 * self.model_bytes))?;
        write!(f, "store: {}", shown(&self.options.store))
    }
}

/// What an ingest would do to the store that is there, if any; refuses what it would refuse.
pub fn foresee(options: &Options) -> Result<&'static str> {
    let before = match Store::open(&options.store, options.wait) {
        Ok(store) if !options.fresh => store.stage(Stage::Ingest)?,
        Ok(_) => return Ok("the store is emptied"),
        Err(Error::NoStore { .. }) => None,
        Err(error) => return Err(error),
    };
    Ok(match before {
        None => "a new store",
        Some(record) if rerun::is_unchanged(&record, options)? => "nothing to do",
        Some(_) => "the model is read again: other materials open a branch, another geometry is refused",
    })
}
