//! Sensor points in: CSV with a header (RFC 4180), or six numbers a line, separated by commas or, as in
//! Radiance `.pts` files, by blanks.
//!
//! What would have to be guessed is refused: surplus cells, decimal commas, columns that are there twice.

use std::io::{BufReader, Chain, Cursor, Read};
use std::path::{Path, PathBuf};

use super::lines::{LineReader, PlainText};
use crate::base::text::{shown, shown_name};
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

/// Put behind a file: a row by itself, unless a quote is still open.
const END: &[u8] = b"\n\0end of the points\0\n";

const HELP: &str = "write a CSV with the header `x,y,z,nx,ny,nz`, or six numbers a line as in a Radiance .pts file";
const COMMAS: &str = "separate cells by commas, and write decimal points instead of decimal commas";

type Rest<R> = Chain<Chain<Cursor<Vec<u8>>, BufReader<PlainText<R>>>, &'static [u8]>;

/// Where rows come from.
enum Rows<R> {
    /// Nothing has been read.
    New(LineReader<R>),
    /// Cells between blanks.
    Blanks(LineReader<R>),
    /// Comma- or tab-separated; lines before the reader's first.
    Csv(Box<csv::Reader<Rest<R>>>, u64),
    /// Nothing is left.
    Ended,
}

/// Which cells matter, once the first row has told.
struct Layout {
    columns: [usize; 6],
    /// Cells of a row, those behind the last column of interest included.
    cells: usize,
    has_header: bool,
}

/// Reads points row by row.
pub struct PointReader<R> {
    rows: Rows<R>,
    path: PathBuf,
    line: u64,
    layout: Option<Layout>,
}

impl<R: Read> PointReader<R> {
    /// Over a reader; `path` is for messages.
    pub fn new(reader: R, path: &Path) -> Result<Self> {
        let rows = Rows::New(LineReader::new(reader, path)?);
        Ok(Self { rows, path: path.to_path_buf(), line: 0, layout: None })
    }

    fn fault(&self, what: &str, help: &str) -> Error {
        Error::failed(format!("{}:{}: {what}", shown(&self.path), self.line), help)
    }

    /// Cells of the next row that holds any, trimmed; `None` at the end.
    fn row(&mut self) -> Result<Option<Vec<Vec<u8>>>> {
        loop {
            let cells = match &mut self.rows {
                Rows::Ended => return Ok(None),
                Rows::New(_) => match self.first_row()? {
                    Some(cells) => cells,
                    None => continue,
                },
                Rows::Blanks(lines) => {
                    if !lines.read_line(|_| false)? {
                        return Ok(None);
                    }
                    self.line = lines.line;
                    between_blanks(&lines.text)
                }
                Rows::Csv(..) => match self.csv_row()? {
                    Some(cells) => cells,
                    None => return Ok(None),
                },
            };
            if !self.is_comment(&cells) && cells.iter().any(|c| !c.is_empty()) {
                return Ok(Some(cells));
            }
        }
    }

    /// Whether a row begins with `#`, and not because its first column holds names like `#1`.
    fn is_comment(&self, cells: &[Vec<u8>]) -> bool {
        let is_row = |l: &Layout| l.has_header && !l.columns.contains(&0) && cells.len() == l.cells;
        cells.first().is_some_and(|c| c.starts_with(b"#")) && !self.layout.as_ref().is_some_and(is_row)
    }

