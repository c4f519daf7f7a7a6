//! Unoccluded form factors: the closed form from a point to a polygon, averaged over a receiver.
//!
//! Never sampled area to area: that is unbounded near contact, while every term here is in 0..=1.

use std::f64::consts::PI;

use glam::DVec3;

use super::contour;
use crate::geom::polygon::Polygon;
use crate::geom::quadtree;

/// Below this (radius / distance)^2 a polygon counts as a small area seen from afar: the closed
/// form's edge terms cancel there, and the small-area formula errs by less than this ratio.
const FAR: f64 = 1e-6;

/// Returns the form factor from a point on a surface to an unoccluded polygon, either winding.
///
/// * `receiver` in m, `normal` its unit normal; what lies below its horizon is clipped away.
/// * Result: 0..=1. Occlusion and the facing of the polygon are the caller's.
///
/// Source: Lambert's edge formula; for the attribution see Stark 2000, UUCS-00-012.
#[must_use]
pub fn point_to_polygon(receiver: DVec3, normal: DVec3, polygon: &Polygon) -> f64 {
    let horizon = normal.dot(receiver);
    let clipped;
    let mut shape = polygon;
    if polygon.corners().iter().any(|c| normal.dot(*c) < horizon) {
        clipped = polygon.clip(normal, horizon);
        shape = &clipped;
    }
    let c = shape.corners();
    if c.len() < 3 {
        return 0.0;
    }
    let centre = shape.centre();
    let away = centre - receiver;
    let distance_squared = away.length_squared();
    let radius_squared = c.iter().map(|p| p.distance_squared(centre)).fold(0.0, f64::max);
    if radius_squared < FAR * distance_squared {
        let area_vector = shape.doubled_area_vector() * 0.5;
        let cosines = normal.dot(away) * area_vector.dot(away).abs();
        return (cosines / (PI * distance_squared * distance_squared)).clamp(0.0, 1.0);
    }
    let mut sum = 0.0;
    let mut from = c[c.len() - 1] - receiver;
    for corner in c {
        let to = *corner - receiver;
        let axis = to.cross(from);
        let sine = axis.length();
        if sine > 0.0 {
            sum += angle(sine, from.dot(to)) * axis.dot(normal) / sine;
        }
        from = to;
    }
    (sum.abs() / (2.0 * PI)).min(1.0)
}

/// atan2 for a positive `sine`: from afar most edges are seen under small angles, whose series errs by less
/// than 4e-12.
fn angle(sine: f64, cosine: f64) -> f64 {
    if cosine <= 0.0 || sine > 0.25 * cosine {
        return libm::atan2(sine, cosine);
    }
    let t = sine / cosine;
    let s = t * t;
    let series = [1.0 / 13.0, 1.0 / 11.0, 1.0 / 9.0, 1.0 / 7.0, 1.0 / 5.0, 1.0 / 3.0, 1.0];
    t * series.iter().fold(1.0 / 15.0, |sum, coefficient| coefficient - s * sum)
}

/// A form factor averaged over a receiver.
#[derive(Clone, Copy, Debug, Default)]
pub struct Average {
    /// Mean over the receiver.
    pub mean: f64,
    /// Largest and smallest value met.
    pub high: f64,
    /// See `high`.
    pub low: f64,
    /// Estimated error of `mean`.
    pub error: f64,
}

/// What a receiver point sees of the source: 0 behind the source's plane.
#[inline]
pub(super) fn at_point(point: DVec3, normal: DVec3, source: &Polygon, source_normal: DVec3) -> f64 {
    if source_normal.dot(point - source.corners()[0]) <= 0.0 {
        return 0.0;
    }
    point_to_polygon(point, normal, source)
}

/// Offsets of the two Gauss points on [0, 1].
const GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];

/// Mean by four Gauss points (quads) or the four children's centroids (triangles).
fn rule(shape: &Polygon, normal: DVec3, source: &Polygon, source_normal: DVec3) -> Average {
    let mut values = [0.0; 4];
    let mut weights = [0.25; 4];
    if shape.corners().len() == 4 {
        let c = shape.corners();
        for (i, value) in values.iter_mut().enumerate() {
            let (u, v) = (GAUSS[i % 2], GAUSS[i / 2]);
            let along_u = (c[1] - c[0]) * (1.0 - v) + (c[2] - c[3]) * v;
            let along_v = (c[3] - c[0]) * (1.0 - u) + (c[2] - c[1]) * u;
            weights[i] = along_u.cross(along_v).length();
            *value = at_point(shape.point(u, v), normal, source, source_normal);
        }
    } else {
        // The degree-3 rule with a negative weight is no average; four equal cells are.
        for (i, value) in values.iter_mut().enumerate() {
            *value = at_point(quadtree::quarter(shape, i as u32).centroid(), normal, source, source_normal);
        }
    }
    let total: f64 = weights.iter().sum();
    let mean = values.iter().zip(weights).map(|(v, w)| v * w).sum::<f64>() / total;
    let high = values.iter().copied().fold(0.0, f64::max);
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    Average { mean, high, low, error: 0.0 }
}

