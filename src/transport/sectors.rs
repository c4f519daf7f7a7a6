//! The sector nodes of a receiving cluster: above the roots of its patch sides, in the same hierarchy.

use crate::base::{NodeName, PatchSide, Rgb};
use crate::geom::quadtree;
use crate::model::geometry::{GeometryView, NONE, SideMaterial, sector_of};

use super::mesh::Mesh;

/// A sector node while a task works on its cluster.
#[derive(Clone, Copy, Debug)]
pub struct Sector {
    /// Its name.
    pub name: NodeName,
    /// Node of the cluster's tree.
    pub tree_node: u32,
    /// Position of the sector node above, or [`NONE`]; it comes earlier.
    pub parent: u32,
    /// Area of the sides below, m2.
    pub area_m2: f64,
    /// Mean irradiance of the sides below, W/m2.
    pub irradiance: Rgb,
    /// Darkest and brightest leaf below, per channel, W/m2.
    pub leaf_low: [f64; 3],
    /// See `leaf_low`.
    pub leaf_high: [f64; 3],
}

impl Sector {
    /// Largest deviation, in any channel, of any leaf below, W/m2.
    #[must_use]
    pub fn spread(&self) -> f64 {
        let h = self.irradiance.0;
        (0..3).map(|i| (self.leaf_high[i] - h[i]).max(h[i] - self.leaf_low[i])).fold(0.0, f64::max)
    }
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

/// All sector nodes of a cluster, by name; unlit until [`pull`].
#[must_use]
pub fn load(geometry: &GeometryView<'_>) -> Vec<Sector> {
    let above = |head: &crate::model::geometry::SectorHead| {
        let parent = geometry.tree[head.tree_node as usize].parent;
        if parent == NONE { NONE } else { find(geometry, head.node(), head.node().sector_digit(), parent) }
    };
    geometry
        .sectors
        .iter()
        .map(|head| Sector {
            name: head.node(),
            tree_node: head.tree_node,
            parent: above(head),
            area_m2: f64::from(head.area_m2),
            irradiance: Rgb::BLACK,
            leaf_low: [f64::INFINITY; 3],
            leaf_high: [0.0; 3],
        })
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
            find(geometry, of, sector_of_side(geometry, at), patch.tree_node)
        })
        .collect()
}

/// Sets means and extremes of all sector nodes from the roots below.
pub fn pull(mesh: &mut Mesh) {
    let Mesh { sectors, side_sector, elements, .. } = mesh;
    for sector in sectors.iter_mut() {
        (sector.irradiance, sector.area_m2) = (Rgb::BLACK, 0.0);
        (sector.leaf_low, sector.leaf_high) = ([f64::INFINITY; 3], [0.0; 3]);
    }
    for (root, &above) in elements.iter().zip(side_sector.iter()) {
        if above == NONE {
            continue;
        }
        let sector = &mut sectors[above as usize];
        add(sector, root.irradiance * root.area_m2, root.area_m2, root.leaf_low, root.leaf_high);
    }
    // Those above come earlier: sums go up from the end.
    for at in (0..sectors.len()).rev() {
        let below = sectors[at];
        if below.parent != NONE {
            let above = &mut sectors[below.parent as usize];
            add(above, below.irradiance, below.area_m2, below.leaf_low, below.leaf_high);
        }
    }
    for sector in sectors.iter_mut() {
        sector.irradiance = sector.irradiance * (1.0 / sector.area_m2.max(f64::MIN_POSITIVE));
    }
}

fn add(to: &mut Sector, power: Rgb, area_m2: f64, low: [f64; 3], high: [f64; 3]) {
    to.irradiance += power;
    to.area_m2 += area_m2;
    to.leaf_low = std::array::from_fn(|i| to.leaf_low[i].min(low[i]));
    to.leaf_high = std::array::from_fn(|i| to.leaf_high[i].max(high[i]));
}

/// Mean radiosity of each sector node, W/m2; `materials` are two per patch.
#[must_use]
pub fn radiosities(mesh: &Mesh, materials: &[SideMaterial]) -> Vec<Rgb> {
    let mut power = vec![Rgb::BLACK; mesh.sectors.len()];
    for (i, &above) in mesh.side_sector.iter().enumerate() {
        if above != NONE {
            let (root, material) = (&mesh.elements[i], &materials[i]);
            let leaves = Rgb::from_f32(material.exitance) + Rgb::from_f32(material.rho).times(root.irradiance);
            power[above as usize] += leaves * root.area_m2;
        }
    }
    for at in (0..power.len()).rev() {
        let parent = mesh.sectors[at].parent;
        if parent != NONE {
            let sum = power[at];
            power[parent as usize] += sum;
        }
    }
    power.iter().zip(&mesh.sectors).map(|(p, s)| *p * (1.0 / s.area_m2.max(f64::MIN_POSITIVE))).collect()
}
