//! Small rooms cut, and what must hold of any cut face.

use bytemuck::Zeroable;
use glam::{DMat3, DVec3};

use super::super::pieces::{is_lost_in_rounding, is_needle};
use super::*;
use crate::base::Quiet;
use crate::geom::cut_tree::{axes_kept, part_at};
use crate::geom::sequence::{mix, unit};
use crate::geom::split::{area_vector, is_convex};

const RULES: Rules = Rules { contact_m: 0.01, least_m: 0.05, snap_m: 1e-4 };

fn piece(corners: &[DVec3]) -> Piece {
    let mut piece = Piece { corner_count: corners.len() as u32, source_count: 1, ..Piece::zeroed() };
    for (i, corner) in corners.iter().enumerate() {
        piece.corners_m[i..].fill(corner.as_vec3().to_array());
        piece.named[i] = FaceCorner { vertex: i as u32, uv: i as u32, normal: i as u32 };
    }
    piece
}

/// A rectangle from a corner along two edges.
fn quad(from: DVec3, u: DVec3, v: DVec3) -> Piece {
    piece(&[from, from + u, from + u + v, from + v])
}

fn floor(width: f64, depth: f64) -> Piece {
    quad(DVec3::ZERO, DVec3::X * width, DVec3::Y * depth)
}

/// A box by its lowest corner and size, turned about the vertical through its centre.
fn block(from: DVec3, size: DVec3, turn: f64) -> Vec<Piece> {
    let centre = from + size * 0.5;
    let turn = DMat3::from_rotation_z(turn);
    let [x, y, z] = [DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z];
    let sides = [(from, y, x), (from + z, x, y), (from, x, z), (from + y, z, x), (from, z, y), (from + x, y, z)];
    let turned = |p: DVec3| centre + turn * (p - centre);
    sides.into_iter().map(|(a, u, v)| piece(&[a, a + u, a + u + v, a + v].map(turned))).collect()
}

/// An upright prism on a regular foot, without bottom.
fn column(centre: DVec3, radius: f64, facets: u32, height: f64) -> Vec<Piece> {
    let at = |i: u32| {
        let angle = std::f64::consts::TAU * f64::from(i % facets) / f64::from(facets);
        centre + DVec3::new(angle.cos(), angle.sin(), 0.0) * radius
    };
    (0..facets).map(|i| piece(&[at(i), at(i + 1), at(i + 1) + DVec3::Z * height, at(i) + DVec3::Z * height])).collect()
}

/// A face's parts and nodes.
struct Result1 {
    parts: Vec<Part>,
    nodes: Vec<CutNode>,
    seams: Vec<PartSeam>,
}

fn cut_all(pieces: &[Piece], memory_bytes: u64) -> (Vec<Result1>, Tally) {
    let dir = tempfile::tempdir().unwrap();
    let mut file = RecordFile::create(dir.path(), "pieces", 0).unwrap();
    for piece in pieces {
        file.push(*piece).unwrap();
    }
    let mut cuts = cut(&mut file, &RULES, dir.path(), memory_bytes, &Quiet).unwrap();
    let faces = (0..pieces.len() as u64).map(|i| {
        let of = cuts.faces.get(i).unwrap();
        Result1 {
            parts: (0..u64::from(of.parts)).map(|k| cuts.parts.get(of.first_part + k).unwrap()).collect(),
            nodes: (0..u64::from(of.nodes)).map(|k| cuts.nodes.get(of.first_node + k).unwrap()).collect(),
            seams: (0..of.seams).map(|k| cuts.seams.get(of.first_seam + k).unwrap()).collect(),
        }
    });
    (faces.collect(), cuts.tally)
}

/// The first face's.
fn cut_first(pieces: &[Piece]) -> Result1 {
    cut_all(pieces, 1 << 20).0.remove(0)
}

fn corners(part: &Part) -> Vec<DVec3> {
    part.corners_m[..part.corner_count as usize].iter().map(|c| DVec3::from_array(c.map(f64::from))).collect()
}

fn area(part: &Part) -> f64 {
    0.5 * area_vector(&corners(part)).length()
}