/// Deepest subdivision of a receiver while averaging.
const MAX_LEVELS: u32 = 9;

/// Returns the mean over `receiver` (a triangle or quad) of the form factor from its points to
/// `source`, with the receiver's points added until the estimated error meets `tolerance`.
///
/// * `normal`, `source_normal`: unit normals of the sides that face each other.
#[must_use]
pub fn average(receiver: &Polygon, normal: DVec3, source: &Polygon, source_normal: DVec3, tolerance: f64) -> Average {
    let coarse = rule(receiver, normal, source, source_normal);
    let centre = at_point(receiver.centroid(), normal, source, source_normal);
    let coarse = Average { high: coarse.high.max(centre), low: coarse.low.min(centre), ..coarse };
    if is_near(receiver, source) {
        return near(receiver, normal, source, source_normal, &coarse, tolerance);
    }
    // Far apart the integrand is nearly quadratic, which four Gauss points integrate: the centre's
    // distance from the mean is then the size of what they already account for.
    let curvature = (coarse.mean - centre).abs();
    if curvature <= 0.5 * tolerance || (curvature < 0.01 * coarse.mean && 0.1 * curvature <= tolerance) {
        return Average { error: 0.2 * curvature, ..coarse };
    }
    let mut out = refine(receiver, normal, source, source_normal, &coarse, tolerance, 1);
    out.high = out.high.max(coarse.high);
    out.low = out.low.min(coarse.low);
    out
}

/// Whether the receiver is larger than its distance from the source.
fn is_near(receiver: &Polygon, source: &Polygon) -> bool {
    let (r, s) = (receiver.radius(), source.radius());
    receiver.centre().distance(source.centre()) < 2.0 * r + s
}

/// The exact mean, with extremes at points near the receiver's corners added.
fn near(
    receiver: &Polygon,
    normal: DVec3,
    source: &Polygon,
    source_normal: DVec3,
    coarse: &Average,
    tolerance: f64,
) -> Average {
    let area = receiver.area();
    let seen = receiver.clip(source_normal, source_normal.dot(source.corners()[0]));
    let seeing = source.clip(normal, normal.dot(receiver.corners()[0]));
    if area <= 0.0 || seen.corners().len() < 3 || seeing.corners().len() < 3 {
        return Average::default();
    }
    let mean = (contour::exchange_area(&seen, &seeing, tolerance * area * 0.1) / area).min(1.0);
    let centre = receiver.centroid();
    let mut out = Average { mean, error: 0.1 * tolerance, ..*coarse };
    for corner in receiver.corners() {
        let value = at_point(*corner * 0.9 + centre * 0.1, normal, source, source_normal);
        out.high = out.high.max(value);
        out.low = out.low.min(value);
    }
    out
}

fn refine(
    receiver: &Polygon,
    normal: DVec3,
    source: &Polygon,
    source_normal: DVec3,
    coarse: &Average,
    tolerance: f64,
    level: u32,
) -> Average {
    let parts: [(Polygon, Average, f64); 4] = std::array::from_fn(|i| {
        let part = quadtree::child(receiver, i as u32);
        (part, rule(&part, normal, source, source_normal), part.area())
    });
    let area: f64 = parts.iter().map(|p| p.2).sum();
    if area <= 0.0 {
        return *coarse;
    }
    let mean = parts.iter().map(|p| p.1.mean * p.2).sum::<f64>() / area;
    let high = parts.iter().map(|p| p.1.high).fold(0.0, f64::max);
    let low = parts.iter().map(|p| p.1.low).fold(f64::INFINITY, f64::min);
    // The error falls by at least 2 a level even beside an edge; half the change bounds what is left.
    let change = (mean - coarse.mean).abs();
    if 0.5 * change <= tolerance || level >= MAX_LEVELS {
        return Average { mean, high, low, error: 0.5 * change };
    }
    let mut sum = Average { low: f64::INFINITY, ..Average::default() };
    for (part, rough, part_area) in &parts {
        let share = part_area / area;
        // A part may err by its area's share of what is allowed, and more: errors do not all add.
        let fine = refine(part, normal, source, source_normal, rough, tolerance * 0.5 / share.max(0.25), level + 1);
        sum.mean += fine.mean * share;
        sum.error += fine.error * share;
        sum.high = sum.high.max(fine.high);
        sum.low = sum.low.min(fine.low);
    }
    sum
}
