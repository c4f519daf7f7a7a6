//! The floor plan: two rows of rooms along the facades, two corridors, and between these a core of bays that hold the
//! stairs, inner rooms and the atrium.
//!
//! x runs along the building from bay to bay, y across it from the southern facade; both m, from the inner south-western
//! corner.

use std::ops::Range;

use super::canvas::Span;
use super::place::Place;

/// Width of a bay, m.
pub const BAY: f64 = 4.1;
/// Depth of rooms at the facades, m.
pub const OUTER_DEPTH: f64 = 5.2;
/// Depth of rooms in the core, m.
pub const INNER_DEPTH: f64 = 3.8;
/// Width of corridors, m.
pub const CORRIDOR: f64 = 2.0;
/// Thickness of inner walls, m.
pub const WALL: f64 = 0.15;
/// Thickness of outer walls, m.
pub const FACADE: f64 = 0.3;
/// Height of rooms, m.
pub const HEIGHT: f64 = 3.0;
/// From a ceiling to the floor above, m.
pub const SLAB: f64 = 0.6;
/// From floor to floor, m.
pub const STOREY: f64 = HEIGHT + SLAB;

/// Inner edge of the southern corridor.
const SOUTH_CORRIDOR: f64 = OUTER_DEPTH + WALL;
/// The core from corridor to corridor.
pub const CORE: Span = [SOUTH_CORRIDOR + CORRIDOR, SOUTH_CORRIDOR + CORRIDOR + 2.0 * INNER_DEPTH + 3.0 * WALL];
/// The corridors across.
pub const CORRIDORS: [Span; 2] = [[SOUTH_CORRIDOR, CORE[0]], [CORE[1], CORE[1] + CORRIDOR]];
/// Inner face of the northern facade.
pub const NORTH: f64 = CORRIDORS[1][1] + WALL + OUTER_DEPTH;

/// Bays of the stairs, at the western end.
const STAIRS: usize = 1;

/// Least rooms of a floor: with five there is no plan that has an atrium.
pub const LEAST_ROOMS: usize = 6;

/// What a bay of the core holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Core {
    /// The stairs.
    Stairs,
    /// Two rooms back to back.
    TwoRooms,
    /// A room as deep as the core.
    DeepRoom,
    /// A part of the atrium.
    Atrium,
}

/// The plan that all floors share.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Bays along the building.
    pub bays: usize,
    /// Rooms of a floor.
    pub rooms: usize,
    /// Bays of inner rooms before the atrium, behind the stairs.
    before: usize,
    /// Bays of the atrium.
    atrium: usize,
}

impl Plan {
    /// The shortest plan with so many rooms whose atrium has a quarter of the bays, one at least. The atrium takes what
    /// rooms leave.
    #[must_use]
    pub fn with_rooms(rooms: usize) -> Self {
        assert!(rooms >= LEAST_ROOMS, "the command line sees to it");
        let inner_bays = |bays: usize| (rooms - 2 * bays).div_ceil(2);
        let fits = |bays: &usize| STAIRS + inner_bays(*bays) + usize::max(1, bays / 4) <= *bays;
        let bays = (2..=rooms / 2).find(fits).expect("six rooms and more have a plan");
        let inner = inner_bays(bays);
        Self { bays, rooms, before: inner.div_ceil(2), atrium: bays - STAIRS - inner }
    }

    /// What the core holds in a bay.
    #[must_use]
    pub fn core(&self, bay: usize) -> Core {
        let has_deep_room = self.rooms % 2 == 1;
        if bay < STAIRS {
            Core::Stairs
        } else if self.atrium_bays().contains(&bay) {
            Core::Atrium
        } else if has_deep_room && bay == STAIRS {
            Core::DeepRoom
        } else {
            Core::TwoRooms
        }
    }

    fn atrium_bays(&self) -> Range<usize> {
        let first = STAIRS + self.before;
        first..first + self.atrium
    }

    /// The atrium along x.
    #[must_use]
    pub fn atrium(&self) -> Span {
        let bays = self.atrium_bays();
        [bays.start, bays.end].map(|bay| bay as f64 * BAY)
    }

    /// A bay along x.
    #[must_use]
    pub fn bay(&self, bay: usize) -> Span {
        [bay as f64 * BAY, (bay + 1) as f64 * BAY]
    }

    /// Length of the building between its inner faces, m.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.bays as f64 * BAY
    }
}

/// A bay's unit on one side of a corridor, u along the corridor from 0 to [`BAY`], v away from it; v = 0 is where the wall
/// to the corridor ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Row {
    /// At the southern facade.
    SouthOuter,
    /// In the core, on the southern corridor.
    SouthInner,
    /// In the core, on the northern corridor.
    NorthInner,
    /// At the northern facade.
    NorthOuter,
}

impl Row {
    /// The frame of its unit in a bay of the floor at a height, m.
    #[must_use]
    pub fn place(self, bay: usize, z: f64) -> Place {
        let [x0, x1] = [bay as f64 * BAY, (bay + 1) as f64 * BAY];
        let looking_south = |y: f64| Place::new(x1, y, z).quarters(2);
        match self {
            Self::SouthOuter => looking_south(OUTER_DEPTH),
            Self::SouthInner => Place::new(x0, CORE[0] + WALL, z),
            Self::NorthInner => looking_south(CORE[1] - WALL),
            Self::NorthOuter => Place::new(x0, CORRIDORS[1][1] + WALL, z),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_of_rooms_has_a_plan_with_just_these_stairs_and_an_atrium() {
        for rooms in LEAST_ROOMS..1000 {
            let plan = Plan::with_rooms(rooms);
            let of = |core: Core| (0..plan.bays).filter(|bay| plan.core(*bay) == core).count();
            assert_eq!(2 * plan.bays + 2 * of(Core::TwoRooms) + of(Core::DeepRoom), rooms, "{plan:?}");
            assert_eq!((of(Core::Stairs), of(Core::Atrium)), (1, plan.atrium), "{plan:?}");
            assert!(plan.atrium >= 1 && of(Core::DeepRoom) == rooms % 2, "{plan:?}");
        }
    }
}
