//! A cluster's records: patches, seams, materials, light of version 0.

use bytemuck::Zeroable;

use super::contact::PartSeam;
use super::faces::ClusterFaces;
use super::materials::Material;
use super::piece::{NONE as NO_MATERIAL, Piece};
use super::pieces::bounds;
use crate::base::{ClusterId, NodeName, PatchSide};
use crate::geom::bounds::Bounds;
use crate::geom::grouping::cut_by_area;
use crate::geom::polygon::Polygon;
use crate::model::geometry::{ClusterHead, PatchRecord, Seam, SideMaterial};
use crate::model::layout::ArraysBuilder;
use crate::model::light::{ElementLight, LightHead, RowLight};
use crate::rays::PatchKey;

/// So many patches are not put in order any further.
const FEW: usize = 4;

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
    /// Patches; those near each other follow each other.
    pub patches: Vec<PatchRecord>,
    /// Seams, by patch.
    pub seams: Vec<Seam>,
    /// Materials, front then back of each patch.
    pub materials: Vec<SideMaterial>,
    /// Which part each patch was.
    pub order: Vec<u32>,
    /// What names each face to rays.
    pub keys: Vec<PatchKey>,
}

impl ClusterRecords {
    /// From faces of one object, with 1 to 256 parts.
    #[must_use]
    pub fn new(id: ClusterId, cluster: &ClusterFaces, rules: Rules<'_>) -> Self {
        let parts = &cluster.parts;
        let boxes: Vec<Bounds> = parts.iter().map(|part| bounds(&part.piece)).collect();
        let mut order: Vec<u32> = (0..parts.len() as u32).collect();
        put_in_order(&boxes, &mut order);
        let keys = cluster.keys(id, &order);
        let ordered = || order.iter().map(|i| &parts[*i as usize]);
        let patches: Vec<PatchRecord> = ordered()
            .map(|part| PatchRecord {
                face: keys[part.face].packed(),
                face_area_m2: cluster.faces[part.face].area_m2,
                ..patch(&part.piece, rules)
            })
            .collect();
        let materials = ordered().flat_map(|part| side_materials(&part.piece, rules)).collect();
        let seams = seams(cluster, &order);
        let whole = boxes.iter().fold(Bounds::EMPTY, |all, part| all.union(*part));
        let head = ClusterHead {
            cluster: id.0,
            patches: parts.len() as u32,
            min_m: whole.min.as_vec3().to_array(),
            max_m: whole.max.as_vec3().to_array(),
            ..ClusterHead::zeroed()
        };
        Self { head, patches, seams, materials, order, keys }
    }

    /// The geometry extent's payload.
    #[must_use]
    pub fn geometry(&self) -> Vec<u8> {
        ArraysBuilder::default().with(&[self.head]).with(&self.patches).with(&self.seams).finish()
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

/// Puts parts that lie near each other one after the other: halved again and again where that costs least surface.
fn put_in_order(boxes: &[Bounds], order: &mut [u32]) {
    if order.len() <= FEW {
        return order.sort_unstable();
    }
    let cut = cut_by_area(boxes, order, FEW);
    let (left, right) = order.split_at_mut(cut);
    put_in_order(boxes, left);
    put_in_order(boxes, right);
}

fn patch(piece: &Piece, rules: Rules<'_>) -> PatchRecord {
    let two_sided = rules.both_sides || piece.material[1] != NO_MATERIAL;
    let (points, n) = piece.points();
    PatchRecord {
        corners_m: piece.corners_m,
        corner_count: piece.corner_count as u8,
        sides: if two_sided { 3 } else { 1 },
        area_m2: Polygon::new(&points[..n]).area() as f32,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Rgb;
    use crate::model::geometry::GeometryView;
    use crate::model::layout::aligned;
    use crate::model::light::LightView;

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
    fn patches_near_each_other_follow_each_other_and_the_head_has_their_box() {
        let rules = Rules { materials: &[DARK, DARK], both_sides: true, emit_both: false };
        let records = ClusterRecords::new(ClusterId(9), &row_of_tiles(100), rules);
        let payload = aligned(&records.geometry());
        let view = GeometryView::parse(bytemuck::cast_slice(&payload)).unwrap();
        let mut parts = records.order.clone();
        parts.sort_unstable();
        assert!(parts.iter().copied().eq(0..100), "each once");
        assert_eq!((view.head.min_m, view.head.max_m), ([0.0; 3], [100.0, 1.0, 0.0]));
        let step = |w: &[PatchRecord]| (w[0].corners_m[0][0] - w[1].corners_m[0][0]).abs();
        let far: f32 = view.patches.windows(2).map(step).sum();
        assert!(far < 4.0 * 100.0, "{far} m from the first to the last of 100 tiles of 1 m");
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
