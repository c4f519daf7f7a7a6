//! `sample`: irradiance and lux at sensor points, on surfaces and in the open.

use std::io::Write;
use std::path::Path;

use glam::DVec3;
use serde::Serialize;

use super::point_light::PointLight;
use super::ray_scene::{OpenScene, with_scene};
use super::stored_light::StoredLight;
use super::working_set::WorkingSet;
use crate::base::{ClusterId, Error, PatchSide, Progress, Result, Rgb, lux};
use crate::formats::points::SensorPoint;
use crate::rays::locate::Place;
use crate::store::{ModelFacts, Store};

/// How to sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// `--version`; the newest if none.
    pub version: Option<u64>,
    /// `--snap`, m; that of ingest if none.
    pub snap_m: Option<f64>,
    /// `--stored`.
    pub is_stored: bool,
    /// `--tolerance`; that of the version if none.
    pub tolerance: Option<f64>,
}

/// What came out.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Points read.
    pub points: u64,
    /// Points with an answer.
    pub answered: u64,
    /// Those of them on no surface.
    pub free: u64,
    /// Points without one: what is stored says nothing of those on no surface.
    pub unanswered: u64,
}

/// Where nobody has solved yet.
const DEFAULT_TOLERANCE: f64 = 0.02;

/// Bytes of stored light that are held.
const HELD_BYTES: usize = 32 << 20;

/// Header of the result.
pub const HEADER: &str = "x,y,z,nx,ny,nz,irradiance_r_w_m2,irradiance_g_w_m2,irradiance_b_w_m2,illuminance_lx";

/// Reads points one by one and writes a line for each, in the same order.
pub fn execute(
    store: &Store,
    options: &Options,
    points: &mut dyn Iterator<Item = Result<SensorPoint>>,
    out: &mut dyn Write,
    progress: &dyn Progress,
) -> Result<Summary> {
    let version = options.version.map_or_else(|| store.newest_iteration_end(), Ok)?;
    let set = WorkingSet::open(store, version)?;
    let facts = store.facts()?;
    let branch = store.version(version)?.map_or(0, |row| row.branch);
    let of_version = store.options_of_branch(branch)?.map_or(DEFAULT_TOLERANCE, |options| options.tolerance);
    let tolerance = options.tolerance.unwrap_or(of_version);
    let snap_m = options.snap_m.unwrap_or(facts.snap_m);
    with_scene(&set, |open| {
        let (mut measured, mut stored) =
            (PointLight::new(&set, open.scene, tolerance), StoredLight::new(&set, HELD_BYTES));
        let mut light = |place: Option<Place>, point: DVec3, normal: DVec3| match (place, options.is_stored) {
            (Some(place), true) => {
                let side = PatchSide { patch: place.key.patch as u8, side: place.side };
                stored.irradiance(ClusterId(place.key.cluster), side, point).map(Some)
            }
            (None, true) => Ok(None),
            (Some(place), false) => measured.on(place, point).map(Some),
            (None, false) => measured.free(point, normal).map(Some),
        };
        answer(open, &mut light, (&facts, snap_m), points, out, progress)
    })
}

fn answer(
    open: &OpenScene<'_>,
    light: &mut dyn FnMut(Option<Place>, DVec3, DVec3) -> Result<Option<Rgb>>,
    (facts, snap_m): (&ModelFacts, f64),
    points: &mut dyn Iterator<Item = Result<SensorPoint>>,
    out: &mut dyn Write,
    progress: &dyn Progress,
) -> Result<Summary> {
    let mut summary = Summary::default();
    let io = |e: std::io::Error| Error::io(Path::new("the answers"), &e);
    writeln!(out, "{HEADER}").map_err(io)?;
    progress.begin("sample", "points", None);
    for point in points {
        let point = point?;
        progress.go_on()?;
        let origin = DVec3::from_array(facts.origin);
        let at = (DVec3::from_array(point.position) - origin) * facts.metres_per_unit;
        // Scaled first: squares of what is very short or long are 0 or infinite.
        let normal = DVec3::from_array(point.normal);
        let normal = (normal / normal.abs().max_element()).normalize_or_zero();
        summary.points += 1;
        let [x, y, z] = point.position;
        let [nx, ny, nz] = point.normal;
        let place = open.scene.locate(at, normal, snap_m);
        let answer = light(place, at, normal);
        open.look.verdict()?;
        let answer = match answer? {
            Some(irradiance) => {
                summary.answered += 1;
                summary.free += u64::from(place.is_none());
                let irradiance = Rgb::from_f32(irradiance.to_f32());
                let [r, g, b] = irradiance.to_f32();
                format!("{r},{g},{b},{}", lux(irradiance) as f32)
            }
            None => {
                summary.unanswered += 1;
                ",,,".to_owned()
            }
        };
        writeln!(out, "{x},{y},{z},{nx},{ny},{nz},{answer}").map_err(io)?;
        progress.at(summary.points);
    }
    Ok(summary)
}
