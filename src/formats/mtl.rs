//! Wavefront MTL: names, `Kd` and `Ke` pass a sieve, and tobj reads what has passed; all else is
//! counted.
//!
//! Nothing else in a file can refuse or crash an import, since tobj never sees it: it gets numbers for
//! names, and three numbers that were looked at for every colour.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use super::lines::{LineReader, number, open, words};
use crate::base::text::{shown, shown_name};
use crate::base::{Error, Result};

/// Reflectance where an MTL gives none.
pub const DEFAULT_KD: [f64; 3] = [0.5; 3];

/// Largest `Ke` that is taken for light, W/(m2 sr): sums of what it sends stay within f32.
const LARGEST_KE: f64 = 1e30;

const HELP: &str = "write three numbers with decimal points, or one for all three: `Kd 0.7 0.7 0.7`";

/// A material as the file states it.
#[derive(Clone, Debug, PartialEq)]
pub struct Definition {
    /// Its name.
    pub name: Vec<u8>,
    /// Line of its `newmtl`.
    pub line: u64,
    /// `Kd`, diffuse reflectance; [`DEFAULT_KD`] where absent.
    pub kd: [f64; 3],
    /// `Ke`, emitted radiance, W/(m2 sr); 0 where absent.
    pub ke: [f64; 3],
}

/// What a file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Library {
    /// The file.
    pub path: PathBuf,
    /// Its materials, in file order.
    pub materials: Vec<Definition>,
    /// What was there and is ignored (`Ks`, `d`, `map_Kd`...) -> how many materials have it.
    pub ignored: BTreeMap<String, u64>,
    /// Colours that cannot be and were corrected: how many.
    pub corrected: u64,
    /// The first of them, with file and line.
    pub first_corrected: String,
}

/// Reads an MTL file; the error names file and line.
pub fn read(path: &Path) -> Result<Library> {
    parse(open(path)?, path)
}

/// Reads from anything; `path` is for messages.
pub fn parse(input: impl Read, path: &Path) -> Result<Library> {
    let mut lines = LineReader::new(input, path)?;
    let mut sieve = Sieve {
        library: Library { path: path.to_path_buf(), ..Library::default() },
        passed: String::new(),
        ignored: BTreeSet::new(),
    };
    while lines.read_line(|_| false)? {
        sieve.line(&lines)?;
    }
    sieve.finish()
}

#[derive(Clone, Copy, PartialEq)]
enum Colour {
    Kd,
    Ke,
}

impl Colour {
    fn key(self) -> &'static str {
        match self {
            Self::Kd => "Kd",
            Self::Ke => "Ke",
        }
    }

    /// A number as it is used. Reflectances over 1 are the caller's: what is used counts there.
    fn possible(self, x: f64) -> f64 {
        match self {
            Self::Kd if !(x as f32).is_finite() => DEFAULT_KD[0],
            Self::Ke if !x.is_finite() || x > LARGEST_KE => 0.0,
            _ => x.max(0.0),
        }
    }
}

struct Sieve {
    library: Library,
    /// What tobj gets.
    passed: String,
    /// What the current material has that is ignored.
    ignored: BTreeSet<String>,
}

impl Sieve {
    fn line(&mut self, lines: &LineReader<impl Read>) -> Result<()> {
        let mut words = words(&lines.text);
        let Some(keyword) = words.next() else { return Ok(()) };
        let values: Vec<&[u8]> = words.collect();
        match keyword.to_ascii_lowercase().as_slice() {
            b"newmtl" => {
                let name = lines.text.trim_ascii_start()[keyword.len()..].trim_ascii().to_vec();
                writeln!(self.passed, "newmtl {}", self.library.materials.len()).expect("a string takes all");
                self.library.materials.push(Definition { name, line: lines.line, kd: DEFAULT_KD, ke: [0.0; 3] });
                self.count_ignored();
            }
            b"kd" => self.colour(lines, Colour::Kd, &values)?,
            b"ke" => self.colour(lines, Colour::Ke, &values)?,
            other => self.ignored.extend(ignored(other, &values)),
        }
        Ok(())
    }

