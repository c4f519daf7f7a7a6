//! Push-pull: what arrives at inner elements goes down to the leaves, means come up again.

use super::mesh::Mesh;
use crate::base::{NodeName, Rgb};
use crate::model::links::LeafClosure;

/// How a leaf's row is closed: see [`super::closure`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factors {
    /// What the form factors of the leaf's own links are multiplied by.
    pub own_scale: f64,
    /// What their standard errors are multiplied by, to be added.
    pub own_correction: f64,
    /// What the form factors of links of elements above it are multiplied by.
    pub above_scale: f64,
    /// What their standard errors are multiplied by, to be added.
    pub above_correction: f64,
}

impl Factors {
    /// Nothing to close.
    pub const ONE: Self = Self { own_scale: 1.0, own_correction: 0.0, above_scale: 1.0, above_correction: 0.0 };

    /// As stored.
    #[must_use]
    pub fn of(closure: &LeafClosure) -> Self {
        Self {
            own_scale: f64::from(closure.own_scale),
            own_correction: f64::from(closure.own_correction),
            above_scale: f64::from(closure.above_scale),
            above_correction: f64::from(closure.above_correction),
        }
    }
}

/// Factors of every node of a mesh, by position: of a leaf those that close its row.
#[must_use]
pub fn factors(mesh: &Mesh, closure: &[LeafClosure]) -> Vec<Factors> {
    let mut factors = vec![Factors::ONE; mesh.node_count()];
    for c in closure {
        factors[mesh.position(NodeName(c.leaf))] = Factors::of(c);
    }
    factors
}

/// What an element gathered over its own links, W/m2.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gathered {
    /// Sum of form factors times radiosities.
    pub light: Rgb,
    /// Sum of the form factors' standard errors times radiosities.
    pub doubt: Rgb,
}

impl Gathered {
    /// Adds a link's light.
    pub fn add(&mut self, radiosity: Rgb, form_factor: f64, error: f64) {
        self.light += radiosity * form_factor;
        self.doubt += radiosity * error;
    }

    fn plus(self, other: Self) -> Self {
        Self { light: self.light + other.light, doubt: self.doubt + other.doubt }
    }
}

/// Sets every element's irradiance from what each gathered over its own links and from each leaf's closing factors (both
/// by position in the mesh; sector nodes send only). Keeps power: a node's irradiance is the area-weighted mean of those
/// below it.
pub fn push_pull(mesh: &mut Mesh, gathered: &[Gathered], factors: &[Factors]) {
    let (own, factors) = (&gathered[mesh.sectors.len()..], &factors[mesh.sectors.len()..]);
    // Those above come earlier: one pass down, one up.
    let mut above = vec![Gathered::default(); own.len()];
    for at in 0..mesh.elements.len() {
        let element = &mut mesh.elements[at];
        if element.is_leaf() {
            let (own, above, by) = (&own[at], &above[at], &factors[at]);
            let closed = own.light * by.own_scale
                + own.doubt * by.own_correction
                + above.light * by.above_scale
                + above.doubt * by.above_correction;
            // No link turns negative, so this is rounding alone.
            element.set_irradiance(Rgb(closed.0.map(|x| x.max(0.0))));
        } else {
            let first = element.first_child as usize;
            let down = above[at].plus(own[at]);
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
