//! A whole model in memory, solved as one group: the second implementation of [`Clusters`], [`Lights`], [`Shapes`],
//! [`Kept`], [`Outside`] and [`Inside`], for tests.

use std::collections::BTreeSet;
use std::rc::Rc;

use bytemuck::Zeroable;
use glam::DVec3;

use super::iterate::relax::{self, Inner, Inside, Member, Outside, Shapes};
use super::iterate::residual::{self, Change};
use super::light::line::Halves;
use super::light::lit::{Lights, LitCluster};
use super::measure::lamps::{self, LightTree};
use super::nodes::mesh::Mesh;
use super::nodes::places::{Draws, Places};
use super::norm::Norm;
use super::oracle;
use super::records;
use super::refine::{self, Around, Context, Measured, Refined, Sides};
use super::row::{Found, Kept, Part, Row, add, slots};
use super::source::{ClusterView, Clusters, Loaded};
use crate::base::{ClusterId, NodeName, PatchSide, Quiet, Result};
use crate::geom::quadtree;
use crate::model::geometry::{ClusterHead, GeometryView, PatchRecord, SideMaterial};
use crate::model::layout::aligned;
use crate::model::light::LightView;
use crate::model::rays;
use crate::model::report::ErrorSums;
use crate::rays::emitters::NO_EMITTERS;
use crate::rays::node::Node;
use crate::rays::{RayScene, build};

/// One cluster of one polygon.
struct Stored {
    head: ClusterHead,
    patches: Vec<PatchRecord>,
    materials: Vec<SideMaterial>,
    light: Vec<u128>,
}

impl Loaded for Stored {
    fn view(&self) -> ClusterView<'_> {
        ClusterView {
            id: ClusterId(self.head.cluster),
            geometry: GeometryView { head: &self.head, patches: &self.patches, seams: &[] },
            materials: &self.materials,
            light: LightView::parse(bytemuck::cast_slice(&self.light)).expect("written by `records`"),
        }
    }
}

/// A model and its solution.
pub struct MemoryScene {
    stored: Vec<Rc<Stored>>,
    lit: Vec<Rc<LitCluster>>,
    rows: Vec<Vec<Row>>,
    nodes: Vec<rays::RayNode>,
    refs: Vec<rays::ClusterRef>,
    file: Vec<u128>,
}

/// Where an iteration has led.
#[derive(Clone, Debug, Default)]
pub struct Iterated {
    /// Where the error is.
    pub error: ErrorSums,
    /// By how much the light has changed, in the norm of `--tolerance`.
    pub residual: f64,
}

impl Iterated {
    /// Squared error as rows know it, relative.
    fn most(&self) -> f64 {
        let ErrorSums { rough, norm, .. } = self.error;
        if norm > 0.0 { rough / norm } else { 0.0 }
    }
}

impl Clusters for MemoryScene {
    fn cluster(&self, id: ClusterId) -> Result<Rc<dyn Loaded>> {
        Ok(self.stored[id.0 as usize].clone())
    }
}

impl Lights for MemoryScene {
    fn lit(&self, id: ClusterId) -> Result<Rc<LitCluster>> {
        Ok(self.lit[id.0 as usize].clone())
    }
}

/// Iterations after which a test has waited long enough.
const MOST_ITERATIONS: u32 = 80;

/// Rays in rows before which nobody believes what they say of themselves.
const LEAST_RAYS: f64 = 2e5;

/// Rays in rows after which it has, too.
const MOST_RAYS: f64 = 4e6;

/// From which all places and rays derive.
const SEED: u64 = 1;

impl MemoryScene {
    /// From polygons of three or four corners with reflectance and exitance (W/m2) of the front; the
    /// back reflects alike and emits nothing.
    pub fn new(polygons: &[(Vec<[f64; 3]>, f64, f64)]) -> Self {
        let (mut stored, mut lit, mut refs, mut bytes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
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
            let (min_m, max_m) = nodes[0].whole_m();
            refs.push((reference, min_m, max_m));
            let mut head = ClusterHead::zeroed();
            (head.cluster, head.patches) = (i as u32, 1);
            let front = SideMaterial { rho: [*rho as f32; 3], exitance: [*exitance as f32; 3] };
            let materials = vec![front, SideMaterial { exitance: [0.0; 3], ..front }];
            let patches = vec![patch];
            let mesh = Mesh::new(ClusterId(i as u32), &patches);
            lit.push(Rc::new(LitCluster::of(&mesh, &patches, &materials)));
            let light = aligned(&records::encode(&mesh));
            stored.push(Rc::new(Stored { head, patches, materials, light }));
        }
        let (nodes, refs) = build::top(&refs);
        let rows = vec![Vec::new(); stored.len()];
        Self { stored, lit, rows, nodes, refs, file: aligned(&bytes) }
    }

