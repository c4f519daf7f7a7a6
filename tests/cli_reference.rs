//! `docs/cli.md` is what the flags say. Renew it with `RENEW=1 cargo test --test cli_reference`.

use std::fmt::Write as _;
use std::path::Path;

use clerestory::cli::pages::{EXIT_CODES, GROUPS, grouped};
use clerestory::cli::settings;

#[test]
fn the_reference_is_what_the_flags_say() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/cli.md");
    let now = reference();
    if std::env::var_os("RENEW").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, &now).unwrap();
    }
    let written = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(written == now, "docs/cli.md differs from the flags: renew it as the top of this test says");
}

/// The reference, as Markdown: every verb's help.
fn reference() -> String {
    let mut out = String::from(
        "# Command line reference\n\nMade from the flags; `tests/cli_reference.rs` compares it and tells how to renew it.\n",
    );
    let mut whole = grouped(settings::command()).term_width(100);
    whole.build();
    writeln!(out, "\n```text\n{}\n```", whole.render_help().to_string().trim_end()).unwrap();
    for name in GROUPS.iter().flat_map(|g| g.1) {
        if let Some(verb) = whole.find_subcommand_mut(name) {
            writeln!(out, "\n## {name}\n\n```text\n{}\n```", verb.render_help().to_string().trim_end()).unwrap();
        }
    }
    writeln!(out, "\n## Exit codes\n\n```text\n{EXIT_CODES}```").unwrap();
    let lines: String = out.lines().map(|l| format!("{}\n", l.trim_end())).collect();
    format!("{}\n", lines.trim_end_matches('\n'))
}
