//! Gates: what stored rows must keep to in closed scenes. Rays that a row lost, met twice or counted wrongly would not
//! show in the light of a room that all looks alike.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use super::solved::{Solved, Wrong, data, solve_to};
use clerestory::base::{ClusterId, NodeName};
use clerestory::geom::polygon::Polygon;
use clerestory::geom::quadtree;
use clerestory::model::ExtentKind;
use clerestory::model::geometry::{GeometryView, PatchRecord};
use clerestory::model::links::{LinksView, for_each_row};
use clerestory::stages::link_extent::ChainRows;
use clerestory::store::{Snapshot, Store};
use clerestory::transport::kernel::form_factor::point_to_polygon;
use clerestory::transport::row::{Found, Hit, Kept, Part, Row, Share};
use glam::DVec3;

/// A solved scene of `data/`. Rows must be right whether or not the light that they bring balances.
fn solve(model: &str) -> Solved {
    solve_to(&[0, 3], &data(&format!("{model}.obj")), None, &[])
}

/// Patches and rows of the newest version.
struct Rows {
    title: String,
    patches: BTreeMap<ClusterId, Vec<PatchRecord>>,
    rows: Vec<Row>,
}

fn side_of(name: NodeName) -> NodeName {
    NodeName::root(name.cluster(), name.patch_side())
}

impl Rows {
    fn of(solved: &Solved) -> Self {
        let store = Store::open(&solved.store(), Duration::from_secs(10)).unwrap();
        let snapshot = Snapshot::newest(&store).unwrap();
        let mut all = Self { title: solved.title.clone(), patches: BTreeMap::new(), rows: Vec::new() };
        for cluster in snapshot.clusters() {
            let id = cluster.unwrap().id;
            let geometry = snapshot.need(ExtentKind::Geometry, id).unwrap();
            all.patches.insert(id, geometry.parse(GeometryView::parse).unwrap().patches.to_vec());
            let extents = snapshot.links(id).unwrap();
            let views: Vec<LinksView<'_>> = extents.iter().map(|e| e.parse(LinksView::parse).unwrap()).collect();
            let rows = ChainRows::of(&views);
            all.rows.extend((0..rows.keys().len()).map(|number| rows.row(number)));
        }
        assert!(all.rows.len() > 20, "{}: {} rows", all.title, all.rows.len());
        all
    }

    fn shape(&self, element: NodeName) -> Polygon {
        let patch = &self.patches[&element.cluster()][usize::from(element.patch_side().patch)];
        quadtree::element_polygon(patch, element.path())
    }

    fn normal(&self, element: NodeName) -> DVec3 {
        let front = self.shape(element).normal();
        if element.patch_side().side == 0 { front } else { -front }
    }

    fn area_m2(&self, element: NodeName) -> f64 {
        self.shape(element).area()
    }

    /// Indirect rows with what their rays met.
    fn indirect(&self) -> impl Iterator<Item = (&Row, &[Hit])> {
        self.rows.iter().filter_map(|row| match &row.found {
            Found::Hits(hits) => Some((row, hits.as_slice())),
            Found::Shares(_) => None,
        })
    }

    /// Direct rows with the lamps that their rays reached.
    fn direct(&self) -> impl Iterator<Item = (&Row, &[Share])> {
        self.rows.iter().filter_map(|row| match &row.found {
            Found::Shares(shares) => Some((row, shares.as_slice())),
            Found::Hits(_) => None,
        })
    }

    /// Form factor between two sides if nothing lies between, averaged over the first: at 64 x 64 places, within 1e-4
    /// for sides that meet at an edge.
    fn unoccluded(&self, receiver: NodeName, source: NodeName) -> f64 {
        let (shape, normal, seen) = (self.shape(receiver), self.normal(receiver), self.shape(source));
        let each = each_place(64).map(|[u, v]| facing(&shape, normal, (&seen, self.normal(source)), u, v));
        each.sum::<f64>() / 4096.0
    }
}

/// The middles of a grid's cells.
fn each_place(n: u32) -> impl Iterator<Item = [f64; 2]> {
    let middle = move |i: u32| (f64::from(i) + 0.5) / f64::from(n);
    (0..n * n).map(move |i| [middle(i % n), middle(i / n)])
}

/// Form factor from a place of a shape to a side; 0 from behind it.
fn facing(shape: &Polygon, normal: DVec3, (seen, front): (&Polygon, DVec3), u: f64, v: f64) -> f64 {
    let place = shape.even_point(u, v);
    if front.dot(place - seen.corners()[0]) <= 0.0 { 0.0 } else { point_to_polygon(place, normal, seen) }
}

/// A sum and the square of its standard error.
#[derive(Clone, Copy, Default)]
struct Measured {
    sum: f64,
    variance: f64,
}

