//! Materials: from the names that faces use to reflectance and exitance.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

use super::read::MaterialUse;
use crate::base::text::{shown, shown_name};
use crate::base::{Progress, Rgb};
use crate::formats::mtl::{DEFAULT_KD, Definition, Library};
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

/// Definitions by name, each with its file; the first of a name counts.
#[derive(Default)]
struct Definitions<'a> {
    by_name: HashMap<&'a [u8], (&'a Path, &'a Definition)>,
    /// The same for names that end in a comment, without it.
    by_bare_name: HashMap<&'a [u8], (&'a Path, &'a Definition)>,
    /// Later ones of a name that say something else: how many, and the first.
    differing: (usize, String),
}

impl<'a> Definitions<'a> {
    fn of(files: impl IntoIterator<Item = &'a Library>) -> Self {
        let mut all = Self::default();
        for (path, definition) in files.into_iter().flat_map(|f| f.materials.iter().map(|d| (f.path.as_path(), d))) {
            if let Some(bare) = without_comment(&definition.name) {
                all.by_bare_name.entry(bare).or_insert((path, definition));
            }
            let (first_path, first) = *all.by_name.entry(&definition.name).or_insert((path, definition));
            if (first.kd, first.ke) != (definition.kd, definition.ke) {
                all.differing.0 += 1;
                if all.differing.0 == 1 {
                    all.differing.1 = format!(
                        "{}:{}: `{}` counts as {}:{} defines it",
                        shown(path),
                        definition.line,
                        shown_name(&definition.name),
                        shown(first_path),
                        first.line
                    );
                }
            }
        }
        all
    }

    /// The definition of a name; `#` may be part of one (`Material #25`), so that a comment is one only where the
    /// whole is no name.
    fn get(&self, name: &[u8]) -> Option<&(&'a Path, &'a Definition)> {
        let bare = || without_comment(name).and_then(|bare| self.by_name.get(bare));
        self.by_name.get(name).or_else(bare).or_else(|| self.by_bare_name.get(name))
    }
}

/// A name without a comment behind it, if it has one.
fn without_comment(name: &[u8]) -> Option<&[u8]> {
    let at = name.windows(2).position(|pair| pair[0].is_ascii_whitespace() && pair[1] == b'#')?;
    Some(name[..at].trim_ascii_end()).filter(|bare| !bare.is_empty())
}

/// The material of every use. `overriding`: the definitions of `--materials`.
#[must_use]
pub fn materials_of(
    uses: &[MaterialUse],
    libraries: &[Vec<Library>],
    overriding: Option<&Library>,
    progress: &dyn Progress,
) -> Vec<Material> {
    let is_given = overriding.is_some();
    let overriding = Definitions::of(overriding);
    let defined: Vec<Definitions> = libraries.iter().map(Definitions::of).collect();
    let mut clamped = BTreeMap::new();
    let mut undefined = BTreeSet::new();
    let mut given_is_used = false;
    let materials: Vec<Material> = uses
        .iter()
        .map(|of| {
            let name = of.name.as_deref().unwrap_or_default();
            let given = overriding.get(name).or(overriding.get(b"*"));
            given_is_used |= given.is_some();
            let Some((path, definition)) = given.or(defined[of.file as usize].get(name)) else {
                undefined.extend(of.name.as_deref());
                return Material { rho: Rgb(DEFAULT_KD), exitance: Rgb::BLACK };
            };
            let rho = definition.kd.map(|x| x.min(MAX_RHO));
            if rho != definition.kd {
                clamped.insert(name, (*path, *definition));
            }
            Material { rho: Rgb(rho), exitance: Rgb(definition.ke) * std::f64::consts::PI }
        })
        .collect();
    warn_of_clamped(&clamped, progress);
    if is_given && !given_is_used {
        progress.warn("no face is of a material that `--materials` defines: it changes nothing");
    }
    if let Some(name) = undefined.first() {
        progress.warn(&format!(
            "{} without definition, first `{}`: Kd 0.5 is used",
            plural(undefined.len(), "material"),
            shown_name(name)
        ));
    }
    for (n, first) in defined.iter().chain([&overriding]).map(|d| &d.differing).filter(|d| d.0 > 0) {
        progress.warn(&format!("{} defined again and differently, first {first}", plural(*n, "material")));
    }
    materials
}

fn warn_of_clamped(clamped: &BTreeMap<&[u8], (&Path, &Definition)>, progress: &dyn Progress) {
    let Some((name, (path, definition))) = clamped.iter().next() else { return };
    let [r, g, b] = definition.kd;
    progress.warn(&format!(
        "reflectance of {} clamped to 0..0.99, first `{}` with Kd {r} {g} {b} ({}:{})",
        plural(clamped.len(), "material"),
        shown_name(name),
        shown(path),
        definition.line
    ));
}

