//! What mutations begin with: small files that hold every form once, and extents as tasks write them.

use bytemuck::Zeroable;
use clerestory::base::{ClusterId, NodeName, PatchSide};
use clerestory::model::cut::CutNode;
use clerestory::model::geometry::{ClusterHead, PatchRecord, Seam, SideMaterial};
use clerestory::model::layout::ArraysBuilder;
use clerestory::model::light::{ElementLight, LightHead, RowLight};
use clerestory::model::links::{LinksHead, RowHead, StoredHit, StoredShare};
use clerestory::model::origin::{BakeCorner, PatchSource};
use clerestory::model::rays::{ClusterRaysView, ClusterRef, Cuts, FaceCut, RayNode, RayPatch, WHOLE};
use clerestory::model::visibility::{VisibilityHead, VisibleCluster};

/// OBJ files.
pub const OBJ: &[&str] = &[
    "mtllib a.mtl \"b c.mtl\"\no room\ng wall\nusemtl white wall\nv 0 0 0\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0\nv 0 1 0\n\
     vt 0 0\nvt 1 0 0\nvn 0 0 1\nf 1/1/1 2/2/1 3//1 4\nf -4 -3 -2\ns off\nl 1 2\np 1\n",
    "# comment \\\r\nv 0 \\\r\n1 2e-3\r\nv nan -inf 1.#IND\rv .5 1. +2\rf 1 2 3\rfo 1 2 3\rcurv 0 1 1 2\nsurf 0 1 0 1 1/1\n",
    "\u{feff}v 1e308 -1e-308 0\nf 1 1 1 1/99999999999/1\nf 0 1 2\nf 9223372036854775807 2 3\nf 1 2\nf a b c\n",
    "",
];

/// MTL files.
pub const MTL: &[&str] = &[
    "newmtl white wall\nKa 0 0 0\nKd 0.7 0.7 0.7\nKs 0 0 0\nNs 10\nd 1.0\nillum 2\nmap_Kd -s 1 1 1 x y.png\nKe 1 2 3\n",
    "NEWMTL a\r\nkd 0.5 # grey\r\nke 5\rnewmtl a\rKd 1 1 1 1\rTr 0.5\rd -halo 0.5\rbump\rnorm x\rmap_ y\r",
    "\u{feff}newmtl\nKd nan inf -1\nKe 1e400 1e39 1.#IND\nKd spectral a.rfl\nKd xyz 1 1 1\nKd 1 1\nKd\nKe 0,5\n",
    "Kd 1 1 1\nnewmtl \u{e9}\u{1b}\n",
];

/// Files of points.
pub const POINTS: &[&str] = &[
    "x,y,z,nx,ny,nz\n1.5,2.5,0,0,0,1\n,,,,,\n-3,0.25,10,0,0,-2,\n",
    "name,X, y ,z,\"nx\",NY,nz\r\n\"Desk 0, \"\"A\"\"\r\nhere\",1,2,3,0,0,1\r\n\"open,1,2,3,0,0,1\r\n",
    "# points\r1 2 3\t0 0 1\r1.5 2 3 0 0 1\r7 1 2 3 0 0 1\r",
    "room no\tx\ty\tz\tnx\tny\tnz\nA 1\t1.5\t2.5\t0\t0\t0\t1\n",
    "x;y;z;nx;ny;nz\n0,5;1,5;0;0;0;1\n",
    "\u{feff}1,2,3,0,0,1\n1,nan,3,0,0,1\n1,2,3,0,0,0\n",
];

fn patch(x: f32) -> PatchRecord {
    let corners_m = [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x + 1.0, 1.0, 0.0], [x, 1.0, 0.0]];
    PatchRecord { corners_m, corner_count: 4, sides: 3, reserved: 0, area_m2: 1.0, face: 7 << 8, face_area_m2: 2.0 }
}

/// A geometry extent: two patches and the seam between them.
pub fn geometry() -> Vec<u8> {
    let head = ClusterHead { cluster: 7, patches: 2, max_m: [2.0, 1.0, 0.0], ..ClusterHead::zeroed() };
    let seam = Seam {
        patch: 0,
        other: 1,
        edge: 1,
        other_edge: 3,
        sides: 3,
        reserved: 0,
        along: [0.0, 0.5],
        other_along: [1.0, 0.5],
    };
    let shapes = ArraysBuilder::default().with(&[head]).with(&[patch(0.0), patch(1.0)]);
    shapes.with(&[seam, seam.turned()]).finish()
}

/// A materials extent.
pub fn materials() -> Vec<u8> {
    ArraysBuilder::default().with(&[SideMaterial { rho: [0.5; 3], exitance: [3.0; 3] }; 4]).finish()
}

