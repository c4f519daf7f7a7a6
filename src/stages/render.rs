//! `render`: the solution seen from a camera, smoothly interpolated, as PNG or Radiance HDR.

use std::path::PathBuf;

use glam::DVec3;
use serde::Serialize;

use super::entry;
use super::output::{self, Output};
use super::ray_scene::with_scene;
use super::stored_light::StoredLight;
use super::working_set::WorkingSet;
use crate::base::memory::MemoryBudget;
use crate::base::parallel::{Crew, Turns};
use crate::base::text::shown;
use crate::base::{ClusterId, Error, Progress, Result, Rgb};
use crate::formats::picture::{write_hdr, write_png};
use crate::geom::bounds::Bounds;
use crate::rays::RayScene;
use crate::rays::traverse::Nearest;
use crate::render::camera::{Camera, View};
use crate::render::tone;
use crate::store::{ModelFacts, Store};

/// Rays per pixel and axis.
const GRID: u32 = 2;
/// Bytes that a pixel takes until the picture is written.
const PIXEL_BYTES: u64 = 40;
/// What to draw.
#[derive(Clone, Debug)]
pub struct Options {
    /// `-o`: .png or .hdr.
    pub output: PathBuf,
    /// `--force`.
    pub force: bool,
    /// `--eye` and `--look`, model coordinates; the whole from above if none.
    pub eye_and_look: Option<[[f64; 3]; 2]>,
    /// `--view-up`; the model's vertical if none.
    pub view_up: Option<[f64; 3]>,
    /// `--fov`, degrees.
    pub fov_degrees: f64,
    /// `--size`, pixels.
    pub size: (u32, u32),
    /// `--version`.
    pub version: Option<u64>,
    /// Threads; never changes the picture.
    pub threads: usize,
    /// `--memory`.
    pub memory: MemoryBudget,
}

/// What is going to be drawn.
pub struct Plan<'s> {
    store: &'s Store,
    options: Options,
    facts: ModelFacts,
    camera: Camera,
    is_hdr: bool,
    /// The version.
    pub version: u64,
}

/// What was drawn.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Files.
    pub files: Vec<String>,
    /// The version.
    pub solution_version: u64,
    /// Pixels across and down.
    pub size: (u32, u32),
    /// Share of the pixels in which there is something.
    pub covered: f64,
}

impl super::summary::Summary for Summary {
    fn lines(&self) -> Vec<String> {
        let (width, height) = self.size;
        vec![format!("version {} in {}, {width} x {height} pixels", self.solution_version, self.files.join(", "))]
    }
}

/// Places the camera; refuses to overwrite, and pictures that would not fit in memory.
pub fn plan<'s>(store: &'s Store, options: &Options) -> Result<Plan<'s>> {
    let usage = |message: String, help: &str| Error::Usage { message, help: help.to_owned() };
    let ending = options.output.extension().map(|e| e.to_string_lossy().to_lowercase());
    let is_hdr = match ending.as_deref() {
        Some("png") => false,
        None if options.output.as_os_str() == "-" => false,
        Some("hdr" | "pic") => true,
        _ => {
            return Err(usage(
                format!("{}: no picture format has that ending", shown(&options.output)),
                "end the file name in .png or .hdr",
            ));
        }
    };
    output::check(&options.output, options.force)?;
    let (width, height) = options.size;
    let needed = u64::from(width) * u64::from(height) * PIXEL_BYTES + (32 << 20);
    options.memory.require(&format!("a picture of {width} x {height}"), needed, ", or a smaller `--size`")?;
    let facts = store.facts()?;
    let camera = camera(options, &facts).ok_or_else(|| {
        usage("the camera looks nowhere, or along its up".to_owned(), "give another `--look`, or `--view-up`")
    })?;
    let version = entry::version_to_read(store, options.version)?;
    Ok(Plan { store, options: options.clone(), facts, camera, is_hdr, version })
}

fn vertical(facts: &ModelFacts) -> DVec3 {
    if facts.up == 'y' { DVec3::Y } else { DVec3::Z }
}

fn camera(options: &Options, facts: &ModelFacts) -> Option<Camera> {
    let (width, height) = options.size;
    let aspect = f64::from(width) / f64::from(height);
    let Some(places) = options.eye_and_look else {
        let bounds = Bounds { min: DVec3::from_array(facts.min_m), max: DVec3::from_array(facts.max_m) };
        return Camera::overview(bounds, vertical(facts), aspect);
    };
    let [eye, look] = places.map(|p| (DVec3::from_array(p) - DVec3::from_array(facts.origin)) * facts.metres_per_unit);
    let up = options.view_up.map_or(vertical(facts), DVec3::from_array);
    Camera::new(&View { eye, look, up, fov_degrees: options.fov_degrees, aspect })
}