/// Standard errors that a number may be off by: of a few hundred, one in 16,000 is further off.
const ERRORS: f64 = 4.0;

const CLOSED: [&str; 5] = ["closed_cube", "corridor", "mean_value_cube", "two_zone", "leak_abutting"];

/// A row whose rays start within a room loses none of them, and one that looks out of the model loses all.
#[test]
fn no_ray_gets_out_of_a_closed_scene_or_into_it() {
    for model in CLOSED {
        let (all, mut within) = (Rows::of(&solve(model)), 0);
        for (row, hits) in all.indirect().filter(|(_, hits)| !hits.is_empty()) {
            let gone = hits.iter().filter(|hit| hit.side == NodeName::ESCAPE).count();
            assert!(gone == 0 || gone == hits.len(), "{model}: {:?} lost {gone} of {} rays", row.element, hits.len());
            within += usize::from(gone == 0);
        }
        assert!(within >= 6, "{model}: {within} rows within");
    }
}

/// Rows of either part lie side by side over all of a side, each with what its rays must leave.
#[test]
fn rows_cover_each_side_once_and_hold_what_their_rays_found() {
    for model in CLOSED {
        let all = Rows::of(&solve(model));
        let mut covered: BTreeMap<(NodeName, Part), f64> = BTreeMap::new();
        for row in &all.rows {
            *covered.entry((side_of(row.element), row.part)).or_default() += all.area_m2(row.element);
        }
        for ((side, part), area) in covered {
            let whole = all.area_m2(side);
            assert!(
                (area - whole).abs() < 1e-6 * whole,
                "{model}: {part:?} rows of {side:?} cover {area} of {whole} m2"
            );
        }
        for (row, hits) in all.indirect() {
            let rays = 2 * usize::from(row.rounds) * row.open.count_ones() as usize;
            assert_eq!(hits.len(), rays, "{model}: {:?}", row.element);
        }
        for (row, shares) in all.direct() {
            let mut rays = [0; 32];
            for share in shares {
                rays[usize::from(share.slot)] += 1;
                assert!(
                    row.open >> (share.slot / 2) & 1 == 1,
                    "{model}: {:?}, a ray from a covered place",
                    row.element
                );
            }
            let most = rays.into_iter().max().unwrap();
            assert!(most <= row.rounds, "{model}: {:?}, {most} of {} rays from one place", row.element, row.rounds);
        }
    }
}

/// A delta's rows that are no more are not read.
#[test]
fn rows_that_were_split_are_gone() {
    let solved = solve("closed_cube");
    let store = Store::open(&solved.store(), Duration::from_secs(10)).unwrap();
    let snapshot = Snapshot::newest(&store).unwrap();
    let mut gone = 0;
    for cluster in snapshot.clusters() {
        let extents = snapshot.links(cluster.unwrap().id).unwrap();
        let views: Vec<LinksView<'_>> = extents.iter().map(|e| e.parse(LinksView::parse).unwrap()).collect();
        gone += views.iter().flat_map(|v| v.rows).filter(|row| row.rounds == 0).count();
        for_each_row(&views, |_, row| assert!(row.rounds > 0, "{:?}", NodeName(row.element)));
    }
    assert!(gone > 0, "no chain deletes a row: nothing was tested");
}

/// What a lamp's shares add up to over a side, as an exchange area, with its standard error: from what the two halves
/// of each place differ by, and from where in its cell a place lies.
fn shares_of(all: &Rows, side: NodeName, lamp: NodeName) -> (Measured, f64) {
    let (mut got, mut expected) = (Measured::default(), 0.0);
    let seen = all.shape(lamp);
    for (row, shares) in all.direct().filter(|(row, _)| side_of(row.element) == side && row.open == u16::MAX) {
        let (shape, normal, area) = (all.shape(row.element), all.normal(row.element), all.area_m2(row.element));
        let mut halves = [[0.0; 2]; 16];
        for share in shares.iter().filter(|share| share.lamp == lamp) {
            halves[usize::from(share.slot / 2)][usize::from(share.slot % 2)] +=
                f64::from(share.factor) / f64::from(row.rounds);
        }
        let (mut exact, mut variance) = (0.0, 0.0);
        for (place, [a, b]) in halves.into_iter().enumerate() {
            got.sum += area * (a + b) / 32.0;
            let within: Vec<f64> = each_place(8)
                .map(|[u, v]| {
                    let (u, v) = (((place % 4) as f64 + u) / 4.0, ((place / 4) as f64 + v) / 4.0);
                    facing(&shape, normal, (&seen, all.normal(lamp)), u, v)
                })
                .collect();
            let mean = within.iter().sum::<f64>() / 64.0;
            let jitter = within.iter().map(|f| (f - mean) * (f - mean)).sum::<f64>() / 64.0;
            exact += mean / 16.0;
            variance += (jitter + (a - b) * (a - b) / 4.0) / 256.0;
        }
        expected += area * exact;
        got.variance += area * area * variance;
    }
    (got, expected)
}

