//! Which patch sides emit, for faces that coincide: of those an emitting one is seen.

use super::PatchKey;

/// Bits for the sides of up to 256 patches.
type Sides = [u64; 8];

/// The emitting sides of a model in one version: 68 bytes for each cluster that has any.
#[derive(Clone, Debug, Default)]
pub struct Emitters(Vec<(u32, Sides)>);

/// A model without any.
pub static NO_EMITTERS: Emitters = Emitters(Vec::new());

impl Emitters {
    /// Adds a cluster's emitting sides, as twice the patch plus the side; clusters come in ascending order.
    pub fn add(&mut self, cluster: u32, emitting: impl Iterator<Item = usize>) {
        let mut sides = Sides::default();
        for side in emitting {
            sides[side / 64] |= 1 << (side % 64);
        }
        if sides != Sides::default() {
            debug_assert!(self.0.last().is_none_or(|last| last.0 < cluster));
            self.0.push((cluster, sides));
        }
    }

    /// Whether nothing emits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether any side of a cluster emits.
    #[must_use]
    pub fn any_of(&self, cluster: u32) -> bool {
        self.0.binary_search_by_key(&cluster, |c| c.0).is_ok()
    }

    /// Whether a patch emits from its front or back.
    #[must_use]
    pub fn emits(&self, patch: PatchKey, front: bool) -> bool {
        let side = 2 * patch.patch as usize + usize::from(!front);
        let found = self.0.binary_search_by_key(&patch.cluster, |c| c.0);
        found.is_ok_and(|at| self.0[at].1[side / 64] >> (side % 64) & 1 == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_side_emits_if_it_was_added_and_no_other() {
        let mut emitters = Emitters::default();
        emitters.add(3, [0, 511].into_iter());
        emitters.add(7, [65].into_iter());
        let all: Vec<(u32, u32, bool)> = (0..9)
            .flat_map(|c| (0..256).flat_map(move |p| [(c, p, true), (c, p, false)]))
            .filter(|&(cluster, patch, front)| emitters.emits(PatchKey { cluster, patch }, front))
            .collect();
        assert_eq!(all, [(3, 0, true), (3, 255, false), (7, 32, false)]);
    }
}
