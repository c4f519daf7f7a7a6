//! The leaves of a cluster's quadtrees with their light, in order of name.

use bytemuck::Zeroable;

use crate::base::{NodeName, PatchSide, Rgb};
use crate::geom::grid::GridPoint;
use crate::geom::polygon::Polygon;
use crate::geom::quadtree::element_polygon;
use crate::model::light::ElementLight;
use crate::transport::light::at::{SideLights, Vertex};
use crate::transport::light::line::Line;
use crate::transport::source::ClusterView;

/// A leaf element.
pub struct Leaf {
    /// Its name.
    pub name: NodeName,
    /// Its shape, winding towards its own side, m from the store's origin.
    pub shape: Polygon,
    /// What leaves it, W/m2.
    pub radiosity: Rgb,
    /// What arrives at it, W/m2.
    pub irradiance: Rgb,
}

/// The lines of one patch side's leaves, in order of the tree; none for a side that takes no part.
#[must_use]
pub fn lines_of_side(view: &ClusterView<'_>, at: PatchSide) -> Vec<(NodeName, Line)> {
    if !view.takes_part(at.index()) {
        return Vec::new();
    }
    let mut lines = Vec::new();
    let mut below = vec![NodeName::root(view.id, at)];
    while let Some(name) = below.pop() {
        if view.light.has_children(name) {
            below.extend((0..4).rev().map(|quarter| name.child(quarter)));
            continue;
        }
        let light = view.light.find(name).copied().unwrap_or(ElementLight::zeroed());
        let along = [light.slope_u, light.slope_v].map(Rgb::from_f32);
        lines.push((name, Line { mean: Rgb::from_f32(light.irradiance), along }));
    }
    lines
}

/// The leaves of one patch side, in order of name; none for a side that takes no part.
#[must_use]
pub fn of_side(view: &ClusterView<'_>, at: PatchSide) -> Vec<Leaf> {
    of_lines(view, at, &in_order(lines_of_side(view, at)))
}

fn in_order(mut lines: Vec<(NodeName, Line)>) -> Vec<(NodeName, Line)> {
    lines.sort_unstable_by_key(|(name, _)| *name);
    lines
}

fn of_lines(view: &ClusterView<'_>, at: PatchSide, lines: &[(NodeName, Line)]) -> Vec<Leaf> {
    let patch = &view.geometry.patches[usize::from(at.patch)];
    let material = &view.materials[at.index()];
    let (rho, exitance) = (Rgb::from_f32(material.rho), Rgb::from_f32(material.exitance));
    let leaf = |&(name, line): &(NodeName, Line)| {
        let shape = element_polygon(patch, name.path());
        let shape = if at.side == 0 { shape } else { shape.reversed() };
        Leaf { name, shape, radiosity: exitance + rho.times(line.mean), irradiance: line.mean }
    };
    lines.iter().map(leaf).collect()
}

/// All sides of a cluster's patches, in order of name.
pub fn sides(view: &ClusterView<'_>) -> impl Iterator<Item = PatchSide> + use<> {
    (0..2 * view.geometry.patches.len()).map(PatchSide::from_index)
}

/// A patch side as a mesh: vertices that leaves share, with smooth light.
pub struct SideMesh {
    /// Position, m from the store's origin, and radiosity, W/m2.
    pub vertices: Vec<([f64; 3], Rgb)>,
    /// Unit normal of the side.
    pub normal: [f64; 3],
    /// Leaves with vertices, three or four, winding towards the side. A leaf beside smaller ones is made of triangles, so
    /// that no vertex lies on an edge.
    pub faces: Vec<(NodeName, Vec<u32>)>,
    /// Leaves.
    pub leaves: u64,
}

impl SideMesh {
    /// From its leaves; `None` if there are none. `lights`: of its cluster.
    #[must_use]
    pub fn new(view: &ClusterView<'_>, at: PatchSide, lights: &mut SideLights) -> Option<Self> {
        let lines = in_order(lines_of_side(view, at));
        let leaves = of_lines(view, at, &lines);
        let first = leaves.first()?;
        let light = lights.of(&view.geometry, at, |side| lines_of_side(view, side));
        let material = &view.materials[at.index()];
        let (rho, exitance) = (Rgb::from_f32(material.rho), Rgb::from_f32(material.exitance));
        let mut known: std::collections::BTreeMap<GridPoint, u32> = std::collections::BTreeMap::new();
        let mut mesh = Self {
            vertices: Vec::new(),
            normal: first.shape.normal().to_array(),
            faces: Vec::with_capacity(leaves.len()),
            leaves: leaves.len() as u64,
        };
        for leaf in &leaves {
            let is_back = leaf.name.patch_side().side == 1;
            let front = if is_back { leaf.shape.reversed() } else { leaf.shape };
            let (outline, triangles) = light.outline(leaf.name, &front);
            let mut vertex = |of: &Vertex| {
                let next = mesh.vertices.len() as u32;
                let number = of.point.map_or(next, |at| *known.entry(at).or_insert(next));
                if number == next {
                    mesh.vertices.push((of.place.to_array(), exitance + rho.times(of.light)));
                }
                number
            };
            let numbers: Vec<u32> = outline.iter().map(&mut vertex).collect();
            let faces: Vec<Vec<u32>> = if triangles.is_empty() {
                vec![numbers]
            } else {
                triangles.iter().map(|of| of.iter().map(|&i| numbers[i]).collect()).collect()
            };
            for mut face in faces {
                // Corners of a back run the other way round.
                if is_back {
                    face.reverse();
                }
                mesh.faces.push((leaf.name, face));
            }
        }
        Some(mesh)
    }

    /// Whether no light leaves it.
    #[must_use]
    pub fn is_dark(&self) -> bool {
        self.vertices.iter().all(|v| v.1.is_black())
    }

    /// Triangles of the faces.
    pub fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.faces.iter().flat_map(|(_, f)| (1..f.len() - 1).map(|i| [f[0], f[i], f[i + 1]]))
    }
}
