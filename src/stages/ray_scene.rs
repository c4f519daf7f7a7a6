//! What rays can meet, opened for a version: the ray structures, checked as rays come to them, and which sides emit.

use super::working_set::WorkingSet;
use crate::base::Result;
use crate::model::rays::ClusterRef;
use crate::rays::{FirstLook, RayScene};

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
pub fn with_scene<T>(set: &WorkingSet<'_>, work: impl FnOnce(&OpenScene<'_>) -> Result<T>) -> Result<T> {
    let store = set.snapshot().store();
    let rays = store.rays()?;
    let check = |at: &ClusterRef| rays.check(at);
    let look = FirstLook::new(rays.top()?.clusters.len(), &check);
    let (emitters, snap_m) = (set.emitters()?, store.facts()?.snap_m);
    let scene = RayScene::new(rays.top()?, rays.file(), emitters, snap_m).map_err(|e| rays.damage(e))?;
    let scene = scene.with_first_look(&look);
    let done = work(&OpenScene { scene, look: &look, is_dark: emitters.is_empty() });
    look.verdict()?;
    done
}
