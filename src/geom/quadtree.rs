//! Shapes of quadtree elements: they follow from patch and path alone.
//!
//! Children of a triangle: its three corners in order, then the middle; of a quad: its four corners
//! in order, cut at the edge midpoints and the mean of the corners. What is longer than four times its width is cut
//! into four slices instead, or a skirting board of 5 m by 1 cm would take ten thousand elements of a tenth of a
//! millimetre: slices lie in the order of the first or the second edge; those of a triangle from its shortest edge on,
//! three quads and a triangle at the tip.

use glam::DVec3;

use super::polygon::Polygon;
use crate::model::geometry::PatchRecord;

/// The patch as a polygon in f64, winding towards its front.
#[must_use]
pub fn patch_polygon(patch: &PatchRecord) -> Polygon {
    let corners = patch.corners_m.map(|c| DVec3::from_array(c.map(f64::from)));
    Polygon::new(&corners[..usize::from(patch.corner_count)])
}

/// The element of a patch at `path` (a leading 1, then two bits a level), winding towards the
/// patch's front. Both sides share shapes.
#[must_use]
pub fn element_polygon(patch: &PatchRecord, path: u32) -> Polygon {
    let mut shape = patch_polygon(patch);
    let depth = (31 - path.leading_zeros()) / 2;
    for level in (0..depth).rev() {
        shape = child(&shape, (path >> (2 * level)) & 3);
    }
    shape
}

/// How an element is cut into its four children.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cut {
    /// A quad at the middles of its edges.
    Quarters,
    /// A long quad into slices along its first edge.
    AlongFirst,
    /// A long quad into slices along its second edge.
    AlongSecond,
    /// A triangle at the middles of its edges.
    Corners,
    /// A needle into slices from its shortest edge, which begins at that corner, to the corner opposite.
    Needle(usize),
}

/// Length of what is sliced, in widths: slices are then no wider than they are long.
const LONG: f64 = 4.0;

impl Cut {
    fn of(shape: &Polygon) -> Self {
        let c = shape.corners();
        if let [a, b, c, d] = *c {
            // Twice the lines between the middles of opposite edges.
            let (first, second) = ((b - a) + (c - d), (d - a) + (c - b));
            let (first, second) = (first.length_squared(), second.length_squared());
            return match () {
                () if first >= LONG * LONG * second => Self::AlongFirst,
                () if second >= LONG * LONG * first => Self::AlongSecond,
                () => Self::Quarters,
            };
        }
        let edge = |i: usize| c[i].distance_squared(c[(i + 1) % 3]);
        let longest = edge(0).max(edge(1)).max(edge(2));
        // So long that its height is a quarter of that.
        if longest < LONG * shape.doubled_area_vector().length() {
            return Self::Corners;
        }
        Self::Needle((0..3).min_by(|i, j| edge(*i).total_cmp(&edge(*j))).unwrap_or(0))
    }

    /// The shape of a child.
    fn shape(self, of: &Polygon, quarter: u32) -> Polygon {
        let (corners, count) = self.child(of.corners(), quarter, mixed);
        Polygon::new(&corners[..count])
    }

    /// Corners of a child, and how many they are; `mix(a, b, k)` lies k quarters of the way from a to b.
    fn child<P: Copy>(self, c: &[P], quarter: u32, mix: impl Fn(P, P, u32) -> P) -> ([P; 4], usize) {
        let (here, there) = (quarter, quarter + 1);
        let middle = |i: usize, j: usize| mix(c[i], c[j], 2);
        match self {
            Self::AlongFirst => {
                let [a, b] = [here, there].map(|k| mix(c[0], c[1], k));
                let [d, e] = [here, there].map(|k| mix(c[3], c[2], k));
                ([a, b, e, d], 4)
            }
            Self::AlongSecond => {
                let [a, b] = [here, there].map(|k| mix(c[0], c[3], k));
                let [d, e] = [here, there].map(|k| mix(c[1], c[2], k));
                ([a, d, e, b], 4)
            }
            Self::Quarters => {
                let (ab, bc, cd, da) = (middle(0, 1), middle(1, 2), middle(2, 3), middle(3, 0));
                let centre = mix(ab, cd, 2);
                let corners = match quarter {
                    0 => [c[0], ab, centre, da],
                    1 => [ab, c[1], bc, centre],
                    2 => [centre, bc, c[2], cd],
                    _ => [da, centre, cd, c[3]],
                };
                (corners, 4)
            }
            Self::Corners => {
                let (ab, bc, ca) = (middle(0, 1), middle(1, 2), middle(2, 0));
                let [a, b, c] = match quarter {
                    0 => [c[0], ab, ca],
                    1 => [ab, c[1], bc],
                    2 => [ca, bc, c[2]],
                    _ => [bc, ca, ab],
                };
                ([a, b, c, c], 3)
            }
            Self::Needle(base) => {
                let (p, r, tip) = (c[base], c[(base + 1) % 3], c[(base + 2) % 3]);
                let [a, b] = [here, there].map(|k| mix(p, tip, k));
                let [d, e] = [here, there].map(|k| mix(r, tip, k));
                if quarter == 3 { ([a, d, tip, tip], 3) } else { ([a, d, e, b], 4) }
            }
        }
    }
}

