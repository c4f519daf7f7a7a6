//! The form factor between two polygons near each other, by Stokes' theorem: a double integral of
//! ln r over their outlines, the inner one in closed form, the outer one adaptive. Exact in contact,
//! where averaging over points converges slowly and falsely.
//!
//! Source: the contour form in Schroeder and Hanrahan 1993.

use std::f64::consts::PI;

use glam::DVec3;

use crate::geom::polygon::Polygon;

/// Nodes (on 0..1) and weights of the 8-point Gauss-Legendre rule.
const NODES: [(f64, f64); 8] = [
    (0.019_855_071_751_231_856, 0.050_614_268_145_188_13),
    (0.101_666_761_293_186_64, 0.111_190_517_226_687_24),
    (0.237_233_795_041_835_5, 0.156_853_322_938_943_64),
    (0.408_282_678_752_175, 0.181_341_891_689_181),
    (0.591_717_321_247_825, 0.181_341_891_689_181),
    (0.762_766_204_958_164_5, 0.156_853_322_938_943_64),
    (0.898_333_238_706_813_4, 0.111_190_517_226_687_24),
    (0.980_144_928_248_768_1, 0.050_614_268_145_188_13),
];

/// Integral of ln |p - x| over the segment from `a` of length `length` along unit `along`.
fn log_over_segment(p: DVec3, a: DVec3, along: DVec3, length: f64) -> f64 {
    let offset = p - a;
    let s = offset.dot(along);
    let h_squared = (offset.length_squared() - s * s).max(0.0);
    let h = h_squared.sqrt();
    let primitive = |x: f64| {
        let r_squared = x * x + h_squared;
        let log_part = if r_squared > 0.0 { 0.5 * x * libm::log(r_squared) } else { 0.0 };
        log_part - x + if h > 0.0 { h * libm::atan(x / h) } else { 0.0 }
    };
    primitive(length - s) - primitive(-s)
}

struct Edges {
    /// (start, unit direction, length)
    edges: Vec<(DVec3, DVec3, f64)>,
}

impl Edges {
    fn new(shape: &Polygon) -> Self {
        let c = shape.corners();
        let edges = (0..c.len())
            .map(|i| {
                let along = c[(i + 1) % c.len()] - c[i];
                (c[i], along.normalize_or_zero(), along.length())
            })
            .filter(|e| e.2 > 0.0)
            .collect();
        Self { edges }
    }

    /// Sum over the edges of (d . d_i) times the integral of ln |p - x|.
    fn at(&self, p: DVec3, d: DVec3) -> f64 {
        self.edges
            .iter()
            .map(|(a, along, length)| {
                let cosine = d.dot(*along);
                if cosine == 0.0 { 0.0 } else { cosine * log_over_segment(p, *a, *along, *length) }
            })
            .sum()
    }
}

/// Deepest halving of an outer edge.
const MAX_LEVELS: u32 = 14;

/// Gauss rule on `from..to` of an outer edge, halved until both agree within `tolerance`.
fn integrate(f: &dyn Fn(f64) -> f64, from: f64, to: f64, whole: f64, tolerance: f64, level: u32) -> f64 {
    let middle = 0.5 * (from + to);
    let (left, right) = (gauss(f, from, middle), gauss(f, middle, to));
    if (left + right - whole).abs() <= tolerance || level >= MAX_LEVELS {
        return left + right;
    }
    integrate(f, from, middle, left, tolerance * 0.5, level + 1)
        + integrate(f, middle, to, right, tolerance * 0.5, level + 1)
}

fn gauss(f: &dyn Fn(f64) -> f64, from: f64, to: f64) -> f64 {
    NODES.iter().map(|(x, w)| w * f(from + (to - from) * x)).sum::<f64>() * (to - from)
}

/// Returns the area integral of the form factor from `receiver`'s points to `source`, m2 (divide by
/// the receiver's area), both convex, each wholly in front of the other; `tolerance` in m2.
#[must_use]
pub fn exchange_area(receiver: &Polygon, source: &Polygon, tolerance_m2: f64) -> f64 {
    let source = Edges::new(source);
    let outer = Edges::new(receiver);
    let tolerance = tolerance_m2 * 2.0 * PI / outer.edges.len().max(1) as f64;
    let sum: f64 = outer
        .edges
        .iter()
        .map(|(a, along, length)| {
            let f = |t: f64| source.at(*a + *along * t, *along);
            integrate(&f, 0.0, *length, gauss(&f, 0.0, *length), tolerance, 0)
        })
        .sum();
    sum.abs() / (2.0 * PI)
}