/// Says once what the MTL files state and this program ignores or corrects.
pub fn warn_of_oddities<'a>(libraries: impl IntoIterator<Item = &'a Library>, progress: &dyn Progress) {
    let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
    let mut corrected: (u64, Option<&str>) = (0, None);
    for library in libraries {
        for (what, n) in &library.ignored {
            *counts.entry(what).or_default() += n;
        }
        if library.corrected > 0 {
            corrected = (corrected.0 + library.corrected, corrected.1.or(Some(&library.first_corrected)));
        }
    }
    if !counts.is_empty() {
        let list: Vec<_> = counts.iter().map(|(what, n)| format!("{what} of {n}")).collect();
        progress.warn(&format!("ignored in materials: {}", list.join(", ")));
    }
    if let (n, Some(first)) = corrected {
        progress.warn(&format!("{} cannot be, first {first}", plural(n as usize, "colour")));
    }
}

fn plural(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;
    use crate::base::Quiet;
    use crate::formats::mtl;

    struct Heard(Mutex<Vec<String>>);

    impl Progress for Heard {
        fn begin(&self, _phase: &str, _unit: &str, _total: Option<u64>) {}
        fn at(&self, _done: u64) {}
        fn warn(&self, message: &str) {
            self.0.lock().unwrap().push(message.to_owned());
        }
        fn interrupted(&self) -> bool {
            false
        }
    }

    fn library(text: &str) -> Library {
        mtl::parse(text.as_bytes(), Path::new("own.mtl")).unwrap()
    }

    fn uses(names: &[&str]) -> Vec<MaterialUse> {
        names.iter().map(|n| MaterialUse { file: 0, name: Some(n.as_bytes().to_vec()) }).collect()
    }

    #[test]
    fn a_comment_behind_a_name_is_no_part_of_it_where_the_whole_is_no_name() {
        let dir = tempfile::tempdir().unwrap();
        let own = dir.path().join("own.mtl");
        std::fs::write(&own, "newmtl a # one\nKd 0.1 0 0\nnewmtl Material #2\nKd 0.2 0 0\nnewmtl b\nKd 0.3 0 0\n")
            .unwrap();
        let libraries = [vec![mtl::read(&own).unwrap()]];
        let uses: Vec<_> = ["a", "Material #2", "b # two"]
            .iter()
            .map(|n| MaterialUse { file: 0, name: Some(n.as_bytes().to_vec()) })
            .collect();
        let red: Vec<f64> = materials_of(&uses, &libraries, None, &Quiet).iter().map(|m| m.rho.0[0]).collect();
        assert_eq!(red, [0.1, 0.2, 0.3]);
    }

    #[test]
    fn given_materials_replace_those_of_the_same_name_and_the_star_all_others() {
        let libraries = [vec![library("newmtl a\nKd 0.1\nnewmtl b\nKd 0.2\nnewmtl c\nKd 2 0 0\n")]];
        let uses = uses(&["a", "b", "c", "d"]);
        let red = |overriding: Option<&Library>| -> Vec<f64> {
            materials_of(&uses, &libraries, overriding, &Quiet).iter().map(|m| m.rho.0[0]).collect()
        };
        assert_eq!(red(None), [0.1, 0.2, 0.99, 0.5]);
        let mut given = library("newmtl b\nKd 0.7 0 0\nKe 1 1 1\n");
        assert_eq!(red(Some(&given)), [0.1, 0.7, 0.99, 0.5]);
        let lit = materials_of(&uses, &libraries, Some(&given), &Quiet)[1].exitance.0[0];
        assert!((lit - std::f64::consts::PI).abs() < 1e-15, "{lit}");
        given.materials[0].name = b"*".to_vec();
        assert_eq!(red(Some(&given)), [0.7; 4]);
    }
    #[test]
    fn what_is_odd_about_materials_is_said_once_with_file_and_line() {
        let own = library("newmtl a\nKd 0.1\nnewmtl white\x1b\nKd 1\nnewmtl a\nKd 0.2\nnewmtl a\nKd 0.1\nKe -1\nKs 1");
        let heard = Heard(Mutex::default());
        assert_eq!(materials_of(&uses(&["a", "white\x1b", "gone"]), &[vec![own.clone()]], None, &heard).len(), 3);
        warn_of_oddities([&own, &own], &heard);
        let expected = [
            "reflectance of 1 material clamped to 0..0.99, first `white\\u{1b}` with Kd 1 1 1 (own.mtl:3)",
            "1 material without definition, first `gone`: Kd 0.5 is used",
            "1 material defined again and differently, first own.mtl:5: `a` counts as own.mtl:1 defines it",
            "ignored in materials: Ks of 2",
            "2 colours cannot be, first own.mtl:9: `Ke -1 -1 -1` of `a` is taken as 0 0 0",
        ];
        assert_eq!(*heard.0.lock().unwrap(), expected);
    }
}
