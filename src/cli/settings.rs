//! Where values come from: flag > environment > `clerestory.toml` > what the store remembers >
//! default.
//!
//! The lower layers become clap's defaults, so that every value is checked and shown in one way.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, Command, CommandFactory};
use serde::Serialize;

use super::args::Cli;
use crate::base::text::{from_stored, shown, stored};
use crate::base::{Error, Result};
use crate::stages::entry::{self, Store};
pub use crate::stages::settings::STAGES;
use crate::stages::settings::recorded;

/// In the current folder.
const FILE: &str = "clerestory.toml";
const ENVIRONMENT: &str = "environment";
/// Where values come from below the command line, each beating those before it.
const LAYERS: [&str; 4] = ["default", "store", FILE, ENVIRONMENT];

/// Flags that a store remembers, by the stage that they shape.
const REMEMBERED: [(&str, &[&str]); 4] = [
    (
        "ingest",
        &["units", "up", "sides", "materials", "emit", "max-cluster-patches", "snap", "contact", "least-contact"],
    ),
    ("visibility", &["method", "missing", "seed"]),
    ("partition", &["method", "groups"]),
    ("solve-group", &["tolerance", "quality", "min-element", "inner", "links", "order", "seed"]),
];

/// Flags that only mean something on the command line.
const COMMAND_LINE_ONLY: [&str; 6] = ["version", "output", "points", "group", "store", "help"];

/// A value that a verb runs with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Setting {
    /// The verb.
    pub verb: String,
    /// Its flag, without dashes.
    pub flag: String,
    /// As typed.
    pub value: String,
    /// Byte for byte, as the store remembers it.
    #[serde(skip)]
    stored: String,
    /// `flag`, `environment`, `clerestory.toml`, `store` or `default`.
    pub source: &'static str,
}