fn mixed(a: DVec3, b: DVec3, quarters: u32) -> DVec3 {
    (a * f64::from(4 - quarters) + b * f64::from(quarters)) * 0.25
}

/// Child `quarter` (0..4) of an element's shape.
#[must_use]
pub fn child(shape: &Polygon, quarter: u32) -> Polygon {
    Cut::of(shape).shape(shape, quarter)
}

/// Child `quarter` of an element's shape, and of its corners on a grid; `mix` as for shapes.
pub(super) fn child_on_grid<P: Copy>(
    shape: &Polygon,
    grid: &[P; 4],
    quarter: u32,
    mix: impl Fn(P, P, u32) -> P,
) -> (Polygon, [P; 4]) {
    let cut = Cut::of(shape);
    (cut.shape(shape, quarter), cut.child(grid, quarter, mix).0)
}

/// Whether a shape is so long that its children are slices.
fn is_sliced(shape: &Polygon) -> bool {
    !matches!(Cut::of(shape), Cut::Quarters | Cut::Corners)
}

/// How a triangle or parallelogram is cut whose points are told by two numbers: of a parallelogram along its first and its
/// last edge, of a triangle the weights of its second and third corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum UnitCut {
    /// Into quarters.
    Quarters = 0,
    /// Into slices along its first edge.
    AlongFirst = 1,
    /// Into slices along its last edge.
    AlongLast = 2,
    /// A triangle, at the middles of its edges.
    Corners = 3,
}

impl UnitCut {
    /// All, by number.
    pub const ALL: [Self; 4] = [Self::Quarters, Self::AlongFirst, Self::AlongLast, Self::Corners];

    /// Of a shape; `None` for needles and quads that are no parallelograms.
    #[must_use]
    pub fn of(shape: &Polygon) -> Option<Self> {
        match Cut::of(shape) {
            _ if shape.is_skew() => None,
            Cut::Quarters => Some(Self::Quarters),
            Cut::AlongFirst => Some(Self::AlongFirst),
            Cut::AlongSecond => Some(Self::AlongLast),
            Cut::Corners => Some(Self::Corners),
            Cut::Needle(_) => None,
        }
    }

    /// The same where children, and theirs, are alike and as large as each other: no slices.
    #[must_use]
    pub fn alike(shape: &Polygon) -> Option<Self> {
        Self::of(shape).filter(|cut| matches!(cut, Self::Quarters | Self::Corners))
    }

    /// Where a point of the descendant that a path of such children leads to (two bits a level, the last lowest) lies in the
    /// whole: numbers in 0..1, as the point's own.
    #[must_use]
    pub fn within(self, path: u64, levels: u32, mut point: [f64; 2]) -> [f64; 2] {
        for level in 0..levels {
            let child = (path >> (2 * level)) & 3;
            let [x, y] = point;
            point = match (self, child) {
                (Self::AlongFirst, _) => [0.25 * (child as f64 + x), y],
                (Self::AlongLast, _) => [x, 0.25 * (child as f64 + y)],
                (_, 0) => [0.5 * x, 0.5 * y],
                (_, 1) => [0.5 + 0.5 * x, 0.5 * y],
                (Self::Quarters, 2) => [0.5 + 0.5 * x, 0.5 + 0.5 * y],
                (Self::Quarters, _) | (Self::Corners, 2) => [0.5 * x, 0.5 + 0.5 * y],
                (Self::Corners, _) => [0.5 - 0.5 * x, 0.5 - 0.5 * y],
            };
        }
        point
    }

