//! What an ingest into a store that has a model already may do: nothing, new materials, or refuse.

use std::ffi::OsString;
use std::io::Read;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use super::Options;
use crate::base::text::{from_stored, shown, stored};
use crate::base::{Error, Result};
use crate::formats::lines;
use crate::store::StageRecord;
use crate::store::stage_rows::hash;

/// What shaped the model in a store; kept as the stage's options, as JSON.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Recipe {
    /// Options that shape geometry.
    pub geometry: GeometryOptions,
    /// Options that shape materials.
    pub emit: String,
    /// Model files as given, MTL files as found, the file of `--materials`: path as [`stored`] and hash
    /// of bytes.
    pub inputs: Vec<(String, String)>,
    /// How many of them are models.
    pub models: usize,
    /// Whether the last is that of `--materials`.
    pub has_given_materials: bool,
    /// Whether what tells the vertical is clear.
    #[serde(default)]
    pub up_is_sure: bool,
    /// Whether a material file was missing: it may be there the next time.
    pub incomplete: bool,
}

/// Options that shape geometry.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct GeometryOptions {
    /// `--units`.
    pub units: String,
    /// `--up`.
    pub up: String,
    /// `--sides`.
    pub sides: String,
    /// `--snap`, m.
    pub snap_m: Option<f64>,
    /// `--contact`, m.
    pub contact_m: f64,
    /// `--least-contact`, m.
    pub least_contact_m: f64,
    /// `--max-cluster-patches`.
    pub max_cluster_patches: u32,
}

impl GeometryOptions {
    /// Of an ingest.
    #[must_use]
    pub fn of(options: &Options) -> Self {
        Self {
            units: options.units.name().to_owned(),
            up: options.up.map_or("auto".to_owned(), String::from),
            sides: if options.both_sides { "both" } else { "front" }.to_owned(),
            snap_m: options.snap_m,
            contact_m: options.contact_m,
            least_contact_m: options.least_contact_m,
            max_cluster_patches: options.max_cluster_patches,
        }
    }

    /// Their hash.
    #[must_use]
    pub fn hash(&self) -> String {
        let text = serde_json::to_string(self).expect("plain data");
        hash([text.as_bytes()])
    }

    /// The flags in which two differ.
    fn differences(&self, other: &Self) -> Vec<String> {
        let mut out = Vec::new();
        let mut compare = |flag: &str, a: String, b: String| {
            if a != b {
                out.push(format!("{flag} was {a}, now {b}"));
            }
        };
        let snap = |s: Option<f64>| s.map_or("automatic".to_owned(), |s| format!("{s} m"));
        compare("--units", self.units.clone(), other.units.clone());
        compare("--up", self.up.clone(), other.up.clone());
        compare("--sides", self.sides.clone(), other.sides.clone());
        compare("--snap", snap(self.snap_m), snap(other.snap_m));
        let metres = |m: f64| format!("{m} m");
        compare("--contact", metres(self.contact_m), metres(other.contact_m));
        compare("--least-contact", metres(self.least_contact_m), metres(other.least_contact_m));
        compare("--max-cluster-patches", self.max_cluster_patches.to_string(), other.max_cluster_patches.to_string());
        out
    }
}

/// The emitting sides as recorded.
#[must_use]
pub fn emit_name(options: &Options) -> &'static str {
    if options.emit_both { "both" } else { "front" }
}

/// Whether the store holds just what this ingest would make, by options and bytes of all inputs.
/// Fails if options differ that the store's geometry was made with.
pub fn is_unchanged(record: &StageRecord, options: &Options) -> Result<bool> {
    let Ok(recipe) = serde_json::from_str::<Recipe>(&record.options) else { return Ok(false) };
    let geometry = GeometryOptions::of(options);
    if geometry != recipe.geometry {
        return Err(refused(options, &recipe.geometry.differences(&geometry).join(", ")));
    }
    if recipe.incomplete || recipe.emit != emit_name(options) {
        return Ok(false);
    }
    let same = |given: &Path, recorded: &str| {
        std::fs::canonicalize(given).is_ok_and(|g| recorded == stored(g.as_os_str().as_bytes()))
    };
    let given: Vec<&PathBuf> = options.models.iter().collect();
    let recorded: Vec<&String> = recipe.inputs[..recipe.models].iter().map(|i| &i.0).collect();
    if given.len() != recorded.len() || !given.iter().zip(&recorded).all(|(g, r)| same(g, r)) {
        return Ok(false);
    }
    let given = recipe.inputs.last().filter(|_| recipe.has_given_materials);
    let same_materials = match (&options.materials, given) {
        (Some(now), Some((before, _))) => same(now, before),
        (now, before) => now.is_none() && before.is_none(),
    };
    if !same_materials {
        return Ok(false);
    }
    for (path, recorded) in &recipe.inputs {
        let Some(path) = input_path(path).filter(|p| p.is_file()) else { return Ok(false) };
        if hash_file(&path)? != *recorded {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Path of an input as recorded, if it is one that this program records.
fn input_path(recorded: &str) -> Option<PathBuf> {
    from_stored(recorded).map(|bytes| PathBuf::from(OsString::from_vec(bytes)))
}

/// Bytes of an input that has been recorded.
pub fn input_bytes(recorded: &str) -> Result<u64> {
    let path = input_path(recorded).unwrap_or_default();
    Ok(std::fs::metadata(&path).map_err(|e| Error::io(&path, &e))?.len())
}

/// The error for a store that was made from other geometry.
#[must_use]
pub fn refused(options: &Options, what: &str) -> Error {
    Error::StageMissing {
        message: format!("{}: the store was made from another model: {what}", shown(&options.store)),
        help: "give `--fresh` to empty the store, or name another one".to_owned(),
    }
}

/// Hash of a file's bytes.
pub fn hash_file(path: &Path) -> Result<String> {
    let mut file = lines::open(path)?;
    let mut hasher = Xxh3::new();
    let mut buffer = vec![0; 256 << 10];
    loop {
        let read = file.read(&mut buffer).map_err(|e| Error::io(path, &e))?;
        if read == 0 {
            return Ok(format!("{:032x}", hasher.digest128()));
        }
        hasher.update(&buffer[..read]);
    }
}
