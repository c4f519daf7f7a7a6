//! Sensor points in: CSV with a header, or Radiance `.pts` (six columns, no header).

use std::io::BufRead;
use std::path::{Path, PathBuf};

use crate::base::{Error, Result};

/// A sensor: where it lies and which way it looks, in the model's own coordinates and units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorPoint {
    /// Position.
    pub position: [f64; 3],
    /// Normal, any length but 0.
    pub normal: [f64; 3],
}

/// Columns of a CSV, in the order of [`SensorPoint`]'s fields.
const COLUMNS: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

/// Reads points line by line.
pub struct PointReader<R> {
    lines: std::io::Lines<R>,
    path: PathBuf,
    line: u64,
    columns: Option<[usize; 6]>,
}

impl<R: BufRead> PointReader<R> {
    /// Over a reader; `path` is for messages.
    pub fn new(reader: R, path: &Path) -> Self {
        Self { lines: reader.lines(), path: path.to_path_buf(), line: 0, columns: None }
    }

    fn fault(&self, what: &str) -> Error {
        Error::failed(
            format!("{}:{}: {what}", self.path.display(), self.line),
            "write a CSV with the header `x,y,z,nx,ny,nz`, or six numbers a line as in a Radiance .pts file",
        )
    }

    fn point(&mut self, text: &str) -> Result<Option<SensorPoint>> {
        let comma = text.contains(',');
        let cells: Vec<&str> =
            if comma { text.split(',').map(str::trim).collect() } else { text.split_whitespace().collect() };
        if self.columns.is_none() {
            let is_header = cells.contains(&"x");
            let mut columns = [0, 1, 2, 3, 4, 5];
            if is_header {
                for (column, name) in columns.iter_mut().zip(COLUMNS) {
                    *column = cells
                        .iter()
                        .position(|c| *c == name)
                        .ok_or_else(|| self.fault(&format!("the header has no column `{name}`")))?;
                }
            }
            self.columns = Some(columns);
            if is_header {
                return Ok(None);
            }
        }
        let columns = self.columns.expect("set above");
        let mut numbers = [0.0f64; 6];
        for ((number, column), name) in numbers.iter_mut().zip(columns).zip(COLUMNS) {
            let cell = cells.get(column).ok_or_else(|| self.fault(&format!("no value for `{name}`")))?;
            *number = cell.parse().map_err(|_| self.fault(&format!("`{cell}` is no number for `{name}`")))?;
            if !number.is_finite() {
                return Err(self.fault(&format!("`{cell}` is not finite")));
            }
        }
        let [x, y, z, nx, ny, nz] = numbers;
        if [nx, ny, nz] == [0.0; 3] {
            return Err(self.fault("the normal is 0"));
        }
        Ok(Some(SensorPoint { position: [x, y, z], normal: [nx, ny, nz] }))
    }
}

impl<R: BufRead> Iterator for PointReader<R> {
    type Item = Result<SensorPoint>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let text = self.lines.next()?;
            self.line += 1;
            let text = match text {
                Ok(text) => text,
                Err(e) => return Some(Err(self.fault(&e.to_string()))),
            };
            let text = text.trim().trim_start_matches('\u{feff}');
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            if let Some(point) = self.point(text).transpose() {
                return Some(point);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<SensorPoint>> {
        PointReader::new(text.as_bytes(), Path::new("p.csv")).collect()
    }

    #[test]
    fn both_forms_read_alike_and_other_columns_do_not_matter() {
        let csv = read("face,x,y,z,nx,ny,nz\n7,1,2,3,0,0,1\n").unwrap();
        let pts = read("1 2 3\t0 0 1\n").unwrap();
        assert_eq!(csv, pts);
        assert_eq!(csv, vec![SensorPoint { position: [1., 2., 3.], normal: [0., 0., 1.] }]);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let message = |text: &str| read(text).unwrap_err().to_string();
        assert!(message("x,y,z,nx,ny\n").contains("p.csv:1: the header has no column `nz`"));
        assert!(message("x,y,z,nx,ny,nz\n1,2,a,0,0,1\n").contains("p.csv:2: `a` is no number for `z`"));
        assert!(message("1 2 3 0 0 0").contains("the normal is 0"));
    }
}
