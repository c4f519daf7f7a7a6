//! `building`: writes a parametric office building, one OBJ with its MTL a floor.
//!
//! `plan` says where things are, `floor` goes through its units, each of which draws on a `canvas`, which writes. Nothing
//! of a floor is held, and what a floor holds follows from the options and its number alone.

mod args;
mod atrium;
mod canvas;
mod corridor;
mod floor;
mod furniture;
mod lamp;
mod material;
mod obj;
mod place;
mod plan;
mod random;
mod room;
mod stairs;
mod wall;

use std::fs;
use std::path::Path;
use std::process::ExitCode;

use clerestory::base::text::{for_shell, shown};
use clerestory::base::{Error, Result};
use clerestory::cli::tool::{self, print};
use serde::Serialize;

use self::args::{Args, Size};
use self::floor::Level;
use self::obj::{Counts, Obj};
use self::plan::Plan;

/// What was written.
#[derive(Serialize)]
struct Summary {
    floors: usize,
    rooms: usize,
    #[serde(flatten)]
    counts: Counts,
    next: String,
}

fn main() -> ExitCode {
    tool::run("building", |args: &Args| write(args).and_then(|summary| tell(&summary, args.json)))
}

fn write(args: &Args) -> Result<Summary> {
    let Size { floors, rooms_per_floor, is_furnished } = args.size();
    make_folder(&args.output)?;
    let plan = Plan::with_rooms(rooms_per_floor);
    let mut counts = Counts::default();
    for number in 0..floors {
        let (is_ground, is_top) = (number == 0, number + 1 == floors);
        let level = Level { number, is_ground, is_top, is_furnished, seed: args.seed };
        counts += write_floor(&args.output, args.units.per_m(), &plan, level)?;
    }
    let folder = for_shell(&args.output);
    let units = args.units.flag();
    let next = format!("clerestory ingest {folder}.clr {folder}/*.obj{units}");
    Ok(Summary { floors, rooms: floors * rooms_per_floor, counts, next })
}

fn make_folder(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).map_err(|e| Error::io(folder, &e))?;
    let mut entries = fs::read_dir(folder).map_err(|e| Error::io(folder, &e))?;
    match entries.next() {
        None => Ok(()),
        // Floors of another building among these would be ingested with them.
        Some(_) => Err(Error::failed(format!("{}: not empty", shown(folder)), "name a new folder, or an empty one")),
    }
}

fn write_floor(folder: &Path, units_per_m: f64, plan: &Plan, level: Level) -> Result<Counts> {
    let name = format!("floor_{:03}", level.number + 1);
    let (library, materials) = (folder.join(format!("{name}.mtl")), material::library());
    fs::write(&library, &materials).map_err(|e| Error::io(&library, &e))?;
    let obj = Obj::create(&folder.join(format!("{name}.obj")), &format!("{name}.mtl"), units_per_m)?;
    let mut counts = floor::draw(obj, plan, level)?;
    counts.bytes += materials.len() as u64;
    Ok(counts)
}

fn tell(summary: &Summary, as_json: bool) -> Result<()> {
    if as_json {
        let text = serde_json::to_string_pretty(summary).expect("a summary has no keys but strings");
        return print(&format!("{text}\n"));
    }
    let Summary { floors, rooms, counts, next } = summary;
    print(&format!(
        "{floors} floors, {rooms} rooms: {} patches in {} clusters, {} emitting, {:.1} m2; {:.1} MB\nNext: {next}\n",
        counts.patches,
        counts.clusters,
        counts.emitters,
        counts.area_m2,
        counts.bytes as f64 * 1e-6
    ))
}
