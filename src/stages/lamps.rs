//! Light trees of the lamps in sight of clusters, held as far as there is room: clusters of a room share theirs, and so do
//! points between them.

use std::cell::RefCell;
use std::num::NonZeroUsize;
use std::rc::Rc;

use lru::LruCache;

use super::working_set::WorkingSet;
use crate::base::{ClusterId, Result};
use crate::transport::measure::lamps::LightTree;
use crate::transport::measure::path::InSight;

/// Clusters whose lamps are remembered.
const REMEMBERED: NonZeroUsize = NonZeroUsize::new(512).expect("not 0");

/// Bytes of trees that are held.
const HELD_BYTES: usize = 16 << 20;

/// Clusters with lamps, ascending.
type Names = Rc<Vec<ClusterId>>;

/// The lamps in sight of clusters.
pub struct LampsInSight<'a, 's> {
    set: &'a WorkingSet<'s>,
    names: RefCell<LruCache<u32, Names>>,
    trees: RefCell<(LruCache<Names, Rc<InSight>>, usize)>,
}

impl<'a, 's> LampsInSight<'a, 's> {
    /// In a version.
    #[must_use]
    pub fn new(set: &'a WorkingSet<'s>) -> Self {
        let (names, trees) = (LruCache::new(REMEMBERED), LruCache::unbounded());
        Self { set, names: RefCell::new(names), trees: RefCell::new((trees, 0)) }
    }

    /// Those of a cluster.
    pub fn of(&self, id: ClusterId) -> Result<Rc<InSight>> {
        self.lamps(self.names_of(id)?)
    }

    /// Those of any of some clusters, and their own.
    pub fn of_any(&self, ids: &[ClusterId]) -> Result<Rc<InSight>> {
        let emitters = self.set.emitters()?;
        let mut names: Vec<ClusterId> = ids.iter().copied().filter(|id| emitters.any_of(id.0)).collect();
        for &id in ids {
            names.extend(self.names_of(id)?.iter());
        }
        names.sort_unstable();
        names.dedup();
        self.lamps(Rc::new(names))
    }

    fn lamps(&self, names: Names) -> Result<Rc<InSight>> {
        let (held, bytes) = &mut *self.trees.borrow_mut();
        if let Some(known) = held.get(&names) {
            return Ok(known.clone());
        }
        let tree = LightTree::of_clusters(self.set, &names)?;
        *bytes += tree.bytes();
        let lamps = Rc::new(InSight { clusters: names.to_vec(), tree });
        held.put(names, lamps.clone());
        while *bytes > HELD_BYTES && held.len() > 1 {
            *bytes -= held.pop_lru().map_or(0, |(_, dropped)| dropped.tree.bytes());
        }
        Ok(lamps)
    }

    fn names_of(&self, id: ClusterId) -> Result<Names> {
        let look = || {
            let (mut visible, emitters) = (self.set.visible(id)?.0, self.set.emitters()?);
            visible.retain(|cluster| emitters.any_of(cluster.0));
            Ok(Rc::new(visible))
        };
        self.names.borrow_mut().try_get_or_insert(id.0, look).cloned()
    }
}