/// How far a point is inside a convex polygon with that normal, m.
fn depth(polygon: &[DVec3], normal: DVec3, point: DVec3) -> f64 {
    let n = polygon.len();
    let inside = |i: usize| normal.cross((polygon[(i + 1) % n] - polygon[i]).normalize()).dot(point - polygon[i]);
    (0..n).map(inside).fold(f64::INFINITY, f64::min)
}

/// The area of parts inside a footprint, m2; fails if one is neither inside nor outside.
fn area_inside(result: &Result1, footprint: &[DVec3]) -> f64 {
    let normal = area_vector(footprint).normalize();
    let mut sum = 0.0;
    for part in &result.parts {
        let of = corners(part);
        let middle = of.iter().sum::<DVec3>() / of.len() as f64;
        if depth(footprint, normal, middle) > 0.0 {
            for corner in &of {
                assert!(depth(footprint, normal, *corner) > -1e-5, "{of:?} straddles {footprint:?}");
            }
            sum += area(part);
        } else {
            // None of its points is deep inside either.
            for t in 1..10 {
                for corner in &of {
                    let point = middle.lerp(*corner, f64::from(t) / 10.0);
                    assert!(depth(footprint, normal, point) < 1e-5, "{of:?} straddles {footprint:?}");
                }
            }
        }
    }
    sum
}

#[test]
fn of_a_few_segments_those_are_cut_along_first_that_leave_the_fewest_parts() {
    // Three boxes, each turned another way: 12 segments. Along those that multiply segments least: 14 parts.
    let boxes = (0..3u32).flat_map(|i| {
        let at = DVec3::new(0.4 + 0.7 * f64::from(i), 0.5, 0.0);
        block(at, DVec3::new(0.3, 0.2, 0.5), 0.3 * f64::from(i + 1))
    });
    let pieces: Vec<Piece> = std::iter::once(floor(3.0, 2.0)).chain(boxes).collect();
    let parts = cut_first(&pieces).parts.len();
    assert_eq!(parts, 13);
}

/// What must hold of any face's parts.
fn check(face: &Piece, result: &Result1) {
    let (points, n) = face.points();
    let whole = area_vector(&points[..n]);
    let (normal, size) = (whole.normalize(), points[..n].iter().map(|p| p.abs().max_element()).fold(0.0, f64::max));
    let rounding = 4.0 * size / f64::from(1 << 24);
    let mut sum = 0.0;
    for part in &result.parts {
        let of = corners(part);
        assert!(!is_needle(&of) && !is_lost_in_rounding(&of), "{of:?}");
        assert!(area_vector(&of).dot(normal) > 0.0, "{of:?} winds otherwise");
        let across = of.iter().flat_map(|a| of.iter().map(|b| a.distance(*b))).fold(0.0, f64::max);
        let width = 2.0 * area(part) / across;
        assert!(width > 0.4 * RULES.snap_m, "{of:?} is {width} m wide");
        assert!(of.len() == 3 || is_convex(&of), "{of:?}");
        for (i, corner) in of.iter().enumerate() {
            let k = part.named[i].vertex as usize;
            assert!(part.named[i] == FaceCorner::MADE || (points[k] == *corner && part.named[i] == face.named[k]));
        }
        sum += area(part);
    }
    let whole = 0.5 * whole.length();
    assert!((sum / whole - 1.0).abs() < 1e-5, "{sum} m2 of {whole}");
    let mut used = vec![false; result.parts.len()];
    for child in result.nodes.iter().flat_map(|n| n.children).filter(|c| c & CutNode::PART != 0) {
        used[(child & !CutNode::PART) as usize] = true;
    }
    assert!(used.iter().all(|u| *u) || (result.nodes.is_empty() && used.len() == 1));
    for seam in &result.seams {
        let [[a, b], [c, d]] = ends(result, seam);
        assert!(a.distance(c) < 2e-4 && b.distance(d) < 2e-4 && a.distance(b) > 1e-5, "{a} {b}, {c} {d}");
    }
    for i in 0..2000 {
        let (s, t) = (unit(mix(2 * i)), unit(mix(2 * i + 1)));
        let [s, t] = if n == 3 && s + t > 1.0 { [1.0 - s, 1.0 - t] } else { [s, t] };
        let mut point = points[0] + (points[1] - points[0]) * s + (points[n - 1] - points[0]) * t;
        if n == 4 {
            point += (points[0] - points[1] + points[2] - points[3]) * (s * t);
        }
        let part = part_at(&result.nodes, axes_kept(area_vector(&points[..n])), point);
        let of = corners(&result.parts[part as usize]);
        let off = depth(&of, normal, point);
        assert!(off > -rounding - 0.3 * RULES.snap_m, "{point} is {off} m off part {part}, {of:?}");
    }
}