/// A light extent: four roots, one of them with children; a row of each part.
pub fn light() -> Vec<u8> {
    let root = |i: usize| NodeName::root(ClusterId(7), PatchSide::from_index(i));
    let element = |name: NodeName| ElementLight { name: name.0, irradiance: [1.0; 3], ..ElementLight::zeroed() };
    let elements: Vec<_> = (0..4).map(root).chain((0..4).map(|q| root(1).child(q))).map(element).collect();
    let mut level_start = [8; 16];
    level_start[..2].copy_from_slice(&[0, 4]);
    let head = LightHead { channels: 3, layer: 0, level_start, reserved: [0; 2] };
    let row = |part: u16| {
        let (name, slope_u) = (root(1).child(2).0, [-0.5, 0.25, 0.0]);
        RowLight {
            name,
            irradiance: [0.5; 3],
            slope_u,
            structure: -0.01,
            noise: 0.02,
            rounds: 2,
            part,
            ..RowLight::zeroed()
        }
    };
    ArraysBuilder::default().with(&[head]).with(&[row(0), row(1)]).with(&elements).finish()
}

/// A links extent: a row of each part, two shares, four hits.
pub fn links() -> Vec<u8> {
    let root = |i: usize| NodeName::root(ClusterId(7), PatchSide::from_index(i)).0;
    let head = LinksHead { delta: 0, reserved: 0, rows: 2, shares: 2, hits: 4 };
    let row = |count: u32, part: u16| RowHead {
        element: root(0),
        first: 0,
        count,
        part,
        rounds: 1,
        open: 0x8001,
        reserved: [0; 3],
    };
    let share = |lamp: u32, slot: u8| StoredShare::new(lamp, 0, slot, 0.25);
    let hit = |side: u32, at: u16| StoredHit { side, at: [at, 0] };
    ArraysBuilder::default()
        .with(&[head])
        .with(&[row(2, 0), row(4, 1)])
        .with(&[root(2), root(3), NodeName::ESCAPE.0])
        .with(&[share(0, 0), share(1, 31)])
        .with(&[hit(0, 0), hit(1, u16::MAX), hit(1, 7), hit(2, 0)])
        .finish()
}

/// A visibility extent.
pub fn visibility() -> Vec<u8> {
    let head = VisibilityHead { rays: 1000, escape: 0.1, missing: 0.01 };
    let list = [VisibleCluster { cluster: 1, form_factor: 0.5 }, VisibleCluster { cluster: 7, form_factor: 0.0 }];
    ArraysBuilder::default().with(&[head]).with(&list).finish()
}

fn nodes(items: u32) -> [RayNode; 2] {
    let box_m = ([0.0; 3], [2.0; 3]);
    let leaf = RayNode::EMPTY.with(2, box_m, 1, items - 1);
    [RayNode::EMPTY.with(0, box_m, 0, 1).with(4, box_m, 1, 0), leaf]
}

/// A ray structure of a cluster of a face in two parts and a whole one.
pub fn rays() -> Vec<u8> {
    let face = |x: f32, patch: u32, cut: u32| RayPatch {
        corners_m: self::patch(x).corners_m,
        patch,
        corner_count: 4,
        area_m2: 1.0,
        cut,
    };
    let cut = FaceCut { first_node: 0, nodes: 1, first_part: 0, parts: 2 };
    let node = CutNode { line: [1.0, 0.0, -0.5], children: [CutNode::PART, CutNode::PART | 1] };
    let cuts = Cuts { faces: &[cut], nodes: &[node], parts: &[7 << 8, 7 << 8 | 1] };
    ClusterRaysView { nodes: &nodes(2), patches: &[face(0.0, 0, 0), face(1.0, 2, WHOLE)], cuts }.payload()
}

/// A ray structure over clusters whose arrays lie in the same bytes.
pub fn top_rays() -> Vec<u8> {
    let at = |cluster: u32| ClusterRef {
        nodes_at: 48,
        patches_at: 48,
        cuts_at: 48,
        cut_nodes_at: 48,
        parts_at: 48,
        cluster,
        nodes: 1,
        ..ClusterRef::zeroed()
    };
    ArraysBuilder::default().with(&nodes(2)).with(&[at(1), at(7)]).finish()
}

/// Sources of patches.
pub fn provenance() -> Vec<u8> {
    ArraysBuilder::default().with(&[PatchSource { patch: 1, file: 1, line: 9, face: 0 }; 3]).finish()
}

/// Corners as modelled.
pub fn bake() -> Vec<u8> {
    ArraysBuilder::default().with(&[BakeCorner { corner: 5, ..BakeCorner::zeroed() }; 3]).finish()
}

/// Polygons as f32 pairs and heights: an L, a needle, a bow tie, one point over and over.
pub fn polygons() -> Vec<Vec<u8>> {
    let of = |corners: &[[f32; 3]]| bytemuck::cast_slice(corners).to_vec();
    vec![
        of(&[[0., 0., 0.], [3., 0., 0.], [3., 1., 0.], [1., 1., 0.], [1., 3., 0.], [0., 3., 0.]]),
        of(&[[0., 0., 0.], [1., 1e-7, 0.], [2., 0., 0.], [1., -1e-7, 0.]]),
        of(&[[0., 0., 1.], [1., 1., 1.], [1., 0., 1.], [0., 1., 1.], [0.5, 0.5, 2.]]),
        of(&[[4.; 3]; 9]),
    ]
}
