//! What rays can meet, opened for a version: the ray structure, and which of its sides emit.

use std::sync::Arc;

use memmap2::Mmap;

use crate::base::{Error, Result};
use crate::model::geometry::SideMaterial;
use crate::model::rays::TopRaysView;
use crate::model::{Arrays, ExtentKind};
use crate::rays::{Emitters, RayScene};
use crate::store::{Extent, Snapshot};

/// The mapped ray structure with what a version adds to it.
pub struct SceneFiles {
    top: Extent,
    file: Arc<Mmap>,
    emitters: Emitters,
    snap_m: f64,
}

impl SceneFiles {
    /// Opens them; a store without a ray structure is damaged.
    pub fn open(snapshot: &Snapshot<'_>) -> Result<Self> {
        let store = snapshot.store();
        let (top, file) =
            store.ray_top()?.ok_or_else(|| Error::damaged(store.dir(), "the model has no ray structure"))?;
        Ok(Self { top, file, emitters: emitters(snapshot)?, snap_m: store.facts()?.snap_m })
    }

    /// Whether nothing emits in this version.
    #[must_use]
    pub fn is_dark(&self) -> bool {
        self.emitters.is_empty()
    }

    /// The scene.
    pub fn scene(&self) -> Result<RayScene<'_>> {
        let view = self.top.parse(TopRaysView::parse)?;
        RayScene::new(view, &self.file, &self.emitters, self.snap_m).map_err(|e| self.top.damage(e))
    }
}

fn emitters(snapshot: &Snapshot<'_>) -> Result<Emitters> {
    // The catalogue counts emitters in the materials of the last ingest.
    let counts_hold = snapshot.store().has_ingested_materials(snapshot.version())?;
    let mut emitters = Emitters::default();
    for cluster in snapshot.clusters() {
        let cluster = cluster?;
        if counts_hold && cluster.emitters == 0 {
            continue;
        }
        let materials = snapshot.need(ExtentKind::Materials, cluster.id)?;
        let sides: &[SideMaterial] = materials.parse(|payload| Arrays::new(payload).get(0))?;
        let emitting = sides.iter().enumerate().filter(|(_, side)| side.exitance != [0.0; 3]);
        emitters.add(cluster.id.0, emitting.map(|(i, _)| i));
    }
    Ok(emitters)
}
