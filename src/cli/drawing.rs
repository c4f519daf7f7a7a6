//! Progress as people and programs see it: a bar, plain lines, or JSON events, all on stderr.

use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use indicatif::{HumanCount, ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::args::ProgressMode;
use crate::base::Progress;
use crate::base::text::harmless;

/// Between two plain lines.
const PLAIN_PERIOD: Duration = Duration::from_secs(30);
/// Between two events.
const EVENT_PERIOD: Duration = Duration::from_secs(1);

enum Style {
    Bar,
    Plain,
    Events,
    Nothing,
}

struct Phase {
    name: String,
    unit: String,
    total: Option<u64>,
    done: u64,
    began: Instant,
    shown: Instant,
    bar: Option<ProgressBar>,
}

/// Draws progress, collects warnings, hears interrupts.
pub struct Drawing {
    style: Style,
    quiet: bool,
    phase: Mutex<Option<Phase>>,
    warnings: Mutex<Vec<String>>,
    interrupted: Arc<AtomicBool>,
}

impl Drawing {
    /// `quiet`: nothing but errors.
    #[must_use]
    pub fn new(mode: ProgressMode, quiet: bool, interrupted: Arc<AtomicBool>) -> Self {
        let style = match mode {
            _ if quiet => Style::Nothing,
            ProgressMode::Auto if std::io::stderr().is_terminal() => Style::Bar,
            ProgressMode::Auto | ProgressMode::Plain => Style::Plain,
            ProgressMode::Bar => Style::Bar,
            ProgressMode::Json => Style::Events,
            ProgressMode::None => Style::Nothing,
        };
        Self { style, quiet, phase: Mutex::new(None), warnings: Mutex::default(), interrupted }
    }

    /// Ends the last phase and takes it off the screen; the warnings so far.
    #[must_use]
    pub fn finish(&self) -> Vec<String> {
        if let Some(bar) = self.lock().take().and_then(|p| p.bar) {
            bar.finish_and_clear();
        }
        std::mem::take(&mut *self.warnings.lock().unwrap_or_else(std::sync::PoisonError::into_inner))
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Option<Phase>> {
        // A phase is whole at any time: a panic elsewhere leaves nothing to repair.
        self.phase.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn say(&self, line: &str) {
        // Nobody is left to tell if stderr is gone.
        let _ = writeln!(std::io::stderr(), "{line}");
    }
}

impl Progress for Drawing {
    fn begin(&self, phase: &str, unit: &str, total: Option<u64>) {
        let mut current = self.lock();
        if let Some(bar) = current.take().and_then(|p| p.bar) {
            bar.finish_and_clear();
        }
        let bar = matches!(self.style, Style::Bar).then(|| bar(phase, unit, total));
        let now = Instant::now();
        *current =
            Some(Phase { name: phase.to_owned(), unit: unit.to_owned(), total, done: 0, began: now, shown: now, bar });
    }

    fn at(&self, done: u64) {
        let mut current = self.lock();
        let Some(phase) = current.as_mut() else { return };
        phase.done = done;
        if let Some(bar) = &phase.bar {
            bar.set_position(done);
            return;
        }
        let period = match self.style {
            Style::Plain => PLAIN_PERIOD,
            Style::Events => EVENT_PERIOD,
            Style::Bar | Style::Nothing => return,
        };
        if phase.shown.elapsed() >= period {
            phase.shown = Instant::now();
            self.say(&match self.style {
                Style::Events => event(phase),
                _ => line(phase),
            });
        }
    }

    fn warn(&self, message: &str) {
        let mut warnings = self.warnings.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if warnings.iter().any(|w| w == message) {
            return;
        }
        warnings.push(message.to_owned());
        if self.quiet {
            return;
        }
        let text = match self.style {
            Style::Events => serde_json::json!({"message_type": "warning", "message": message}).to_string(),
            _ => format!("warning: {}", harmless(message)),
        };
        match self.lock().as_ref().and_then(|p| p.bar.as_ref()) {
            Some(bar) => bar.suspend(|| self.say(&text)),
            None => self.say(&text),
        }
    }

    fn interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }
}

fn bar(phase: &str, unit: &str, total: Option<u64>) -> ProgressBar {
    let template = match total {
        Some(_) => "  {msg} [{bar:20}] {percent:>3} %  {human_pos} {prefix}  {per_sec}  ETA {eta}",
        None => "  {msg}  {human_pos} {prefix}  {per_sec}",
    };
    let bar = ProgressBar::with_draw_target(total, ProgressDrawTarget::stderr_with_hz(5));
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("#>-"));
    }
    bar.set_message(format!("{phase:<10}"));
    bar.set_prefix(unit.to_owned());
    bar
}

