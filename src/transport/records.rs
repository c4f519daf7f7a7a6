//! A mesh as a radiosity extent: rows, then elements, coarse first.

use super::nodes::mesh::Mesh;
use crate::model::layout::ArraysBuilder;
use crate::model::light::{ElementLight, LightHead, RowLight};

/// The payload of the mesh's radiosity extent.
#[must_use]
pub fn encode(mesh: &Mesh) -> Vec<u8> {
    let mut elements: Vec<(u32, ElementLight)> = (mesh.elements.iter())
        .map(|e| {
            let [slope_u, slope_v] = e.line.along.map(|along| along.to_f32());
            let irradiance = e.line.mean.to_f32();
            (e.name.depth(), ElementLight { name: e.name.0, irradiance, slope_u, slope_v, reserved: 0 })
        })
        .collect();
    elements.sort_by_key(|(depth, light)| (*depth, light.name));
    let mut level_start = [0u32; 16];
    for depth in 0..15u32 {
        level_start[depth as usize + 1] = elements.partition_point(|(d, _)| *d <= depth) as u32;
    }
    let head = LightHead { channels: 3, layer: 0, level_start, reserved: [0; 2] };
    let elements: Vec<ElementLight> = elements.into_iter().map(|(_, light)| light).collect();
    let rows: Vec<RowLight> = (mesh.rows.iter())
        .map(|row| {
            let [slope_u, slope_v] = row.fit.line.along.map(|along| along.to_f32());
            RowLight {
                name: mesh.elements[row.element as usize].name.0,
                irradiance: row.fit.line.mean.to_f32(),
                slope_u,
                slope_v,
                structure: row.fit.structure as f32,
                structure_error: row.fit.structure_error as f32,
                found: row.fit.found as f32,
                noise: row.fit.noise as f32,
                rounds: row.rounds,
                part: row.part as u16,
            }
        })
        .collect();
    ArraysBuilder::default().with(&[head]).with(&rows).with(&elements).finish()
}
