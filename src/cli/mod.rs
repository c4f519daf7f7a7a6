//! The command line: flags, progress drawing, summaries, errors. Calls the stages, and only them.

#[allow(missing_docs, reason = "the doc comments of flags are their help; verbs and values speak for themselves")]
pub mod args;
mod dispatch;
pub mod drawing;
pub mod pages;
mod report;
mod resources;
mod run_options;
pub mod settings;
mod summaries;
pub mod tool;
pub mod values;

use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::FromArgMatches;

use self::args::Cli;
use self::dispatch::{Context, Done};
use self::drawing::Drawing;
use self::resources::Watch;
use crate::base::{Error, Result};

/// Runs the program on the arguments of the process.
#[must_use]
pub fn run() -> ExitCode {
    let line: Vec<OsString> = std::env::args_os().collect();
    let as_json = line.iter().any(|a| a == "--json");
    match work(&line) {
        Ok(()) | Err(Error::ReaderGone) => ExitCode::SUCCESS,
        Err(error) => {
            report::print_error(&error, as_json);
            ExitCode::from(error.exit_code())
        }
    }
}

fn work(line: &[OsString]) -> Result<()> {
    let watch = Watch::start();
    let resolved = match settings::resolve(line) {
        Ok(resolved) => resolved?,
        Err(error) => return help_or_usage(&error, line),
    };
    let cli = match Cli::from_arg_matches(&resolved.matches) {
        Ok(cli) => cli,
        Err(error) => return help_or_usage(&error, line),
    };
    let (as_json, quiet) = (cli.common.json, cli.common.quiet);
    let drawing = Drawing::new(cli.common.progress, quiet, interrupts()?);
    if cli.common.verbose {
        show_settings(&resolved);
    }
    let done = dispatch::run(cli, &Context { progress: &drawing, watch: &watch, resolved: &resolved });
    let warnings = drawing.finish();
    match done? {
        Done::Page(page) => report::print(&page),
        Done::Report(report) => {
            let figures = report.with_children(watch.figures());
            if as_json {
                report::print(&format!("{}\n", report.json(&figures, &warnings)))?;
            } else if !quiet && report.stdout_is_taken {
                eprint_text(&report.text(&figures));
            } else if !quiet {
                report::print(&report.text(&figures))?;
            }
            report.shortfall.map_or(Ok(()), Err)
        }
    }
}

/// Ctrl-C asks to stop; a second one stops at once.
fn interrupts() -> Result<Arc<AtomicBool>> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let flag = Arc::new(AtomicBool::new(false));
    let failed = |e: std::io::Error| Error::failed(format!("signals: {e}"), "try again");
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register_conditional_shutdown(signal, 130, flag.clone()).map_err(failed)?;
        signal_hook::flag::register(signal, flag.clone()).map_err(failed)?;
    }
    Ok(flag)
}

fn show_settings(resolved: &settings::Resolved) {
    let verb = resolved.matches.subcommand_name().unwrap_or_default();
    for s in resolved.settings(verb) {
        eprint_text(&format!("{} = {} ({})\n", s.flag, s.value, s.source));
    }
}

/// To stderr; if that is gone nobody is left to tell.
fn eprint_text(text: &str) {
    let _ = std::io::Write::write_all(&mut std::io::stderr(), text.as_bytes());
}

/// `--help` and `--version` print; anything else that clap refuses is a usage error in our two lines.
fn help_or_usage(error: &clap::Error, line: &[OsString]) -> Result<()> {
    use clap::error::ErrorKind;
    match error.kind() {
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand if line.len() <= 1 => report::print(&pages::help(None)?),
        ErrorKind::DisplayHelp if is_top_level(line) => report::print(&pages::help(None)?),
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            report::print(&format!("{}\n", error.render().to_string().trim_end()))
        }
        _ => {
            let verbs = settings::command();
            let verb =
                line.iter().skip(1).map(|a| a.to_string_lossy()).find(|a| verbs.find_subcommand(a.as_ref()).is_some());
            let help = match verb {
                Some(verb) => format!("see `clerestory help {verb}`"),
                None => "see `clerestory help`".to_owned(),
            };
            Err(tool::usage(error, help))
        }
    }
}

/// Whether help is asked for before any verb.
fn is_top_level(line: &[OsString]) -> bool {
    line.get(1).is_some_and(|a| a == "--help" || a == "-h")
}
