//! Rays aimed exactly at the edges and vertices of closed meshes: none may pass.

use clerestory::geom::sequence::{Sequence, mix};
use clerestory::model::rays::{ClusterRaysView, ClusterRef, Cuts, RayPatch, TopRaysView, WHOLE};
use clerestory::rays::emitters::NO_EMITTERS;
use clerestory::rays::traverse::Nearest;
use clerestory::rays::{RayScene, build};
use glam::{DMat3, DVec3};

/// Rays of each kind, half of them into an upright box, half into a turned one.
const RAYS: u64 = 1_000_000;
/// Quads along an edge of the box.
const ACROSS: u32 = 100;
const FACES_A_CLUSTER: usize = 64;

/// Quads of a box from -1 to 1, which share their corners to the bit.
fn quads(turn: DMat3) -> Vec<[[f32; 3]; 4]> {
    let mut quads = Vec::new();
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            for i in 0..ACROSS * ACROSS {
                quads.push([(0, 0), (1, 0), (1, 1), (0, 1)].map(|(u, v)| {
                    let on = |at: u32| f64::from(at) * 2.0 / f64::from(ACROSS) - 1.0;
                    let mut place = DVec3::splat(side);
                    place[(axis + 1) % 3] = on(i % ACROSS + u);
                    place[(axis + 2) % 3] = on(i / ACROSS + v);
                    (turn * place).as_vec3().to_array()
                }));
            }
        }
    }
    quads
}

/// (rays through edges, rays through vertices) that escape.
fn escaped(turn: DMat3, seed: u64) -> (u64, u64) {
    let quads = quads(turn);
    let (mut refs, mut bytes) = (Vec::new(), Vec::new());
    for (cluster, quads) in quads.chunks(FACES_A_CLUSTER).enumerate() {
        let face = |(patch, &corners_m): (usize, &[[f32; 3]; 4])| {
            let (patch, area_m2) = (patch as u32, 4.0 / (ACROSS * ACROSS) as f32);
            RayPatch { corners_m, patch, corner_count: 4, area_m2, cut: WHOLE }
        };
        let faces: Vec<RayPatch> = quads.iter().enumerate().map(face).collect();
        let corners = || quads.iter().flatten().map(|&c| glam::Vec3::from(c));
        let (min, max) = (corners().reduce(glam::Vec3::min), corners().reduce(glam::Vec3::max));
        let (nodes, patches) = build::cluster(&faces);
        let cuts = Cuts { faces: &[], nodes: &[], parts: &[] };
        let payload = ClusterRaysView { nodes: &nodes, patches: &patches, cuts }.payload();
        let at = ClusterRef::to(cluster as u32, &payload, bytes.len() as u64).expect("just built");
        bytes.extend_from_slice(&payload);
        refs.push((at, min.expect("a face").to_array(), max.expect("a face").to_array()));
    }
    let (nodes, clusters) = build::top(&refs);
    let mut words = vec![0u128; bytes.len().div_ceil(16)];
    bytemuck::cast_slice_mut::<u128, u8>(&mut words)[..bytes.len()].copy_from_slice(&bytes);
    let top = TopRaysView { nodes: &nodes, clusters: &clusters };
    let scene = RayScene::new(top, bytemuck::cast_slice(&words), &NO_EMITTERS, 1e-5).expect("just built");
    let (sequence, mut escaped) = (Sequence::new(seed), (0, 0));
    for i in 0..RAYS / 2 {
        let [x, y, z, share] = sequence.point(i);
        let from = turn * (DVec3::new(x, y, z) - 0.5);
        let corners = quads[mix(i) as usize % quads.len()].map(|c| DVec3::from_array(c.map(f64::from)));
        let passes = |to: DVec3| u64::from(matches!(scene.nearest(from, to - from, None), Nearest::Escaped));
        escaped.0 += passes(corners[0].lerp(corners[1], share));
        escaped.1 += passes(corners[2]);
    }
    escaped
}

/// Prints how many rays pass.
pub fn leaks() {
    let turned = DMat3::from_rotation_z(0.31) * DMat3::from_rotation_x(0.47);
    let (upright, turned) = (escaped(DMat3::IDENTITY, 3), escaped(turned, 4));
    super::common::print("closed box", "edge_leaks", (upright.0 + turned.0) as f64, "1");
    super::common::print("closed box", "vertex_leaks", (upright.1 + turned.1) as f64, "1");
}
