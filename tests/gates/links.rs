//! Gates: what stored form factors must keep to in closed scenes.

use std::collections::BTreeMap;
use std::time::Duration;

use super::solved::{Solved, Wrong, solve};
use clerestory::base::{ClusterId, NodeName};
use clerestory::geom::polygon::Polygon;
use clerestory::geom::quadtree;
use clerestory::model::ExtentKind;
use clerestory::model::geometry::{GeometryView, PatchRecord};
use clerestory::model::links::{LinksView, Visibility};
use clerestory::store::{Snapshot, Store};
use clerestory::transport::form_factor;
use clerestory::transport::link_rows::{self, Link};

/// A leaf's share of its patch's area and the sum of its form factors before closing.
type Sum = (f64, f64);

/// Patches, links by receiver and source, and row sums by patch side, of the newest version.
struct Links {
    patches: BTreeMap<ClusterId, Vec<PatchRecord>>,
    links: BTreeMap<(NodeName, NodeName), Link>,
    sums: BTreeMap<NodeName, Vec<Sum>>,
}

fn root(name: NodeName) -> NodeName {
    NodeName::root(name.cluster(), name.patch_side())
}

impl Links {
    fn of(solved: &Solved) -> Self {
        let store = Store::open(&solved.store(), Duration::from_secs(10)).unwrap();
        let snapshot = Snapshot::newest(&store).unwrap();
        let mut all = Self { patches: BTreeMap::new(), links: BTreeMap::new(), sums: BTreeMap::new() };
        for cluster in snapshot.clusters() {
            let id = cluster.unwrap().id;
            let geometry = snapshot.need(ExtentKind::Geometry, id).unwrap();
            all.patches.insert(id, geometry.parse(GeometryView::parse).unwrap().patches.to_vec());
            let extents = snapshot.links(id).unwrap();
            let views: Vec<LinksView<'_>> = extents.iter().map(|e| e.parse(LinksView::parse).unwrap()).collect();
            link_rows::for_each_row(&views, |receiver, view, row| {
                for link in row.map(|at| link_rows::link_at(view, at)) {
                    all.links.insert((receiver, link.source), link);
                }
            });
            for row in views.last().map_or(&[][..], |v| v.closure) {
                let leaf = NodeName(row.leaf);
                let share = 0.25f64.powi(leaf.depth() as i32);
                let mut sum = f64::from(row.measured_escape);
                let mut at = Some(leaf);
                while let Some(receiver) = at {
                    let of_receiver = (receiver, NodeName(0))..=(receiver, NodeName(u64::MAX));
                    sum += all.links.range(of_receiver).map(|(_, link)| f64::from(link.form_factor)).sum::<f64>();
                    at = receiver.parent();
                }
                all.sums.entry(root(leaf)).or_default().push((share, sum));
            }
        }
        assert!(all.links.len() > 1000, "{}: {} links", solved.title, all.links.len());
        all
    }

    fn shape(&self, element: NodeName) -> Polygon {
        let patch = &self.patches[&element.cluster()][usize::from(element.patch_side().patch)];
        quadtree::element_polygon(patch, element.path())
    }

    fn area_m2(&self, element: NodeName) -> f64 {
        self.shape(element).area()
    }

    /// What a receiver would see of a source if nothing lay between, within 1e-6.
    fn unoccluded(&self, receiver: NodeName, source: NodeName) -> f64 {
        let sided = |name: NodeName| {
            let shape = self.shape(name);
            let front = shape.normal();
            (shape, if name.patch_side().side == 0 { front } else { -front })
        };
        let ((r, r_normal), (s, s_normal)) = (sided(receiver), sided(source));
        form_factor::average(&r, r_normal, &s, s_normal, 1e-6).mean
    }
}

/// What a link's form factor may be off by: three standard errors of its sampled share, and 2e-4, the
/// coarsest tolerance of its unoccluded factor.
fn bound(link: &Link) -> f64 {
    3.0 * f64::from(link.uncertainty) + 2e-4
}

