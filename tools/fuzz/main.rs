//! Throws broken input at every reader: `cargo run --release --example fuzz -- [--inputs N] [--target NAME]
//! [--seed S] [--replay INPUT]`.
//!
//! Inputs are mutations of a small corpus that the driver makes itself; each follows from seed, target and
//! number alone, so that what is reported can be run again by itself. A reader may refuse what it likes; it
//! may not panic, and not take longer than ten seconds. Exit code 1 if one did.

mod corpus;
mod mutate;
mod targets;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use self::mutate::Random;
use self::targets::Target;

/// An input that takes longer than this hangs.
const LONGEST: Duration = Duration::from_secs(10);
/// Panics that are shown of a target.
const SHOWN: u64 = 3;

/// Number of the input at work, and when it began, in ms from the start; for the watchdog.
static INPUT: AtomicU64 = AtomicU64::new(0);
static BEGUN_MS: AtomicU64 = AtomicU64::new(u64::MAX);
/// Where the last panic was.
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());
static TARGET: Mutex<&str> = Mutex::new("");

struct Options {
    inputs: u64,
    seed: u64,
    target: Option<String>,
    replay: Option<u64>,
}

fn options() -> Result<Options, String> {
    let mut options = Options { inputs: 20_000, seed: 1, target: None, replay: None };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or(format!("{word} needs a value"))?;
        let number = || value.parse().map_err(|_| format!("{word} {value}: not a number"));
        match word.as_str() {
            "--inputs" => options.inputs = number()?,
            "--seed" => options.seed = number()?,
            "--replay" => options.replay = Some(number()?),
            "--target" => options.target = Some(value),
            _ => return Err(format!("{word}: unknown; --inputs, --seed, --target and --replay are known")),
        }
    }
    Ok(options)
}

fn main() -> ExitCode {
    let options = match options() {
        Ok(options) => options,
        Err(why) => {
            eprintln!("error: {why}");
            return ExitCode::from(2);
        }
    };
    std::panic::set_hook(Box::new(|info| {
        *LAST_PANIC.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = info.to_string();
    }));
    watch(Instant::now(), options.seed);
    let mut panics = 0;
    let all = targets::all();
    let is_chosen = |t: &&Target| options.target.as_ref().is_none_or(|name| name == t.name);
    if !all.iter().any(|t| is_chosen(&t)) {
        let names: Vec<&str> = all.iter().map(|t| t.name).collect();
        eprintln!("error: no such target; there are {}", names.join(", "));
        return ExitCode::from(2);
    }
    for target in all.iter().filter(is_chosen) {
        panics += run(target, &options);
    }
    ExitCode::from(u8::from(panics > 0))
}

/// Ends the program when an input hangs.
fn watch(start: Instant, seed: u64) {
    CLOCK.get_or_init(|| start);
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(Duration::from_millis(500));
            let begun = BEGUN_MS.load(Ordering::Acquire);
            if now_ms().saturating_sub(begun) > LONGEST.as_millis() as u64 {
                let target = *TARGET.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                let input = INPUT.load(Ordering::Acquire);
                eprintln!("{target}: HANG: over {LONGEST:?}; --seed {seed} --target {target} --replay {input}");
                std::process::exit(1);
            }
        }
    });
}

static CLOCK: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();

fn now_ms() -> u64 {
    CLOCK.get().map_or(0, |start| start.elapsed().as_millis() as u64)
}

/// Runs one target; how many of its inputs panicked.
fn run(target: &Target, options: &Options) -> u64 {
    *TARGET.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = target.name;
    let started = Instant::now();
    let (mut panics, mut read, mut slowest) = (0, 0, Duration::ZERO);
    let numbers = options.replay.map_or(0..options.inputs, |n| n..n + 1);
    for number in numbers.clone() {
        let input = mutate::input(target, &mut Random::new(options.seed, target.name, number));
        INPUT.store(number, Ordering::Release);
        BEGUN_MS.store(now_ms(), Ordering::Release);
        let begun = Instant::now();
        match catch_unwind(AssertUnwindSafe(|| (target.read)(&input))) {
            Ok(understood) => read += u64::from(understood),
            Err(_) => {
                panics += 1;
                if panics <= SHOWN {
                    let why = LAST_PANIC.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clone();
                    let (seed, name) = (options.seed, target.name);
                    eprintln!("{name}: PANIC: {why}\n  --seed {seed} --target {name} --replay {number}");
                    eprintln!("  {}", input.escape_ascii());
                }
            }
        }
        slowest = slowest.max(begun.elapsed());
    }
    BEGUN_MS.store(u64::MAX, Ordering::Release);
    println!(
        "{:<12} {} inputs, {read} read to the end, {panics} panics, 0 hangs, {:.1} s, slowest {:.1} ms",
        target.name,
        numbers.end - numbers.start,
        started.elapsed().as_secs_f64(),
        1e3 * slowest.as_secs_f64()
    );
    panics
}
