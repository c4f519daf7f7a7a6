//! What a verb ends with: a few lines for people, one JSON document for programs, or an error.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::drawing::{bytes, span};
use crate::base::Error;
use crate::base::text::{harmless, shown};
use crate::model::figures::ProcessFigures;
use crate::stages::summary::Summary;

/// A verb's result, whatever the verb.
pub struct Report {
    /// As typed.
    pub verb: &'static str,
    /// The store it worked on.
    pub store: Option<PathBuf>,
    /// Its own JSON keys.
    pub keys: Map<String, Value>,
    /// For people.
    pub lines: Vec<String>,
    /// The command to type next.
    pub next: Option<String>,
    /// Why the exit code is not 0.
    pub shortfall: Option<Error>,
    /// Whether stdout carries data, so that the lines go to stderr.
    pub stdout_is_taken: bool,
}

impl Report {
    /// Of a stage's summary.
    #[must_use]
    pub fn of(verb: &'static str, store: PathBuf, summary: &impl Summary) -> Self {
        Self { shortfall: summary.shortfall(), ..Self::new(verb, store, summary, summary.lines()) }
    }

    /// Of keys of the JSON document, and lines for people.
    #[must_use]
    pub fn new(verb: &'static str, store: PathBuf, keys: &impl Serialize, lines: Vec<String>) -> Self {
        let keys = match serde_json::to_value(keys) {
            Ok(Value::Object(keys)) => keys,
            _ => Map::new(),
        };
        let next = keys.get("next").and_then(Value::as_str).map(str::to_owned);
        Self { verb, store: Some(store), keys, lines, next, shortfall: None, stdout_is_taken: false }
    }

    /// Of a dry run: the plan's text.
    #[must_use]
    pub fn plan(verb: &'static str, store: PathBuf, plan: &str) -> Self {
        let lines: Vec<String> = plan.lines().map(str::to_owned).collect();
        Self::new(verb, store, &json!({"plan": lines}), lines)
    }

    /// Beside what the verb wrote to `output`.
    #[must_use]
    pub fn beside(mut self, output: &Path) -> Self {
        self.stdout_is_taken = output.as_os_str() == "-";
        self
    }

    /// The figures with the peaks of the processes that the verb started: the larger counts.
    #[must_use]
    pub fn with_children(&self, mut own: ProcessFigures) -> ProcessFigures {
        let of = |key: &str| self.keys.get(key).and_then(Value::as_u64).unwrap_or(0);
        own.peak_rss_bytes = own.peak_rss_bytes.max(of("peak_rss_bytes"));
        own.used.peak_anon_bytes = own.used.peak_anon_bytes.max(of("peak_anon_bytes"));
        own
    }

    /// The JSON document.
    #[must_use]
    pub fn json(&self, figures: &ProcessFigures, warnings: &[String]) -> Value {
        let mut document = Map::new();
        let mut put = |key: &str, value: Value| document.insert(key.to_owned(), value);
        put("command", json!(self.verb));
        put("store", json!(self.store.as_ref().map(shown)));
        put("version_of_program", json!(env!("CARGO_PKG_VERSION")));
        put("warnings", json!(warnings));
        put("next", json!(self.next));
        for (key, value) in json!(figures).as_object().into_iter().flatten().chain(&self.keys) {
            if !document.contains_key(key) {
                document.insert(key.clone(), value.clone());
            }
        }
        Value::Object(document)
    }

    /// The lines for people, figures and next command included.
    #[must_use]
    pub fn text(&self, figures: &ProcessFigures) -> String {
        let mut out: String = self.lines.iter().map(|line| format!("{}\n", harmless(line))).collect();
        out += &format!(
            "Done in {} (CPU {}, peak {} anonymous, {} resident; {} read, {} written).\n",
            span(figures.wall_s),
            span(figures.used.cpu_s),
            bytes(figures.used.peak_anon_bytes),
            bytes(figures.peak_rss_bytes),
            bytes(figures.used.bytes_read),
            bytes(figures.used.bytes_written)
        );
        if let Some(next) = &self.next {
            out += &format!("Next: {next}\n");
        }
        out
    }
}

/// Prints an error as two lines on stderr, with `--json` also as a document.
pub fn print_error(error: &Error, as_json: bool) {
    let mut stderr = std::io::stderr().lock();
    let (message, help) = (error.to_string(), error.remedy());
    // Nobody is left to tell if stderr is gone.
    let _ = writeln!(stderr, "error: {}\nhelp: {}", harmless(&message), harmless(&help));
    if as_json {
        let document =
            json!({"message_type": "exit_error", "code": error.exit_code(), "message": message, "help": help});
        let _ = writeln!(stderr, "{document}");
    }
}

/// Writes to stdout; a reader who has gone away is no error.
pub fn print(text: &str) -> Result<(), Error> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::failed(format!("stdout: {e}"), "check where the output goes"))
        }
        _ => Ok(()),
    }
}