/// Where a seam begins and ends on the edges of both of its parts.
fn ends(result: &Result1, seam: &PartSeam) -> [[DVec3; 2]; 2] {
    [0, 1].map(|i| {
        let of = corners(&result.parts[seam.parts[i] as usize]);
        let (from, to) = (of[seam.edges[i] as usize], of[(seam.edges[i] as usize + 1) % of.len()]);
        [seam.from[i], seam.to[i]].map(|share| from.lerp(to, f64::from(share)))
    })
}

#[test]
fn seams_are_where_cuts_go_on_beyond_what_stands() {
    let from = DVec3::new(2.0, 1.5, 0.0);
    let walls = block(from, DVec3::new(1.0, 1.0, 1.0), 0.0);
    let result = cut_first(&[&[floor(5.0, 4.0)], &walls[..]].concat());
    let touches = |p: &DVec3| (*p - from - DVec3::new(0.5, 0.5, 0.0)).abs().max_element() < 0.5 - 0.006;
    for seam in &result.seams {
        let [[a, b], _] = ends(&result, seam);
        assert!((0..=10).all(|i| !touches(&a.lerp(b, f64::from(i) / 10.0))), "{a} {b}");
        assert_eq!(seam.sides, 3);
    }
    // From the box to the edges of the floor: two lines across, two from there to the others.
    let open: f64 = result.seams.iter().map(|seam| ends(&result, seam)[0]).map(|[a, b]| a.distance(b)).sum();
    let least = 2.0 * 1.5 + 2.0 * 1.5;
    assert!(open > least - 0.05 && open < least + 2.05, "{open} m");
}

#[test]
fn between_two_walls_within_a_centimetre_no_seam_leads_to_the_other_side() {
    // Two walls that overlap by half a metre, four millimetres apart: neither doubles the other.
    let wall = |from: f64, to: f64, y: f64| quad(DVec3::new(from, y, 0.0), DVec3::X * (to - from), DVec3::Z);
    let result = cut_first(&[floor(5.0, 4.0), wall(0.0, 2.75, 2.0), wall(2.25, 5.0, 2.004)]);
    assert!(result.parts.len() > 2, "{}", result.parts.len());
    for seam in &result.seams {
        let middles = seam.parts.map(|part| {
            let of = corners(&result.parts[part as usize]);
            of.iter().sum::<DVec3>().y / of.len() as f64
        });
        assert!(middles.iter().all(|y| (y - 2.002).abs() > 0.05), "{middles:?}");
    }
}

#[test]
fn under_a_wall_on_a_floor_light_goes_on_below_it() {
    let wall = quad(DVec3::new(1.0, 2.0, 0.0), DVec3::X * 2.0, DVec3::Z);
    let result = cut_first(&[floor(5.0, 4.0), wall]);
    assert_eq!(result.parts.len(), 2);
    let mut sides: Vec<(u32, f64)> = result
        .seams
        .iter()
        .map(|s| (s.sides, ends(&result, s)[0]))
        .map(|(s, [a, b])| (s, (a.distance(b) * 100.0).round()))
        .collect();
    sides.sort_by(|a, b| a.partial_cmp(b).unwrap());
    assert_eq!(sides, [(2, 201.0), (3, 100.0), (3, 199.0)]);
}