    /// A point of such a shape by its numbers in 0..1.
    #[must_use]
    pub fn point(self, shape: &Polygon, [x, y]: [f64; 2]) -> DVec3 {
        let c = shape.corners();
        let last = c[c.len() - 1];
        c[0] + (c[1] - c[0]) * x + (last - c[0]) * y
    }

    /// Numbers of a point by two that are even in 0..1.
    #[must_use]
    pub fn even(self, [u, v]: [f64; 2]) -> [f64; 2] {
        if self == Self::Corners && u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] }
    }

    /// Numbers of the centroid.
    #[must_use]
    pub fn centroid(self) -> [f64; 2] {
        if self == Self::Corners { [1.0 / 3.0; 2] } else { [0.5; 2] }
    }

    /// The child that a point lies in, and the point's numbers there; in units of 2^-32.
    #[inline(always)]
    #[must_use]
    pub fn child(self, [x, y]: [u32; 2]) -> (u32, [u32; 2]) {
        match self {
            Self::Quarters => {
                let (right, upper) = (x >> 31, y >> 31);
                (if upper == 0 { right } else { 3 - right }, [x << 1, y << 1])
            }
            Self::AlongFirst => (x >> 30, [x << 2, y]),
            Self::AlongLast => (y >> 30, [x, y << 2]),
            Self::Corners if x >> 31 == 1 => (1, [x << 1, y << 1]),
            Self::Corners if y >> 31 == 1 => (2, [x << 1, y << 1]),
            Self::Corners if (x + y) >> 31 == 0 => (0, [x << 1, y << 1]),
            Self::Corners => (3, [x << 1, y << 1].map(|twice| 0u32.wrapping_sub(twice))),
        }
    }
}

/// Longest edge that the children of a shape have, m; of a needle's first about so.
#[must_use]
pub fn child_edge_m(shape: &Polygon) -> f64 {
    shape.longest_edge() / if is_sliced(shape) { LONG } else { 2.0 }
}

/// How lines part the children of a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Parting {
    /// Two lines that cross.
    Crossed = 0,
    /// The middle line of four slices, then the first, then the last.
    Slices = 1,
    /// A line before each corner of a triangle.
    Corners = 2,
}

impl Parting {
    /// The child that holds a point, by what lies to the left of which line.
    #[inline]
    #[must_use]
    pub fn child(self, is_left: impl Fn(usize) -> bool) -> u32 {
        match self {
            Self::Crossed => match (is_left(0), is_left(1)) {
                (true, false) => 0,
                (false, false) => 1,
                (false, true) => 2,
                (true, true) => 3,
            },
            Self::Slices if is_left(0) => u32::from(!is_left(1)),
            Self::Slices => 2 + u32::from(!is_left(2)),
            Self::Corners => (0..3).position(is_left).map_or(3, |i| i as u32),
        }
    }
}

/// The lines that part the children of a shape, each from one point to another.
#[must_use]
pub fn parting(shape: &Polygon) -> (Parting, [(DVec3, DVec3); 3]) {
    let c = shape.corners();
    let mid = |i: usize, j: usize| mixed(c[i], c[j], 2);
    let slices = |line: &dyn Fn(u32) -> (DVec3, DVec3)| (Parting::Slices, [line(2), line(1), line(3)]);
    match Cut::of(shape) {
        Cut::Quarters => {
            let (ab, bc, cd, da) = (mid(0, 1), mid(1, 2), mid(2, 3), mid(3, 0));
            (Parting::Crossed, [(ab, cd), (da, bc), (da, bc)])
        }
        Cut::AlongFirst => slices(&|k| (mixed(c[0], c[1], k), mixed(c[3], c[2], k))),
        Cut::AlongSecond => slices(&|k| (mixed(c[1], c[2], k), mixed(c[0], c[3], k))),
        Cut::Needle(base) => {
            let (p, r, tip) = (c[base], c[(base + 1) % 3], c[(base + 2) % 3]);
            slices(&|k| (mixed(r, tip, k), mixed(p, tip, k)))
        }
        Cut::Corners => {
            let (ab, bc, ca) = (mid(0, 1), mid(1, 2), mid(2, 0));
            (Parting::Corners, [(ab, ca), (bc, ab), (ca, bc)])
        }
    }
}

