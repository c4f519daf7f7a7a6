//! The rays' view of a model: the top level, and the clusters' structures in one mapped file.

use super::emitters::Emitters;
use super::first_look::FirstLook;
use crate::model::rays::{ClusterRaysView, ClusterRef, RayNode, RayPatch, TopRaysView};

/// A patch anywhere in the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PatchKey {
    /// Cluster number.
    pub cluster: u32,
    /// Patch number within it.
    pub patch: u32,
}

/// Everything that rays can meet.
#[derive(Clone, Copy)]
pub struct RayScene<'a> {
    pub(super) top: TopRaysView<'a>,
    file: &'a [u8],
    /// What is seen first of faces that coincide.
    pub(super) emitters: &'a Emitters,
    /// Checks what rays come to; what is not looked at is trusted.
    look: Option<&'a FirstLook<'a>>,
    /// Faces this near coincide, m.
    pub(super) snap_m: f64,
}

impl<'a> RayScene<'a> {
    /// From the top extent and the whole segment file that it and all clusters' structures lie in;
    /// what is wrong with them otherwise. `snap_m`: faces this near coincide; of those `emitters` are seen.
    pub fn new(top: TopRaysView<'a>, file: &'a [u8], emitters: &'a Emitters, snap_m: f64) -> Result<Self, String> {
        if top.nodes.is_empty() {
            return Err("the top level of the ray structure is empty".to_owned());
        }
        let scene = Self { top, file, emitters, look: None, snap_m };
        for at in top.clusters {
            if scene.try_cluster(at).is_none_or(|c| c.nodes.is_empty()) {
                return Err(format!("the ray structure of cluster {} lies outside its segment", at.cluster));
            }
        }
        Ok(scene)
    }

    fn slice<T: bytemuck::Pod>(&self, at: u64, count: u32) -> Option<&'a [T]> {
        let start = usize::try_from(at).ok()?;
        let bytes = self.file.get(start..start.checked_add(count as usize * size_of::<T>())?)?;
        bytemuck::try_cast_slice(bytes).ok()
    }

    fn try_cluster(&self, at: &ClusterRef) -> Option<ClusterRaysView<'a>> {
        Some(ClusterRaysView {
            nodes: self.slice::<RayNode>(at.nodes_at, at.nodes)?,
            patches: self.slice::<RayPatch>(at.patches_at, at.patches)?,
        })
    }

    /// The same scene, of which rays meet only what has been looked at and found sound.
    #[must_use]
    pub fn with_first_look(self, look: &'a FirstLook<'a>) -> Self {
        Self { look: Some(look), ..self }
    }

    /// Places of the clusters of a leaf of the top level.
    #[inline(always)]
    pub(super) fn places(leaf: &RayNode) -> std::ops::Range<usize> {
        leaf.first as usize..(leaf.first + leaf.count) as usize
    }

    /// The cluster at a place with its structure; `None` if that is damaged.
    #[inline(always)]
    pub(super) fn cluster_at(&self, place: usize) -> Option<(u32, ClusterRaysView<'a>)> {
        let at = &self.top.clusters[place];
        if self.look.is_some_and(|look| !look.finds_sound(place, at)) {
            return None;
        }
        Some((at.cluster, self.try_cluster(at).expect("`new` checked every cluster")))
    }

    /// Faces this near coincide, m.
    #[must_use]
    pub fn snap_m(&self) -> f64 {
        self.snap_m
    }
}