    /// What rays can meet.
    pub fn rays(&self) -> RayScene<'_> {
        let top = rays::TopRaysView { nodes: &self.nodes, clusters: &self.refs };
        RayScene::new(top, bytemuck::cast_slice(&self.file), &NO_EMITTERS, 1e-5).expect("laid out by `new`")
    }

    /// One iteration over the whole model as one group, as a visit of `solve-group` goes.
    pub fn iterate(&mut self, threshold: f64, norm: Norm) -> Iterated {
        let all: Vec<ClusterId> = (0..self.stored.len()).map(|i| ClusterId(i as u32)).collect();
        let mut rows = std::mem::take(&mut self.rows);
        let mut iterated = Iterated::default();
        let mut members = Vec::new();
        {
            let context = Context {
                scene: self.rays(),
                clusters: &*self,
                lights: &*self,
                seed: SEED,
                threshold,
                norm,
                gain: [1.0; 3],
                min_element_m: 0.0,
                made_bytes: u64::MAX,
                progress: &Quiet,
            };
            let lamps = LightTree::of_clusters(self, &all).expect("memory does not fail");
            let around = Around { lamps, escapes: false, emitted_w: 0.0 };
            let sides: Vec<Sides> = self.stored.iter().map(|own| Sides::of(&own.view(), &context.scene)).collect();
            for ((own, sides), rows) in self.stored.iter().zip(&sides).zip(&mut rows) {
                let view = own.view();
                let kept = MemoryKept(std::mem::take(rows));
                let refined = refine::refine(&context, view, sides, &around, &kept, &mut |_| unreachable!());
                let Refined { mesh, mut made, gone, .. } = refined.expect("memory does not fail");
                let changed: BTreeSet<_> = made.iter().map(Row::key).chain(gone).collect();
                made.extend(kept.0.into_iter().filter(|row| !changed.contains(&row.key())));
                made.sort_by_key(Row::key);
                let lit = LitCluster::of(&mesh, &own.patches, &own.materials);
                let above = mesh.rows_above();
                let materials = own.materials.clone();
                members.push(Member { mesh, materials, lit, above, external: Vec::new(), escapes: Vec::new() });
                *rows = made;
            }
            let shapes = MemoryShapes { stored: &self.stored, sides: &sides };
            let inner = Inner::Converge { tolerance: 1e-6, q: 0.99 };
            let (mut inside, same) = (MemoryRows { scene: self, rows: &rows }, (SEED, [1.0; 3]));
            relax::take_over(&mut members, &shapes, &inside, same, &Quiet).expect("memory does not fail");
            relax::relax(&mut members, &shapes, &mut inside, inner, same, &Quiet).expect("memory does not fail");
            for (own, member) in self.stored.iter().zip(&members) {
                let (view, mesh) = (own.view(), &member.mesh);
                for row in &mesh.rows {
                    refine::case(&context, &view, mesh, row.element as usize, row.rounds, row.fit)
                        .add_to(&mut iterated.error, !view.emits(mesh.elements[row.element as usize].name));
                }
                let [squared, lit, area] = refine::level(&view, mesh, &norm);
                iterated.error.norm += squared;
                iterated.error.lit = [iterated.error.lit[0] + lit, iterated.error.lit[1] + area];
            }
        }
        self.rows = rows;
        let mut change = Change::default();
        for (index, member) in members.into_iter().enumerate() {
            let light = aligned(&records::encode(&member.mesh));
            self.lit[index] = Rc::new(member.lit);
            let own = Rc::get_mut(&mut self.stored[index]).expect("nobody reads any more");
            let before = std::mem::replace(&mut own.light, light);
            let before = LightView::parse(bytemuck::cast_slice(&before)).expect("written by `records`");
            let view = own.view();
            change = change.plus(residual::of_cluster(&view.geometry, view.materials, &before, &view.light));
        }
        iterated.residual = change.residual();
        iterated
    }

    /// What lamps bring over a row.
    fn brought(&self, row: &Row) -> Halves {
        let mut halves = Halves::default();
        if let Found::Shares(shares) = &row.found {
            for share in shares {
                let lamp = &self.stored[share.lamp.cluster().0 as usize];
                let exitance = lamp.materials[share.lamp.patch_side().index()].exitance;
                add(&mut halves, usize::from(share.slot), exitance, share.factor / f32::from(row.rounds));
            }
        }
        halves
    }

    /// Mean irradiance (first channel) that lamps bring to the front of a polygon, W/m2: measured on all elements of a
    /// depth, with so many rounds each.
    pub fn direct(&self, polygon: usize, depth: u32, rounds: u16) -> f64 {
        let (own, scene) = (&self.stored[polygon], self.rays());
        let (view, part) = (own.view(), Part::Direct);
        let all: Vec<ClusterId> = (0..self.stored.len()).map(|i| ClusterId(i as u32)).collect();
        let lamps = LightTree::of_clusters(self, &all).expect("memory does not fail");
        let (sides, front) = (Sides::of(&view, &scene), PatchSide { patch: 0, side: 0 });
        let mut nodes = vec![Node::root(view.id, &own.patches[0], front)];
        for _ in 0..depth {
            nodes = nodes.iter().flat_map(|node| (0..4).map(|quarter| node.child(quarter))).collect();
        }
        let (mut power_w, mut area_m2) = (0.0, 0.0);
        for node in &nodes {
            let places = Places::of(node, part, SEED, sides.covering(front));
            let cast = lamps::cast(&scene, &lamps, node, &places, &Draws::of(node, part, SEED), 0..rounds);
            let (element, open, found) = (node.name, places.open, Found::Shares(cast.shares));
            let halves = self.brought(&Row { element, part, rounds, open, found });
            let fit = Measured::of(&view, &sides, element, part, SEED).fit(rounds, &halves);
            power_w += node.shape.area() * fit.line.mean.0[0];
            area_m2 += node.shape.area();
        }
        power_w / area_m2
    }

    /// Iterates as `merge` steers until the estimated error, with two standard errors of that, meets the tolerance and
    /// what is left to change is nothing beside it.
    pub fn solve(&mut self, tolerance: f64) -> Iterated {
        let mut last = self.iterate(f64::INFINITY, Norm::UNKNOWN);
        for _ in 1..MOST_ITERATIONS {
            if last.error.rays > MOST_RAYS {
                break;
            }
            let [lit, area] = last.error.lit;
            // Few rays know little of themselves.
            let knows_little = last.error.rays < LEAST_RAYS && last.most() > 0.0;
            let aim = if knows_little { 0.5 * last.most() } else { tolerance * tolerance };
            let excess = last.most() - aim;
            let is_settled = last.residual <= 0.5 * last.most().sqrt();
            if excess <= 0.0 && last.residual <= tolerance / 25.0 {
                return last;
            }
            let marked =
                is_settled.then(|| oracle::threshold(&last.error.bins, excess * last.error.norm, last.error.rays));
            let norm = Norm::of_mean(if area > 0.0 { lit / area } else { 0.0 });
            last = self.iterate(marked.flatten().unwrap_or(f64::INFINITY), norm);
        }
        let (most, rays) = (last.most().sqrt(), last.error.rays);
        panic!("error of up to {most} for {tolerance} with {rays} rays");
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

struct MemoryShapes<'a> {
    stored: &'a [Rc<Stored>],
    sides: &'a [Sides],
}

