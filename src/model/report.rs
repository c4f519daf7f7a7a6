//! What a task reports of its work: summed by merge, in the order of the groups.

use bincode::{Decode, Encode};

use super::figures::{Power, Resources, Work};

/// What acts that promise about the same a ray would come to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Encode, Decode)]
pub struct Bin {
    /// Logarithm of the rate, in steps of the oracle.
    pub rate: i32,
    /// By how much the error would fall, (W/m2)2 m2.
    pub promise: f64,
    /// Rays.
    pub cost: f64,
}

/// Where the error of the light is, summed over rows.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub struct ErrorSums {
    /// Squared error times area as the rows know it, (W/m2)2 m2.
    pub rough: f64,
    /// The same where places were measured anew, and the variance of that.
    pub checked: [f64; 2],
    /// Places measured anew.
    pub places: u64,
    /// Squared irradiance times area, (W/m2)2 m2.
    pub norm: f64,
    /// Irradiance times area of what is lit, W; its area, m2.
    pub lit: [f64; 2],
    /// Rays in rows.
    pub rays: f64,
    /// What may be done, ascending by rate.
    pub bins: Vec<Bin>,
}

impl ErrorSums {
    /// Adds an act.
    pub fn add(&mut self, rate: i32, promise: f64, cost: f64) {
        let at = self.bins.partition_point(|bin| bin.rate < rate);
        if self.bins.get(at).is_none_or(|bin| bin.rate != rate) {
            self.bins.insert(at, Bin { rate, ..Bin::default() });
        }
        self.bins[at].promise += promise;
        self.bins[at].cost += cost;
    }

    /// The sum of both.
    pub fn plus(&mut self, other: &Self) {
        self.rough += other.rough;
        self.places += other.places;
        self.checked = [0, 1].map(|i| self.checked[i] + other.checked[i]);
        self.norm += other.norm;
        self.lit = [0, 1].map(|i| self.lit[i] + other.lit[i]);
        self.rays += other.rays;
        for bin in &other.bins {
            self.add(bin.rate, bin.promise, bin.cost);
        }
    }
}

/// Figures of one group's visit.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub struct TaskReport {
    /// Power of the group's sides.
    pub power: Power,
    /// What was done in the visit, and the rows and elements of the group's clusters.
    pub work: Work,
    /// Where the error is.
    pub error: ErrorSums,
    /// Whether light has come from everywhere (not so in the first iteration, which knows of the lights only).
    pub complete: bool,
    /// Gathers within the group until it converged.
    pub inner_sweeps: u32,
    /// Largest reflectance.
    pub q_max: f64,
    /// What the visit used.
    pub used: Resources,
    /// What arrives at the group's sides, W.
    pub received_w: [f64; 3],
}

/// More than any report takes: a damaged length asks for no memory.
const MOST_BYTES: usize = 1 << 20;

impl TaskReport {
    /// As stored: bincode, fixed-size integers.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        bincode::encode_to_vec(self, bincode::config::legacy()).expect("plain numbers always encode")
    }

    /// From stored bytes; what is wrong with them otherwise.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let (report, used): (Self, usize) =
            bincode::decode_from_slice(bytes, bincode::config::legacy().with_limit::<MOST_BYTES>())
                .map_err(|e| e.to_string())?;
        if used == bytes.len() { Ok(report) } else { Err("bytes behind the end of a report".to_owned()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_comes_back_and_a_cut_off_one_does_not() {
        let (work, used) = (Work { rays: 7, ..Work::default() }, Resources { cpu_s: 0.5, ..Resources::default() });
        let report = TaskReport { work, used, complete: true, ..TaskReport::default() };
        let bytes = report.encode();
        assert_eq!(TaskReport::decode(&bytes).unwrap(), report);
        assert_eq!(bytes[96..104], 7u64.to_le_bytes(), "where stores that exist have it");
        assert!(TaskReport::decode(&bytes[1..]).is_err());
    }
}