/// What came of all layers.
pub struct Resolved {
    /// As clap parsed it.
    pub matches: ArgMatches,
    /// The store that was asked what it remembers, for a verb that works with it as it is.
    pub store: Cell<Option<Store>>,
    lower: BTreeMap<String, (OsString, &'static str)>,
}

/// Verbs that make a store, or give room back before they open it.
const OPEN_IT_THEMSELVES: [&str; 3] = ["run", "ingest", "gc"];

/// The command.
#[must_use]
pub fn command() -> Command {
    Cli::command()
}

/// The name of a flag that takes a value and may come from elsewhere than the command line.
fn settable(arg: &clap::Arg) -> Option<String> {
    let flag = arg.get_long()?;
    let takes_value = matches!(arg.get_action(), ArgAction::Set | ArgAction::Append);
    (takes_value && !COMMAND_LINE_ONLY.contains(&flag)).then(|| flag.to_owned())
}

/// The flags of a verb that take a value, the common ones included.
#[must_use]
pub fn flags_of(verb: &str) -> Vec<String> {
    let command = command();
    let of = command.find_subcommand(verb).into_iter().flat_map(Command::get_arguments);
    of.chain(command.get_arguments()).filter_map(settable).collect()
}

/// Parses a command line over all layers.
pub fn resolve(line: &[OsString]) -> std::result::Result<Result<Resolved>, clap::Error> {
    let command = command();
    let first = command.clone().try_get_matches_from(line)?;
    let Some((verb, matches)) = first.subcommand() else {
        return Ok(Ok(Resolved { matches: first, store: Cell::default(), lower: BTreeMap::new() }));
    };
    let is_fresh = matches.try_get_one::<bool>("fresh").ok().flatten().copied().unwrap_or(false);
    let wait = matches.get_one::<Duration>("wait").copied().unwrap_or_default();
    // A store that can't be read is the stage's to report.
    let store = store_of(matches).filter(|_| !is_fresh).and_then(|dir| entry::open(&dir, wait).ok());
    let lower = match lower_layers(&command, verb, matches, store.as_ref()) {
        Ok(lower) => lower,
        Err(error) => return Ok(Err(error)),
    };
    let set = |command: Command| {
        command.mut_args(|arg| match settable(&arg).and_then(|flag| lower.get(&flag)) {
            Some((value, _)) => arg.default_value(value.clone()),
            None => arg,
        })
    };
    let matches = set(command).mut_subcommand(verb, set).try_get_matches_from(line)?;
    let store = Cell::new(store.filter(|_| !OPEN_IT_THEMSELVES.contains(&verb)));
    Ok(Ok(Resolved { matches, store, lower }))
}

/// Values of the environment, the file and the store for a verb's flags.
fn lower_layers(
    command: &Command,
    verb: &str,
    matches: &ArgMatches,
    store: Option<&Store>,
) -> Result<BTreeMap<String, (OsString, &'static str)>> {
    let flags = flags_of(verb);
    let mut lower = BTreeMap::new();
    if let Some(store) = store {
        for ((stage, flag), value) in recorded(store).unwrap_or_default() {
            if let Some(flag) = flag_on(verb, &stage, &flag)
                && flags.contains(&flag)
            {
                let value = from_stored(&value).map_or_else(|| value.clone().into(), OsString::from_vec);
                lower.insert(flag, (value, "store"));
            }
        }
    }
    for (flag, value) in file_values(Path::new(FILE), command, verb)? {
        if flags.contains(&flag) {
            lower.insert(flag, (value.into(), FILE));
        }
    }
    for flag in flags {
        let name = format!("CLERESTORY_{}", flag.replace('-', "_").to_uppercase());
        if let Some(value) = std::env::var_os(name) {
            lower.insert(flag, (value, ENVIRONMENT));
        }
    }
    forget_overruled_tolerance(matches, &mut lower);
    Ok(lower)
}

/// Tolerance and quality are one setting: a tolerance gives way to a quality from a higher layer.
fn forget_overruled_tolerance(matches: &ArgMatches, lower: &mut BTreeMap<String, (OsString, &'static str)>) {
    if matches.try_contains_id("quality").is_err() {
        return;
    }
    let rank = |flag: &str| match matches.value_source(flag) {
        Some(ValueSource::CommandLine) => LAYERS.len(),
        _ => lower.get(flag).map_or(0, |(_, layer)| LAYERS.iter().position(|l| l == layer).unwrap_or(0)),
    };
    if rank("quality") > rank("tolerance") {
        lower.remove("tolerance");
    }
}

/// The store that a command line names.
#[must_use]
pub fn store_of(matches: &ArgMatches) -> Option<PathBuf> {
    if let Ok(Some(store)) = matches.try_get_one::<PathBuf>("store") {
        return Some(store.clone());
    }
    matches.try_get_many::<PathBuf>("models").ok()??.next().map(|model| default_store(model))
}

/// In the current folder, after the model: `office.obj` -> `office.clr`.
#[must_use]
pub fn default_store(model: &Path) -> PathBuf {
    let mut name = model.file_stem().unwrap_or_default().to_os_string();
    name.push(".clr");
    PathBuf::from(name)
}

/// What a verb calls a stage's flag, if it has it.
fn flag_on(verb: &str, stage: &str, flag: &str) -> Option<String> {
    match (verb, stage, flag) {
        ("run", "partition", "method") => Some("partition".to_owned()),
        ("sample", "ingest", "snap") => None,
        ("run", ..) => Some(flag.to_owned()),
        _ => (verb == stage).then(|| flag.to_owned()),
    }
}

/// Values of `clerestory.toml`: flags at the top, or in a table named after the verb.
fn file_values(path: &Path, command: &Command, verb: &str) -> Result<BTreeMap<String, String>> {
    let wrong = |what: String| Error::Usage {
        message: format!("{}: {what}", shown(path)),
        help: "write flags without dashes, like `link-cache = \"32M\"`".to_owned(),
    };
    match std::fs::metadata(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(BTreeMap::new()),
        Ok(meta) if !meta.is_file() => return Err(wrong("not a file".to_owned())),
        _ => {}
    }
    let text = std::fs::read_to_string(path).map_err(|e| wrong(e.to_string()))?;
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| wrong(e.message().to_owned()))?;
    let known = |flag: &str| {
        let all = command.get_subcommands().flat_map(Command::get_arguments).chain(command.get_arguments());
        all.filter_map(settable).any(|f| f == flag)
    };
    let mut values = BTreeMap::new();
    let mut own = BTreeMap::new();
    for (key, value) in &table {
        match value {
            toml::Value::Table(table) if command.find_subcommand(key).is_some() => {
                for (key, value) in table {
                    let flag = key.replace('_', "-");
                    if !known(&flag) {
                        return Err(wrong(format!("there is no flag `{key}`")));
                    }
                    own.insert(flag, (key.clone(), value));
                }
                if key != verb {
                    own.clear();
                }
                values.extend(std::mem::take(&mut own));
            }
            _ if known(&key.replace('_', "-")) => {
                values.entry(key.replace('_', "-")).or_insert((key.clone(), value));
            }
            _ => return Err(wrong(format!("there is no flag `{key}`"))),
        }
    }
    values
        .into_iter()
        .map(|(flag, (key, value))| match value {
            toml::Value::String(s) => Ok((flag, s.clone())),
            toml::Value::Integer(_) | toml::Value::Float(_) => Ok((flag, value.to_string())),
            _ => Err(wrong(format!("`{key}` is neither text nor a number"))),
        })
        .collect()
}

/// What each stage would run with on a store if nothing were given on the command line.
pub fn of_stages(store: &Path) -> Result<Vec<Setting>> {
    let mut out = Vec::new();
    for (verb, rest) in
        [("ingest", &["model.obj"][..]), ("visibility", &[]), ("partition", &[]), ("solve-group", &["--next"])]
    {
        let mut line: Vec<OsString> = vec!["clerestory".into(), verb.into(), store.into()];
        line.extend(rest.iter().map(OsString::from));
        let resolved = resolve(&line).map_err(|e| Error::Usage {
            message: e.to_string().lines().next().unwrap_or_default().to_owned(),
            help: "correct the environment or clerestory.toml".to_owned(),
        })??;
        out.extend(resolved.settings(verb));
    }
    Ok(out)
}

impl Resolved {
    /// Every value of a verb's flags and where it came from.
    #[must_use]
    pub fn settings(&self, verb: &str) -> Vec<Setting> {
        let Some(matches) = self.matches.subcommand_matches(verb) else { return Vec::new() };
        let command = command();
        let Some(of) = command.find_subcommand(verb) else { return Vec::new() };
        let mut out = Vec::new();
        for arg in of.get_arguments().chain(command.get_arguments()) {
            let Some(flag) = settable(arg) else { continue };
            let id = arg.get_id().as_str();
            let Ok(Some(raw)) = matches.try_get_raw(id) else { continue };
            let raw = raw.collect::<Vec<_>>().join(OsStr::new(" "));
            let value = raw.to_str().map_or_else(|| shown(&raw), str::to_owned);
            let stored = match flag.as_str() {
                // Another command may be typed in another folder.
                "materials" => {
                    stored(std::path::absolute(&raw).unwrap_or_else(|_| raw.clone().into()).as_os_str().as_bytes())
                }
                _ => stored(raw.as_bytes()),
            };
            let source = match matches.value_source(id) {
                Some(ValueSource::CommandLine) => "flag",
                _ => self.lower.get(&flag).map_or("default", |l| l.1),
            };
            out.push(Setting { verb: verb.to_owned(), flag, value, stored, source });
        }
        out
    }

