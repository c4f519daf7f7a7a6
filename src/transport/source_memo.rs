//! What links ask of their sources, each looked up once: many links lead to few sources.

use super::source::{Clusters, SourceLight};
use crate::base::{NodeName, Result};
use crate::rays::recent::Recent;

/// A source as links see it.
#[derive(Clone, Copy, Debug, Default)]
pub struct KnownSource {
    /// Light that leaves it.
    pub light: SourceLight,
    /// Whether it emits.
    pub emits: bool,
}

/// Sources of one version looked up lately.
#[derive(Default)]
pub struct SourceMemo(Recent<KnownSource, REMEMBERED>);

/// Sources that are remembered, 56 bytes each: what a large room sees.
const REMEMBERED: usize = 1 << 18;

impl SourceMemo {
    /// A source, from the version that is read.
    pub fn source(&self, clusters: &dyn Clusters, name: NodeName) -> Result<KnownSource> {
        if let Some(known) = self.0.get(name) {
            return Ok(known);
        }
        let loaded = clusters.cluster(name.cluster())?;
        let view = loaded.view();
        let found = KnownSource { light: view.source(name), emits: view.emits(name) };
        self.0.put(name, found);
        Ok(found)
    }
}
