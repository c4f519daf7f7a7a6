//! glTF 2.0 binary out: one node per cluster, unlit, light as vertex colours and as true values.
//!
//! Everything goes through temporary files, so that memory stays bounded; JSON first, then buffers.

use std::io::{self, Write};
use std::path::Path;

use serde_json::json;

use super::spool::Spool;

/// A mesh with light.
#[derive(Default)]
pub struct GlbMesh {
    /// Places, m, +Y up.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals.
    pub normals: Vec<[f32; 3]>,
    /// What leaves the surface, W/m2.
    pub radiosity: Vec<[f32; 3]>,
    /// Three per triangle.
    pub indices: Vec<u32>,
}

/// What the whole file says of itself.
pub struct GlbFacts {
    /// Radiosity that is shown as 1, W/m2.
    pub exposure_w_m2: f64,
    /// Where the meshes' origin lies, m, +Y up.
    pub origin_m: [f64; 3],
}

/// Collects meshes, then writes them.
pub struct GlbWriter {
    facts: GlbFacts,
    views: Spool,
    accessors: Spool,
    meshes: Spool,
    nodes: Spool,
    binary: Spool,
    count: u64,
    accessor_count: u64,
}

/// Bytes of a file's headers and JSON head, at most.
const OVERHEAD: u64 = 4096;

impl GlbWriter {
    /// An empty one; `dir` takes unnamed temporary files.
    pub fn create(dir: &Path, facts: GlbFacts) -> io::Result<Self> {
        let spool = |name: &str| Spool::create(dir, &format!("glb-{name}"));
        Ok(Self {
            facts,
            views: spool("views")?,
            accessors: spool("accessors")?,
            meshes: spool("meshes")?,
            nodes: spool("nodes")?,
            binary: spool("binary")?,
            count: 0,
            accessor_count: 0,
        })
    }

    /// Bytes that the file has so far.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let json = self.views.bytes() + self.accessors.bytes() + self.meshes.bytes() + self.nodes.bytes();
        OVERHEAD + json + self.binary.bytes()
    }

    /// Adds a mesh as a node of that name; one without triangles is left out.
    pub fn mesh(&mut self, name: &str, mesh: &GlbMesh) -> io::Result<()> {
        if mesh.indices.is_empty() {
            return Ok(());
        }
        let n = self.count;
        let vertices = mesh.positions.len();
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for p in &mesh.positions {
            for i in 0..3 {
                low[i] = low[i].min(p[i]);
                high[i] = high[i].max(p[i]);
            }
        }
        let exposure = self.facts.exposure_w_m2;
        let shown = |x: f32| (f64::from(x) / exposure).clamp(0.0, 1.0) * 65535.0;
        let colours: Vec<[u16; 4]> = mesh
            .radiosity
            .iter()
            .map(|b| [shown(b[0]).round() as u16, shown(b[1]).round() as u16, shown(b[2]).round() as u16, u16::MAX])
            .collect();
        self.accessor(
            bytemuck::cast_slice(&mesh.positions),
            34962,
            &json!({"componentType": 5126, "type": "VEC3",
            "count": vertices, "min": low, "max": high}),
        )?;
        self.accessor(
            bytemuck::cast_slice(&mesh.normals),
            34962,
            &json!({"componentType": 5126, "type": "VEC3",
            "count": vertices}),
        )?;
        self.accessor(
            bytemuck::cast_slice(&colours),
            34962,
            &json!({"componentType": 5123, "type": "VEC4",
            "normalized": true, "count": vertices}),
        )?;
        self.accessor(
            bytemuck::cast_slice(&mesh.radiosity),
            34962,
            &json!({"componentType": 5126, "type": "VEC3",
            "count": vertices}),
        )?;
        self.accessor(
            bytemuck::cast_slice(&mesh.indices),
            34963,
            &json!({"componentType": 5125, "type": "SCALAR",
            "count": mesh.indices.len()}),
        )?;
        let a = self.accessor_count - 5;
        put(
            &mut self.meshes,
            n == 0,
            &json!({"name": name, "primitives": [{"material": 0, "indices": a + 4,
            "attributes": {"POSITION": a, "NORMAL": a + 1, "COLOR_0": a + 2, "_RADIOSITY": a + 3}}]}),
        )?;
        put(&mut self.nodes, n == 0, &json!({"name": name, "mesh": n}))?;
        self.count += 1;
        Ok(())
    }

    fn accessor(&mut self, bytes: &[u8], target: u32, accessor: &serde_json::Value) -> io::Result<()> {
        let first = self.views.bytes() == 0;
        let view = json!({"buffer": 0, "byteOffset": self.binary.bytes(), "byteLength": bytes.len(), "target": target});
        put(&mut self.views, first, &view)?;
        let mut accessor = accessor.clone();
        accessor["bufferView"] = json!(self.accessor_count);
        self.accessor_count += 1;
        put(&mut self.accessors, first, &accessor)?;
        self.binary.write_all(bytes)
    }

    /// Writes the file.
    pub fn finish(self, out: &mut dyn Write) -> io::Result<()> {
        let roots: Vec<u64> = vec![self.count];
        let children: Vec<u64> = (0..self.count).collect();
        let root = json!({"name": "clerestory", "translation": self.facts.origin_m, "children": children});
        let head = json!({
            "asset": {"version": "2.0", "generator": "clerestory"},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{"nodes": roots, "extras": {
                "exposure": self.facts.exposure_w_m2,
                "exposure_unit": "W/m2",
                "radiosity_unit": "W/m2",
                "colours": "COLOR_0 = radiosity / exposure, at most 1, linear; _RADIOSITY = radiosity",
            }}],
            "materials": [{"name": "radiosity", "extensions": {"KHR_materials_unlit": {}},
                "pbrMetallicRoughness": {"baseColorFactor": [1.0, 1.0, 1.0, 1.0], "metallicFactor": 0.0,
                    "roughnessFactor": 1.0}}],
            "buffers": [{"byteLength": self.binary.bytes()}],
        });
        let head = head.to_string();
        let head = head.strip_suffix('}').unwrap_or(&head);
        let root = root.to_string();
        let comma = if self.count == 0 { "" } else { "," };
        let lists = [
            (",\"bufferViews\":[", self.views, "]"),
            (",\"accessors\":[", self.accessors, "]"),
            (",\"meshes\":[", self.meshes, "]"),
        ];
        let mut length = head.len() as u64 + 1;
        for (before, list, after) in &lists {
            length += before.len() as u64 + list.bytes() + after.len() as u64;
        }
        let (nodes_before, nodes_after) = (",\"nodes\":[", format!("{comma}{root}]"));
        length += nodes_before.len() as u64 + self.nodes.bytes() + nodes_after.len() as u64;
        let json_padding = length.next_multiple_of(4) - length;
        let binary = self.binary.bytes();
        let total = 12 + 8 + length + json_padding + 8 + binary;
        let word = |n: u64| u32::try_from(n).map_err(|_| io::Error::other("over 4 GiB: more than GLB can hold"));
        out.write_all(b"glTF")?;
        for n in [2, total, length + json_padding] {
            out.write_all(&word(n)?.to_le_bytes())?;
        }
        out.write_all(b"JSON")?;
        out.write_all(head.as_bytes())?;
        for (before, list, after) in lists {
            out.write_all(before.as_bytes())?;
            list.copy_to(out)?;
            out.write_all(after.as_bytes())?;
        }
        out.write_all(nodes_before.as_bytes())?;
        self.nodes.copy_to(out)?;
        out.write_all(nodes_after.as_bytes())?;
        out.write_all(b"}")?;
        out.write_all(&b"   "[..json_padding as usize])?;
        out.write_all(&word(binary)?.to_le_bytes())?;
        out.write_all(b"BIN\0")?;
        self.binary.copy_to(out)
    }
}

