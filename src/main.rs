//! The `clerestory` program: parses, calls [`clerestory::cli`], exits.

use std::process::ExitCode;

fn main() -> ExitCode {
    clerestory::cli::run()
}
