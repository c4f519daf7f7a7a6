//! What shapes a solution. A branch keeps it as JSON: one type writes it and reads it.

use std::io;

use serde::{Deserialize, Serialize};

/// The options that shape a solution, not those of order, memory, workers and caches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SolveOptions {
    /// `--tolerance`, the error people dial.
    pub tolerance: f64,
    /// `--min-element`, m; from the tolerance if none.
    pub min_element_m: Option<f64>,
    /// `--inner`.
    pub inner: InnerOption,
    /// `--links`.
    pub links: LinkStorage,
    /// `--seed`.
    pub seed: u64,
}

/// `--inner`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum InnerOption {
    /// So many gathers per visit.
    Gathers(u32),
    /// Until converged.
    #[serde(with = "converge")]
    Converge,
}

/// `--links`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LinkStorage {
    /// In the store.
    Keep,
    /// Nowhere: they are made anew in every visit.
    Discard,
}

impl SolveOptions {
    /// As JSON. Its bytes tell branches apart: they must stay as they are.
    #[must_use]
    pub fn to_json(&self) -> String {
        let mut json = Vec::new();
        let mut serializer = serde_json::Serializer::with_formatter(&mut json, ShortNumbers);
        self.serialize(&mut serializer).expect("plain data");
        String::from_utf8(json).expect("JSON is UTF-8")
    }

    /// From JSON; what is wrong with it where it is not ours.
    pub fn from_json(json: &str) -> Result<Self, String> {
        serde_json::from_str(json).map_err(|e| e.to_string())
    }
}

/// The word that stands for [`InnerOption::Converge`].
mod converge {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str("converge")
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<(), D::Error> {
        let word = String::deserialize(from)?;
        if word == "converge" { Ok(()) } else { Err(D::Error::custom("neither a number nor `converge`")) }
    }
}

/// Numbers as people write them: 1 and 0.000001, not 1.0 and 1e-6.
struct ShortNumbers;

impl serde_json::ser::Formatter for ShortNumbers {
    fn write_f64<W: ?Sized + io::Write>(&mut self, writer: &mut W, value: f64) -> io::Result<()> {
        write!(writer, "{value}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Golden texts: branches of stores that exist are found by them.
    #[test]
    fn options_are_written_as_ever_and_read_back() {
        let (inner, links) = (InnerOption::Converge, LinkStorage::Keep);
        let usual = SolveOptions { tolerance: 0.02, min_element_m: None, inner, links, seed: 1 };
        let (inner, links) = (InnerOption::Gathers(3), LinkStorage::Discard);
        let other = SolveOptions { tolerance: 1.0, min_element_m: Some(1e-6), inner, links, seed: u64::MAX };
        let all = u64::MAX;
        for (options, json) in [
            (usual, r#"{"tolerance":0.02,"min_element_m":null,"inner":"converge","links":"keep","seed":1}"#.to_owned()),
            (other, format!(r#"{{"tolerance":1,"min_element_m":0.000001,"inner":3,"links":"discard","seed":{all}}}"#)),
        ] {
            assert_eq!(options.to_json(), json);
            assert_eq!(SolveOptions::from_json(&json), Ok(options));
        }
    }

    #[test]
    fn what_is_damaged_is_not_read() {
        for json in ["", "{}", r#"{"tolerance":0.02,"min_element_m":null,"inner":"never","links":"keep","seed":1}"#] {
            assert!(SolveOptions::from_json(json).is_err(), "{json}");
        }
    }
}
