//! What a link with a sector node at either end is worth. Bounds that need no ray come first: most pairs are
//! split by them. Rays then run between points of sides drawn by area.

use glam::DVec3;

use super::bundle::Bundle;
use super::form_factor;
use super::sight::{Sight, UNANIMOUS};
use crate::base::NodeName;
use crate::geom::sequence::{Sequence, mix};
use crate::model::links::Visibility;
use crate::rays::RayScene;

/// A form factor without occlusion, from some points of the receiver.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Mean over the points.
    pub form_factor: f64,
    /// Largest deviation from it.
    pub spread: f64,
    /// Standard error of the mean.
    pub error: f64,
}

/// Points of a receiver that stand for it.
const POINTS: usize = 8;

/// Square of radius over distance below which a source's sides are summed as small areas from its middle.
const FAR: f64 = 0.01;

/// Returns what `r` would see of `s` if nothing stood between; `None` if no side faces another.
#[must_use]
pub fn estimate(r: &Bundle, s: &Bundle, slack_m: f64) -> Option<Estimate> {
    let from_sides = |point: DVec3, normal: DVec3| -> f64 {
        let away = s.centre - point;
        let distance_squared = away.length_squared();
        if s.radius_m * s.radius_m < FAR * distance_squared {
            let cosine = normal.dot(away).max(0.0);
            let towards: f64 = s.sides().iter().map(|side| (-side.node.normal.dot(away)).max(0.0) * side.area_m2).sum();
            return (cosine * towards / (std::f64::consts::PI * distance_squared * distance_squared)).min(1.0);
        }
        let seen =
            |side: &super::bundle::Side| form_factor::at_point(point, normal, &side.node.shape, side.node.normal);
        s.sides().iter().map(seen).sum::<f64>().min(1.0)
    };
    // Points all over the sides: a wall's middle does not stand for its ends.
    let values: [f64; POINTS] = std::array::from_fn(|i| {
        let (side, along) = r.draw((i as f64 + 0.5) / POINTS as f64);
        let across = (0.5 + i as f64 * GOLDEN).fract();
        from_sides(side.node.shape.point(along, across), side.node.normal)
    });
    let mean = values.iter().sum::<f64>() / POINTS as f64;
    let faces = || r.sides().iter().any(|a| s.sides().iter().any(|b| a.node.faces(&b.node, slack_m)));
    if mean == 0.0 && !faces() {
        return None;
    }
    let spread = values.iter().map(|v| (v - mean).abs()).fold(0.0, f64::max);
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (POINTS - 1) as f64;
    Some(Estimate { form_factor: mean, spread, error: (variance / POINTS as f64).sqrt() })
}

/// Steps of this keep points of a line apart.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// Rays of the first batch and the most.
const RAYS: (u64, u64) = (8, 64);

/// Adds visibility to an estimate: rays until its error is below `allowed` or they have told enough.
#[must_use]
pub fn look(
    scene: &RayScene<'_>,
    r: &Bundle,
    s: &Bundle,
    estimate: &Estimate,
    allowed: f64,
    seed: u64,
    rays: &mut u64,
) -> Sight {
    let (low, high) = (r.name.min(s.name), r.name.max(s.name));
    let sequence = Sequence::new(mix(seed ^ mix(low.0)) ^ high.0);
    let least = RAYS.0;
    let softening = 2e-3 * s.area_m2;
    let (mut all, mut squares, mut visible, mut cast) = (0.0, 0.0, 0.0, 0u64);
    let (mut index, mut target) = (0, least);
    loop {
        while cast < target && index < 4 * target {
            let [a, b, c, d] = sequence.point(index);
            // The first numbers run through the sides in turn.
            let a = (a + index as f64) / target as f64 % 1.0;
            index += 1;
            let ((from_side, a), (to_side, c)) = (r.draw(a), s.draw(c));
            let (from, to) = (from_side.node.shape.point(a, b), to_side.node.shape.point(c, d));
            let along = to - from;
            let (cos_r, cos_s) = (from_side.node.normal.dot(along), -to_side.node.normal.dot(along));
            if cos_r <= 0.0 || cos_s <= 0.0 || from_side.node.end.key == to_side.node.end.key {
                continue;
            }
            let distance_squared = along.length_squared();
            let weight = cos_r * cos_s / (distance_squared * (distance_squared + softening));
            (cast, *rays) = (cast + 1, *rays + 1);
            all += weight;
            squares += weight * weight;
            if !scene.blocked(from, to, &from_side.node.end, &to_side.node.end, &None) {
                visible += weight;
            }
        }
        let share = if all > 0.0 { visible / all } else { 0.0 };
        let effective = if squares > 0.0 { all * all / squares } else { 0.0 };
        let error = (share * (1.0 - share) / (effective + 1.0)).sqrt().max(UNANIMOUS / (effective + 1.0));
        let doubt = estimate.form_factor * error;
        let unsure = estimate.error * share;
        if doubt <= allowed || target >= RAYS.1 || index >= 4 * target {
            let mixed = share > 0.0 && share < 1.0;
            // Where visibility is partial some of the receiver may see all and some nothing.
            let spread =
                estimate.spread * share + if mixed { estimate.form_factor * share.min(1.0 - share) } else { 0.0 };
            return Sight {
                form_factor: estimate.form_factor * share,
                spread,
                uncertainty: doubt + unsure,
                class: Visibility::Partial,
            };
        }
        target *= 2;
    }
}

/// What marks a pair of nodes as dealt with where its links lie below, or nothing faces.
#[must_use]
pub fn mark(source: NodeName) -> super::link_rows::Link {
    super::link_rows::Link { source, form_factor: 0.0, spread: 0.0, uncertainty: 0.0, class: Visibility::Hidden }
}
