//! Wavefront MTL, read by tobj: what of a material this program uses, and what it ignores.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use super::obj::{not_utf8, utf16_error};
use crate::base::{Error, Result};

/// Reflectance where an MTL gives none.
pub const DEFAULT_KD: [f64; 3] = [0.5; 3];

/// A material as the file states it.
#[derive(Clone, Debug, PartialEq)]
pub struct Definition {
    /// Its name.
    pub name: String,
    /// `Kd`, diffuse reflectance; [`DEFAULT_KD`] where absent.
    pub kd: [f64; 3],
    /// `Ke`, emitted radiance, W/(m2 sr); 0 where absent.
    pub ke: [f64; 3],
}

/// What a file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Library {
    /// Its materials, in file order.
    pub materials: Vec<Definition>,
    /// What was there and is ignored (`Ks`, `d`, `map_Kd`...) -> how many materials have it.
    pub ignored: BTreeMap<String, u64>,
}

/// Reads an MTL file; the error names file and line.
pub fn read(path: &Path) -> Result<Library> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
    if let Some(encoding) = not_utf8(&bytes) {
        return Err(utf16_error(path, encoding));
    }
    let text = String::from_utf8_lossy(&bytes);
    parse(text.trim_start_matches('\u{feff}'), path)
}

fn parse(text: &str, path: &Path) -> Result<Library> {
    let (materials, _) = tobj::load_mtl_buf(&mut Cursor::new(text)).map_err(|e| broken_line(text, path, &e))?;
    let mut library = Library::default();
    for material in materials {
        let mut ignore = |what: &str, present: bool| {
            if present {
                *library.ignored.entry(what.to_owned()).or_default() += 1;
            }
        };
        ignore("Ks", material.specular.is_some_and(|ks| ks != [0.0; 3]));
        ignore("d", material.dissolve.is_some_and(|d| d != 1.0));
        ignore("map_Ka", material.ambient_texture.is_some());
        ignore("map_Kd", material.diffuse_texture.is_some());
        ignore("map_Ks", material.specular_texture.is_some());
        ignore("map_Bump", material.normal_texture.is_some());
        ignore("map_Ns", material.shininess_texture.is_some());
        ignore("map_d", material.dissolve_texture.is_some());
        ignore("Tr", material.unknown_param.get("Tr").is_some_and(|v| v.trim().parse() != Ok(0.0)));
        for key in material.unknown_param.keys() {
            ignore(key, key.starts_with("map_") || key == "norm" || key == "bump");
        }
        library.materials.push(Definition {
            name: material.name,
            kd: material.diffuse.map_or(DEFAULT_KD, |kd| kd.map(decimal)),
            ke: material.emissive.map_or([0.0; 3], |ke| ke.map(decimal)),
        });
    }
    Ok(library)
}

/// The decimal number that an f32 was read from: `0.73`, not `0.7300000190734863`.
fn decimal(x: f32) -> f64 {
    x.to_string().parse().unwrap_or(f64::from(x))
}

/// tobj names no line: the first line that fails by itself is the culprit.
fn broken_line(text: &str, path: &Path, error: &tobj::LoadError) -> Error {
    let fails = |line: &str| tobj::load_mtl_buf(&mut Cursor::new(format!("newmtl m\n{line}\n"))).is_err();
    let line = text.lines().position(fails).map_or(1, |i| i + 1);
    let shown = text.lines().nth(line - 1).unwrap_or_default().trim();
    Error::failed(format!("{}:{line}: `{shown}`: {error}", path.display()), "correct that line of the material file")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kd_defaults_to_grey_and_ke_to_dark() {
        let library = parse("newmtl a\nnewmtl b\nKd 0.25 0.5 1\nKe 1 2 3", Path::new("a.mtl")).unwrap();
        assert_eq!(library.materials[0].kd, DEFAULT_KD);
        assert_eq!(library.materials[0].ke, [0.0; 3]);
        assert_eq!(library.materials[1].kd, [0.25, 0.5, 1.0]);
        assert_eq!(library.materials[1].ke, [1.0, 2.0, 3.0]);
    }

    #[test]
    fn what_is_ignored_is_counted() {
        let text = "newmtl a\nKd 1 1 1\nKs 0.5 0 0\nd 0.5\nmap_Kd x.png\nnewmtl b\nKs 0 0 0\nd 1\nmap_Kd y.png";
        let library = parse(text, Path::new("a.mtl")).unwrap();
        let counts: Vec<_> = library.ignored.iter().map(|(k, v)| (k.as_str(), *v)).collect();
        assert_eq!(counts, [("Ks", 1), ("d", 1), ("map_Kd", 2)]);
    }

    #[test]
    fn a_broken_number_names_file_and_line() {
        let error = parse("newmtl a\nKd 1 1 1\nKd 1 x 1\n", Path::new("lib.mtl")).unwrap_err();
        assert!(error.to_string().starts_with("lib.mtl:3: `Kd 1 x 1`"), "{error}");
    }
}
