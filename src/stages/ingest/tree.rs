//! A cluster's records: patches in tree order, tree, sector nodes, materials, light of version 0.

use bytemuck::Zeroable;
use glam::DVec3;

use super::contact::PartSeam;
use super::faces::ClusterFaces;
use super::materials::Material;
use super::piece::{NONE as NO_MATERIAL, Piece};
use super::pieces::bounds;
use crate::base::{ClusterId, NodeName, PatchSide};
use crate::geom::bounds::Bounds;
use crate::geom::grouping::cut_by_area;
use crate::geom::polygon::Polygon;
use crate::model::geometry::{ClusterHead, NONE, PatchRecord, Seam, SectorHead, SideMaterial, TreeNode, sector_of};
use crate::model::layout::ArraysBuilder;
use crate::model::light::{ElementLight, LightHead, RowLight};
use crate::rays::PatchKey;

/// Patches of a leaf of the tree.
const LEAF: usize = 4;

/// What shapes the records besides the pieces.
#[derive(Clone, Copy)]
pub struct Rules<'a> {
    /// Materials by number.
    pub materials: &'a [Material],
    /// Whether surfaces reflect on both sides.
    pub both_sides: bool,
    /// Whether emitters shine both ways.
    pub emit_both: bool,
}

/// A cluster's records.
pub struct ClusterRecords {
    /// Head of the geometry extent.
    pub head: ClusterHead,
    /// Patches, in tree order.
    pub patches: Vec<PatchRecord>,
    /// Tree, in preorder.
    pub tree: Vec<TreeNode>,
    /// Sector nodes, by name.
    pub sectors: Vec<SectorHead>,
    /// Seams, by patch.
    pub seams: Vec<Seam>,
    /// Materials, front then back of each patch.
    pub materials: Vec<SideMaterial>,
    /// Which part each patch was.
    pub order: Vec<u32>,
    /// What names each face to rays.
    pub keys: Vec<PatchKey>,
}

struct Shape {
    area_m2: f64,
    normal: DVec3,
}

impl ClusterRecords {
    /// From faces of one object, with 1 to 256 parts.
    #[must_use]
    pub fn new(id: ClusterId, cluster: &ClusterFaces, rules: Rules<'_>) -> Self {
        let parts = &cluster.parts;
        let boxes: Vec<Bounds> = parts.iter().map(|part| bounds(&part.piece)).collect();
        let mut order: Vec<u32> = (0..parts.len() as u32).collect();
        let mut tree = Vec::new();
        grow(&boxes, &mut order, (0, parts.len()), NONE, &mut tree);
        let keys = cluster.keys(id, &order);
        let ordered = || order.iter().map(|i| &parts[*i as usize]);
        let mut patches: Vec<PatchRecord> = ordered()
            .map(|part| PatchRecord {
                face: keys[part.face].packed(),
                face_area_m2: cluster.faces[part.face].area_m2,
                ..patch(&part.piece, rules)
            })
            .collect();
        for (number, node) in tree.iter().enumerate() {
            if node.left == NONE {
                for patch in &mut patches[below(node)] {
                    patch.tree_node = number as u16;
                }
            }
        }
        let shapes: Vec<Shape> = ordered().map(|part| shape(&part.piece)).collect();
        let materials = ordered().flat_map(|part| side_materials(&part.piece, rules)).collect();
        let sectors = sectors(id, &patches, &shapes, &tree);
        let seams = seams(cluster, &order);
        let head = ClusterHead {
            cluster: id.0,
            patches: parts.len() as u32,
            min_m: tree[0].min_m,
            max_m: tree[0].max_m,
            ..ClusterHead::zeroed()
        };
        Self { head, patches, tree, sectors, seams, materials, order, keys }
    }

    /// The geometry extent's payload.
    #[must_use]
    pub fn geometry(&self) -> Vec<u8> {
        let shapes = ArraysBuilder::default().with(&[self.head]).with(&self.patches).with(&self.tree);
        shapes.with(&self.sectors).with(&self.seams).finish()
    }

    /// The materials extent's payload.
    #[must_use]
    pub fn materials_payload(&self) -> Vec<u8> {
        ArraysBuilder::default().with(&self.materials).finish()
    }

    /// Patches that emit.
    #[must_use]
    pub fn emitters(&self) -> u32 {
        self.materials.chunks_exact(2).filter(|m| m.iter().any(|s| s.exitance != [0.0; 3])).count() as u32
    }

    /// Faces that emit, each counted in the cluster where rays meet it.
    #[must_use]
    pub fn emitting_faces(&self) -> u64 {
        let emits = |key: &&PatchKey| {
            let first = 2 * key.patch as usize;
            key.cluster == self.head.cluster && self.materials[first..first + 2].iter().any(|s| s.exitance != [0.0; 3])
        };
        self.keys.iter().filter(emits).count() as u64
    }

