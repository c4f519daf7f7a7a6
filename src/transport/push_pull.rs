//! Push-pull: what arrives at inner elements goes down to the leaves, means come up again.

use super::mesh::Mesh;
use crate::base::Rgb;

/// What a leaf's own links and those above it are multiplied by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factors {
    /// For the leaf's own links.
    pub own: f64,
    /// For links of elements above it.
    pub above: f64,
}

impl Factors {
    /// Nothing to close.
    pub const ONE: Self = Self { own: 1.0, above: 1.0 };
}

/// Sets every element's irradiance from what each gathered over its own links (`gathered`, W/m2, by
/// position in the mesh) and each leaf's closing factors. Keeps power: a parent's irradiance is the
/// area-weighted mean of its children's.
pub fn push_pull(mesh: &mut Mesh, gathered: &[Rgb], factors: &[Factors]) {
    let mut above = vec![Rgb::BLACK; mesh.elements.len()];
    // Children lie behind their parents: one pass down, one up.
    for at in 0..mesh.elements.len() {
        let element = &mut mesh.elements[at];
        if element.is_leaf() {
            element.set_irradiance(gathered[at] * factors[at].own + above[at] * factors[at].above);
        } else {
            let first = element.first_child as usize;
            let down = above[at] + gathered[at];
            above[first..first + 4].fill(down);
        }
    }
    pull(mesh);
}

/// Means and extremes of the leaves, upwards.
pub fn pull(mesh: &mut Mesh) {
    for at in (0..mesh.elements.len()).rev() {
        if mesh.elements[at].is_leaf() {
            continue;
        }
        let first = mesh.elements[at].first_child as usize;
        let children: [_; 4] = std::array::from_fn(|q| mesh.elements[first + q]);
        let area: f64 = children.iter().map(|c| c.area_m2).sum();
        let sum = children.iter().fold(Rgb::BLACK, |sum, c| sum + c.irradiance * c.area_m2);
        let above = &mut mesh.elements[at];
        above.irradiance = if area > 0.0 { sum * (1.0 / area) } else { children[0].irradiance };
        above.leaf_low = std::array::from_fn(|i| children.iter().map(|c| c.leaf_low[i]).fold(f64::INFINITY, f64::min));
        above.leaf_high =
            std::array::from_fn(|i| children.iter().map(|c| c.leaf_high[i]).fold(f64::NEG_INFINITY, f64::max));
    }
}
