//! Materials: from the names that faces use to reflectance and exitance.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use super::read::{InputFile, MaterialUse};
use crate::base::{Progress, Result, Rgb};
use crate::formats::mtl::{self, DEFAULT_KD, Definition, Library};
use crate::model::geometry::SideMaterial;

/// Largest reflectance: above it light would hardly ever end.
const MAX_RHO: f64 = 0.99;

/// What the faces of one `usemtl` name are made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Diffuse reflectance, 0..=0.99.
    pub rho: Rgb,
    /// Exitance pi Ke, W/m2.
    pub exitance: Rgb,
}

impl Material {
    /// Whether it emits.
    #[must_use]
    pub fn emits(&self) -> bool {
        !self.exitance.is_black()
    }

    /// As stored, with or without its light.
    #[must_use]
    pub fn side(&self, lit: bool) -> SideMaterial {
        let exitance = if lit { self.exitance.to_f32() } else { [0.0; 3] };
        SideMaterial { rho: self.rho.to_f32(), exitance }
    }
}

/// An MTL file that was read.
pub struct LibraryFile {
    /// Where it was found.
    pub path: PathBuf,
    library: Library,
}

/// Reads the MTL files that the models name, once each; missing ones are warned of.
pub fn read_libraries(files: &[InputFile], progress: &dyn Progress) -> Result<Vec<Vec<LibraryFile>>> {
    files
        .iter()
        .map(|file| {
            let mut found: Vec<LibraryFile> = Vec::new();
            let folder = file.path.parent().unwrap_or(Path::new(""));
            for names in &file.libraries {
                let (paths, missing) = resolve(folder, names);
                for name in missing {
                    progress.warn(&format!(
                        "{}: material file `{name}` is missing: its materials reflect 0.5",
                        file.path.display()
                    ));
                }
                for path in paths {
                    if found.iter().all(|f| f.path != path) {
                        let library = mtl::read(&path)?;
                        found.push(LibraryFile { path, library });
                    }
                }
            }
            Ok(found)
        })
        .collect()
}

/// The files that the rest of an `mtllib` line names, blanks in names and between them alike: always
/// the longest run of words that is a file. What is left names none.
fn resolve(folder: &Path, names: &str) -> (Vec<PathBuf>, Vec<String>) {
    let words: Vec<&str> = names.split_whitespace().collect();
    let (mut found, mut missing) = (Vec::new(), Vec::new());
    let mut from = 0;
    let whole = |name: &str| {
        [name.to_owned(), name.replace('\\', "/")].into_iter().map(|n| folder.join(n)).find(|p| p.is_file())
    };
    if let Some(path) = whole(names) {
        return (vec![path], missing);
    }
    while from < words.len() {
        let run = (from + 1..=words.len()).rev().find_map(|to| Some((to, whole(&words[from..to].join(" "))?)));
        match run {
            Some((to, path)) => {
                found.push(path);
                from = to;
            }
            None => {
                missing.push(words[from].to_owned());
                from += 1;
            }
        }
    }
    if found.is_empty() {
        missing = vec![names.to_owned()];
    }
    (found, missing)
}