impl Shapes for MemoryShapes<'_> {
    fn with(&self, index: usize, with: &mut dyn FnMut(&ClusterView<'_>, &Sides)) -> Result<()> {
        with(&self.stored[index].view(), &self.sides[index]);
        Ok(())
    }
}

/// Rows of the iteration before.
struct MemoryKept(Vec<Row>);

impl Kept for MemoryKept {
    fn keys(&self) -> Vec<(NodeName, Part)> {
        self.0.iter().map(Row::key).collect()
    }

    fn row(&self, number: usize) -> Row {
        self.0[number].clone()
    }
}

/// Everything lies within the group.
struct MemoryRows<'a> {
    scene: &'a MemoryScene,
    rows: &'a [Vec<Row>],
}

impl Outside for MemoryRows<'_> {
    fn each(&self, index: usize, visit: &mut dyn FnMut(&Halves, f32)) -> Result<()> {
        self.rows[index].iter().for_each(|row| visit(&self.scene.brought(row), 0.0));
        Ok(())
    }
}

impl Inside for MemoryRows<'_> {
    fn each(&mut self, index: usize, members: &[Member], visit: &mut dyn FnMut(usize, &Halves)) -> Result<()> {
        let mut external = members[index].external.iter();
        for (number, row) in self.rows[index].iter().enumerate() {
            let Found::Hits(hits) = &row.found else { continue };
            let mut halves = *external.next().expect("one of each indirect row");
            let weight = 1.0 / f32::from(row.rounds);
            for (hit, slot) in hits.iter().zip(slots(row.open)).filter(|(hit, _)| hit.side != NodeName::ESCAPE) {
                let lit = &members[hit.side.cluster().0 as usize].lit;
                add(&mut halves, slot, lit.leaving_from(hit.side.patch_side(), hit.at), weight);
            }
            visit(number, &halves);
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
