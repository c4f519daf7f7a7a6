//! A model goes through all stages in one process, and the store that comes out is sound.

mod common;
mod support;

use std::time::Duration;

use clerestory::base::{ClusterId, Quiet};
use clerestory::model::ExtentKind;
use clerestory::model::light::LightView;
use clerestory::model::order::UpdateOrder;
use clerestory::stages::{check, gc, ingest, merge, partition, solve_group, visibility};
use clerestory::store::{Snapshot, Store};

fn ingest_options(dir: &std::path::Path) -> ingest::Options {
    let model = dir.join("rooms.obj");
    common::write_rooms(&model, 2);
    ingest::Options { wait: Duration::from_secs(5), ..support::options(&dir.join("rooms.clr"), &model) }
}

fn solve_options(order: UpdateOrder) -> solve_group::Options {
    let options = solve_group::SolveOptions {
        tolerance: 0.1,
        min_element_m: None,
        inner: solve_group::InnerOption::Converge,
        links: solve_group::LinkStorage::Keep,
        seed: 1,
    };
    solve_group::Options {
        which: solve_group::Which::UntilDone,
        version: None,
        settings: solve_group::SolveSettings { options, order },
        link_cache_bytes: 32 << 20,
        schedule: clerestory::partition::schedule::Policy::FfdWs { delta: 16 },
        memory: support::MEMORY,
    }
}

#[test]
fn a_store_that_was_solved_is_sound_and_stays_so_after_gc() {
    let dir = tempfile::tempdir().unwrap();
    let options = ingest_options(dir.path());
    ingest::execute(ingest::plan(&options).unwrap(), &Quiet).unwrap();
    let store = Store::open(&options.store, options.wait).unwrap();
    let looking = visibility::Options { missing: 0.01, seed: 1, workers: 1, memory: support::MEMORY };
    visibility::execute(&visibility::plan(&store, &looking).unwrap(), &Quiet).unwrap();
    let grouping = partition::Options { method: None, groups: Some(2), memory: support::MEMORY };
    partition::execute(&partition::plan(&store, &grouping).unwrap(), &Quiet).unwrap();
    let solving = solve_options(UpdateOrder::Jacobi);
    let mut last = merge::Summary::default();
    for _ in 0..40 {
        let plan = solve_group::plan(&store, &solving).unwrap();
        solve_group::execute(&plan, &solve_group::Resources::default, &Quiet).unwrap();
        last = merge::execute(&store, merge::plan(&store).unwrap(), &Quiet).unwrap();
        if last.converged {
            break;
        }
    }
    assert!(last.converged, "{last:?}");
    let balance = last.figures.unwrap().energy_balance;
    assert!(balance < 0.01, "sealed rooms keep their light: {balance}");
    let sound = || {
        let summary = check::execute(&store, &Quiet).unwrap();
        assert_eq!(summary.damages, []);
        summary.bytes_verified
    };
    let before = sound();
    let removed = gc::execute(&store, 1, &Quiet).unwrap();
    assert!(removed.versions_removed > 0);
    assert!(sound() < before);
    let newest = Snapshot::newest(&store).unwrap();
    let light = newest.need(ExtentKind::Radiosity, ClusterId(0)).unwrap();
    assert!(!light.parse(LightView::parse).unwrap().elements.is_empty());
}