/// Draws and writes.
pub fn execute(plan: &Plan<'_>, progress: &dyn Progress) -> Result<Summary> {
    let (width, height) = plan.options.size;
    let mut out = Output::create(&plan.options.output, plan.options.force)?;
    let (pixels, covered) = draw(plan, progress)?;
    let written = if plan.is_hdr {
        write_hdr(&pixels, (width, height), &header_lines(&plan.options, &plan.facts), &mut out)
    } else {
        let exposure = tone::exposure(&pixels);
        let bytes: Vec<u8> = pixels.iter().flat_map(|p| tone::display(*p, exposure)).collect();
        write_png(&bytes, (width, height), tone::NAME, &mut out)
    };
    written.map_err(|e| Error::io(&plan.options.output, &e))?;
    out.finish()?;
    Ok(Summary {
        files: vec![shown(&plan.options.output)],
        solution_version: plan.version,
        size: plan.options.size,
        covered: covered as f64 / f64::from(width * height),
    })
}

/// What a Radiance picture says of itself.
fn header_lines(options: &Options, facts: &ModelFacts) -> Vec<String> {
    let mut lines = vec!["# radiance in W/(m2 sr)".to_owned(), "EXPOSURE=1".to_owned()];
    if let Some([eye, look]) = options.eye_and_look {
        let along: [f64; 3] = std::array::from_fn(|i| look[i] - eye[i]);
        let text = |v: [f64; 3]| format!("{} {} {}", v[0], v[1], v[2]);
        let (width, height) = options.size;
        let half = libm::tan(0.5 * options.fov_degrees.to_radians());
        let across = 2.0 * libm::atan(half * f64::from(width) / f64::from(height)).to_degrees();
        let up = options.view_up.unwrap_or(vertical(facts).to_array());
        lines.push(format!(
            "VIEW=-vtv -vp {} -vd {} -vu {} -vh {across} -vv {}",
            text(eye),
            text(along),
            text(up),
            options.fov_degrees
        ));
    }
    lines
}

struct Row {
    pixels: Vec<[f32; 3]>,
    covered: u64,
}

/// All pixels, row by row, drawn by several threads, and the rays that met something.
fn draw(plan: &Plan<'_>, progress: &dyn Progress) -> Result<(Vec<[f32; 3]>, u64)> {
    let (width, height) = plan.options.size;
    // Each thread opens the store for itself; of the plan they share the rest.
    let (options, camera, version) = (&plan.options, &plan.camera, plan.version);
    let (dir, wait) = (plan.store.dir().to_path_buf(), plan.store.wait());
    progress.begin("draw", "rows", Some(u64::from(height)));
    let work = |turns: &Turns<'_, Row>| {
        let store = Store::open(&dir, wait)?;
        let set = WorkingSet::open(&store, version)?;
        with_scene(&set, |open| {
            let mut eye = Eye::new(&set, open.scene, options);
            turns.each(|y| {
                let row = eye.row(camera, y as u32, (width, height));
                open.look.verdict()?;
                row
            })
        })
    };
    let (mut pixels, mut covered) = (Vec::with_capacity(width as usize * height as usize), 0);
    Crew { threads: options.threads, progress }.in_order(height as usize, work, |_, row| {
        pixels.extend(row.pixels);
        covered += row.covered;
        Ok(())
    })?;
    Ok((pixels, covered))
}

/// Looks up the light where rays meet the model.
struct Eye<'a, 's> {
    scene: RayScene<'a>,
    light: StoredLight<'a, 's>,
}

impl<'a, 's> Eye<'a, 's> {
    fn new(set: &'a WorkingSet<'s>, scene: RayScene<'a>, options: &Options) -> Self {
        let limit_bytes = options.memory.limit_bytes / 8 / options.threads.max(1) as u64;
        Self { scene, light: StoredLight::new(set, limit_bytes as usize) }
    }

    fn row(&mut self, camera: &Camera, y: u32, (width, height): (u32, u32)) -> Result<Row> {
        let mut row = Row { pixels: Vec::with_capacity(width as usize), covered: 0 };
        for x in 0..width {
            let (mut sum, mut met) = (Rgb::BLACK, false);
            for i in 0..GRID * GRID {
                let at = |pixel: u32, step: u32, size: u32| {
                    (f64::from(pixel) + (f64::from(step) + 0.5) / f64::from(GRID)) / f64::from(size)
                };
                let (from, along) = camera.ray(at(x, i % GRID, width), at(y, i / GRID, height));
                if let Nearest::Met(hit) = self.scene.nearest(from, along, None) {
                    sum += self.light.radiosity(ClusterId(hit.key.cluster), hit.side(), from + along * hit.t)?;
                    met = true;
                }
            }
            let scale = 1.0 / (f64::from(GRID * GRID) * std::f64::consts::PI);
            row.pixels.push((sum * scale).to_f32());
            row.covered += u64::from(met);
        }
        Ok(row)
    }
}