/// The child of `shape` that holds `point`, which lies on it.
#[must_use]
pub fn child_at(shape: &Polygon, point: DVec3) -> u32 {
    let normal = shape.doubled_area_vector();
    let (parting, lines) = parting(shape);
    parting.child(|line| {
        let (from, to) = lines[line];
        normal.cross(to - from).dot(point - from) >= 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn patch(corners: &[[f32; 3]]) -> PatchRecord {
        let mut record = PatchRecord::zeroed();
        for i in 0..4 {
            record.corners_m[i] = corners[i.min(corners.len() - 1)];
        }
        record.corner_count = corners.len() as u8;
        record
    }

    #[test]
    fn children_tile_their_parent_with_its_normal() {
        let quad = patch(&[[0., 0., 0.], [3., 0., 0.], [2., 2., 0.], [0., 1., 0.]]);
        let triangle = patch(&[[0., 0., 1.], [3., 0., 0.], [2., 2., 0.]]);
        let strip = patch(&[[0., 0., 0.], [0.1, 0., 0.], [0.12, 7., 0.], [0., 8., 0.]]);
        let board = patch(&[[0., 0., 0.], [40., 0., 9.], [40., 1., 9.], [0., 1., 0.]]);
        let needle = patch(&[[0., 0., 1.], [3., 0., 1.], [0., 0.1, 1.]]);
        let cap = patch(&[[0., 0., 1.], [3., 0., 1.], [1.4, 0.1, 1.]]);
        for record in [quad, triangle, strip, board, needle, cap] {
            let whole = patch_polygon(&record);
            for path in [1, 4, 0b1_11, 0b1_10_01, 0b1_10_01_11_00] {
                let shape = element_polygon(&record, path);
                let sum: f64 = (0..4).map(|q| child(&shape, q).area()).sum();
                assert!((sum - shape.area()).abs() < 1e-12 * shape.area(), "{path:b}: {sum} {}", shape.area());
                assert!((shape.normal() - whole.normal()).length() < 1e-6);
                for q in 0..4 {
                    let part = child(&shape, q);
                    if let Some(cut) = UnitCut::of(&shape) {
                        let c = shape.corners();
                        let (a, b) = (c[1] - c[0], c[c.len() - 1] - c[0]);
                        let numbers = |p: DVec3| {
                            let (normal, p) = (a.cross(b), p - c[0]);
                            [p.cross(b), a.cross(p)].map(|n| n.dot(normal) / normal.length_squared() * 2f64.powi(32))
                        };
                        let (chosen, [x, y]) = cut.child(numbers(part.centroid()).map(|x| x as u32));
                        assert_eq!(chosen, q, "{path:b} {shape:?}");
                        let middle = if part.corners().len() == 3 { 1.0 / 3.0 } else { 0.5 };
                        assert!([x, y].iter().all(|x| (f64::from(*x) / 2f64.powi(32) - middle).abs() < 1e-6));
                        let back = cut.point(&shape, cut.within(u64::from(q), 1, [middle; 2]));
                        assert!(back.distance(part.centroid()) < 1e-6, "{path:b} {shape:?}");
                    }
                    assert_eq!(child_at(&shape, part.centroid()), q, "{path:b} {shape:?}");
                    assert!((part.normal() - whole.normal()).length() < 1e-6);
                }
            }
        }
    }

    #[test]
    fn long_shapes_take_as_many_elements_as_they_are_long() {
        fn count(shape: &Polygon, smallest_m: f64) -> usize {
            if child_edge_m(shape) < smallest_m {
                return 1;
            }
            (0..4).map(|q| count(&child(shape, q), smallest_m)).sum()
        }
        let strip = patch_polygon(&patch(&[[0., 0., 0.], [5., 0., 0.], [5., 0.01, 0.], [0., 0.01, 0.]]));
        let needle = patch_polygon(&patch(&[[0., 0., 0.], [5., 0., 0.], [0., 0.01, 0.]]));
        let cap = patch_polygon(&patch(&[[0., 0., 0.], [5., 0., 0.], [2.6, 0.01, 0.]]));
        // A cap's slices are slanted: 4,096 if they were none.
        for (shape, most) in [(strip, 64), (needle, 64), (cap, 2000)] {
            let parts = count(&shape, 0.05);
            assert!((16..=most).contains(&parts), "{parts} parts of {shape:?}");
        }
    }
}
