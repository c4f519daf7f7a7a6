//! What the other programs of the package do as `clerestory` does: parse, print, and end with two lines and a code.

use std::process::ExitCode;

use clap::Parser;
use clap::error::ErrorKind;

pub use super::report::print;
use super::report::print_error;
use crate::base::{Error, Result};

/// Runs a program of that name on the arguments of the process.
#[must_use]
pub fn run<A: Parser>(name: &str, work: impl FnOnce(&A) -> Result<()>) -> ExitCode {
    let done = match A::try_parse() {
        Ok(args) => work(&args),
        Err(error) => match error.kind() {
            ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => print(&error.render().to_string()),
            _ => Err(usage(&error, format!("see `{name} --help`"))),
        },
    };
    match done {
        Ok(()) | Err(Error::ReaderGone) => ExitCode::SUCCESS,
        Err(error) => {
            print_error(&error, false);
            ExitCode::from(error.exit_code())
        }
    }
}

/// What clap refuses, as a usage error in our two lines.
pub(super) fn usage(error: &clap::Error, help: String) -> Error {
    let text = error.render().to_string();
    let first: Vec<&str> = text.lines().take_while(|line| !line.is_empty()).map(str::trim).collect();
    Error::Usage { message: first.join(" ").trim_start_matches("error: ").to_owned(), help }
}
