//! What is true of the whole model: one row, written by ingest.

use rusqlite::{Connection, OptionalExtension, named_params};

use super::{ExtentRef, Store};
use crate::base::text::{for_shell, shown};
use crate::base::{Error, Result};

/// The model as a whole. Stored coordinates are metres from `origin`.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelFacts {
    /// Origin of the stored coordinates, in model units.
    pub origin: [f64; 3],
    /// Metres per model unit.
    pub metres_per_unit: f64,
    /// The vertical: 'y' or 'z'.
    pub up: char,
    /// Smallest corner of the bounding box, m from the origin.
    pub min_m: [f64; 3],
    /// Largest corner.
    pub max_m: [f64; 3],
    /// Faces this near coincide, m.
    pub snap_m: f64,
    /// Whether surfaces reflect on both sides (`--sides both`).
    pub both_sides: bool,
    /// Whether emitters shine both ways (`--emit both`).
    pub emit_both: bool,
    /// Patches.
    pub patches: u64,
    /// Patches before contact lines cut them.
    pub patches_uncut: u64,
    /// Cuts where faces cross, where one ends near another, and along outlines of faces in one plane.
    pub cuts: [u64; 3],
    /// Clusters.
    pub clusters: u64,
    /// Emitting patches, uncut.
    pub emitters: u64,
    /// `f` records read.
    pub input_polygons: u64,
    /// Area, each patch once, m2.
    pub area_m2: f64,
    /// Square of a typical patch's width, m2.
    pub mean_patch_area_m2: f64,
    /// Power emitted, W.
    pub emitted_w: [f64; 3],
    /// Area-weighted mean reflectance over channels and sides.
    pub mean_reflectance: f64,
    /// Largest reflectance of any side and channel.
    pub max_reflectance: f64,
    /// The top extent of the ray structure.
    pub rays_top: ExtentRef,
}

impl ModelFacts {
    /// Length of the diagonal of the bounding box, m.
    #[must_use]
    pub fn diagonal_m(&self) -> f64 {
        (0..3).map(|i| (self.max_m[i] - self.min_m[i]).powi(2)).sum::<f64>().sqrt()
    }

    pub(super) fn insert(&self, tx: &Connection) -> Result<()> {
        let [xr, yr, zr] = self.origin;
        tx.execute(
            "INSERT OR REPLACE INTO model VALUES (1, :ox, :oy, :oz, :unit, :up, :x0, :y0, :z0, :x1, :y1, :z1, :snap,
                :sides, :emit, :patches, :uncut, :crossings, :contacts, :outlines, :clusters, :emitters, :polygons, :area, :patch_area, :er, :eg, :eb,
                :mean_rho, :max_rho, :segment, :offset, :bytes)",
            named_params! {
                ":ox": xr, ":oy": yr, ":oz": zr, ":unit": self.metres_per_unit, ":up": self.up.to_string(),
                ":x0": self.min_m[0], ":y0": self.min_m[1], ":z0": self.min_m[2],
                ":x1": self.max_m[0], ":y1": self.max_m[1], ":z1": self.max_m[2],
                ":snap": self.snap_m, ":sides": if self.both_sides { "both" } else { "front" },
                ":emit": if self.emit_both { "both" } else { "front" },
                ":patches": self.patches, ":uncut": self.patches_uncut, ":crossings": self.cuts[0],
                ":contacts": self.cuts[1], ":outlines": self.cuts[2], ":clusters": self.clusters, ":emitters": self.emitters,
                ":polygons": self.input_polygons, ":area": self.area_m2, ":patch_area": self.mean_patch_area_m2,
                ":er": self.emitted_w[0], ":eg": self.emitted_w[1], ":eb": self.emitted_w[2],
                ":mean_rho": self.mean_reflectance, ":max_rho": self.max_reflectance,
                ":segment": self.rays_top.segment, ":offset": self.rays_top.offset, ":bytes": self.rays_top.bytes,
            },
        )?;
        Ok(())
    }
}

impl Store {
    /// What ingest found; `None` before it.
    pub fn facts_if_any(&self) -> Result<Option<ModelFacts>> {
        self.read(|| {
            self.require_sealed("model")?;
            self.facts_row()
        })
    }

    fn facts_row(&self) -> Result<Option<ModelFacts>> {
        let mut query = self.connection().prepare_cached("SELECT * FROM model")?;
        let row = query.query_row([], |row| {
            let triple =
                |first: usize| Ok::<_, rusqlite::Error>([row.get(first)?, row.get(first + 1)?, row.get(first + 2)?]);
            let text = |column: &str| row.get::<_, String>(column);
            Ok(ModelFacts {
                origin: triple(1)?,
                metres_per_unit: row.get("metres_per_unit")?,
                up: if text("up")? == "y" { 'y' } else { 'z' },
                min_m: triple(6)?,
                max_m: triple(9)?,
                snap_m: row.get("snap_m")?,
                both_sides: text("sides")? == "both",
                emit_both: text("emit")? == "both",
                patches: row.get("patches")?,
                patches_uncut: row.get("patches_uncut")?,
                cuts: [row.get("crossings")?, row.get("contacts")?, row.get("outlines")?],
                clusters: row.get("clusters")?,
                emitters: row.get("emitters")?,
                input_polygons: row.get("input_polygons")?,
                area_m2: row.get("area_m2")?,
                mean_patch_area_m2: row.get("mean_patch_area_m2")?,
                emitted_w: triple(25)?,
                mean_reflectance: row.get("mean_reflectance")?,
                max_reflectance: row.get("max_reflectance")?,
                rays_top: ExtentRef::from_row(row, 30)?,
            })
        });
        Ok(row.optional()?)
    }

    /// What ingest found; exit code 13 before it.
    pub fn facts(&self) -> Result<ModelFacts> {
        self.facts_if_any()?.ok_or_else(|| self.has_no_model())
    }

    pub(super) fn has_no_model(&self) -> Error {
        Error::StageMissing {
            message: format!("{}: no model in this store", shown(self.dir())),
            help: format!("run `clerestory ingest {} MODEL.obj` first", for_shell(self.dir())),
        }
    }
}