    /// Tells from the first line that holds anything how the file is written. `None`: ask again.
    fn first_row(&mut self) -> Result<Option<Vec<Vec<u8>>>> {
        let Rows::New(mut lines) = std::mem::replace(&mut self.rows, Rows::Ended) else { return Ok(None) };
        loop {
            if !lines.read_line(|_| false)? {
                return Ok(None);
            }
            let text = lines.text.trim_ascii();
            if !text.is_empty() && !text.starts_with(b"#") {
                break;
            }
        }
        self.line = lines.line;
        let text = std::mem::take(&mut lines.text);
        let has = |byte: u8| text.contains(&byte);
        if has(b';') && !has(b',') {
            return Err(self.fault("cells are separated by semicolons", COMMAS));
        }
        let cells = between_blanks(&text);
        let is_table = has(b'\t') && is_header(&cells);
        if !has(b',') && !has(b'"') && !is_table {
            self.rows = Rows::Blanks(lines);
            return Ok(Some(cells));
        }
        let before = lines.line - 1;
        let rest = Cursor::new([&text[..], b"\n"].concat()).chain(lines.into_rest()).chain(END);
        let delimiter = if has(b',') || !is_table { b',' } else { b'\t' };
        let reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .delimiter(delimiter)
            .terminator(csv::Terminator::Any(b'\n'))
            .from_reader(rest);
        self.rows = Rows::Csv(Box::new(reader), before);
        Ok(None)
    }

    fn csv_row(&mut self) -> Result<Option<Vec<Vec<u8>>>> {
        let Rows::Csv(reader, before) = &mut self.rows else { return Ok(None) };
        let mut record = csv::ByteRecord::new();
        let more = reader.read_byte_record(&mut record);
        // The reader stands behind the row; its own line of the row counts empty lines before it.
        let inside = record.as_slice().iter().filter(|b| **b == b'\n').count() as u64;
        self.line = *before + reader.position().line().saturating_sub(1 + inside).max(1);
        if !more.map_err(|e| self.fault(&e.to_string(), HELP))? || record.as_slice() == END.trim_ascii() {
            self.rows = Rows::Ended;
            return Ok(None);
        }
        if record.as_slice().ends_with(END) {
            self.line += 1; // no end of its own
            return Err(self.fault("a quote begins here and does not end", HELP));
        }
        Ok(Some(record.iter().map(|cell| cell.trim_ascii().to_vec()).collect()))
    }

    /// Learns the columns from the first row.
    fn learn(&self, cells: &[Vec<u8>]) -> Result<Layout> {
        if !is_header(cells) {
            return Ok(Layout { columns: [0, 1, 2, 3, 4, 5], cells: 6, has_header: false });
        }
        let mut columns = [0; 6];
        for (column, name) in columns.iter_mut().zip(COLUMNS) {
            let mut found = (0..cells.len()).filter(|i| cells[*i].eq_ignore_ascii_case(name.as_bytes()));
            *column = found.next().ok_or_else(|| {
                let is_list = cells.iter().any(|c| c.contains(&b';'));
                self.fault(&format!("the header has no column `{name}`"), if is_list { COMMAS } else { HELP })
            })?;
            if found.next().is_some() {
                return Err(self.fault(&format!("the header has two columns `{name}`"), "leave one of them"));
            }
        }
        Ok(Layout { columns, cells: cells.len(), has_header: true })
    }

    fn point(&self, layout: &Layout, cells: &[Vec<u8>]) -> Result<SensorPoint> {
        let used = cells.iter().rposition(|c| !c.is_empty()).map_or(0, |last| last + 1);
        if used > layout.cells {
            let expected = if layout.has_header { "in the header" } else { "without a header" };
            let what = format!("{used} cells, but {} {expected}", layout.cells);
            return Err(self
                .fault(&what, "name the columns in a header, `x,y,z,nx,ny,nz` among them, and write decimal points"));
        }
        let mut numbers = [0.0f64; 6];
        for ((number, column), name) in numbers.iter_mut().zip(layout.columns).zip(COLUMNS) {
            let cell = cells.get(column).filter(|c| !c.is_empty());
            let cell = cell.ok_or_else(|| self.fault(&format!("no value for `{name}`"), HELP))?;
            let parsed = std::str::from_utf8(cell).ok().and_then(|c| c.parse().ok());
            *number = parsed.ok_or_else(|| {
                let help = if cell.iter().any(|b| b",; \t".contains(b)) { COMMAS } else { HELP };
                self.fault(&format!("`{}` is no number for `{name}`", shown_name(cell)), help)
            })?;
            if !number.is_finite() {
                return Err(self.fault(&format!("`{}` is not finite", shown_name(cell)), HELP));
            }
        }
        let [x, y, z, nx, ny, nz] = numbers;
        if [nx, ny, nz] == [0.0; 3] {
            return Err(self.fault("the normal is 0", HELP));
        }
        Ok(SensorPoint { position: [x, y, z], normal: [nx, ny, nz] })
    }

