//! What links ask of their sources, each looked up once: many links lead to few sources.

use std::cell::RefCell;

use super::source::{Clusters, SourceLight};
use crate::base::{NodeName, Result};
use crate::geom::sequence::mix;

/// A source as links see it.
#[derive(Clone, Copy, Debug, Default)]
pub struct KnownSource {
    /// Light that leaves it.
    pub light: SourceLight,
    /// Whether it emits.
    pub emits: bool,
}

/// Sources of one version looked up lately: a newer one takes the place of an older.
pub struct SourceMemo(RefCell<Vec<(NodeName, KnownSource)>>);

/// Sources that are remembered, 56 bytes each: what a large room sees.
const REMEMBERED: usize = 1 << 18;

impl Default for SourceMemo {
    fn default() -> Self {
        Self(RefCell::new(vec![(NodeName::ESCAPE, KnownSource::default()); REMEMBERED]))
    }
}

impl SourceMemo {
    /// A source, from the version that is read.
    pub fn source(&self, clusters: &dyn Clusters, name: NodeName) -> Result<KnownSource> {
        let slot = mix(name.0) as usize % REMEMBERED;
        let known = self.0.borrow()[slot];
        if known.0 == name {
            return Ok(known.1);
        }
        let loaded = clusters.cluster(name.cluster())?;
        let view = loaded.view();
        let found = KnownSource { light: view.source(name), emits: view.emits(name) };
        self.0.borrow_mut()[slot] = (name, found);
        Ok(found)
    }
}
