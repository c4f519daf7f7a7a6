//! A whole model in memory, solved as one group: the second implementation of [`Clusters`], for tests.

use std::rc::Rc;

use bytemuck::Zeroable;
use glam::DVec3;

use super::bundle::SideCache;
use super::mesh::Mesh;
use super::oracle::Tolerances;
use super::push_pull::Gathered;
use super::records;
use super::refine::{Context, Scope};
use super::relax::{self, Inner, InnerLink, InnerLinks, Member};
use super::row_parts;
use super::solve_cluster::{SolvedCluster, StoredLinks, Unsolved, solve_cluster};
use super::source::{ClusterView, Clusters, Loaded};
use super::source_memo::SourceMemo;
use crate::base::{ClusterId, NodeName, PatchSide, Quiet, Result};
use crate::geom::quadtree;
use crate::model::geometry::{
    ClusterHead, GeometryView, NONE, PatchRecord, SectorHead, SideMaterial, TreeNode, sector_of,
};
use crate::model::light::LightView;
use crate::model::rays;
use crate::model::visibility::VisibilityHead;
use crate::rays::emitters::NO_EMITTERS;
use crate::rays::{RayScene, build};

/// One cluster of one polygon.
struct Stored {
    head: ClusterHead,
    tree: Vec<TreeNode>,
    sectors: Vec<SectorHead>,
    patches: Vec<PatchRecord>,
    materials: Vec<SideMaterial>,
    light: Vec<u64>,
}

impl Loaded for Stored {
    fn view(&self) -> ClusterView<'_> {
        ClusterView {
            id: ClusterId(self.head.cluster),
            geometry: GeometryView {
                head: &self.head,
                patches: &self.patches,
                tree: &self.tree,
                sectors: &self.sectors,
            },
            materials: &self.materials,
            light: LightView::parse(bytemuck::cast_slice(&self.light)).expect("written by `records`"),
        }
    }
}

/// A model and its solution.
pub struct MemoryScene {
    stored: Vec<Rc<Stored>>,
    nodes: Vec<rays::RayNode>,
    refs: Vec<rays::ClusterRef>,
    file: Vec<u64>,
    links: Vec<StoredLinks>,
}

impl Clusters for MemoryScene {
    fn cluster(&self, id: ClusterId) -> Result<Rc<dyn Loaded>> {
        Ok(self.stored[id.0 as usize].clone())
    }
}

fn aligned(bytes: &[u8]) -> Vec<u64> {
    let mut words = vec![0u64; bytes.len().div_ceil(8)];
    bytemuck::cast_slice_mut::<u64, u8>(&mut words)[..bytes.len()].copy_from_slice(bytes);
    words
}

/// The two sector nodes of a cluster of one patch.
fn sectors_of(cluster: ClusterId, patch: &PatchRecord) -> Vec<SectorHead> {
    let front = quadtree::patch_polygon(patch).normal();
    let mut names = [front, -front].map(|n| NodeName::sector(cluster, sector_of(n.to_array()), 0).0);
    names.sort_unstable();
    names.map(|name| SectorHead { name, area_m2: patch.area_m2, tree_node: 0 }).to_vec()
}

impl MemoryScene {
    /// From polygons of three or four corners with reflectance and exitance (W/m2) of the front; the
    /// back reflects alike and emits nothing.
    pub fn new(polygons: &[(Vec<[f64; 3]>, f64, f64)]) -> Self {
        let (mut stored, mut refs, mut bytes) = (Vec::new(), Vec::new(), Vec::new());
        for (i, (corners, rho, exitance)) in polygons.iter().enumerate() {
            let mut patch = PatchRecord::zeroed();
            for k in 0..4 {
                patch.corners_m[k] = corners[k.min(corners.len() - 1)].map(|x| x as f32);
            }
            patch.corner_count = corners.len() as u8;
            patch.sides = 3;
            patch.area_m2 = quadtree::patch_polygon(&patch).area() as f32;
            (patch.face, patch.face_area_m2) = ((i as u32) << 8, patch.area_m2);
            let (nodes, faces) = build::cluster(&[build::whole(&patch, 0)]);
            let cuts = rays::Cuts { faces: &[], nodes: &[], parts: &[] };
            let payload = rays::ClusterRaysView { nodes: &nodes, patches: &faces, cuts }.payload();
            let reference = rays::ClusterRef::to(i as u32, &payload, bytes.len() as u64).expect("just built");
            bytes.extend_from_slice(&payload);
            refs.push((reference, nodes[0].min_m, nodes[0].max_m));
            let mut head = ClusterHead::zeroed();
            (head.cluster, head.patches) = (i as u32, 1);
            let front = SideMaterial { rho: [*rho as f32; 3], exitance: [*exitance as f32; 3] };
            let materials = vec![front, SideMaterial { exitance: [0.0; 3], ..front }];
            let patches = vec![patch];
            let mut tree = vec![TreeNode::zeroed()];
            (tree[0].patch_count, tree[0].left, tree[0].right, tree[0].parent) = (1, NONE, NONE, NONE);
            let sectors = sectors_of(ClusterId(i as u32), &patch);
            let geometry = GeometryView { head: &head, patches: &patches, tree: &tree, sectors: &sectors };
            let mut mesh = Mesh::empty(ClusterId(i as u32), &geometry);
            for side in 0..2 {
                mesh.add_root(&geometry, PatchSide { patch: 0, side });
            }
            let light = aligned(&records::encode(&mesh, &geometry, &materials));
            stored.push(Rc::new(Stored { head, tree, sectors, patches, materials, light }));
        }
        let (nodes, refs) = build::top(&refs);
        let count = stored.len();
        Self { stored, nodes, refs, file: aligned(&bytes), links: vec![StoredLinks::default(); count] }
    }

