//! Pages made from the flags: help, manual, completions; and the table of exit codes.

use std::fmt::Write as _;

use clap::Command;

use super::settings;
use crate::base::{Error, Result};

/// What each exit status means.
pub const EXIT_CODES: &str = "\
Exit codes:
  0    done (a broken pipe too)
  1    failed: input or machine; the message names file and line where there is one
  2    usage: the command line asks for something that cannot be
  3    finished, but not converged (an audit or the energy balance may say so) or some groups failed;
       the JSON document is still printed
  10   no store there
  11   store busy; the message names who holds it
  12   store damaged, or of another version
  13   an earlier stage is missing or out of date
  14   would not fit in memory or on disk
  130  interrupted; the same command resumes
";

/// Verbs by what they are for, as help shows them.
pub const GROUPS: [(&str, &[&str]); 4] = [
    ("Solve", &["run", "ingest", "visibility", "partition", "solve-group", "merge"]),
    ("Look after the store", &["status", "check", "gc"]),
    ("Use the solution", &["sample", "audit", "render", "export"]),
    ("This program", &["completions", "man", "help"]),
];

/// The command with its verbs in groups.
#[must_use]
pub fn grouped(command: Command) -> Command {
    let mut verbs = String::new();
    for (title, names) in GROUPS {
        let _ = writeln!(verbs, "{title}:");
        for name in names {
            let about = command.find_subcommand(name).and_then(Command::get_about).map(ToString::to_string);
            let _ = writeln!(verbs, "  {name:<13} {}", about.unwrap_or_default());
        }
        verbs.push('\n');
    }
    let template = format!("{{about}}\n\n{{usage-heading}} {{usage}}\n\n{verbs}{{options}}\n\n{{after-help}}");
    command.help_template(template).after_help(
        "Values come from: flag > environment (CLERESTORY_LINK_CACHE=32M) > clerestory.toml in the current\n\
         folder > what the store remembers > default. `clerestory help exit-codes` lists the exit codes.",
    )
}

/// The completions of a shell.
#[must_use]
pub fn completions(shell: clap_complete::Shell) -> String {
    let mut out = Vec::new();
    clap_complete::generate(shell, &mut settings::command(), "clerestory", &mut out);
    String::from_utf8_lossy(&out).into_owned()
}

/// The manual page, in roff.
pub fn manual() -> Result<String> {
    let mut out = Vec::new();
    let io = |e: std::io::Error| Error::failed(format!("the manual could not be made: {e}"), "try again");
    let command = settings::command();
    clap_mangen::Man::new(command.clone()).render(&mut out).map_err(io)?;
    for verb in command.get_subcommands() {
        clap_mangen::Man::new(verb.clone()).render_options_section(&mut out).map_err(io)?;
    }
    Ok(String::from_utf8_lossy(&out).into_owned())
}

/// Help on a verb, on the exit codes, or on everything.
pub fn help(topic: Option<&str>) -> Result<String> {
    let mut command = grouped(settings::command());
    command.build();
    match topic {
        None => Ok(command.render_help().to_string()),
        Some("exit-codes") => Ok(EXIT_CODES.to_owned()),
        Some(verb) => match command.find_subcommand_mut(verb) {
            Some(verb) => Ok(verb.render_long_help().to_string()),
            None => Err(Error::Usage {
                message: format!("there is no verb `{verb}`"),
                help: "see `clerestory help` for all of them".to_owned(),
            }),
        },
    }
}