fn put(list: &mut Spool, first: bool, item: &serde_json::Value) -> io::Result<()> {
    if !first {
        list.write_all(b",")?;
    }
    list.write_all(item.to_string().as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_aligned_and_accessors_lie_within_the_buffer() {
        let dir = tempfile::tempdir().unwrap();
        let facts = GlbFacts { exposure_w_m2: 2.0, origin_m: [1e4, 0.0, 0.0] };
        let mut glb = GlbWriter::create(dir.path(), facts).unwrap();
        let mesh = GlbMesh {
            positions: vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]],
            normals: vec![[0., 0., 1.]; 3],
            radiosity: vec![[1.0, 4.0, 0.0]; 3],
            indices: vec![0, 1, 2],
        };
        glb.mesh("floor", &mesh).unwrap();
        glb.mesh("empty", &GlbMesh::default()).unwrap();
        glb.mesh("wall \"a\"", &mesh).unwrap();
        let mut out = Vec::new();
        glb.finish(&mut out).unwrap();
        let word = |at: usize| u32::from_le_bytes(out[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&out[..4], word(4), word(8)), (&b"glTF"[..], 2, out.len()));
        let json_bytes = word(12);
        assert_eq!(json_bytes % 4, 0);
        let json: serde_json::Value = serde_json::from_slice(&out[20..20 + json_bytes]).unwrap();
        let binary = 20 + json_bytes + 8;
        assert_eq!(word(20 + json_bytes), out.len() - binary);
        assert_eq!(json["nodes"].as_array().unwrap().len(), 3, "two clusters and the root");
        assert_eq!(json["scenes"][0]["nodes"][0], 2);
        assert_eq!(json["nodes"][1]["name"], "wall \"a\"");
        for accessor in json["accessors"].as_array().unwrap() {
            let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            let end = view["byteOffset"].as_u64().unwrap() + view["byteLength"].as_u64().unwrap();
            assert!(end as usize <= out.len() - binary);
        }
        let colour = json["meshes"][1]["primitives"][0]["attributes"]["COLOR_0"].as_u64().unwrap() as usize;
        let at = binary + json["bufferViews"][colour]["byteOffset"].as_u64().unwrap() as usize;
        let channel = |i: usize| u16::from_le_bytes(out[at + 2 * i..at + 2 * i + 2].try_into().unwrap());
        assert_eq!([channel(0), channel(1), channel(2), channel(3)], [32768, 65535, 0, 65535]);
    }
}
