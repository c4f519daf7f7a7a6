//! What rays can meet, opened for a version: the ray structures, checked as rays come to them, and which sides emit.

use crate::base::Result;
use crate::model::geometry::SideMaterial;
use crate::model::rays::ClusterRef;
use crate::model::{Arrays, ExtentKind};
use crate::rays::{Emitters, FirstLook, RayScene};
use crate::store::Snapshot;

/// A version's scene, open.
pub struct OpenScene<'a> {
    /// The scene.
    pub scene: RayScene<'a>,
    /// Tells whether rays have passed through damage so far.
    pub look: &'a FirstLook<'a>,
    /// Whether nothing emits.
    pub is_dark: bool,
}

/// Works with a version's scene. Fails in the end if rays have passed through damage.
pub fn with_scene<T>(snapshot: &Snapshot<'_>, work: impl FnOnce(&OpenScene<'_>) -> Result<T>) -> Result<T> {
    let store = snapshot.store();
    let rays = store.rays()?;
    let check = |at: &ClusterRef| rays.check(at);
    let look = FirstLook::new(rays.top()?.clusters.len(), &check);
    let (emitters, snap_m) = (emitters(snapshot)?, store.facts()?.snap_m);
    let scene = RayScene::new(rays.top()?, rays.file(), &emitters, snap_m).map_err(|e| rays.damage(e))?;
    let scene = scene.with_first_look(&look);
    let done = work(&OpenScene { scene, look: &look, is_dark: emitters.is_empty() });
    look.verdict()?;
    done
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
