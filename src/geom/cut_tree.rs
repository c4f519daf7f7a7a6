//! Which part of a cut face a point lies in.

use glam::DVec3;

use crate::model::cut::CutNode;

/// The axes kept, in order, for a face of that normal: the one along which it is longest is dropped, of equal ones the
/// first.
#[must_use]
pub fn axes_kept(normal: DVec3) -> [usize; 2] {
    let n = normal.abs();
    if n.x >= n.y && n.x >= n.z {
        [1, 2]
    } else if n.y >= n.z {
        [0, 2]
    } else {
        [0, 1]
    }
}

/// The part of a face that a point of its plane lies in, m from the store's origin; 0 where the face has no nodes.
#[must_use]
pub fn part_at(nodes: &[CutNode], axes: [usize; 2], point: DVec3) -> u32 {
    if nodes.is_empty() {
        return 0;
    }
    let (p, q) = (point[axes[0]], point[axes[1]]);
    let mut at = 0;
    loop {
        let CutNode { line: [a, b, c], children } = nodes[at as usize];
        let child = children[usize::from(a * p + b * q + c < 0.0)];
        if child & CutNode::PART != 0 {
            return child & !CutNode::PART;
        }
        at = child;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_axis_of_a_normal_is_dropped_and_of_equal_ones_the_first() {
        assert_eq!(axes_kept(DVec3::NEG_Z), [0, 1]);
        assert_eq!(axes_kept(DVec3::new(0.1, -0.9, 0.2)), [0, 2]);
        assert_eq!(axes_kept(DVec3::ONE), [1, 2]);
        assert_eq!(axes_kept(DVec3::new(0.0, 1.0, -1.0)), [0, 2]);
    }

    #[test]
    fn a_point_falls_down_the_tree_to_its_part_and_one_on_a_line_to_the_first_child() {
        let part = |n: u32| n | CutNode::PART;
        let right = CutNode { line: [1.0, 0.0, -2.0], children: [part(2), 1] };
        let upper = CutNode { line: [0.0, 1.0, -1.0], children: [part(0), part(1)] };
        let at = |x, z| part_at(&[right, upper], [0, 2], DVec3::new(x, 7.0, z));
        assert_eq!([at(3.0, 0.0), at(2.0, 0.0), at(1.0, 1.5), at(1.0, 0.5)], [2, 2, 0, 1]);
        assert_eq!(part_at(&[], [0, 1], DVec3::ZERO), 0);
    }
}
