//! What the process uses: processor time, memory, bytes, read from `/proc`; memory is sampled by a
//! thread of its own.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::base::memory::{proc_field, status_bytes};
use crate::model::figures::{ProcessFigures, Resources};

/// Between two looks at the anonymous memory.
const PERIOD: Duration = Duration::from_millis(20);
/// Clock ticks of `/proc/self/stat`: fixed on Linux.
const TICKS_PER_S: f64 = 100.0;

/// Watches the process until dropped.
pub struct Watch {
    began: Instant,
    /// What the process had used before: a shell or `cargo run` that became this program leaves its children's.
    before: Used,
    peak_anon: Arc<AtomicU64>,
    ended: Arc<AtomicBool>,
    sampler: Option<JoinHandle<()>>,
}

impl Watch {
    /// Begins to watch.
    #[must_use]
    pub fn start() -> Self {
        let (peak_anon, ended) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(false)));
        let (peak, end) = (peak_anon.clone(), ended.clone());
        // Without the sampler the figure is that of the moments when it is asked for.
        let sampler = std::thread::Builder::new().name("memory".to_owned()).stack_size(128 << 10).spawn(move || {
            while !end.load(Ordering::Relaxed) {
                sample(&peak);
                std::thread::park_timeout(PERIOD);
            }
        });
        Self { began: Instant::now(), before: Used::now(), peak_anon, ended, sampler: sampler.ok() }
    }

    /// The figures so far.
    #[must_use]
    pub fn figures(&self) -> ProcessFigures {
        sample(&self.peak_anon);
        let (now, before) = (Used::now(), &self.before);
        let since = |now: u64, before: u64| now.saturating_sub(before);
        ProcessFigures {
            wall_s: self.began.elapsed().as_secs_f64(),
            peak_rss_bytes: status_bytes("VmHWM:"),
            used: Resources {
                cpu_s: now.cpu_s - before.cpu_s,
                peak_anon_bytes: self.peak_anon.load(Ordering::Relaxed),
                bytes_read: since(now.bytes_asked, before.bytes_asked)
                    .max(since(now.bytes_from_disk, before.bytes_from_disk)),
                bytes_written: since(now.bytes_written, before.bytes_written),
            },
        }
    }
}

/// What the system has counted for the process and its ended children.
struct Used {
    cpu_s: f64,
    /// Read by calls.
    bytes_asked: u64,
    bytes_from_disk: u64,
    bytes_written: u64,
}

impl Used {
    fn now() -> Self {
        let io = std::fs::read_to_string("/proc/self/io").unwrap_or_default();
        let of = |key| proc_field(&io, key).unwrap_or(0);
        Self {
            cpu_s: cpu_s(),
            bytes_asked: of("rchar:"),
            bytes_from_disk: of("read_bytes:"),
            bytes_written: of("wchar:"),
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        if let Some(sampler) = self.sampler.take() {
            sampler.thread().unpark();
            let _ = sampler.join();
        }
    }
}

fn sample(peak: &AtomicU64) {
    peak.fetch_max(status_bytes("RssAnon:"), Ordering::Relaxed);
}

/// User and system time of this process and of its ended children, s.
fn cpu_s() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name, in parentheses, may hold blanks: fields count from behind it.
    let after = text.rsplit_once(')').map_or("", |p| p.1);
    let ticks: u64 = after.split_whitespace().skip(11).take(4).filter_map(|t| t.parse::<u64>().ok()).sum();
    ticks as f64 / TICKS_PER_S
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peak_of_anonymous_memory_is_seen_after_it_is_gone() {
        let watch = Watch::start();
        let before = watch.figures();
        let mut block = vec![0u8; 64 << 20];
        for i in (0..block.len()).step_by(4096) {
            block[i] = 1;
        }
        std::thread::sleep(10 * PERIOD);
        assert_eq!(block[4096], 1);
        drop(block);
        let after = watch.figures();
        assert!(after.used.peak_anon_bytes >= before.used.peak_anon_bytes.max(64 << 20), "{after:?}");
        assert!(after.wall_s > before.wall_s && after.used.bytes_read > 0);
    }

    #[test]
    fn working_takes_processor_time() {
        let before = cpu_s();
        let began = Instant::now();
        while cpu_s() < before + 0.05 {
            assert!(began.elapsed() < Duration::from_secs(20), "no tick in 20 s");
        }
    }
}
