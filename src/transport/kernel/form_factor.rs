//! Unoccluded form factors: the closed form from a point to a polygon.

use std::f64::consts::PI;

use glam::DVec3;

use crate::geom::polygon::Polygon;
use crate::transport::numbers;

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
    if radius_squared < numbers::FAR * distance_squared {
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
    if cosine <= 0.0 || sine > numbers::SMALL_ANGLE * cosine {
        return libm::atan2(sine, cosine);
    }
    let t = sine / cosine;
    let s = t * t;
    // 1 - s / 3 + s^2 / 5 and so on.
    let coefficients = (1..=15u8).rev().step_by(2).map(|odd| 1.0 / f64::from(odd));
    t * coefficients.fold(0.0, |sum, coefficient| coefficient - s * sum)
}