#[test]
fn a_box_on_a_floor_gives_the_part_beneath_it_and_few_others() {
    let centre = DVec3::new(2.0, 2.0, 0.0);
    for turn in [0.0, 0.52] {
        for height in [0.0, 0.005, -0.005, -0.4] {
            let size = DVec3::new(0.8, 0.6, 1.0);
            let walls = block(centre - DVec3::new(0.4, 0.3, -height), size, turn);
            let result = cut_first(&[&[floor(5.0, 4.0)], &walls[..]].concat());
            check(&floor(5.0, 4.0), &result);
            let mut foot = walls[1].points().0.to_vec();
            foot.iter_mut().for_each(|p| p.z = 0.0);
            let inside = area_inside(&result, &foot);
            assert!((inside - 0.48).abs() < 1e-6, "{inside} m2 at {turn}, {height}");
            assert!(result.parts.len() <= 7, "{} parts", result.parts.len());
            if turn == 0.0 {
                assert_eq!(result.parts.len(), 5);
            }
        }
    }
}

#[test]
fn what_hovers_higher_than_the_contact_distance_and_what_is_small_cuts_nothing() {
    let hovering = block(DVec3::new(1.0, 1.0, 0.02), DVec3::ONE, 0.3);
    let leg = block(DVec3::new(3.0, 1.0, 0.0), DVec3::new(0.02, 0.02, 0.5), 0.3);
    let below = block(DVec3::new(3.0, 3.0, -1.02), DVec3::ONE, 0.0);
    let result = cut_first(&[vec![floor(5.0, 5.0)], hovering, leg, below].concat());
    assert_eq!((result.parts.len(), result.nodes.len()), (1, 0));
    assert_eq!(result.parts[0].corners_m, floor(5.0, 5.0).corners_m);
}

