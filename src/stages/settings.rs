//! Settings as a store remembers them, per stage: the values it was run with when none are given.

use std::collections::BTreeMap;

use crate::base::Result;
use crate::store::Store;

/// The stages that remember settings.
pub const STAGES: [&str; 4] = ["ingest", "visibility", "partition", "solve-group"];

/// Everything that a store remembers: (stage, flag) -> value.
pub fn recorded(store: &Store) -> Result<BTreeMap<(String, String), String>> {
    let mut all = BTreeMap::new();
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
pub fn record(store: &Store, stage: &str, settings: &[(String, String)]) -> Result<()> {
    let known: BTreeMap<_, _> = store.settings(stage)?.into_iter().collect();
    let is_known = |(flag, value): &(String, String)| known.get(flag).map_or("", String::as_str) == value;
    if settings.iter().all(is_known) { Ok(()) } else { store.put_settings(stage, settings) }
}