/// The material of every use. `overriding`: the definitions of `--materials`.
#[must_use]
pub fn materials_of(
    uses: &[MaterialUse],
    libraries: &[Vec<LibraryFile>],
    overriding: Option<&Library>,
    progress: &dyn Progress,
) -> Vec<Material> {
    let by_name = |library: &Library| -> HashMap<String, Definition> {
        library.materials.iter().rev().map(|d| (d.name.clone(), d.clone())).collect()
    };
    let overriding = overriding.map(by_name).unwrap_or_default();
    let defined: Vec<HashMap<String, Definition>> =
        libraries.iter().map(|files| files.iter().rev().flat_map(|f| by_name(&f.library)).collect()).collect();
    let mut clamped = BTreeMap::new();
    let mut undefined = BTreeMap::new();
    let materials: Vec<Material> = uses
        .iter()
        .map(|of| {
            let name = of.name.as_deref().unwrap_or_default();
            let own = defined[of.file as usize].get(name);
            let definition = overriding.get(name).or(overriding.get("*")).or(own);
            if definition.is_none() && of.name.is_some() {
                undefined.insert(name.to_owned(), ());
            }
            let (kd, ke) = definition.map_or((DEFAULT_KD, [0.0; 3]), |d| (d.kd, d.ke));
            let rho = kd.map(|x| if x.is_finite() { x.clamp(0.0, MAX_RHO) } else { DEFAULT_KD[0] });
            if rho != kd {
                clamped.insert(name.to_owned(), kd);
            }
            let ke = ke.map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 });
            Material { rho: Rgb(rho), exitance: Rgb(ke) * std::f64::consts::PI }
        })
        .collect();
    if let Some((name, kd)) = clamped.iter().next() {
        let [r, g, b] = kd;
        progress.warn(&format!(
            "reflectance of {} clamped to 0..0.99, first `{name}` with Kd {r} {g} {b}",
            plural(clamped.len(), "material")
        ));
    }
    if let Some(name) = undefined.keys().next() {
        progress.warn(&format!(
            "{} without definition, first `{name}`: Kd 0.5 is used",
            plural(undefined.len(), "material")
        ));
    }
    materials
}

/// Says once what the MTL files state and this program ignores.
pub fn warn_of_ignored(libraries: &[Vec<LibraryFile>], progress: &dyn Progress) {
    let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
    for (what, n) in libraries.iter().flatten().flat_map(|f| &f.library.ignored) {
        *counts.entry(what).or_default() += n;
    }
    if !counts.is_empty() {
        let list: Vec<_> = counts.iter().map(|(what, n)| format!("{what} of {n}")).collect();
        progress.warn(&format!("ignored in materials: {}", list.join(", ")));
    }
}

fn plural(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Quiet;

    #[test]
    fn a_library_line_names_files_with_blanks_or_several_files() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a b.mtl", "c.mtl", "d.mtl"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        let names = |line: &str| {
            let (found, missing) = resolve(dir.path(), line);
            let found: Vec<_> = found.iter().map(|p| p.file_name().unwrap().to_string_lossy().into_owned()).collect();
            (found.join("|"), missing.join("|"))
        };
        assert_eq!(names("a b.mtl"), ("a b.mtl".into(), String::new()));
        assert_eq!(names("./c.mtl d.mtl"), ("c.mtl|d.mtl".into(), String::new()));
        assert_eq!(names("x.mtl a b.mtl y.mtl"), ("a b.mtl".into(), "x.mtl|y.mtl".into()));
        assert_eq!(names(".\\c.mtl").0, "c.mtl");
    }

    #[test]
    fn given_materials_replace_those_of_the_same_name_and_the_star_all_others() {
        let dir = tempfile::tempdir().unwrap();
        let own = dir.path().join("own.mtl");
        std::fs::write(&own, "newmtl a\nKd 0.1 0.1 0.1\nnewmtl b\nKd 0.2 0.2 0.2\nnewmtl c\nKd 2 0 0\n").unwrap();
        let libraries = [vec![LibraryFile { library: mtl::read(&own).unwrap(), path: own.clone() }]];
        let uses: Vec<_> =
            ["a", "b", "c", "d"].iter().map(|n| MaterialUse { file: 0, name: Some((*n).to_owned()) }).collect();
        let red = |overriding: Option<&Library>| -> Vec<f64> {
            materials_of(&uses, &libraries, overriding, &Quiet).iter().map(|m| m.rho.0[0]).collect()
        };
        assert_eq!(red(None), [0.1, 0.2, 0.99, 0.5]);
        std::fs::write(&own, "newmtl b\nKd 0.7 0 0\nKe 1 1 1\n").unwrap();
        let mut given = mtl::read(&own).unwrap();
        assert_eq!(red(Some(&given)), [0.1, 0.7, 0.99, 0.5]);
        let lit = materials_of(&uses, &libraries, Some(&given), &Quiet)[1].exitance.0[0];
        assert!((lit - std::f64::consts::PI).abs() < 1e-15, "{lit}");
        given.materials[0].name = "*".to_owned();
        assert_eq!(red(Some(&given)), [0.7; 4]);
    }
}
