//! A mesh as a radiosity extent: coarse first, with the light of sector nodes.

use super::mesh::Mesh;
use crate::base::Rgb;
use crate::geom::quadtree;
use crate::geom::sequence::mix;
use crate::model::geometry::{GeometryView, NONE, SideMaterial, sector_of};
use crate::model::layout::ArraysBuilder;
use crate::model::light::{ElementLight, LightHead, SectorLight};

/// The payload of the mesh's radiosity extent; `seen` as in [`LightHead`].
#[must_use]
pub fn encode(mesh: &Mesh, geometry: &GeometryView<'_>, materials: &[SideMaterial], seen: u32) -> Vec<u8> {
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
    let head = LightHead { channels: 3, layer: 0, level_start, lit: lit(mesh, materials), seen };
    let elements: Vec<ElementLight> = elements.into_iter().map(|(_, light)| light).collect();
    ArraysBuilder::default().with(&[head]).with(&sectors(mesh, geometry, materials)).with(&elements).finish()
}

/// See [`LightHead`]: of the largest elements that light leaves all over.
fn lit(mesh: &Mesh, materials: &[SideMaterial]) -> u32 {
    let mut is_lit = vec![true; mesh.elements.len()];
    // Children lie behind their parents.
    for (at, element) in mesh.elements.iter().enumerate().rev() {
        is_lit[at] = if element.is_leaf() {
            let material = &materials[element.name.patch_side().index()];
            let reflected = Rgb::from_f32(material.rho).times(element.irradiance);
            !(Rgb::from_f32(material.exitance) + reflected).is_black()
        } else {
            let first = element.first_child as usize;
            is_lit[first..first + 4].iter().all(|lit| *lit)
        };
    }
    let is_largest = |parent: u32| parent == NONE || !is_lit[parent as usize];
    let largest = mesh.elements.iter().zip(&is_lit).filter(|(element, is_lit)| **is_lit && is_largest(element.parent));
    largest.fold(0, |sum, (element, _)| sum ^ mix(element.name.0)) as u32
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
            debug_assert_ne!(head.tree_node, NONE);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_lit_is_told_by_places_however_they_are_divided() {
        let materials = [SideMaterial { rho: [0.5; 3], exitance: [0.0; 3] }; 2];
        let mesh_lit_by = |irradiance: f64| Mesh::of_square(Rgb::grey(irradiance)).0;
        let patch = Mesh::of_square(Rgb::BLACK).1;
        let (dark, mut mesh) = (lit(&mesh_lit_by(0.0), &materials), mesh_lit_by(1.0));
        let whole = lit(&mesh, &materials);
        assert!(dark == 0 && whole != 0);
        mesh.split(0, &patch);
        mesh.split(3, &patch);
        assert_eq!(lit(&mesh, &materials), whole, "divided, but lit all over");
        mesh.elements[6].set_irradiance(Rgb::BLACK);
        let in_part = lit(&mesh, &materials);
        assert!(in_part != whole && in_part != 0);
        mesh.split(2, &patch);
        assert_eq!(lit(&mesh, &materials), in_part);
    }
}