#[test]
fn a_face_that_nothing_cuts_stays_as_it_is_however_flat_a_corner() {
    let flat = [[0.0, 0.0], [1.0, -0.0006], [2.0, 0.0], [1.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
    let result = cut_first(&[piece(&flat)]);
    assert_eq!((result.parts.len(), result.nodes.len()), (1, 0));
    assert_eq!((result.parts[0].corners_m, result.parts[0].named), (piece(&flat).corners_m, piece(&flat).named));
}

#[test]
fn a_face_that_is_gone_has_no_parts_and_cuts_nothing() {
    let mut wall = quad(DVec3::new(1.0, 1.0, 0.0), DVec3::X, DVec3::Z);
    let pieces = [floor(3.0, 3.0), wall];
    assert_eq!(cut_all(&pieces, 0).0[0].parts.len(), 2);
    wall.gone = 1;
    let (faces, tally) = cut_all(&[floor(3.0, 3.0), wall, floor(1.0, 1.0)], 0);
    assert_eq!(faces[1].parts.len(), 0);
    assert_eq!(tally.faces, 2);
}

#[test]
fn the_foot_of_a_round_column_is_found_to_a_centimetre_in_proportion_to_its_bends() {
    let foot: Vec<DVec3> = column(DVec3::new(1.0, 1.0, 0.0), 0.15, 48, 2.0).iter().map(|p| p.points().0[0]).collect();
    let result = cut_first(&[vec![floor(2.0, 2.0)], column(DVec3::new(1.0, 1.0, 0.0), 0.15, 48, 2.0)].concat());
    check(&floor(2.0, 2.0), &result);
    assert!((10..=24).contains(&result.parts.len()), "{} parts", result.parts.len());
    let inside: f64 =
        result.parts.iter().filter(|p| corners(p).iter().all(|c| depth(&foot, DVec3::Z, *c) > -1e-5)).map(area).sum();
    let whole = 0.5 * area_vector(&foot).length();
    assert!((0.9..=1.0).contains(&(inside / whole)), "{inside} of {whole} m2");
}

#[test]
fn a_curved_wall_of_short_facets_parts_the_floor_from_edge_to_edge() {
    let bend = |i: u32| 0.02 * f64::from(i);
    let at = |i: u32| DVec3::new(bend(i), 1.0 + 0.4 * bend(i).sin(), 0.0);
    let mut pieces = vec![floor(3.0, 3.0)];
    pieces.extend((0..150).map(|i| quad(at(i), at(i + 1) - at(i), DVec3::Z)));
    let result = cut_first(&pieces);
    check(&pieces[0], &result);
    assert!(result.parts.len() < 30, "{} parts", result.parts.len());
    for part in &result.parts {
        let of = corners(part);
        let off = |p: &DVec3| p.y - (1.0 + 0.4 * p.x.sin());
        let (low, high) = of.iter().map(off).fold((0.0, 0.0), |(l, h), x| (f64::min(l, x), f64::max(h, x)));
        assert!(low > -0.012 || high < 0.012, "{of:?} lies on both sides");
    }
}

#[test]
fn a_rug_partly_over_the_edge_outlines_its_part_of_the_floor_and_not_its_own_diagonal() {
    let at = |x, y| DVec3::new(x, y, 0.004);
    let (a, b, c, d) = (at(2.0, 1.0), at(4.0, 1.0), at(4.0, 2.0), at(2.0, 2.0));
    let (faces, tally) = cut_all(&[floor(3.0, 3.0), piece(&[a, b, c]), piece(&[a, c, d])], 0);
    assert_eq!(faces[0].parts.len(), 4);
    let inside = area_inside(&faces[0], &[a, b, c, d].map(|p| DVec3::new(p.x.min(3.0), p.y, 0.0)));
    assert!((inside - 1.0).abs() < 1e-6, "{inside}");
    // Three lines on the floor; the floor's edge crosses both triangles of the rug.
    assert_eq!((tally.crossings, tally.contacts, tally.outlines), (0, 0, 5));
}

#[test]
fn two_walls_that_cross_cut_each_other_and_count_as_crossings() {
    let walls = [
        quad(DVec3::new(0.0, 1.0, 0.0), DVec3::X * 2.0, DVec3::Z),
        quad(DVec3::new(1.0, 0.0, 0.0), DVec3::Y * 2.0, DVec3::Z),
    ];
    let (faces, tally) = cut_all(&walls, 0);
    assert!(faces.iter().all(|f| f.parts.len() == 2));
    assert_eq!((tally.crossings, tally.contacts, tally.outlines), (2, 0, 0));
    assert_eq!((tally.parts, tally.faces), (4, 2));
    assert_eq!(tally.most, Some((walls[0].sources[0], 2)));
}

#[test]
fn walls_along_the_edges_of_a_floor_and_floors_beside_it_cut_nothing() {
    let mut pieces = vec![floor(3.0, 2.0), quad(DVec3::ZERO, DVec3::X * 3.0, DVec3::Z)];
    pieces.push(quad(DVec3::new(0.5, 1.99995, -1.0), DVec3::X, DVec3::Z * 3.0));
    pieces.push(quad(DVec3::new(3.0, 0.5, 0.0), DVec3::X, DVec3::Y));
    pieces.push(quad(DVec3::new(0.0, -1.0, 0.0), DVec3::X * 2.0, DVec3::Y));
    // A fin on a wall is no longer for the wall it stands at.
    pieces.push(quad(DVec3::new(0.5, 1.96, 0.0), DVec3::Y * 0.04, DVec3::Z));
    assert_eq!(cut_all(&pieces, 0).0[0].parts.len(), 1);
}

#[test]
fn of_a_pane_thinner_than_a_centimetre_one_side_parts_the_floor_and_of_a_thicker_one_both() {
    for (thick, parts) in [(0.008, 2), (0.02, 3)] {
        let pane = block(DVec3::new(0.0, 1.0, 0.0), DVec3::new(3.0, thick, 2.0), 0.0);
        assert_eq!(cut_first(&[vec![floor(3.0, 3.0)], pane].concat()).parts.len(), parts);
    }
    // Beyond a single wall just inside the edge light may be another.
    let wall = quad(DVec3::new(0.0, 0.008, 0.0), DVec3::X * 3.0, DVec3::Z);
    assert_eq!(cut_first(&[floor(3.0, 3.0), wall]).parts.len(), 2);
    let closed = quad(DVec3::ZERO, DVec3::X * 3.0, DVec3::Z);
    assert_eq!(cut_first(&[floor(3.0, 3.0), wall, closed]).parts.len(), 1);
}

#[test]
fn a_floor_of_thousands_of_boxes_is_worked_on_by_regions_and_has_parts_in_proportion() {
    for turned in [0.0, 1.0] {
        let mut pieces = vec![floor(100.0, 100.0)];
        for i in 0..2500u64 {
            let at = DVec3::new((i % 50) as f64, (i / 50) as f64, 0.0) * 2.0 + DVec3::new(0.5, 0.5, 0.0);
            let shift = DVec3::new(unit(mix(3 * i)), unit(mix(3 * i + 1)), 0.0) * 0.4 * turned;
            pieces.extend(block(at + shift, DVec3::new(0.6, 0.5, 0.7), turned * unit(mix(3 * i + 2))));
        }
        let result = cut_first(&pieces);
        check(&pieces[0], &result);
        let each = result.parts.len() as f64 / 2500.0;
        assert!(each < 6.0, "{each} parts a box");
        for bottom in pieces[1..].chunks(6).map(|of| of[1]).step_by(50) {
            let (foot, n) = bottom.points();
            let (inside, whole) = (area_inside(&result, &foot[..n]), 0.5 * area_vector(&foot[..n]).length());
            assert!((inside / whole - 1.0).abs() < 1e-3, "{inside} of {whole} m2");
        }
    }
}

#[test]
fn other_orders_and_less_memory_give_the_same() {
    let mut pieces = vec![floor(6.0, 6.0), quad(DVec3::new(0.0, 3.0, 0.0), DVec3::X * 6.0, DVec3::Z * 3.0)];
    for i in 0..40u64 {
        let random = |k| unit(mix(8 * i + k));
        let from = DVec3::new(random(0) * 5.0, random(1) * 5.0, random(2) * 0.02 - 0.01);
        pieces.extend(block(from, DVec3::new(random(3), random(4), random(5)) + 0.05, random(6)));
    }
    let (expected, _) = cut_all(&pieces, 1 << 24);
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by_key(|i| mix(*i as u64));
    let shuffled: Vec<Piece> = order.iter().map(|i| pieces[*i]).collect();
    let (found, _) = cut_all(&shuffled, 0);
    for (new, old) in order.iter().enumerate() {
        assert_eq!(found[new].parts, expected[*old].parts);
        assert_eq!(found[new].nodes, expected[*old].nodes);
        assert_eq!(found[new].seams, expected[*old].seams);
        check(&pieces[*old], &expected[*old]);
    }
    assert!(expected[0].parts.len() > 100);
}

/// Seeds 0 to 59: walls at random, some almost along others, on quads and triangles in any direction.
#[test]
fn parts_of_faces_under_random_walls_tile_them() {
    let mut most = 0;
    for seed in 0..60u64 {
        let random = |k: u64| unit(mix(seed << 20 | k));
        let turn = DMat3::from_rotation_y(3.0 * random(0)) * DMat3::from_rotation_x(3.0 * random(1));
        let shift = DVec3::new(random(2), random(3), random(4)) * 50.0;
        let place = |p: DVec3| turn * p + shift;
        let mut outline = vec![DVec3::ZERO, DVec3::X * 3.0, DVec3::new(3.0 + random(5), 2.0, 0.0), DVec3::Y * 2.5];
        outline.truncate(3 + (seed % 2) as usize);
        let mut pieces = vec![piece(&outline.iter().map(|p| place(*p)).collect::<Vec<_>>())];
        let mut last = [DVec3::ZERO, DVec3::X];
        for i in 0..1 + seed * 2 {
            let k = 10 + 8 * i;
            let mut wall = [0, 2].map(|j| DVec3::new(4.0 * random(k + j) - 0.5, 3.0 * random(k + j + 1) - 0.2, 0.0));
            if i % 3 == 2 {
                wall =
                    last.map(|p| p + DVec3::new(random(k + 4), random(k + 5), 0.0) * 10f64.powf(-5.0 * random(k + 6)));
            }
            last = wall;
            let up = DVec3::Z * (random(k + 7) + 0.1);
            pieces.push(piece(&[wall[0], wall[1], wall[1] + up, wall[0] + up].map(place)));
        }
        let result = cut_first(&pieces);
        check(&pieces[0], &result);
        most = most.max(result.parts.len());
    }
    assert!(most > 100, "{most}");
}