fn line(phase: &Phase) -> String {
    let Phase { name, unit, total, done, began, .. } = phase;
    let rate = *done as f64 / began.elapsed().as_secs_f64().max(1e-3);
    match total {
        Some(total) if *total > 0 => {
            let percent = 100 * done.min(total) / total;
            let left = match done {
                0 => "unknown".to_owned(),
                _ => span(total.saturating_sub(*done) as f64 / rate),
            };
            format!("  {name:<10} {percent:>3} %  {} {unit}  {}/s  ETA {left}", count(*done as f64), count(rate))
        }
        _ => format!("  {name:<10} {} {unit}  {}/s", count(*done as f64), count(rate)),
    }
}

fn event(phase: &Phase) -> String {
    let Phase { name, unit, total, done, began, .. } = phase;
    let elapsed_s = began.elapsed().as_secs_f64();
    serde_json::json!({"message_type": "progress", "phase": name, "unit": unit, "done": done, "total": total,
        "elapsed_s": elapsed_s})
    .to_string()
}

/// A count with three significant digits: `38.2 M`, `1,204`.
#[must_use]
pub fn count(n: f64) -> String {
    for (size, name) in [(1e9, " G"), (1e6, " M")] {
        if n >= size {
            return format!("{}{name}", three_digits(n / size));
        }
    }
    if n >= 100.0 { thousands(n.round() as u64) } else { three_digits(n) }
}

fn three_digits(n: f64) -> String {
    let decimals = if n >= 100.0 || n.fract() == 0.0 {
        0
    } else if n >= 10.0 {
        1
    } else {
        2
    };
    format!("{n:.decimals$}")
}

/// Digits in threes: `1,234,567`.
#[must_use]
pub fn thousands(n: u64) -> String {
    HumanCount(n).to_string()
}

/// A time: `41 s`, `1 m 48 s`, `2 h 05 m`.
#[must_use]
pub fn span(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..10 => format!("{seconds:.2} s"),
        10..60 => format!("{whole} s"),
        60..3600 => format!("{} m {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} m", whole / 3600, whole / 60 % 60),
    }
}

/// Bytes: `6.10 GiB`.
#[must_use]
pub fn bytes(n: u64) -> String {
    let mut value = n as f64;
    for unit in ["B", "KiB", "MiB", "GiB"] {
        if value < 1024.0 {
            return format!("{} {unit}", three_digits(value));
        }
        value /= 1024.0;
    }
    format!("{} TiB", three_digits(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits_thousands_and_units() {
        assert_eq!(count(38_230_000.0), "38.2 M");
        assert_eq!(count(1204.4), "1,204");
        assert_eq!(count(7.0), "7");
        assert_eq!(thousands(1_234_567), "1,234,567");
        assert_eq!(bytes(6 << 30), "6 GiB");
        assert_eq!(bytes(1536), "1.50 KiB");
        assert_eq!(span(108.0), "1 m 48 s");
        assert_eq!(span(41.2), "41 s");
    }

    #[test]
    fn a_warning_is_kept_once_and_an_interrupt_is_heard() {
        let flag = Arc::new(AtomicBool::new(false));
        let drawing = Drawing::new(ProgressMode::None, true, flag.clone());
        drawing.warn("no material emits");
        drawing.warn("no material emits");
        assert!(!drawing.interrupted());
        flag.store(true, Ordering::Relaxed);
        assert!(drawing.interrupted());
        assert_eq!(drawing.finish(), ["no material emits"]);
    }

    #[test]
    fn a_plain_line_tells_share_rate_and_time_left() {
        let began = Instant::now().checked_sub(Duration::from_secs(61)).unwrap();
        let mut phase = Phase {
            name: "gather".to_owned(),
            unit: "links".to_owned(),
            total: Some(2_000_000),
            done: 1_220_000,
            began,
            shown: began,
            bar: None,
        };
        assert_eq!(line(&phase), "  gather      61 %  1.22 M links  20,000/s  ETA 39 s");
        phase.done = 0;
        assert_eq!(line(&phase), "  gather       0 %  0 links  0/s  ETA unknown");
    }
}
