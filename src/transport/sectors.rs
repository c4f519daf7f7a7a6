//! The sector nodes of a receiving cluster: above the roots of its patch sides, in the same hierarchy.

use std::ops::AddAssign;

use crate::base::{NodeName, PatchSide, Rgb};
use crate::geom::quadtree;
use crate::model::geometry::{GeometryView, NONE, SideMaterial, sector_of};

use super::mesh::Mesh;

/// A sector node while a task works on its cluster.
#[derive(Clone, Copy, Debug)]
pub struct Sector {
    /// Its name.
    pub name: NodeName,
    /// Position of the sector node above, or [`NONE`]; it comes earlier.
    pub parent: u32,
    /// Area of the sides below, m2.
    pub area_m2: f64,
}

/// Which way a patch side faces: the sector it belongs to.
#[must_use]
pub fn sector_of_side(geometry: &GeometryView<'_>, at: PatchSide) -> u8 {
    let front = quadtree::patch_polygon(&geometry.patches[usize::from(at.patch)]).normal();
    sector_of((if at.side == 0 { front } else { -front }).to_array())
}

/// Position among a cluster's sector nodes, by sector and node of the tree.
fn find(geometry: &GeometryView<'_>, of: NodeName, sector: u8, tree_node: u32) -> u32 {
    let name = NodeName::sector(of.cluster(), sector, u64::from(tree_node));
    geometry.sectors.binary_search_by_key(&name.0, |s| s.name).map_or(NONE, |i| i as u32)
}

/// All sector nodes of a cluster, by name.
#[must_use]
pub fn load(geometry: &GeometryView<'_>) -> Vec<Sector> {
    let above = |head: &crate::model::geometry::SectorHead| {
        let parent = geometry.tree[head.tree_node as usize].parent;
        if parent == NONE { NONE } else { find(geometry, head.node(), head.node().sector_digit(), parent) }
    };
    geometry
        .sectors
        .iter()
        .map(|head| Sector { name: head.node(), parent: above(head), area_m2: f64::from(head.area_m2) })
        .collect()
}

/// The lowest sector node above each patch side, or [`NONE`] for a side that takes no part.
#[must_use]
pub fn above_sides(geometry: &GeometryView<'_>, of: NodeName) -> Vec<u32> {
    (0..2 * geometry.patches.len())
        .map(|index| {
            let (at, patch) = (PatchSide::from_index(index), &geometry.patches[index / 2]);
            if patch.sides & (1 << (index % 2)) == 0 {
                return NONE;
            }
            find(geometry, of, sector_of_side(geometry, at), u32::from(patch.tree_node))
        })
        .collect()
}

/// What each sector node holds of the roots below it, summed in their order; `of_root` by position.
#[must_use]
pub fn sum_up<T: Copy + Default + AddAssign>(mesh: &Mesh, of_root: impl Fn(usize) -> T) -> Vec<T> {
    let mut sums = vec![T::default(); mesh.sectors.len()];
    for (root, &sector) in mesh.side_sector.iter().enumerate().filter(|(_, sector)| **sector != NONE) {
        sums[sector as usize] += of_root(root);
    }
    // Those above come earlier: sums go up from the end.
    for at in (0..sums.len()).rev() {
        let (sum, parent) = (sums[at], mesh.sectors[at].parent);
        if parent != NONE {
            sums[parent as usize] += sum;
        }
    }
    sums
}

/// Sets the areas of all sector nodes from the roots below.
pub fn measure(mesh: &mut Mesh) {
    let areas_m2 = sum_up(mesh, |root| mesh.elements[root].area_m2);
    for (sector, area_m2) in mesh.sectors.iter_mut().zip(areas_m2) {
        sector.area_m2 = area_m2;
    }
}

/// Mean radiosity of each sector node, W/m2; `materials` are two per patch.
#[must_use]
pub fn radiosities(mesh: &Mesh, materials: &[SideMaterial]) -> Vec<Rgb> {
    let power = sum_up(mesh, |i| {
        let (root, material) = (&mesh.elements[i], &materials[i]);
        let leaves = Rgb::from_f32(material.exitance) + Rgb::from_f32(material.rho).times(root.irradiance);
        leaves * root.area_m2
    });
    power.iter().zip(&mesh.sectors).map(|(p, s)| *p * (1.0 / s.area_m2.max(f64::MIN_POSITIVE))).collect()
}
