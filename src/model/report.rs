//! What a task reports of its work: summed by merge, in the order of the groups.

use bincode::{Decode, Encode};

use super::figures::{Power, Resources, Work};

/// Figures of one group's visit.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub struct TaskReport {
    /// Power of the group's sides.
    pub power: Power,
    /// What was done in the visit, and the rows and elements of the group's clusters.
    pub work: Work,
    /// Sum over lit leaves of area times the part of the row that nothing is linked to, m2.
    pub unlinked_area_m2: f64,
    /// Area of lit leaves, m2.
    pub lit_area_m2: f64,
    /// Whether every link meets the oracle against all sources (not so in the first iteration,
    /// which gathers from the lights only).
    pub complete: bool,
    /// Gathers within the group until it converged.
    pub inner_sweeps: u32,
    /// Largest row sum of reflectance times form factor.
    pub q_max: f64,
    /// What the visit used.
    pub used: Resources,
}

impl TaskReport {
    /// As stored: bincode, fixed-size integers.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        bincode::encode_to_vec(self, bincode::config::legacy()).expect("plain numbers always encode")
    }

    /// From stored bytes; what is wrong with them otherwise.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let (report, used): (Self, usize) =
            bincode::decode_from_slice(bytes, bincode::config::legacy()).map_err(|e| e.to_string())?;
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
