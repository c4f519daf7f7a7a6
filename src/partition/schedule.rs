//! Which group a free worker takes next (section 5.2 of the paper).

use crate::model::free_group::FreeGroup;

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

/// Chooses among free groups; `taken` have been claimed before in this iteration. `None` if none is.
#[must_use]
pub fn choose(policy: Policy, candidates: &[FreeGroup], taken: usize, all_by_cost: &[u32]) -> Option<u32> {
    let costliest = |list: &[FreeGroup]| {
        list.iter().max_by(|a, b| a.cost.total_cmp(&b.cost).then(b.group.cmp(&a.group))).map(|c| c.group)
    };
    let best_held = |list: &[FreeGroup]| {
        list.iter()
            .max_by(|a, b| {
                let merit = |c: &FreeGroup| c.held_here - c.held_elsewhere;
                merit(a).total_cmp(&merit(b)).then(a.cost.total_cmp(&b.cost)).then(b.group.cmp(&a.group))
            })
            .map(|c| c.group)
    };
    match policy {
        Policy::Ffd => costliest(candidates),
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
                return costliest(&overdue);
            }
            let within: Vec<_> =
                candidates.iter().copied().filter(|c| turn(c.group) < taken + delta as usize).collect();
            best_held(&within).or_else(|| costliest(candidates))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidates() -> Vec<FreeGroup> {
        [(0, 9.0, 0.0), (1, 5.0, 0.2), (2, 1.0, 1.0)]
            .map(|(group, cost, held_here)| FreeGroup { group, cost, held_here, held_elsewhere: 0.0 })
            .to_vec()
    }

    #[test]
    fn ffd_takes_the_costliest_ws_the_best_held_and_the_mix_stays_near_the_order_by_cost() {
        let c = candidates();
        let order = [0, 1, 2];
        assert_eq!(choose(Policy::Ffd, &c, 0, &order), Some(0));
        assert_eq!(choose(Policy::Ws, &c, 0, &order), Some(2));
        assert_eq!(choose(Policy::FfdWs { delta: 1 }, &c, 0, &order), Some(0), "delta 1 is FFD");
        assert_eq!(choose(Policy::FfdWs { delta: 2 }, &c, 0, &order), Some(1));
        assert_eq!(choose(Policy::FfdWs { delta: 99 }, &c, 0, &order), Some(2), "a large delta is WS");
        assert_eq!(choose(Policy::Ffd, &[], 0, &order), None);
    }
}
