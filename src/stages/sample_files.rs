//! `sample` from a file of points to a file of answers.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use super::output::Output;
use super::sample::{Options, Summary, execute};
use crate::base::{Error, Progress, Result};
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
    let input: Box<dyn BufRead> = if points.as_os_str() == "-" {
        Box::new(BufReader::new(std::io::stdin()))
    } else {
        Box::new(BufReader::new(File::open(points).map_err(|e| Error::io(points, &e))?))
    };
    let summary = execute(store, options, &mut PointReader::new(input, points), &mut output, progress)?;
    output.finish()?;
    Ok(summary)
}
