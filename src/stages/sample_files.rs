//! `sample` from a file of points to a file of answers.

use std::io::Read;
use std::path::Path;

use super::output::Output;
use super::sample::{Options, Summary, execute};
use crate::base::{Progress, Result};
use crate::formats::lines;
use crate::formats::points::PointReader;
use crate::store::Store;

/// Reads `points` (`-` is stdin) and writes `output`.
pub fn sample(
    store: &Store,
    options: &Options,
    points: &Path,
    mut output: Output,
    progress: &dyn Progress,
) -> Result<Summary> {
    let input: Box<dyn Read> =
        if points.as_os_str() == "-" { Box::new(std::io::stdin()) } else { Box::new(lines::open(points)?) };
    let summary = execute(store, options, &mut PointReader::new(input, points)?, &mut output, progress)?;
    output.finish()?;
    Ok(summary)
}
