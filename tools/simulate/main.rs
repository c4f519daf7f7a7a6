//! `simulate`: how long a recorded run would have taken on other numbers of workers, and what would have kept them.
//!
//! `recording` reads a store, `replay` goes through its tasks with the real policy, `fleet` keeps what workers hold,
//! `line` what moving it takes, and `outcome` names what costs most. The same store and options give the same numbers.

mod args;
mod fleet;
mod line;
mod outcome;
mod recording;
mod replay;

use std::path::Path;
use std::process::ExitCode;

use clerestory::base::{Error, Result};
use clerestory::cli::drawing::{bytes, span, thousands};
use clerestory::cli::tool::{self, print};
use serde::Serialize;

use self::args::Args;
use self::line::Costs;
use self::outcome::Row;
use self::recording::Recording;
use self::replay::{Settings, replay, timeline};

/// What was found.
#[derive(Serialize)]
struct Summary {
    iterations: usize,
    groups: usize,
    tasks: usize,
    work_s: f64,
    replays: Vec<Row>,
}

fn main() -> ExitCode {
    tool::run("simulate", simulate)
}

fn simulate(args: &Args) -> Result<()> {
    let recording = Recording::read(&args.store, args.time)?;
    let costs = Costs { bandwidth: args.bandwidth, latency_s: args.latency };
    let settings = Settings { policy: args.schedule.policy(), master: args.master, costs, merge_s: args.merge };
    let replays = args.workers.iter().map(|&workers| replay(&recording, settings, workers.into()).row());
    let summary = Summary {
        iterations: recording.iterations.len(),
        groups: recording.groups.len(),
        tasks: recording.tasks(),
        work_s: recording.work_s(),
        replays: replays.collect(),
    };
    if let Some(file) = &args.csv {
        write_csv(file, &summary.replays)?;
    }
    if let (Some(file), Some(&workers)) = (&args.timeline, args.workers.last()) {
        write_csv(file, &timeline(&recording, settings, workers.into()))?;
    }
    if args.json {
        let text = serde_json::to_string_pretty(&summary).expect("a summary has no keys but strings");
        return print(&format!("{text}\n"));
    }
    print(&table(&summary))
}

fn table(summary: &Summary) -> String {
    let mut text = format!(
        "{} tasks of {} groups in {} iterations, {} of work\n",
        thousands(summary.tasks as u64),
        thousands(summary.groups as u64),
        summary.iterations,
        span(summary.work_s)
    );
    text += "workers    makespan  speedup  of linear    download  transfer  waiting  end idle  master busy  next bottleneck\n";
    for row in &summary.replays {
        text += &format!(
            "{:>7}  {:>10}  {:>7.2}  {:>7.1} %  {:>10}  {:>6.1} %  {:>5.1} %  {:>6.1} %  {:>9.1} %  {}\n",
            row.workers,
            span(row.makespan_s),
            row.speedup,
            100.0 * row.share_of_linear,
            bytes(row.download_bytes),
            100.0 * row.transfer_share,
            100.0 * row.waiting_share,
            100.0 * row.end_idle_share,
            100.0 * row.master_busy_share,
            row.next_bottleneck
        );
    }
    text
}

fn write_csv(file: &Path, rows: &[impl Serialize]) -> Result<()> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row).expect("numbers and names always serialise");
    }
    let text = writer.into_inner().expect("memory takes all");
    std::fs::write(file, text).map_err(|e| Error::io(file, &e))
}