    /// What the store is to remember for a stage after this verb: everything but defaults.
    #[must_use]
    pub fn to_remember(&self, verb: &str) -> Vec<(String, String)> {
        let Some((_, flags)) = REMEMBERED.iter().find(|r| r.0 == verb) else { return Vec::new() };
        let mut out: Vec<(String, String)> = self
            .settings(verb)
            .into_iter()
            .filter(|s| s.source != "default" && flags.contains(&s.flag.as_str()))
            .map(|s| (s.flag, s.stored))
            .collect();
        // A tolerance remembered from before must not beat the quality chosen now.
        let has = |flag: &str| out.iter().any(|s| s.0 == flag);
        if has("quality") && !has("tolerance") {
            out.push(("tolerance".to_owned(), String::new()));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_gives_flags_by_name_and_by_verb_and_refuses_unknown_ones() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(FILE);
        let values = |text: &str, verb: &str| {
            std::fs::write(&path, text).unwrap();
            file_values(&path, &command(), verb)
        };
        let text = "link_cache = \"64M\"\nmissing = 0.01\n[solve-group]\nlink-cache = \"8M\"\n";
        assert_eq!(values(text, "solve-group").unwrap()["link-cache"], "8M");
        assert_eq!(values(text, "run").unwrap()["link-cache"], "64M");
        assert_eq!(values(text, "visibility").unwrap()["missing"], "0.01");
        let error = values("linkcache = 1", "run").unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("`linkcache`"), "{error}");
        assert_eq!(values("version = 3", "run").unwrap_err().exit_code(), 2);
    }

    #[test]
    fn the_default_store_lies_in_the_current_folder_after_the_model() {
        assert_eq!(default_store(Path::new("../models/office.v2.obj")), Path::new("office.v2.clr"));
    }

    #[test]
    fn the_command_line_is_consistent() {
        command().debug_assert();
    }
}
