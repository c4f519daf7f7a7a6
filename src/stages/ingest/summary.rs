//! What an ingest found, for people and scripts.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Options;
use super::rerun::Recipe;
use crate::base::Result;
use crate::base::text::for_shell;
use crate::stages::summary;
use crate::store::{Stage, Store};

/// What an ingest found.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Patches.
    pub patches: u64,
    /// Patches before contact lines cut them.
    pub patches_uncut: u64,
    /// Clusters.
    pub clusters: u64,
    /// Emitting patches, uncut.
    pub emitters: u64,
    /// Area, each patch once, m2.
    pub area_m2: f64,
    /// `f` records read.
    pub input_polygons: u64,
    /// Cuts along contact lines: cause -> count.
    pub pieces: BTreeMap<&'static str, u64>,
    /// The face that fell into most pieces; `None` where nothing was cut this time.
    pub most_pieces: Option<MostPieces>,
    /// Faces left out: cause -> count.
    pub skipped: BTreeMap<String, u64>,
    /// Bounding box in model axes, m: smallest corner, largest corner.
    pub bounds_m: [[f64; 3]; 2],
    /// The vertical.
    pub up: char,
    /// Whether what speaks for it is clear, or it was given.
    pub up_is_sure: bool,
    /// Nothing had to be done.
    pub unchanged: bool,
    /// Version that opened a branch with new materials, if that is what was done.
    pub materials_version: Option<u64>,
    /// The command to type next.
    pub next: String,
}

/// A face in many pieces.
#[derive(Clone, Debug, Serialize)]
pub struct MostPieces {
    /// Input file and line.
    pub face: String,
    /// How many.
    pub pieces: u32,
}

impl summary::Summary for Summary {
    fn lines(&self) -> Vec<String> {
        let [low, high] = self.bounds_m;
        let size: Vec<String> = (0..3).map(|i| format!("{:.2}", high[i] - low[i])).collect();
        let skipped: u64 = self.skipped.values().sum();
        let mut lines = vec![
            format!(
                "{} patches ({} emitting) of {} polygons in {} clusters, {:.1} m2; {skipped} faces skipped",
                self.patches, self.emitters, self.input_polygons, self.clusters, self.area_m2
            ),
            format!("{} m, {}", size.join(" x "), vertical_line(self.up, self.up_is_sure)),
        ];
        let cuts: u64 = self.pieces.values().sum();
        if cuts > 0 {
            let causes: Vec<String> = self.pieces.iter().map(|(cause, n)| format!("{n} {cause}")).collect();
            let most =
                self.most_pieces.as_ref().map_or_else(String::new, |m| format!("; most: {}, {}", m.pieces, m.face));
            let (uncut, causes) = (self.patches_uncut, causes.join(", "));
            lines.push(format!("contact lines cut {uncut} faces into {} patches ({causes}{most})", self.patches));
        }
        if self.unchanged {
            lines.push("Nothing has changed since the last ingest.".to_owned());
        }
        if let Some(version) = self.materials_version {
            lines.push(format!("Only materials have changed: version {version} opens a new branch."));
        }
        lines
    }
}

/// The vertical of a store's model, and whether it is sure.
pub fn vertical(store: &Store) -> Result<(char, bool)> {
    let recipe = store.stage(Stage::Ingest)?.and_then(|record| serde_json::from_str::<Recipe>(&record.options).ok());
    Ok((store.facts()?.up, recipe.is_none_or(|recipe| recipe.up_is_sure)))
}

/// The vertical as people read it.
#[must_use]
pub fn vertical_line(up: char, is_sure: bool) -> String {
    let other = if up == 'z' { 'y' } else { 'z' };
    let doubt =
        if is_sure { String::new() } else { format!(", but that is not sure: if it is {other}, give `--up {other}`") };
    format!("up is {up}{doubt}")
}

/// Why contact lines cut faces.
const CAUSES: [&str; 3] = ["crossing", "contact", "outline"];

/// Of what the store holds now.
pub(super) fn of(options: &Options, store: &Store, skipped: BTreeMap<String, u64>) -> Result<Summary> {
    let facts = store.facts()?;
    let (up, up_is_sure) = vertical(store)?;
    // To the micrometre: stored coordinates are f32.
    let micro = |x: f64| (x * 1e6).round() / 1e6;
    let corner = |at: [f64; 3]| std::array::from_fn(|i| micro(at[i] + facts.origin[i] * facts.metres_per_unit));
    Ok(Summary {
        patches: facts.patches,
        patches_uncut: facts.patches_uncut,
        clusters: facts.clusters,
        emitters: facts.emitters,
        area_m2: facts.area_m2,
        input_polygons: facts.input_polygons,
        pieces: CAUSES.into_iter().zip(facts.cuts).collect(),
        most_pieces: None,
        skipped,
        bounds_m: [corner(facts.min_m), corner(facts.max_m)],
        up,
        up_is_sure,
        unchanged: false,
        materials_version: None,
        next: format!("clerestory visibility {}", for_shell(&options.store)),
    })
}
