//! Checks clusters' ray structures when rays first come to them: a model's are too many to check them all for
//! every group. Rays pass through what is not sound; who casts them asks afterwards whether that happened.

use std::cell::Cell;

use crate::base::Result;
use crate::model::rays::ClusterRef;

#[derive(Clone, Copy, Default, PartialEq)]
enum Found {
    #[default]
    NotLooked,
    Sound,
    Damaged,
}

/// What has been looked at, by place in the top level.
pub struct FirstLook<'a> {
    check: &'a dyn Fn(&ClusterRef) -> Result<()>,
    found: Vec<Cell<Found>>,
    damaged: Cell<Option<ClusterRef>>,
}

impl<'a> FirstLook<'a> {
    /// Over a top level of so many clusters. `check` verifies one cluster's structure.
    #[must_use]
    pub fn new(clusters: usize, check: &'a dyn Fn(&ClusterRef) -> Result<()>) -> Self {
        Self { check, found: vec![Cell::default(); clusters], damaged: Cell::new(None) }
    }

    /// Whether a cluster's structure is sound; looks if nobody has.
    #[inline]
    pub(super) fn finds_sound(&self, place: usize, at: &ClusterRef) -> bool {
        self.found[place].get() == Found::Sound || self.look(&self.found[place], at)
    }

    #[cold]
    fn look(&self, found: &Cell<Found>, at: &ClusterRef) -> bool {
        if found.get() == Found::NotLooked {
            if (self.check)(at).is_ok() {
                found.set(Found::Sound);
            } else {
                found.set(Found::Damaged);
                self.damaged.set(Some(*at));
            }
        }
        found.get() == Found::Sound
    }

    /// Fails if rays have passed through damage: what they found is worth nothing.
    pub fn verdict(&self) -> Result<()> {
        self.damaged.get().map_or(Ok(()), |at| (self.check)(&at))
    }
}
