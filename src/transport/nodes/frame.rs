//! Places of a patch in its plane: metres along two axes from its first corner. Both sides share them.

use glam::DVec3;

use crate::geom::polygon::Polygon;
use crate::geom::quadtree::patch_polygon;
use crate::model::geometry::PatchRecord;

/// A place in the plane of a patch, m.
pub type Plane = [f64; 2];

/// The plane of a patch.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    origin: DVec3,
    axes: [DVec3; 2],
    /// Smallest coordinates of the patch, and how far it reaches from there, m.
    low: Plane,
    size: Plane,
}

/// Steps that a stored coordinate counts across a patch.
const STEPS: f64 = u16::MAX as f64;

impl Frame {
    /// Of a patch.
    #[must_use]
    pub fn of(patch: &PatchRecord) -> Self {
        let shape = patch_polygon(patch);
        let corners = shape.corners();
        let along = (corners[1] - corners[0]).normalize_or(DVec3::X);
        let axes = [along, shape.normal().cross(along)];
        let mut frame = Self { origin: corners[0], axes, low: [0.0; 2], size: [0.0; 2] };
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in corners {
            let at = frame.plane(*corner);
            low = [0, 1].map(|i| low[i].min(at[i]));
            high = [0, 1].map(|i| high[i].max(at[i]));
        }
        (frame.low, frame.size) = (low, [0, 1].map(|i| high[i] - low[i]));
        frame
    }

    /// Where a place of the patch lies.
    #[inline]
    #[must_use]
    pub fn plane(&self, place: DVec3) -> Plane {
        self.axes.map(|axis| axis.dot(place - self.origin))
    }

    /// A place as it is stored: steps from the patch's smallest coordinates.
    #[inline]
    #[must_use]
    pub fn pack(&self, at: Plane) -> [u16; 2] {
        [0, 1].map(|i| ((at[i] - self.low[i]) / self.size[i] * STEPS).round().clamp(0.0, STEPS) as u16)
    }

    /// From what is stored.
    #[inline]
    #[must_use]
    pub fn unpack(&self, stored: [u16; 2]) -> [f32; 2] {
        [0, 1].map(|i| (self.low[i] + self.size[i] * (f64::from(stored[i]) / STEPS)) as f32)
    }

    /// Means over the points of an element of x x, x y and y y, relative to a place, m2.
    #[must_use]
    pub fn moments(&self, shape: &Polygon, about: Plane) -> [f64; 3] {
        let corner = |corner: &DVec3| {
            let [x, y] = self.plane(*corner);
            [x - about[0], y - about[1]]
        };
        let (mut moments, mut whole) = ([0.0; 3], 0.0);
        let [first, others @ ..] = shape.corners() else { return moments };
        for pair in others.windows(2) {
            // A triangle's own: a twelfth of the squares of its corners and of their sum.
            let c = [corner(first), corner(&pair[0]), corner(&pair[1])];
            let [a, b] = [1, 2].map(|i| [c[i][0] - c[0][0], c[i][1] - c[0][1]]);
            let area = (a[0] * b[1] - a[1] * b[0]).abs();
            let sum = [0, 1].map(|k| c[0][k] + c[1][k] + c[2][k]);
            for (moment, (j, k)) in moments.iter_mut().zip([(0, 0), (0, 1), (1, 1)]) {
                *moment += area * (c.iter().map(|c| c[j] * c[k]).sum::<f64>() + sum[j] * sum[k]) / (3.0 * 4.0);
            }
            whole += area;
        }
        if whole > 0.0 { moments.map(|moment| moment / whole) } else { moments }
    }

    /// Corners of an element.
    #[must_use]
    pub fn corners(&self, shape: &Polygon) -> Vec<Plane> {
        shape.corners().iter().map(|c| self.plane(*c)).collect()
    }
}
