//! Which group a free worker takes next (section 5.2 of the paper).

use crate::base::Result;
use crate::model::free_group::{FreeGroup, Held};

/// How to choose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// First fit decreasing: the costliest first.
    Ffd,
    /// Working set: what the worker already holds, and others do not.
    Ws,
    /// The working-set choice, but every group within `delta` places of its turn by cost.
    FfdWs {
        /// Places.
        delta: u32,
    },
}

/// Chooses among free groups; `taken` have been claimed before in this iteration. `None` if none is. `held` is asked of
/// groups for which it matters.
pub fn choose(
    policy: Policy,
    candidates: &[FreeGroup],
    (taken, all_by_cost): (usize, &[u32]),
    held: &mut dyn FnMut(u32) -> Result<Held>,
) -> Result<Option<u32>> {
    let costliest = |list: &[FreeGroup]| {
        list.iter().max_by(|a, b| a.cost.total_cmp(&b.cost).then(b.group.cmp(&a.group))).map(|c| c.group)
    };
    let mut best_held = |list: &[FreeGroup]| -> Result<Option<u32>> {
        let merit = |c: &FreeGroup| held(c.group).map(|held| (held.here - held.elsewhere, *c));
        let merits = list.iter().map(merit).collect::<Result<Vec<_>>>()?;
        let best = merits.into_iter().max_by(|(merit, a), (other, b)| {
            merit.total_cmp(other).then(a.cost.total_cmp(&b.cost)).then(b.group.cmp(&a.group))
        });
        Ok(best.map(|(_, c)| c.group))
    };
    match policy {
        Policy::Ffd => Ok(costliest(candidates)),
        Policy::Ws => best_held(candidates),
        Policy::FfdWs { delta } => {
            let turn = |group: u32| all_by_cost.iter().position(|g| *g == group).unwrap_or(usize::MAX);
            // Overdue: its turn by cost was delta places ago.
            let overdue: Vec<_> = candidates
                .iter()
                .copied()
                .filter(|c| turn(c.group).saturating_add(delta as usize) <= taken + 1)
                .collect();
            if !overdue.is_empty() {
                return Ok(costliest(&overdue));
            }
            let within: Vec<_> =
                candidates.iter().copied().filter(|c| turn(c.group) < taken + delta as usize).collect();
            Ok(best_held(&within)?.or_else(|| costliest(candidates)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ffd_takes_the_costliest_ws_the_best_held_and_the_mix_stays_near_the_order_by_cost() {
        let c = [(0, 9.0), (1, 5.0), (2, 1.0)].map(|(group, cost)| FreeGroup { group, cost });
        let order = [0, 1, 2];
        let mut held = |group: u32| Ok(Held { here: [0.0, 0.2, 1.0][group as usize], elsewhere: 0.0 });
        let mut choose = |policy, candidates: &[FreeGroup]| choose(policy, candidates, (0, &order), &mut held).unwrap();
        assert_eq!(choose(Policy::Ffd, &c), Some(0));
        assert_eq!(choose(Policy::Ws, &c), Some(2));
        assert_eq!(choose(Policy::FfdWs { delta: 1 }, &c), Some(0), "delta 1 is FFD");
        assert_eq!(choose(Policy::FfdWs { delta: 2 }, &c), Some(1));
        assert_eq!(choose(Policy::FfdWs { delta: 99 }, &c), Some(2), "a large delta is WS");
        assert_eq!(choose(Policy::Ffd, &[]), None);
    }
}