    fn colour(&mut self, lines: &LineReader<impl Read>, colour: Colour, values: &[&[u8]]) -> Result<()> {
        let key = colour.key();
        let Some(material) = self.library.materials.last() else {
            self.ignored.insert(format!("{key} before the first newmtl"));
            return Ok(());
        };
        let name = shown_name(&material.name);
        let given = numbers(lines, key, &name, values)?;
        let [r, g, b] = given.map(|x| colour.possible(x));
        if [r, g, b] != given {
            self.library.corrected += 1;
            if self.library.corrected == 1 {
                let ([x, y, z], path) = (given, shown(&self.library.path));
                self.library.first_corrected =
                    format!("{path}:{}: `{key} {x} {y} {z}` of `{name}` is taken as {r} {g} {b}", lines.line);
            }
        }
        if values.len() > 3 {
            self.ignored.insert(format!("{key} beyond three numbers"));
        }
        writeln!(self.passed, "{key} {} {} {}", r as f32, g as f32, b as f32).expect("a string takes all");
        Ok(())
    }

    fn count_ignored(&mut self) {
        for what in std::mem::take(&mut self.ignored) {
            *self.library.ignored.entry(what).or_default() += 1;
        }
    }

    fn finish(mut self) -> Result<Library> {
        self.count_ignored();
        let path = shown(&self.library.path);
        let (read, _) = tobj::load_mtl_buf(&mut Cursor::new(&self.passed))
            .map_err(|e| Error::failed(format!("{path}: {e}"), "write the file again from the program that made it"))?;
        for (material, read) in self.library.materials.iter_mut().zip(read) {
            material.kd = read.diffuse.map_or(DEFAULT_KD, |kd| kd.map(decimal));
            material.ke = read.emissive.map_or([0.0; 3], |ke| ke.map(decimal));
        }
        Ok(self.library)
    }
}

/// The three numbers of a colour, or the one that stands for all; anything else would have to be guessed.
fn numbers(lines: &LineReader<impl Read>, key: &str, of: &str, values: &[&[u8]]) -> Result<[f64; 3]> {
    let is_form = |w: &&&[u8]| w.eq_ignore_ascii_case(b"xyz") || w.eq_ignore_ascii_case(b"spectral");
    if let Some(form) = values.first().filter(is_form) {
        let what = format!("`{key} {}` of `{of}` cannot be read", shown_name(form));
        return Err(lines.fault(&what, &format!("write it as RGB: `{key} R G B`")));
    }
    let mut numbers = Vec::with_capacity(3);
    for word in values.iter().take(3) {
        let not_a_number = || format!("`{}` in the `{key}` of `{of}` is not a number", shown_name(word));
        numbers.push(number(word).ok_or_else(|| lines.fault(&not_a_number(), HELP))?);
    }
    match numbers[..] {
        [all] => Ok([all; 3]),
        [r, g, b] => Ok([r, g, b]),
        _ => Err(lines.fault(&format!("the `{key}` of `{of}` has {} of 3 numbers", numbers.len()), HELP)),
    }
}

/// Maps as they are usually written.
const MAPS: [&str; 6] = ["map_Ka", "map_Kd", "map_Ks", "map_Ke", "map_Ns", "map_d"];

/// What a line states that is ignored although it would change the light; `keyword` in small letters.
fn ignored(keyword: &[u8], values: &[&[u8]]) -> Option<String> {
    let states = |neutral: f64| values.last().is_some_and(|w| number(w) != Some(neutral));
    let name = match keyword {
        b"ks" => values.iter().any(|w| number(w) != Some(0.0)).then_some("Ks"),
        b"d" => states(1.0).then_some("d"),
        b"tr" => states(0.0).then_some("Tr"),
        _ if values.is_empty() => None,
        b"norm" => Some("norm"),
        b"bump" | b"map_bump" => Some("map_Bump"),
        _ if keyword.starts_with(b"map_") => {
            let known = MAPS.iter().find(|m| m.as_bytes().eq_ignore_ascii_case(keyword));
            return Some(known.map_or_else(|| shown_name(keyword), |m| (*m).to_owned()));
        }
        _ => None,
    };
    name.map(str::to_owned)
}

