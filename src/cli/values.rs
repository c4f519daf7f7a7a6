//! Values as people type them: sizes, lengths, places, picture sizes.

use std::str::FromStr;
use std::time::Duration;

use crate::base::memory::MemoryBudget;
use crate::model::solve_options::InnerOption;

/// Bytes: `512M`, `2G`, in powers of 1024.
pub fn size(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor: u64 = match text[digits.len()..].trim_end_matches(['B', 'b']).trim_end_matches('i') {
        "" => 1,
        "K" | "k" => 1 << 10,
        "M" | "m" => 1 << 20,
        "G" | "g" => 1 << 30,
        "T" | "t" => 1 << 40,
        _ => return Err("a size is a number with K, M, G or T, like `512M`".to_owned()),
    };
    let number: f64 = parse(digits, "a size is a number with K, M, G or T, like `512M`")?;
    let bytes = number * factor as f64;
    if (0.0..9e18).contains(&bytes) { Ok(bytes as u64) } else { Err("the size is out of range".to_owned()) }
}

/// `--memory`: a size.
pub fn memory(text: &str) -> Result<MemoryBudget, String> {
    size(text).map(|limit_bytes| MemoryBudget { limit_bytes })
}

/// Metres: `0.05`, `5cm`, `2in`.
pub fn length(text: &str) -> Result<f64, String> {
    const WHAT: &str = "a length is a number of metres, or has a unit m, cm, mm, in or ft, like `5cm`";
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let metres = match &text[digits.len()..] {
        "" | "m" => 1.0,
        "cm" => 0.01,
        "mm" => 0.001,
        "in" => 0.0254,
        "ft" => 0.3048,
        _ => return Err(WHAT.to_owned()),
    };
    let value = parse::<f64>(digits.trim_end(), WHAT)? * metres;
    if value.is_finite() && value >= 0.0 { Ok(value) } else { Err("a length is not negative".to_owned()) }
}

/// A number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = parse(text, "not a number")?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err("give a number above 0".to_owned()) }
}

/// A share above 0 and below 1.
pub fn share(text: &str) -> Result<f64, String> {
    let value = positive(text)?;
    if value < 1.0 { Ok(value) } else { Err("give a number below 1".to_owned()) }
}

/// Degrees of a field of view.
pub fn degrees(text: &str) -> Result<f64, String> {
    let value = positive(text)?;
    if value < 180.0 { Ok(value) } else { Err("give an angle below 180 degrees".to_owned()) }
}

/// Seconds, 0 or more.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let value: f64 = parse(text, "not a number of seconds")?;
    Duration::try_from_secs_f64(value).map_err(|_| "give 0 or more seconds".to_owned())
}

/// A place or direction: `1,2.5,-3`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triple(pub [f64; 3]);

impl FromStr for Triple {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const WHAT: &str = "three numbers with commas, like `1,2.5,-3`";
        let numbers: Vec<f64> = text.split(',').map(|n| parse(n.trim(), WHAT)).collect::<Result<_, _>>()?;
        let triple: [f64; 3] = numbers.try_into().map_err(|_| WHAT.to_owned())?;
        if triple.iter().all(|x| x.is_finite()) { Ok(Self(triple)) } else { Err(WHAT.to_owned()) }
    }
}

/// A picture's size: `1280x720`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureSize {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
}

impl FromStr for PictureSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const WHAT: &str = "two numbers of pixels from 1 to 16384, like `1280x720`";
        let (width, height) = text.split_once('x').ok_or(WHAT)?;
        let size = Self { width: parse(width, WHAT)?, height: parse(height, WHAT)? };
        let fits = |n| (1..=16_384).contains(&n);
        if fits(size.width) && fits(size.height) { Ok(size) } else { Err(WHAT.to_owned()) }
    }
}

impl FromStr for InnerOption {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(0) | Err(_) if text != "converge" => Err("give a number from 1, or `converge`".to_owned()),
            Ok(n) => Ok(Self::Gathers(n)),
            Err(_) => Ok(Self::Converge),
        }
    }
}

fn parse<T: FromStr>(text: &str, what: &str) -> Result<T, String> {
    text.parse().map_err(|_| what.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_powers_of_1024_and_lengths_are_metres() {
        assert_eq!(size("512M"), Ok(512 << 20));
        assert_eq!(size("2GiB"), Ok(2 << 30));
        assert_eq!(size("1.5k"), Ok(1536));
        assert!(size("M").is_err() && size("1X").is_err() && size("-1").is_err());
        assert_eq!(length("5cm"), Ok(0.05));
        assert_eq!(length("2in"), Ok(0.0508));
        assert_eq!(length("1e-3"), Ok(0.001));
        assert!(length("5 km").is_err() && length("-1").is_err() && length("nan").is_err());
    }

    #[test]
    fn places_pictures_and_gathers_are_read() {
        assert_eq!("1, 2.5,-3".parse(), Ok(Triple([1.0, 2.5, -3.0])));
        assert!("1,2".parse::<Triple>().is_err());
        assert_eq!("640x480".parse(), Ok(PictureSize { width: 640, height: 480 }));
        assert!("0x480".parse::<PictureSize>().is_err());
        assert_eq!("2".parse(), Ok(InnerOption::Gathers(2)));
        assert_eq!("converge".parse(), Ok(InnerOption::Converge));
        assert!("0".parse::<InnerOption>().is_err() && "x".parse::<InnerOption>().is_err());
        assert!(share("1").is_err() && share("0.02").is_ok() && degrees("180").is_err());
    }
}
