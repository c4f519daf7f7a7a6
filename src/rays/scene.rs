//! The rays' view of a model: the top level, and the clusters' structures in one mapped file.

use glam::DVec3;

use super::emitters::Emitters;
use super::first_look::FirstLook;
use crate::geom::cut_tree::{axes_kept, part_at};
use crate::geom::split::area_vector;
use crate::model::rays::{ClusterRef, Cuts, RayNode, RayPatch, TopRaysView, WHOLE};

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
    /// No coordinate is larger.
    pub(super) largest_m: f32,
}

impl PatchKey {
    /// As it is stored: cluster * 256 + patch.
    #[must_use]
    pub fn packed(self) -> u32 {
        self.cluster << 8 | self.patch
    }

    /// From what is stored.
    #[must_use]
    pub fn of_packed(packed: u32) -> Self {
        Self { cluster: packed >> 8, patch: packed & 0xff }
    }
}

/// The ray structure of a cluster, as far as most rays need it.
#[derive(Clone, Copy)]
pub(super) struct Structure<'a> {
    /// Its number.
    pub(super) cluster: u32,
    /// Box hierarchy; node 0 is the root.
    pub(super) nodes: &'a [RayNode],
    /// Faces, in leaf order.
    pub(super) faces: &'a [RayPatch],
    at: &'a ClusterRef,
}

impl Structure<'_> {
    /// What names one of its faces: the face's first part.
    #[inline(always)]
    pub(super) fn key(&self, face: &RayPatch) -> PatchKey {
        PatchKey { cluster: self.cluster, patch: face.patch }
    }
}

impl<'a> RayScene<'a> {
    /// From the top extent and the whole segment file that it and all clusters' structures lie in;
    /// what is wrong with them otherwise. `snap_m`: faces this near coincide; of those `emitters` are seen.
    pub fn new(top: TopRaysView<'a>, file: &'a [u8], emitters: &'a Emitters, snap_m: f64) -> Result<Self, String> {
        let root = top.nodes.first().ok_or("the top level of the ray structure is empty")?;
        let scene = Self { top, file, emitters, look: None, snap_m, largest_m: root.largest_m() };
        for at in top.clusters {
            if scene.structure(at).is_none_or(|c| c.nodes.is_empty()) || scene.cuts(at).is_none() {
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

    fn structure(&self, at: &'a ClusterRef) -> Option<Structure<'a>> {
        Some(Structure {
            cluster: at.cluster,
            nodes: self.slice(at.nodes_at, at.nodes)?,
            faces: self.slice(at.patches_at, at.patches)?,
            at,
        })
    }

    /// How a cluster's faces are cut.
    fn cuts(&self, at: &ClusterRef) -> Option<Cuts<'a>> {
        Some(Cuts {
            faces: self.slice(at.cuts_at, at.cuts)?,
            nodes: self.slice(at.cut_nodes_at, at.cut_nodes)?,
            parts: self.slice(at.parts_at, at.parts)?,
        })
    }

    /// The patch that a place of a face lies in.
    pub(super) fn patch_at(&self, of: &Structure<'_>, face: &RayPatch, place: DVec3) -> PatchKey {
        if face.cut == WHOLE {
            return of.key(face);
        }
        let cuts = self.cuts(of.at).expect("`new` checked every cluster");
        // Rays pass through damage only until somebody asks: see `FirstLook`.
        let (nodes, parts) = cuts.of_face(face.cut).unwrap_or((&[], &[]));
        let corners = face.corners_m.map(|c| DVec3::from_array(c.map(f64::from)));
        // The axis that was dropped when the tree was made: to the bit, where two are as good.
        let axes = axes_kept(area_vector(&corners[..face.corner_count as usize]));
        let part = parts.get(part_at(nodes, axes, place) as usize);
        part.map_or(of.key(face), |&packed| PatchKey::of_packed(packed))
    }

    /// The same scene, of which rays meet only what has been looked at and found sound.
    #[must_use]
    pub fn with_first_look(self, look: &'a FirstLook<'a>) -> Self {
        Self { look: Some(look), ..self }
    }

    /// The cluster at a place with its structure; `None` if that is damaged.
    #[inline(always)]
    pub(super) fn cluster_at(&self, place: usize) -> Option<Structure<'a>> {
        let at = &self.top.clusters[place];
        if self.look.is_some_and(|look| !look.finds_sound(place, at)) {
            return None;
        }
        Some(self.structure(at).expect("`new` checked every cluster"))
    }

    /// Faces this near coincide, m.
    #[must_use]
    pub fn snap_m(&self) -> f64 {
        self.snap_m
    }
}
