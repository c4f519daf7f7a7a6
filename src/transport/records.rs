//! A mesh as a radiosity extent: coarse first, with the light of sector nodes.

use super::mesh::Mesh;
use crate::base::Rgb;
use crate::geom::quadtree;
use crate::model::geometry::{GeometryView, SideMaterial, sector_of};
use crate::model::layout::ArraysBuilder;
use crate::model::light::{ElementLight, LightHead, SectorLight};

/// The payload of the mesh's radiosity extent.
#[must_use]
pub fn encode(mesh: &Mesh, geometry: &GeometryView<'_>, materials: &[SideMaterial]) -> Vec<u8> {
    let mut elements: Vec<(u32, ElementLight)> = mesh
        .elements
        .iter()
        .map(|e| {
            let light = ElementLight { name: e.name.0, irradiance: e.irradiance.to_f32(), spread: e.spread() as f32 };
            (e.name.depth(), light)
        })
        .collect();
    elements.sort_by_key(|(depth, light)| (*depth, light.name));
    let mut level_start = [0u32; 16];
    for depth in 0..15u32 {
        level_start[depth as usize + 1] = elements.partition_point(|(d, _)| *d <= depth) as u32;
    }
    let head = LightHead { channels: 3, layer: 0, level_start, reserved: [0; 2] };
    let elements: Vec<ElementLight> = elements.into_iter().map(|(_, light)| light).collect();
    ArraysBuilder::default().with(&[head]).with(&sectors(mesh, geometry, materials)).with(&elements).finish()
}

/// Light of one patch side's root.
struct Side {
    area: f64,
    radiosity: Rgb,
    irradiance: Rgb,
    /// Smallest and largest radiosity of its leaves, per channel.
    low: [f64; 3],
    high: [f64; 3],
    sector: u8,
}

fn sides(mesh: &Mesh, geometry: &GeometryView<'_>, materials: &[SideMaterial]) -> Vec<Option<Side>> {
    (0..2 * geometry.patches.len())
        .map(|i| {
            let patch = &geometry.patches[i / 2];
            if patch.sides & (1 << (i % 2)) == 0 {
                return None;
            }
            let front = quadtree::patch_polygon(patch).normal();
            let normal = if i % 2 == 0 { front } else { -front };
            let (rho, exitance) = (Rgb::from_f32(materials[i].rho), Rgb::from_f32(materials[i].exitance));
            let root = &mesh.elements[i];
            Some(Side {
                area: root.area_m2,
                radiosity: exitance + rho.times(root.irradiance),
                irradiance: root.irradiance,
                low: (exitance + rho.times(Rgb(root.leaf_low))).0,
                high: (exitance + rho.times(Rgb(root.leaf_high))).0,
                sector: sector_of(normal.to_array()),
            })
        })
        .collect()
}

fn sectors(mesh: &Mesh, geometry: &GeometryView<'_>, materials: &[SideMaterial]) -> Vec<SectorLight> {
    let sides = sides(mesh, geometry, materials);
    geometry
        .sectors
        .iter()
        .map(|head| {
            let tree = &geometry.tree[head.tree_node as usize];
            let first = usize::from(tree.first_patch) * 2;
            let sector = head.node().sector_digit();
            let below = || {
                sides[first..first + usize::from(tree.patch_count) * 2].iter().flatten().filter(|s| s.sector == sector)
            };
            let area: f64 = below().map(|s| s.area).sum();
            let mean = |f: fn(&Side) -> Rgb| {
                below().fold(Rgb::BLACK, |sum, s| sum + f(s) * s.area) * (1.0 / area.max(f64::MIN_POSITIVE))
            };
            let radiosity = mean(|s| s.radiosity);
            let spread = below()
                .flat_map(|s| (0..3).map(|i| (s.high[i] - radiosity.0[i]).max(radiosity.0[i] - s.low[i])))
                .fold(0.0, f64::max);
            SectorLight {
                name: head.name,
                radiosity: radiosity.to_f32(),
                irradiance: mean(|s| s.irradiance).to_f32(),
                spread: spread as f32,
                reserved: 0,
            }
        })
        .collect()
}
