//! The command line.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};
use clerestory::cli::args::ScheduleFlags;
use clerestory::cli::values::{seconds, size};

const EXAMPLES: &str = "\
Speedup is the time of all tasks over that of the replay; linear is one of P for P workers.
A task reads the clusters that its group sees and the links of its group: a worker gets
geometry once, light when it has changed, and links unless it solved the group last.
Nothing is solved, and nothing of the store changes.

The next bottleneck is what workers lose most time to:
  longest group              a group that takes longer than the mean worker has to do
  end-of-iteration idle      waiting for the last worker where tasks could be shared out better
  bandwidth, latency         downloads and uploads
  master                     waiting until it has served others
  merge                      waiting until it has merged an iteration
  none                       less than a thousandth is lost to any of them

Examples:
  simulate office.clr
  simulate office.clr --workers 8,64 --schedule ffd --csv ffd.csv
  simulate office.clr --master sync --bandwidth 1M --latency 0.01    # as in the paper
  simulate office.clr --workers 8 --timeline tasks.csv               # who does what when";

/// Replay a run's recorded tasks for any number of workers
#[derive(Parser)]
#[command(name = "simulate", version, after_help = EXAMPLES)]
pub struct Args {
    /// A store that has been solved
    #[arg(value_name = "STORE")]
    pub store: PathBuf,
    /// Numbers of workers, each 1 to 1024
    #[arg(long, value_name = "P,...", value_delimiter = ',', value_parser = clap::value_parser!(u16).range(1..=1024),
          default_value = "1,2,4,8,16,32,64,128,256,512,1024")]
    pub workers: Vec<u16>,
    /// Who waits for data to move
    #[arg(long, default_value = "async")]
    pub master: Master,
    /// Bytes that the master sends in a second, and as many that it receives, e.g. 100M [default: no limit]
    #[arg(long, value_name = "BYTES_PER_S", value_parser = bandwidth)]
    pub bandwidth: Option<u64>,
    /// Seconds before the first byte of a download or upload arrives
    #[arg(long, value_name = "S", value_parser = time_s, default_value = "0")]
    pub latency: f64,
    /// Seconds that the master merges after each iteration, while all wait
    #[arg(long, value_name = "S", value_parser = time_s, default_value = "0")]
    pub merge: f64,
    /// Which time of a task counts
    #[arg(long, default_value = "wall")]
    pub time: Time,
    /// Print what was found as a JSON document
    #[arg(long)]
    pub json: bool,
    /// Write the table to a file as well
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write what each worker does when, of the last of --workers, to a file: a line a task, times in s
    #[arg(long, value_name = "FILE")]
    pub timeline: Option<PathBuf>,
    #[command(flatten)]
    pub schedule: ScheduleFlags,
}

/// How data moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Master {
    /// The master serves one worker at a time, and others wait, as in the paper
    Sync,
    /// Transfers share the line alone, and uploads go on behind the next task
    Async,
}

/// A time of a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Time {
    /// From its claim to its publication: with the waits for disk, and for cores that others use
    Wall,
    /// Of the processor, in steps of 10 ms
    Cpu,
}

fn bandwidth(text: &str) -> Result<u64, String> {
    match size(text)? {
        0 => Err("give at least a byte a second".to_owned()),
        bytes => Ok(bytes),
    }
}

fn time_s(text: &str) -> Result<f64, String> {
    seconds(text).map(|time| time.as_secs_f64())
}
