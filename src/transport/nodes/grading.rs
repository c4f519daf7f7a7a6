//! Where a mesh is uneven: an edge of light that rays found in one element goes on in those beside it, where they may have
//! missed it. So elements that lie beside each other are to differ by one level at most (restricted quadtrees: Baum, Mann,
//! Smith, Winget 1991).

use std::collections::BTreeSet;

use super::frame::Plane;
use super::mesh::Mesh;
use crate::base::NodeName;
use crate::geom::quadtree;
use crate::model::geometry::{NONE, PatchRecord};
use crate::transport::light::lit::LitCluster;
use crate::transport::row::Part;

/// Rows whose neighbours of the same part and patch lie more than one level below them. `lit`: the light of `mesh`.
#[must_use]
pub fn uneven(mesh: &Mesh, patches: &[PatchRecord], lit: &LitCluster) -> BTreeSet<(NodeName, Part)> {
    let above = mesh.rows_above();
    let mut found = BTreeSet::new();
    let outlines: Vec<Vec<Plane>> = patches
        .iter()
        .enumerate()
        .map(|(patch, record)| lit.frame(patch as u8).corners(&quadtree::patch_polygon(record)))
        .collect();
    mesh.for_each_shape(patches, |at, shape| {
        let name = mesh.elements[at].name;
        if name.depth() < 2 {
            return;
        }
        for part in Part::ALL {
            let own = above[at][part as usize];
            if own == NONE || mesh.rows[own as usize].element != at as u32 {
                continue;
            }
            let side = name.patch_side();
            for beyond in beyond_edges(&lit.frame(side.patch).corners(shape), mesh.elements[at].centroid) {
                if !is_inside(&outlines[usize::from(side.patch)], beyond) {
                    continue;
                }
                let (leaf, _) = lit.leaf_at(side, beyond.map(|x| x as f32));
                let beside = above[leaf as usize][part as usize];
                if beside != NONE {
                    let beside = mesh.elements[mesh.rows[beside as usize].element as usize].name;
                    if beside.depth() + 1 < name.depth() {
                        found.insert((beside, part));
                    }
                }
            }
        }
    });
    found
}

fn beyond_edges(corners: &[Plane], centroid: Plane) -> impl Iterator<Item = Plane> + '_ {
    (0..corners.len()).map(move |i| {
        let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
        [0, 1].map(|k| {
            let middle = 0.5 * (a[k] + b[k]);
            middle + 0.5 * (middle - centroid[k])
        })
    })
}

/// Whether a place lies in a convex outline that goes round counterclockwise.
fn is_inside(outline: &[Plane], [x, y]: Plane) -> bool {
    (0..outline.len()).all(|i| {
        let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
        (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) >= 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, PatchSide};
    use crate::model::geometry::SideMaterial;
    use crate::transport::light::line::Fit;
    use crate::transport::nodes::mesh::MeshRow;
    use bytemuck::Zeroable;

    #[test]
    fn an_element_beside_much_smaller_ones_is_uneven_and_others_are_not() {
        let mut patch = PatchRecord::zeroed();
        patch.corners_m = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        (patch.corner_count, patch.sides) = (4, 3);
        let patches = [patch];
        let mut mesh = Mesh::new(ClusterId(0), &patches);
        let side = PatchSide { patch: 0, side: 0 };
        let root = NodeName::root(ClusterId(0), side);
        // The element in the middle of the front, at the corner of the first quarter.
        let mut deepest = root;
        for level in 0..3 {
            let at = mesh.nearest(deepest);
            mesh.split(at, &patches[0]);
            let middle = [0.499, 0.499];
            let lit = LitCluster::of(&mesh, &patches, &[SideMaterial::zeroed(); 2]);
            deepest = mesh.elements[lit.leaf_at(side, middle).0 as usize].name;
            assert_eq!(deepest.depth(), level + 1);
        }
        for at in 0..mesh.elements.len() {
            if mesh.elements[at].is_leaf() && mesh.elements[at].name.patch_side() == side {
                let row = MeshRow { element: at as u32, part: Part::Direct, rounds: 1, fit: Fit::default() };
                mesh.rows.push(row);
            }
        }
        let lit = LitCluster::of(&mesh, &patches, &[SideMaterial::zeroed(); 2]);
        let found = uneven(&mesh, &patches, &lit);
        // The two quarters beside the first, which reaches the middle in three steps; the opposite one touches a corner.
        let quarters: BTreeSet<NodeName> = found.iter().map(|(name, _)| *name).collect();
        assert_eq!((found.len(), quarters.len()), (2, 2), "{found:?}");
        assert!(found.iter().all(|(name, part)| name.depth() == 1 && *part == Part::Direct));
    }
}
