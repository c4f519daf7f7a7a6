//! The faces of a cluster: what rays meet of them, and the parts that become its patches.

use super::clusters::{Faces, Members};
use super::contact::PartSeam;
use super::piece::Piece;
use crate::base::{ClusterId, Result};
use crate::geom::polygon::Polygon;
use crate::model::cut::CutNode;
use crate::model::rays::{ClusterRaysView, Cuts, FaceCut, RayNode, RayPatch, WHOLE};
use crate::rays::{PatchKey, build};

/// A face as it was before contact lines cut it.
pub struct Face {
    /// The face.
    pub whole: Piece,
    /// Its area, m2.
    pub area_m2: f32,
    /// How many parts it has, in this cluster and elsewhere.
    pub parts: u32,
    nodes: Vec<CutNode>,
}

impl Face {
    fn new(whole: Piece, parts: u32, nodes: Vec<CutNode>) -> Self {
        let (points, n) = whole.points();
        Self { whole, area_m2: Polygon::new(&points[..n]).area() as f32, parts, nodes }
    }
}

/// A part of a face, on its way to be a patch.
pub struct Part {
    /// The face with the corners of the part.
    pub piece: Piece,
    /// Which of the cluster's faces it is of.
    pub face: usize,
    /// Which part of that.
    pub number: u32,
}

/// The faces of a cluster with their parts.
pub struct ClusterFaces {
    /// Ascending by row.
    pub faces: Vec<Face>,
    /// By face, then number.
    pub parts: Vec<Part>,
    /// Seams between them; their parts are places in `parts`.
    pub seams: Vec<PartSeam>,
    /// Of a face that is spread over several clusters: how many follow with other parts of it.
    pub following: Option<usize>,
}

impl ClusterFaces {
    /// Of the members of a cluster.
    pub fn load(from: &mut Faces<'_>, members: &Members<'_>) -> Result<Self> {
        let (mut faces, mut parts, mut seams) = (Vec::new(), Vec::new(), Vec::new());
        for (face, row) in members.faces.iter().enumerate() {
            let (whole, own) = (from.whole.get(*row)?, from.cuts.faces.get(*row)?);
            let first = parts.len();
            let mut add = |number: u32| -> Result<()> {
                let part = from.cuts.parts.get(own.first_part + u64::from(number))?;
                let (corners_m, named) = (part.corners_m, part.named);
                let piece = Piece { corners_m, named, corner_count: part.corner_count, ..whole };
                parts.push(Part { piece, face, number });
                Ok(())
            };
            match members.some {
                None => (0..own.parts).try_for_each(&mut add)?,
                Some((some, _)) => some.iter().copied().try_for_each(&mut add)?,
            }
            let place = |number: u32| {
                let at = parts[first..].binary_search_by_key(&number, |part: &Part| part.number).ok()?;
                Some((first + at) as u32)
            };
            for i in 0..own.seams {
                let seam = from.cuts.seams.get(own.first_seam + i)?;
                // Of a face that is spread over several clusters those between two of these are left out.
                if let [Some(a), Some(b)] = seam.parts.map(place) {
                    seams.push(PartSeam { parts: [a, b], ..seam });
                }
            }
            // Rays meet a face in the last cluster that holds some of it.
            let is_met = members.some.is_none_or(|(_, following)| following == 0);
            let mut nodes = Vec::new();
            for i in 0..if is_met { own.nodes } else { 0 } {
                nodes.push(from.cuts.nodes.get(own.first_node + u64::from(i))?);
            }
            faces.push(Face::new(whole, own.parts, nodes));
        }
        Ok(Self { faces, parts, seams, following: members.some.map(|(_, following)| following) })
    }

    /// Of faces that nothing cuts.
    #[cfg(test)]
    pub fn uncut(pieces: &[Piece]) -> Self {
        let face = |whole: &Piece| Face::new(*whole, 1, Vec::new());
        let part = |(face, piece): (usize, &Piece)| Part { piece: *piece, face, number: 0 };
        let (faces, parts) = (pieces.iter().map(face).collect(), pieces.iter().enumerate().map(part).collect());
        Self { faces, parts, seams: Vec::new(), following: None }
    }