    fn next_point(&mut self) -> Result<Option<SensorPoint>> {
        while let Some(cells) = self.row()? {
            let layout = match self.layout.take() {
                Some(layout) => layout,
                None => {
                    let layout = self.learn(&cells)?;
                    if layout.has_header {
                        self.layout = Some(layout);
                        continue;
                    }
                    layout
                }
            };
            let point = self.point(&layout, &cells)?;
            self.layout = Some(layout);
            return Ok(Some(point));
        }
        Ok(None)
    }
}

impl<R: Read> Iterator for PointReader<R> {
    type Item = Result<SensorPoint>;

    fn next(&mut self) -> Option<Self::Item> {
        let point = self.next_point();
        if point.is_err() {
            self.rows = Rows::Ended;
        }
        point.transpose()
    }
}

fn between_blanks(text: &[u8]) -> Vec<Vec<u8>> {
    text.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).map(<[u8]>::to_vec).collect()
}

/// Whether a first row names columns: it holds an `x`, or no number at all.
fn is_header(cells: &[Vec<u8>]) -> bool {
    let is_number = |c: &Vec<u8>| std::str::from_utf8(c).is_ok_and(|c| c.parse::<f64>().is_ok());
    cells.iter().any(|c| c.eq_ignore_ascii_case(b"x")) || !cells.iter().any(is_number)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: impl AsRef<[u8]>) -> Result<Vec<SensorPoint>> {
        PointReader::new(text.as_ref(), Path::new("p.csv"))?.collect()
    }

    fn message(text: impl AsRef<[u8]>) -> String {
        let error = read(text).unwrap_err();
        format!("{error} / {}", error.remedy())
    }

    const POINTS: [SensorPoint; 2] = [
        SensorPoint { position: [1.5, 2.5, 0.0], normal: [0.0, 0.0, 1.0] },
        SensorPoint { position: [-3.0, 0.25, 10.0], normal: [0.0, 0.0, -2.0] },
    ];

    #[test]
    fn every_way_to_write_points_gives_the_same_points() {
        for text in [
            "1.5 2.5 0 0 0 1\n-3 0.25 10 0 0 -2\n",
            "1.5\t2.5 0\t0 0 1\n\n  -3.0 .25 1e1 0 0 -2",
            "# made by hand\n\n1.5,2.5,0,0,0,1\n , ,\n# between\n-3, 0.25, 10, 0, 0, -2\n",
            "x,y,z,nx,ny,nz\n1.5,2.5,0,0,0,1\n,,,,,\n-3,0.25,10,0,0,-2,\n",
            "NZ, X ,\"Y\",Z,Nx,nY\n1,1.5,2.5,0,0,0\n\n-2,-3,0.25,10,0,0\n",
            "name,x,y,z,nx,ny,nz\n\"Desk 0, \"\"A\"\"\nby the door\",1.5,2.5,0,0,0,1\nDesk 5\" B,-3,0.25,10,0,0,-2\n",
            "no,x,y,z,nx,ny,nz\n# left out, so far\n#1,1.5,2.5,0,0,0,1\n#2,-3,0.25,10,0,0,-2\n",
            "x,y,z,nx,ny,nz\n#1,2,3,0,0,1\n1.5,2.5,0,0,0,1\n-3,0.25,10,0,0,-2\n",
            "x y z nx ny nz\n1.5 2.5 0 0 0 1\n-3 0.25 10 0 0 -2",
            "room no\tx\ty\tz\tnx\tny\tnz\nA 1\t1.5\t2.5\t0\t0\t0\t1\n\t-3\t0.25\t10\t0\t0\t-2\n",
        ] {
            for end in ["\n", "\r", "\r\n"] {
                let text = format!("\u{feff}{}", text.replace('\n', end));
                assert_eq!(read(&text).unwrap(), POINTS, "{text:?}");
            }
        }
    }

    #[test]
    fn bytes_that_are_no_text_do_no_harm_in_other_columns() {
        assert_eq!(read(b"x,y,z,nx,ny,nz,Geb\xe4ude\n1.5,2.5,0,0,0,1,\xff\n-3,0.25,10,0,0,-2,\xe9\n").unwrap(), POINTS);
        assert!(message(b"x,y,z,nx,ny,nz\n1,2,\xe9,0,0,1\n").starts_with("p.csv:2: `\\xe9` is no number for `z`"));
    }

    #[test]
    fn what_would_have_to_be_guessed_is_refused_with_its_line() {
        for (text, said) in [
            ("1,0,1.5,1.3,1,0,0\n", "p.csv:1: 7 cells, but 6 without a header / name the columns"),
            ("1 2 3 0 0 1\n\n7 1 2 3 0 0 1", "p.csv:3: 7 cells"),
            ("x,y,z,nx,ny,nz\n0,5,1,5,0,0,0,0,1\n", "p.csv:2: 9 cells, but 6 in the header"),
            ("x,y,z,x,nx,ny,nz\n", "p.csv:1: the header has two columns `x`"),
            ("x,y,z,nx,ny\n", "p.csv:1: the header has no column `nz`"),
            ("px,py,pz,dx,dy,dz\n1,2,3,0,0,1\n", "p.csv:1: the header has no column `x`"),
            ("\n\nx,y,z,nx,ny,nz\n\n1,2,a,0,0,1\n", "p.csv:5: `a` is no number for `z`"),
            ("x,y,z,nx,ny,nz\n1,2,3,0,0\n", "p.csv:2: no value for `nz`"),
            ("1,2,,0,0,1\n", "p.csv:1: no value for `z`"),
            ("x;y;z;nx;ny;nz\n", "p.csv:1: cells are separated by semicolons / separate cells by commas"),
            ("0,5;1,5;0;0;0;1\n", "p.csv:1: `5;1` is no number for `y` / separate cells by commas"),
            ("x,y,z,nx,ny,nz\n\"0,5\",1,2,0,0,1\n", "p.csv:2: `0,5` is no number for `x` / separate cells by commas"),
            ("1,5 2,5 0 0 0 1\n", "p.csv:1: `5 2` is no number for `y` / separate cells by commas"),
            ("0,5\t1,5\t0\t0\t0\t1\n", "p.csv:1: `5\\u{9}1` is no number for `y` / separate cells by commas"),
            ("x,y,z,nx,ny,nz,name\n1,2,3,0,0,1,\"Desk\n4,5,6,0,0,1,b\n", "p.csv:2: a quote begins here"),
            ("1 2 3 0 0 0", "p.csv:1: the normal is 0"),
            ("1 2 inf 0 0 1", "p.csv:1: `inf` is not finite"),
        ] {
            for end in ["\n", "\r", "\r\n"] {
                let text = text.replace('\n', end);
                assert!(message(&text).starts_with(said), "{text:?}: {}", message(&text));
            }
        }
    }

    #[test]
    fn an_empty_file_holds_no_points() {
        assert_eq!(read("").unwrap(), []);
        assert_eq!(read("# nothing\n\n").unwrap(), []);
        assert_eq!(read("x,y,z,nx,ny,nz").unwrap(), []);
    }
}