/// Expects row sums, before closing, of 1: within `limit` on average, 1e-2 for every patch, and never above 1 + `over`.
/// A patch's sum is the mean over its leaves.
fn expect_rows_of_one(models: &[&str], limit: f64, over: f64) {
    let mut wrong = Wrong::default();
    for model in models {
        let sums: Vec<f64> = Links::of(&solve(model, &[]))
            .sums
            .values()
            .map(|leaves| {
                let area: f64 = leaves.iter().map(|l| l.0).sum();
                leaves.iter().map(|(share, sum)| share * sum).sum::<f64>() / area
            })
            .collect();
        let average = sums.iter().map(|s| (s - 1.0).abs()).sum::<f64>() / sums.len() as f64;
        let furthest = sums.iter().map(|s| (s - 1.0).abs()).fold(0.0, f64::max);
        let largest = sums.iter().copied().fold(0.0, f64::max);
        wrong.at_most(average, limit, || format!("{model}: off by {average} on average"));
        wrong.at_most(furthest, 1e-2, || format!("{model}: off by up to {furthest}"));
        wrong.at_most(largest - 1.0, over, || format!("{model}: up to {largest}"));
    }
    wrong.assert_none();
}

#[test]
fn the_rows_of_closed_scenes_sum_to_one_before_they_are_closed() {
    expect_rows_of_one(&["closed_cube", "corridor", "mean_value_cube"], 1e-3, 1e-3);
}

/// Visibility past walls is sampled: rows are off by up to twice as much, those of small parts of a face by more, until
/// they are closed.
#[test]
fn rows_past_walls_sum_to_one_before_they_are_closed() {
    expect_rows_of_one(&["two_zone", "leak_abutting"], 2e-3, 1e-2);
}

/// F <= min(1, A_source / A_receiver), each link by no more than its own bounds; and where two elements
/// are linked both ways, they exchange the same.
#[test]
fn form_factors_are_bounded_by_areas_and_reciprocal_within_their_own_bounds() {
    let mut wrong = Wrong::default();
    for model in ["closed_cube", "two_zone", "leak_abutting"] {
        let all = Links::of(&solve(model, &[]));
        let mut both_ways = 0;
        for ((receiver, source), link) in &all.links {
            let (here, there) = (all.area_m2(*receiver), all.area_m2(*source));
            let factor = f64::from(link.form_factor);
            let most = (there / here).min(1.0);
            wrong.at_most(factor, most + bound(link), || {
                format!("{model}: {receiver:?} sees {factor} of {source:?}, at most {most}")
            });
            if let Some(back) = all.links.get(&(*source, *receiver)) {
                both_ways += 1;
                let (out, home) = (here * factor, there * f64::from(back.form_factor));
                let limit = here * bound(link) + there * bound(back);
                wrong.at_most((out - home).abs(), limit, || {
                    format!("{model}: {receiver:?} and {source:?} exchange {out} and {home} m2, may differ by {limit}")
                });
            }
        }
        assert!(both_ways > 100, "{model}: {both_ways} links both ways");
    }
    wrong.assert_none();
}

/// Links proved visible have the closed form's factor, links proved hidden have none, and none has more
/// than if nothing lay between.
#[test]
fn form_factors_are_those_of_the_closed_form_or_less_where_something_lies_between() {
    let mut wrong = Wrong::default();
    for model in ["closed_cube", "mean_value_cube", "leak_abutting"] {
        let all = Links::of(&solve(model, &[]));
        for ((receiver, source), link) in &all.links {
            let (factor, open) = (f64::from(link.form_factor), all.unoccluded(*receiver, *source));
            let excess = match link.class {
                Visibility::Visible => (factor - open).abs(),
                Visibility::Hidden => factor,
                Visibility::Partial => (factor - open).max(0.0),
                Visibility::Surveyed => (factor - open - 4.0 * f64::from(link.uncertainty)).max(0.0),
            };
            // A sampled share is at most 1, so the noise of rays excuses no excess.
            wrong.at_most(excess, 2e-4, || {
                format!(
                    "{model}: {receiver:?} sees {factor} of {source:?}, {:?}; {open} if nothing lies between",
                    link.class
                )
            });
        }
    }
    wrong.assert_none();
}