#[test]
fn shares_of_lamps_in_plain_sight_add_up_to_the_closed_form() {
    let mut wrong = Wrong::default();
    for model in ["closed_cube", "mean_value_cube", "cie_5_3"] {
        let all = Rows::of(&solve(model));
        let sides: BTreeSet<NodeName> = all.direct().map(|(row, _)| side_of(row.element)).collect();
        let lamps: BTreeSet<NodeName> =
            all.direct().flat_map(|(_, shares)| shares.iter().map(|share| share.lamp)).collect();
        let mut compared = 0;
        for &side in &sides {
            for &lamp in &lamps {
                let (got, expected) = shares_of(&all, side, lamp);
                // Sides that look out of the model see lamps only through walls.
                if got.sum == 0.0 || expected < 1e-3 * all.area_m2(side) {
                    continue;
                }
                compared += 1;
                let (error, limit) = ((got.sum - expected).abs(), ERRORS * got.variance.sqrt() + 1e-4 * expected);
                wrong.at_most(error, limit, || {
                    format!("{model}: {side:?} has {} m2 of {lamp:?} for {expected}, may differ by {limit}", got.sum)
                });
                wrong.at_most(limit, 0.5 * expected, || format!("{model}: {side:?}, {lamp:?}: {limit} of {expected}"));
            }
        }
        assert!(compared >= 5 || model == "cie_5_3", "{model}: {compared} pairs");
        assert!(compared > 0, "{model}: nothing was compared");
    }
    wrong.assert_none();
}

/// Area times the share of a side's rays that meet another, m2, by pair.
fn exchanges(all: &Rows) -> BTreeMap<(NodeName, NodeName), Measured> {
    let mut exchange: BTreeMap<(NodeName, NodeName), Measured> = BTreeMap::new();
    let mut sources: BTreeMap<NodeName, BTreeSet<NodeName>> = BTreeMap::new();
    for (row, hits) in all.indirect() {
        sources.entry(side_of(row.element)).or_default().extend(hits.iter().map(|hit| hit.side));
    }
    for (row, hits) in all.indirect().filter(|(_, hits)| !hits.is_empty()) {
        let (area, rays) = (all.area_m2(row.element), hits.len() as f64);
        let mut counts: BTreeMap<NodeName, f64> = BTreeMap::new();
        for hit in hits {
            *counts.entry(hit.side).or_default() += 1.0;
        }
        for source in &sources[&side_of(row.element)] {
            let met = counts.get(source).copied().unwrap_or(0.0);
            // As for one ray more of either kind: a row whose rays all met the same knows its share no better.
            let share = (met + 1.0) / (rays + 2.0);
            let pair = exchange.entry((side_of(row.element), *source)).or_default();
            pair.sum += area * met / rays;
            pair.variance += area * area * share * (1.0 - share) / rays;
        }
    }
    exchange
}

/// What a side sends another comes back from it, as far as their rays can tell.
#[test]
fn sides_exchange_the_same_both_ways_within_what_their_rays_can_tell() {
    let mut wrong = Wrong::default();
    for model in CLOSED {
        let exchange = exchanges(&Rows::of(&solve(model)));
        let mut both_ways = 0;
        for ((receiver, source), out) in exchange.iter().filter(|((receiver, source), _)| receiver < source) {
            let Some(home) = exchange.get(&(*source, *receiver)) else { continue };
            both_ways += 1;
            let limit = ERRORS * (out.variance + home.variance).sqrt();
            wrong.at_most((out.sum - home.sum).abs(), limit, || {
                let (out, home) = (out.sum, home.sum);
                format!("{model}: {receiver:?} and {source:?} exchange {out} and {home} m2, may differ by {limit}")
            });
        }
        assert!(both_ways >= 10, "{model}: {both_ways} pairs of sides that see each other");
    }
    wrong.assert_none();
}

/// A convex room, where nothing lies between any two sides.
#[test]
fn sides_of_a_cube_see_of_each_other_what_the_closed_form_says() {
    let all = Rows::of(&solve("closed_cube"));
    let (exchange, mut wrong, mut compared) = (exchanges(&all), Wrong::default(), 0);
    for ((receiver, source), got) in exchange.iter().filter(|((_, source), _)| *source != NodeName::ESCAPE) {
        compared += 1;
        let expected = all.area_m2(*receiver) * all.unoccluded(*receiver, *source);
        let limit = ERRORS * got.variance.sqrt();
        wrong.at_most((got.sum - expected).abs(), limit, || {
            format!("{receiver:?} sees {} m2 of {source:?} for {expected}, may differ by {limit}", got.sum)
        });
    }
    assert_eq!(compared, 30, "six sides see five each");
    wrong.assert_none();
}
