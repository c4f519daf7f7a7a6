//! What work came to and what it took: the figures of a visit to a group, of an iteration, and of a run, listed once.

use std::ops::AddAssign;

use bincode::{Decode, Encode};
use serde::{Deserialize, Serialize};

/// What was done and what there is now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode, Serialize)]
pub struct Work {
    /// Links that rays made.
    pub links_evaluated: u64,
    /// Links in rows now.
    pub links_stored: u64,
    /// Links used again as they were.
    pub links_reused: u64,
    /// Rays cast.
    pub rays: u64,
    /// Elements, inner ones too.
    pub elements: u64,
}

impl AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.links_evaluated += other.links_evaluated;
        self.links_stored += other.links_stored;
        self.links_reused += other.links_reused;
        self.rays += other.rays;
        self.elements += other.elements;
    }
}

/// Where power goes, W.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode, Serialize)]
pub struct Power {
    /// What sides emit.
    pub emitted_w: [f64; 3],
    /// What they absorb.
    pub absorbed_w: [f64; 3],
    /// What leaves the model over escape links.
    pub escaped_w: [f64; 3],
}

impl Power {
    /// Largest channel of |emitted - absorbed - escaped| / emitted; 0 where nothing is emitted.
    #[must_use]
    pub fn imbalance(&self) -> f64 {
        (0..3)
            .filter(|&i| self.emitted_w[i] > 0.0)
            .map(|i| (self.emitted_w[i] - self.absorbed_w[i] - self.escaped_w[i]).abs() / self.emitted_w[i])
            .fold(0.0, f64::max)
    }
}

impl AddAssign for Power {
    fn add_assign(&mut self, other: Self) {
        let add = |sum: &mut [f64; 3], part: [f64; 3]| sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        add(&mut self.emitted_w, other.emitted_w);
        add(&mut self.absorbed_w, other.absorbed_w);
        add(&mut self.escaped_w, other.escaped_w);
    }
}

/// What a process used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode, Serialize, Deserialize)]
#[serde(default)]
pub struct Resources {
    /// Largest anonymous memory so far, bytes.
    pub peak_anon_bytes: u64,
    /// Processor time, s.
    pub cpu_s: f64,
    /// Bytes read: by calls, or from disk where more (mapped files).
    pub bytes_read: u64,
    /// Bytes written.
    pub bytes_written: u64,
}

impl Resources {
    /// What has been used since `before`; the peak is that of all the time.
    #[must_use]
    pub fn since(self, before: &Self) -> Self {
        Self {
            cpu_s: self.cpu_s - before.cpu_s,
            bytes_read: self.bytes_read - before.bytes_read,
            bytes_written: self.bytes_written - before.bytes_written,
            ..self
        }
    }
}

/// Figures of a process and of its children that have ended, as every JSON document has them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ProcessFigures {
    /// Time, s.
    pub wall_s: f64,
    /// Largest resident memory, bytes.
    pub peak_rss_bytes: u64,
    /// The rest.
    #[serde(flatten)]
    pub used: Resources,
}

impl ProcessFigures {
    /// Adds a process beside others: the larger peaks, the sums of the rest but time.
    pub fn add(&mut self, other: &Self) {
        self.peak_rss_bytes = self.peak_rss_bytes.max(other.peak_rss_bytes);
        self.used.peak_anon_bytes = self.used.peak_anon_bytes.max(other.used.peak_anon_bytes);
        self.used.cpu_s += other.used.cpu_s;
        self.used.bytes_read += other.used.bytes_read;
        self.used.bytes_written += other.used.bytes_written;
    }
}

/// Figures of an iteration, summed over its tasks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct IterationFigures {
    /// Work in the iteration.
    #[serde(flatten)]
    pub work: Work,
    /// Power at its end.
    #[serde(flatten)]
    pub power: Power,
    /// See [`Power::imbalance`].
    pub energy_balance: f64,
    /// Share of the lit rows that nothing is linked to.
    pub unlinked_mean: f64,
}

/// What an iteration does besides gathering.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// Nothing: light still comes in.
    #[default]
    Sweep,
    /// What promises most is split, or rays are cast for it.
    Mark,
    /// Nothing more: the error is as small as was asked for.
    Close,
}

impl Phase {
    /// As the catalogue has it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sweep => "sweep",
            Self::Mark => "mark",
            Self::Close => "close",
        }
    }

    /// From the catalogue; a sweep where it says something else.
    #[must_use]
    pub fn of(name: &str) -> Self {
        [Self::Mark, Self::Close].into_iter().find(|phase| phase.name() == name).unwrap_or_default()
    }
}

/// Where refinement stands at the end of an iteration: what the next one reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steering {
    /// What the next iteration does.
    pub phase: Phase,
    /// Least that its acts promise a ray, (W/m2)2 m2; none if there are none.
    pub threshold: Option<f64>,
    /// Mean irradiance of what is lit and does not emit, W/m2; 0 if nothing is.
    pub lit_mean_w_m2: f64,
    /// Estimated error of the stored light.
    pub estimated_nrms: f64,
    /// Its standard error.
    pub estimated_nrms_error: f64,
    /// Squared error where places were measured anew, relative to what the rows know; 1 before any were.
    pub correction: f64,
    /// Its standard error.
    pub correction_error: f64,
    /// Places that it rests on; those of iterations before count less.
    pub places: f64,
    /// What gathers are multiplied by so that power is kept.
    pub gain: [f64; 3],
}

impl Default for Steering {
    fn default() -> Self {
        Self {
            phase: Phase::default(),
            threshold: None,
            lit_mean_w_m2: 0.0,
            estimated_nrms: 0.0,
            estimated_nrms_error: 0.0,
            correction: 1.0,
            correction_error: 0.0,
            places: 0.0,
            gain: [1.0; 3],
        }
    }
}