/// The decimal number that an f32 was read from: `0.73`, not `0.7300000190734863`.
fn decimal(x: f32) -> f64 {
    x.to_string().parse().unwrap_or(f64::from(x))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &[u8]) -> Result<Library> {
        parse(text, Path::new("lib.mtl"))
    }

    /// Kd and Ke of the only material of a file with these lines.
    fn colours(lines: &str) -> ([f64; 3], [f64; 3]) {
        let library = read_text(format!("newmtl a\n{lines}").as_bytes()).unwrap();
        (library.materials[0].kd, library.materials[0].ke)
    }

    #[test]
    fn kd_defaults_to_grey_and_ke_to_dark() {
        assert_eq!(colours(""), (DEFAULT_KD, [0.0; 3]));
        assert_eq!(colours("Kd 0.25 0.73 1\nKe 1 2 3"), ([0.25, 0.73, 1.0], [1.0, 2.0, 3.0]));
    }

    #[test]
    fn one_number_is_all_three_and_letters_may_be_of_either_case() {
        assert_eq!(colours("kd 0.7\nKE 5 # warm"), ([0.7; 3], [5.0; 3]));
        let library = read_text(b"NEWMTL A b \r\tKd .5 1e-1 0.25 1\r\n").unwrap();
        assert_eq!((library.materials[0].name.as_slice(), library.materials[0].kd), (&b"A b"[..], [0.5, 0.1, 0.25]));
        assert_eq!(library.ignored["Kd beyond three numbers"], 1);
    }

    #[test]
    fn names_that_differ_in_one_byte_are_two_materials() {
        let library = read_text(b"newmtl Mur \xe9\nKd 0.8\nnewmtl Mur \xe8 \nKd 0.1").unwrap();
        let names: Vec<&[u8]> = library.materials.iter().map(|m| m.name.as_slice()).collect();
        assert_eq!(names, [&b"Mur \xe9"[..], b"Mur \xe8"]);
        assert_eq!(library.materials[1].kd, [0.1; 3]);
    }

    #[test]
    fn what_is_ignored_is_counted_and_refuses_nothing() {
        let text = "newmtl a\nKd 1 1 1\nKs 0.5 0 0\nd 0.5\nmap_Kd x.png\nmap_Kd \nKs\nNs x\nillum\n\
                    newmtl b\nKs 0 0 0\nd 1\nmap_kD y.png\nTr 0\nbump\nmap_ÿ z\nd -halo 0.5\n\0\nnorm n.png";
        let library = read_text(text.as_bytes()).unwrap();
        let counts: Vec<_> = library.ignored.iter().map(|(k, v)| (k.as_str(), *v)).collect();
        assert_eq!(counts, [("Ks", 1), ("d", 2), ("map_Kd", 2), ("map_ÿ", 1), ("norm", 1)]);
    }

    #[test]
    fn numbers_that_cannot_be_are_corrected_and_named_with_their_line() {
        assert_eq!(colours("Kd 1e39 0.2 -1\nKe 1e400 -1 2"), ([0.5, 0.2, 0.0], [0.0, 0.0, 2.0]));
        assert_eq!(colours("Kd nan\nKe nan"), (DEFAULT_KD, [0.0; 3]));
        assert_eq!(colours("Ke 1e39 inf 1.#IND"), (DEFAULT_KD, [0.0; 3]));
        let library = read_text(b"newmtl l\x1b\nKe -1\nKe 1e400\nKe 3").unwrap();
        assert_eq!(library.corrected, 2);
        assert_eq!(library.first_corrected, "lib.mtl:2: `Ke -1 -1 -1` of `l\\u{1b}` is taken as 0 0 0");
        assert_eq!(library.materials[0].ke, [3.0; 3]);
    }

    #[test]
    fn a_colour_that_would_have_to_be_guessed_is_refused_with_file_and_line() {
        let message = |line: &str| read_text(format!("newmtl a\r{line}\r").as_bytes()).unwrap_err().to_string();
        assert_eq!(message("Kd 1 x 1"), "lib.mtl:2: `x` in the `Kd` of `a` is not a number");
        assert_eq!(message("Ke 1 1"), "lib.mtl:2: the `Ke` of `a` has 2 of 3 numbers");
        assert_eq!(message("Kd"), "lib.mtl:2: the `Kd` of `a` has 0 of 3 numbers");
        assert_eq!(message("Kd xyz 0.3 0.3 0.3"), "lib.mtl:2: `Kd xyz` of `a` cannot be read");
        assert_eq!(message("Ke spectral lamp.rfl"), "lib.mtl:2: `Ke spectral` of `a` cannot be read");
        assert!(message("Kd 0,5 0,5 0,5").contains("`0,5`"));
    }

    #[test]
    fn utf16_is_refused_and_a_byte_order_mark_is_not_part_of_a_name() {
        assert!(read_text(b"\xff\xfen\0").unwrap_err().to_string().contains("UTF-16LE"));
        assert_eq!(read_text(b"\xef\xbb\xbfnewmtl a").unwrap().materials[0].name, b"a");
    }
}
