//! How much the light has changed between two versions, in the norm of `--tolerance`; and how much
//! it will still change.

use crate::base::{NodeName, Rgb};
use crate::geom::quadtree;
use crate::model::geometry::{GeometryView, SideMaterial};
use crate::model::light::LightView;

/// Sums over area, to be added up cluster by cluster in one order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Change {
    /// Integral of the squared change of irradiance, (W/m2)2 m2.
    pub change: f64,
    /// Integral of the squared irradiance.
    pub norm: f64,
    /// The same two over emitters, which count only where there is nothing else.
    pub emitters: [f64; 2],
}

impl Change {
    /// Relative root mean square change; 0 where nothing is lit.
    #[must_use]
    pub fn residual(self) -> f64 {
        let [change, norm] = if self.norm > 0.0 { [self.change, self.norm] } else { self.emitters };
        if norm > 0.0 { (change / norm).sqrt() } else { 0.0 }
    }

    fn of_emitter(self) -> Self {
        Self { emitters: [self.change, self.norm], ..Self::default() }
    }

    /// The sum of both.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            change: self.change + other.change,
            norm: self.norm + other.norm,
            emitters: [0, 1].map(|i| self.emitters[i] + other.emitters[i]),
        }
    }
}

/// The change of a cluster between two versions, over the lit sides of its patches.
#[must_use]
pub fn of_cluster(
    geometry: &GeometryView<'_>,
    materials: &[SideMaterial],
    old: &LightView<'_>,
    new: &LightView<'_>,
) -> Change {
    let emits = |patch: usize| (0..2).any(|side| materials[2 * patch + side].exitance != [0.0; 3]);
    let mut sum = Change::default();
    for root in new.level(0) {
        let name = NodeName(root.name);
        let patch = usize::from(name.patch_side().patch);
        let before = old.find(name).map_or([0.0; 3], |e| e.irradiance);
        let lit = root.irradiance != [0.0; 3] || before != [0.0; 3];
        if patch < geometry.patches.len() && lit {
            let change = of_element(geometry, patch, name, old, new);
            sum = sum.plus(if emits(patch) { change.of_emitter() } else { change });
        }
    }
    sum
}

/// Down to the leaves of the new version.
fn of_element(
    geometry: &GeometryView<'_>,
    patch: usize,
    name: NodeName,
    old: &LightView<'_>,
    new: &LightView<'_>,
) -> Change {
    if new.has_children(name) {
        return (0..4).fold(Change::default(), |sum, quarter| {
            sum.plus(of_element(geometry, patch, name.child(quarter), old, new))
        });
    }
    let light = |view: &LightView<'_>| view.nearest(name).map_or(Rgb::BLACK, |e| Rgb::from_f32(e.irradiance));
    let (before, after) = (light(old), light(new));
    let area = quadtree::element_polygon(&geometry.patches[patch], name.path()).area();
    let (change, norm) = (area * (after - before).norm_squared(), area * after.norm_squared());
    Change { change, norm, ..Change::default() }
}

/// The factor by which the error falls per iteration: the largest ratio of successive `residuals`
/// (newest first, the last three count), at most `q`, the largest row sum of reflectance times form
/// factor; `q` while there is no ratio yet.
#[must_use]
pub fn contraction(residuals: &[f64], q: f64) -> f64 {
    let last = &residuals[..residuals.len().min(3)];
    let ratios = last.windows(2).filter(|w| w[1] > 0.0).map(|w| w[0] / w[1]);
    ratios.reduce(f64::max).map_or(q, |largest| largest.min(q))
}

/// Relative error left when stopping after a change of `residual`.
#[must_use]
pub fn predicted_error(residual: f64, contraction: f64) -> f64 {
    if residual == 0.0 { 0.0 } else { residual * contraction / (1.0 - contraction) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_geometric_series_is_predicted_exactly() {
        // Errors 1, 1/2, 1/4 ... : changes 1/2, 1/4, 1/8; after the third the error is 1/8.
        let residuals = [0.125, 0.25, 0.5];
        let theta = contraction(&residuals, 0.9);
        assert_eq!(theta, 0.5);
        assert_eq!(predicted_error(residuals[0], theta), 0.125);
        assert_eq!(contraction(&[0.125, 0.13], 0.5), 0.5, "never more than q");
        assert_eq!(contraction(&[1.0], 0.7), 0.7);
    }
}
