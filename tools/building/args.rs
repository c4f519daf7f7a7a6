//! The command line.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};

use super::plan::LEAST_ROOMS;

const EXAMPLES: &str = "\
Presets, both of 50 rooms a floor:
  soda-floor  one floor without furniture, as large as the floor that the papers measured on
  soda-5      five furnished floors, as large as the papers' largest building

Examples:
  building -o office --floors 2 --rooms-per-floor 12 --furnished
  building -o soda --preset soda-5 && clerestory ingest soda.clr soda/*.obj";

/// Write an office building as OBJ, one file with its MTL a floor
#[derive(Parser)]
#[command(name = "building", version, after_help = EXAMPLES)]
pub struct Args {
    /// Folder for the files, new or empty
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// A building of a known size
    #[arg(long, value_name = "NAME", conflicts_with_all = ["floors", "rooms_per_floor", "furnished"])]
    preset: Option<Preset>,
    /// Floors, 1 to 999
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = within(1, 999))]
    floors: u64,
    /// Rooms of each floor, 6 to 1000
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = within(LEAST_ROOMS as u64, 1000))]
    rooms_per_floor: u64,
    /// Furnish the rooms, and light them by luminaires of seven cells instead of plain panels
    #[arg(long)]
    furnished: bool,
    /// What furniture looks like and how chairs are turned follows from it
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Units of the files
    #[arg(long, default_value = "m")]
    pub units: Units,
    /// Print what was written as a JSON document
    #[arg(long)]
    pub json: bool,
}

fn within(least: u64, most: u64) -> clap::builder::RangedU64ValueParser {
    clap::value_parser!(u64).range(least..=most)
}

/// A building of a known size.
#[derive(Clone, Copy, ValueEnum)]
enum Preset {
    SodaFloor,
    #[value(name = "soda-5")]
    Soda5,
}

/// What is to be built.
pub struct Size {
    /// How many.
    pub floors: usize,
    /// On each of them.
    pub rooms_per_floor: usize,
    /// Furniture, and luminaires.
    pub is_furnished: bool,
}

impl Args {
    /// What is to be built.
    #[must_use]
    pub fn size(&self) -> Size {
        let (floors, rooms_per_floor, is_furnished) = match self.preset {
            Some(Preset::SodaFloor) => (1, 50, false),
            Some(Preset::Soda5) => (5, 50, true),
            None => (self.floors as usize, self.rooms_per_floor as usize, self.furnished),
        };
        Size { floors, rooms_per_floor, is_furnished }
    }
}

/// A unit of length.
#[derive(Clone, Copy, ValueEnum)]
pub enum Units {
    /// Inches
    In,
    /// Metres
    M,
}

impl Units {
    /// How many a metre has.
    #[must_use]
    pub fn per_m(self) -> f64 {
        match self {
            Self::In => 1.0 / 0.0254,
            Self::M => 1.0,
        }
    }

    /// What `ingest` must be told.
    #[must_use]
    pub fn flag(self) -> &'static str {
        match self {
            Self::In => " --units in",
            Self::M => "",
        }
    }
}