    /// The radiosity extent's payload of a version in which nothing has arrived yet.
    #[must_use]
    pub fn light_at_start(&self) -> Vec<u8> {
        let id = ClusterId(self.head.cluster);
        let elements: Vec<ElementLight> = (0..2 * self.patches.len())
            .map(|i| NodeName::root(id, PatchSide::from_index(i)))
            .map(|name| ElementLight { name: name.0, ..ElementLight::zeroed() })
            .collect();
        let mut head = LightHead { channels: 3, ..LightHead::zeroed() };
        head.level_start[1..].fill(elements.len() as u32);
        ArraysBuilder::default().with(&[head]).with::<RowLight>(&[]).with(&elements).finish()
    }
}

/// The seams of a cluster's patches, each as both of its patches have it, by patch and place. `order`: which part each
/// patch was.
fn seams(cluster: &ClusterFaces, order: &[u32]) -> Vec<Seam> {
    let mut patch_of = vec![0u16; order.len()];
    for (patch, part) in order.iter().enumerate() {
        patch_of[*part as usize] = patch as u16;
    }
    let both = |seam: &PartSeam| {
        let [patch, other] = seam.parts.map(|part| patch_of[part as usize]);
        let [edge, other_edge] = seam.edges.map(|edge| edge as u8);
        let [along, other_along] = [0, 1].map(|i| [seam.from[i], seam.to[i]]);
        let seam = Seam { patch, other, edge, other_edge, sides: seam.sides as u8, reserved: 0, along, other_along };
        [seam, seam.turned()]
    };
    let mut seams: Vec<Seam> = cluster.seams.iter().flat_map(both).collect();
    seams.retain(|s| s.along[0] < s.along[1] && s.other_along[1] < s.other_along[0]);
    seams.sort_by(|a, b| (a.patch, a.edge).cmp(&(b.patch, b.edge)).then(a.along[0].total_cmp(&b.along[0])));
    seams
}

fn below(node: &TreeNode) -> std::ops::Range<usize> {
    let first = usize::from(node.first_patch);
    first..first + usize::from(node.patch_count)
}

/// Appends the subtree over `order[range]` in preorder and sorts that range by it.
fn grow(boxes: &[Bounds], order: &mut [u32], range: (usize, usize), parent: u32, tree: &mut Vec<TreeNode>) -> u32 {
    let items = &mut order[range.0..range.1];
    let whole = items.iter().fold(Bounds::EMPTY, |b, i| b.union(boxes[*i as usize]));
    let number = tree.len() as u32;
    tree.push(TreeNode {
        min_m: whole.min.as_vec3().to_array(),
        max_m: whole.max.as_vec3().to_array(),
        first_patch: range.0 as u16,
        patch_count: items.len() as u16,
        left: NONE,
        right: NONE,
        parent,
        reserved: [0; 2],
    });
    if items.len() > LEAF {
        let cut = range.0 + cut_by_area(boxes, items, LEAF);
        let left = grow(boxes, order, (range.0, cut), number, tree);
        let right = grow(boxes, order, (cut, range.1), number, tree);
        tree[number as usize].left = left;
        tree[number as usize].right = right;
    } else {
        items.sort_unstable();
    }
    number
}

fn shape(piece: &Piece) -> Shape {
    let (points, n) = piece.points();
    let polygon = Polygon::new(&points[..n]);
    Shape { area_m2: polygon.area(), normal: polygon.normal() }
}

fn patch(piece: &Piece, rules: Rules<'_>) -> PatchRecord {
    let two_sided = rules.both_sides || piece.material[1] != NO_MATERIAL;
    PatchRecord {
        corners_m: piece.corners_m,
        corner_count: piece.corner_count as u8,
        sides: if two_sided { 3 } else { 1 },
        area_m2: shape(piece).area_m2 as f32,
        ..PatchRecord::zeroed()
    }
}

fn side_materials(piece: &Piece, rules: Rules<'_>) -> [SideMaterial; 2] {
    let front = rules.materials[piece.material[0] as usize];
    let back = match piece.material[1] {
        NO_MATERIAL if rules.both_sides => front.side(rules.emit_both),
        NO_MATERIAL => SideMaterial::default(),
        other => rules.materials[other as usize].side(true),
    };
    [front.side(true), back]
}