    /// What names each face to rays: its first patch, in the last cluster that holds some of it; `order` says which part
    /// each patch of this cluster was.
    #[must_use]
    pub fn keys(&self, id: ClusterId, order: &[u32]) -> Vec<PatchKey> {
        let mut keys = vec![None; self.faces.len()];
        for (patch, part) in order.iter().enumerate() {
            keys[self.parts[*part as usize].face].get_or_insert(PatchKey { cluster: id.0, patch: patch as u32 });
        }
        if let Some(following) = self.following {
            // Such a cluster holds nothing else, so that its first patch is of this face.
            keys[0] = Some(PatchKey { cluster: id.0 + following as u32, patch: 0 });
        }
        keys.into_iter().map(|key| key.expect("a face has a part")).collect()
    }

    /// The ray structure: faces by their `keys`, and what they fell into. Empty where the face is met in a cluster that
    /// follows.
    #[must_use]
    pub fn rays(&self, keys: &[PatchKey], patches: &PartNames) -> RayArrays {
        let mut arrays = RayArrays::default();
        if self.following.is_some_and(|following| following > 0) {
            return arrays;
        }
        let mut faces = Vec::new();
        for (number, (face, key)) in self.faces.iter().zip(keys).enumerate() {
            let cut = if face.parts == 1 { WHOLE } else { arrays.cuts.len() as u32 };
            faces.push(RayPatch {
                corners_m: face.whole.corners_m,
                patch: key.patch,
                corner_count: face.whole.corner_count,
                area_m2: face.area_m2,
                cut,
            });
            if cut != WHOLE {
                let (first_node, first_part) = (arrays.cut_nodes.len() as u32, arrays.parts.len() as u32);
                arrays.cut_nodes.extend_from_slice(&face.nodes);
                arrays.parts.extend_from_slice(&patches.names[number]);
                let (nodes, parts) = (face.nodes.len() as u32, face.parts);
                arrays.cuts.push(FaceCut { first_node, nodes, first_part, parts });
            }
        }
        (arrays.nodes, arrays.faces) = build::cluster(&faces);
        arrays
    }
}

/// A cluster's ray structure, to be written.
#[derive(Default)]
pub struct RayArrays {
    nodes: Vec<RayNode>,
    faces: Vec<RayPatch>,
    cuts: Vec<FaceCut>,
    cut_nodes: Vec<CutNode>,
    parts: Vec<u32>,
}

impl RayArrays {
    /// The extent's payload.
    #[must_use]
    pub fn payload(&self) -> Vec<u8> {
        let cuts = Cuts { faces: &self.cuts, nodes: &self.cut_nodes, parts: &self.parts };
        ClusterRaysView { nodes: &self.nodes, patches: &self.faces, cuts }.payload()
    }

    /// The box round all faces; `None` without any.
    #[must_use]
    pub fn bounds_m(&self) -> Option<([f32; 3], [f32; 3])> {
        self.nodes.first().map(RayNode::whole_m)
    }
}

/// Which patch each part of the faces at hand became: 4 bytes for each part.
#[derive(Default)]
pub struct PartNames {
    /// By face of the cluster and part; those of a face that is spread stay until all its clusters have been.
    names: Vec<Vec<u32>>,
    /// Parts that are still to come.
    missing: usize,
}

impl PartNames {
    /// Takes note of a cluster's patches.
    pub fn add(&mut self, id: ClusterId, cluster: &ClusterFaces, order: &[u32]) {
        if self.missing == 0 {
            self.names = cluster.faces.iter().map(|face| vec![0; face.parts as usize]).collect();
            self.missing = cluster.faces.iter().map(|face| face.parts as usize).sum();
        }
        self.missing -= order.len();
        for (patch, part) in order.iter().enumerate() {
            let part = &cluster.parts[*part as usize];
            self.names[part.face][part.number as usize] = PatchKey { cluster: id.0, patch: patch as u32 }.packed();
        }
    }
}
