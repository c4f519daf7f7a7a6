//! Settings as a store remembers them, per stage: the values it was run with when none are given.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use crate::base::Result;
use crate::store::Store;

/// The stages that remember settings.
pub const STAGES: [&str; 4] = ["ingest", "visibility", "partition", "solve-group"];

/// Everything that the store in `dir` remembers: (stage, flag) -> value. Empty without a store.
pub fn recorded(dir: &Path, wait: Duration) -> Result<BTreeMap<(String, String), String>> {
    let mut all = BTreeMap::new();
    if !dir.join("scene.sqlite").is_file() {
        return Ok(all);
    }
    let store = Store::open(dir, wait)?;
    for stage in STAGES {
        for (flag, value) in store.settings(stage)? {
            if !value.is_empty() {
                all.insert((stage.to_owned(), flag), value);
            }
        }
    }
    Ok(all)
}

/// Remembers what a stage was run with, as (flag, value); an empty value forgets the flag.
pub fn record(dir: &Path, wait: Duration, stage: &str, settings: &[(String, String)]) -> Result<()> {
    if settings.is_empty() {
        return Ok(());
    }
    Store::open(dir, wait)?.put_settings(stage, settings)
}