fn sectors(id: ClusterId, patches: &[PatchRecord], shapes: &[Shape], tree: &[TreeNode]) -> Vec<SectorHead> {
    let mut out = Vec::new();
    for sector in 0..6 {
        for (number, node) in tree.iter().enumerate() {
            let mut area = None;
            for p in below(node) {
                for (side, normal) in [shapes[p].normal, -shapes[p].normal].into_iter().enumerate() {
                    if patches[p].sides >> side & 1 == 1 && sector_of(normal.to_array()) == sector {
                        *area.get_or_insert(0.0) += shapes[p].area_m2;
                    }
                }
            }
            if let Some(area) = area {
                let name = NodeName::sector(id, sector, number as u64);
                out.push(SectorHead { name: name.0, area_m2: area as f32, tree_node: number as u32 });
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Rgb;
    use crate::model::geometry::GeometryView;
    use crate::model::light::LightView;

    fn aligned(payload: &[u8]) -> Vec<u128> {
        let mut words = vec![0u128; payload.len().div_ceil(16)];
        bytemuck::cast_slice_mut::<u128, u8>(&mut words)[..payload.len()].copy_from_slice(payload);
        words
    }

    fn row_of_tiles(n: usize) -> ClusterFaces {
        let tiles: Vec<Piece> = (0..n)
            .map(|i| {
                let x = (i * 7 % n) as f32;
                let mut piece = Piece { corner_count: 4, material: [(i % 2) as u32, NO_MATERIAL], ..Piece::zeroed() };
                piece.corners_m = [[x, 0., 0.], [x + 1., 0., 0.], [x + 1., 1., 0.], [x, 1., 0.]];
                piece
            })
            .collect();
        ClusterFaces::uncut(&tiles)
    }

    const DARK: Material = Material { rho: Rgb([0.5; 3]), exitance: Rgb::BLACK };

    #[test]
    fn the_tree_holds_every_patch_once_in_preorder_with_exact_boxes() {
        let rules = Rules { materials: &[DARK, DARK], both_sides: true, emit_both: false };
        let records = ClusterRecords::new(ClusterId(9), &row_of_tiles(100), rules);
        let payload = aligned(&records.geometry());
        let view = GeometryView::parse(bytemuck::cast_slice(&payload)).unwrap();
        assert_eq!(usize::from(view.tree[0].patch_count), 100);
        for (number, node) in view.tree.iter().enumerate() {
            let mut b = Bounds::EMPTY;
            for patch in &view.patches[below(node)] {
                for corner in patch.corners_m {
                    b = b.with(DVec3::from_array(corner.map(f64::from)));
                }
            }
            assert_eq!(Bounds::from_f32(node.min_m, node.max_m), b);
            if node.left == NONE {
                assert!(node.patch_count <= 4);
                assert!(view.patches[below(node)].iter().all(|p| p.tree_node == number as u16));
            } else {
                let (l, r) = (&view.tree[node.left as usize], &view.tree[node.right as usize]);
                assert_eq!(node.left as usize, number + 1, "preorder");
                assert_eq!((l.parent, r.parent), (number as u32, number as u32));
                assert_eq!((l.first_patch, l.first_patch + l.patch_count), (node.first_patch, r.first_patch));
            }
        }
    }

    #[test]
    fn every_side_lies_in_one_sector_of_each_level() {
        let rules = Rules { materials: &[DARK, DARK], both_sides: true, emit_both: false };
        let records = ClusterRecords::new(ClusterId(9), &row_of_tiles(100), rules);
        assert!(records.sectors.windows(2).all(|w| w[0].name < w[1].name));
        let whole: f32 = records.sectors.iter().filter(|s| s.tree_node == 0).map(|s| s.area_m2).sum();
        assert_eq!(whole, 200.0);
        let one_sided = Rules { both_sides: false, ..rules };
        let records = ClusterRecords::new(ClusterId(9), &row_of_tiles(100), one_sided);
        let whole: f32 = records.sectors.iter().filter(|s| s.tree_node == 0).map(|s| s.area_m2).sum();
        assert_eq!(whole, 100.0);
    }

    #[test]
    fn before_the_first_iteration_only_emitters_shine_and_only_from_their_fronts() {
        let lamp = Material { exitance: Rgb::grey(2.0), ..DARK };
        let rules = Rules { materials: &[DARK, lamp], both_sides: true, emit_both: false };
        let records = ClusterRecords::new(ClusterId(9), &row_of_tiles(100), rules);
        assert_eq!(records.emitters(), 50);
        let payload = aligned(&records.light_at_start());
        let view = LightView::parse(bytemuck::cast_slice(&payload)).unwrap();
        assert_eq!(view.elements.len(), 200);
        assert!(view.rows.is_empty() && view.elements.iter().all(|e| e.irradiance == [0.0; 3]), "nothing arrives");
        let emit =
            |side: usize| records.materials.iter().skip(side).step_by(2).filter(|m| m.exitance == [2.0; 3]).count();
        assert_eq!((emit(0), emit(1)), (50, 0));
        let both = ClusterRecords::new(ClusterId(9), &row_of_tiles(100), Rules { emit_both: true, ..rules });
        assert_eq!(both.materials.iter().filter(|m| m.exitance[0] > 0.0).count(), 100);
    }
}