    /// What rays can meet.
    pub fn rays(&self) -> RayScene<'_> {
        let top = rays::TopRaysView { nodes: &self.nodes, clusters: &self.refs };
        RayScene::new(top, bytemuck::cast_slice(&self.file), &NO_EMITTERS, 1e-5).expect("laid out by `new`")
    }

    /// One iteration over the whole model as one group.
    pub fn iterate(&mut self, scope: Scope, row_w_m2: f64, min_element_m: f64) {
        let visible: Vec<ClusterId> = (0..self.links.len()).map(|i| ClusterId(i as u32)).collect();
        let mut members = Vec::new();
        let mut first = 0;
        let mut all_links = std::mem::take(&mut self.links);
        let (sides, sources) = (SideCache::default(), SourceMemo::default());
        for (own, links) in self.stored.iter().zip(&mut all_links) {
            let context = Context {
                scene: self.rays(),
                clusters: self,
                tolerances: Tolerances { row_w_m2, min_element_m },
                seed: 1,
                scope,
                sides: &sides,
                sources: &sources,
                progress: &Quiet,
            };
            let found = VisibilityHead { missing: 1e-3, ..VisibilityHead::zeroed() };
            let stored = std::mem::take(links);
            let before = Unsolved { view: own.view(), visible: visible.clone(), found, stored };
            let solved = solve_cluster(&context, before).expect("memory does not fail");
            let SolvedCluster { mesh, rows, closure, factors, .. } = solved;
            let rows = rows.into_iter().enumerate().map(|(at, row)| (mesh.name_at(at), row)).collect();
            *links = StoredLinks { rows, closure };
            let length = mesh.node_count();
            let (materials, external) = (own.materials.clone(), vec![Gathered::default(); length]);
            members.push(Member { mesh, materials, external, factors, first });
            first += length;
        }
        self.links = all_links;
        let inner = Inner::Converge { tolerance: 1e-6, q: 0.99 };
        relax::relax(&mut members, &mut AllLinks(&self.links), inner, &Quiet).expect("memory does not fail");
        for (own, member) in self.stored.iter_mut().zip(&members) {
            let light = {
                let view = own.view();
                aligned(&records::encode(&member.mesh, &view.geometry, view.materials))
            };
            Rc::get_mut(own).expect("nobody reads any more").light = light;
        }
    }

    /// Lights, then everything until nothing changes much.
    pub fn solve(&mut self, row_w_m2: f64, min_element_m: f64) {
        self.iterate(Scope::Lights, row_w_m2, min_element_m);
        for _ in 0..4 {
            self.iterate(Scope::Everything, row_w_m2, min_element_m);
        }
    }

    /// Mean irradiance (first channel) on the front of a polygon, W/m2.
    pub fn irradiance(&self, polygon: usize) -> f64 {
        f64::from(self.stored[polygon].view().light.elements[0].irradiance[0])
    }

    /// Radiosity (first channel) of the front of a polygon, W/m2.
    pub fn radiosity(&self, polygon: usize) -> f64 {
        let own = &self.stored[polygon];
        f64::from(own.materials[0].exitance[0]) + f64::from(own.materials[0].rho[0]) * self.irradiance(polygon)
    }
}

struct AllLinks<'a>(&'a [StoredLinks]);

impl InnerLinks for AllLinks<'_> {
    fn each(&mut self, index: usize, members: &[Member], visit: &mut dyn FnMut(&InnerLink)) -> Result<()> {
        for (name, row) in &self.0[index].rows {
            let receiver = members[index].mesh.position(*name) as u32;
            let is_leafs = members[index].mesh.is_leaf_at(receiver as usize);
            for link in row {
                let member = &members[link.source.cluster().0 as usize];
                let source = (member.first + member.mesh.position(link.source)) as u32;
                let error = row_parts::error(link, is_leafs) as f32;
                visit(&InnerLink { receiver, source, form_factor: link.form_factor, error });
            }
        }
        Ok(())
    }
}

/// The six faces of a box, fronts inwards: z low, z high, y low, y high, x low, x high.
pub fn room(low: [f64; 3], high: [f64; 3], rho: f64) -> Vec<(Vec<[f64; 3]>, f64, f64)> {
    let p = |i: usize| {
        DVec3::new(
            if i & 1 == 0 { low[0] } else { high[0] },
            if i & 2 == 0 { low[1] } else { high[1] },
            if i & 4 == 0 { low[2] } else { high[2] },
        )
        .to_array()
    };
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        .iter()
        .map(|face: &[usize; 4]| (face.iter().map(|&i| p(i)).collect(), rho, 0.0))
        .collect()
}
