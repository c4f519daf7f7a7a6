//! What a receiver's links ask of their sources, each looked up once: many links lead to few sources.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use super::source::{Clusters, SourceLight};
use crate::base::{NodeName, Result};
use crate::geom::sequence::mix;

/// A source as links see it.
#[derive(Clone, Copy, Debug)]
pub(super) struct KnownSource {
    /// Light that leaves it.
    pub(super) light: SourceLight,
    /// Whether it emits.
    pub(super) emits: bool,
}

/// Sources looked up so far.
#[derive(Default)]
pub(super) struct SourceMemo(HashMap<NodeName, KnownSource, BuildHasherDefault<NameHasher>>);

impl SourceMemo {
    /// A source, from the version that is read.
    pub(super) fn source(&mut self, clusters: &dyn Clusters, name: NodeName) -> Result<KnownSource> {
        if let Some(known) = self.0.get(&name) {
            return Ok(*known);
        }
        let loaded = clusters.cluster(name.cluster())?;
        let view = loaded.view();
        let found = KnownSource { light: view.source(name), emits: view.emits(name) };
        self.0.insert(name, found);
        Ok(found)
    }
}

/// Names are numbers that differ in few bits.
#[derive(Default)]
struct NameHasher(u64);

impl Hasher for NameHasher {
    fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.write_u64(u64::from(*byte));
        }
    }

    fn write_u64(&mut self, name: u64) {
        self.0 = mix(self.0 ^ name);
    }

    fn finish(&self) -> u64 {
        self.0
    }
}
