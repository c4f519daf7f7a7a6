//! Claims, leases and publishing, with workers as threads that each open the store.

use std::time::Duration;

use super::fixture::{self, first, settings, solve};
use super::*;
use crate::base::ClusterId;
use crate::model::ExtentKind;
use crate::model::free_group::Held;
use crate::model::order::UpdateOrder;
use crate::model::solve_options::SolveOptions;

fn count(store: &Store, sql: &str) -> u64 {
    store.connection().query_row(sql, [], |r| r.get(0)).unwrap()
}

#[test]
fn racing_workers_open_one_iteration_and_solve_each_group_once() {
    let dir = tempfile::tempdir().unwrap();
    let store = fixture::store(dir.path(), 40);
    fixture::partition(&store, 20);
    let worker = || {
        let store = Store::open(dir.path(), Duration::from_secs(30)).unwrap();
        let mut worker = Worker::start(&store).unwrap();
        let iteration = store.open_iteration(None, &settings(UpdateOrder::Jacobi)).unwrap();
        assert_eq!((iteration.branch, iteration.number), (0, 1));
        let mut solved = Vec::new();
        while let Some(lease) = store.claim(&iteration, &worker, &mut first).unwrap() {
            assert!(solve(&store, &lease, &mut worker, 1.0));
            solved.push(lease.group);
        }
        solved
    };
    let mut all: Vec<u32> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(worker)).collect();
        threads.into_iter().flat_map(|t| t.join().unwrap()).collect()
    });
    all.sort_unstable();
    assert_eq!(all, (0..20).collect::<Vec<_>>());
    assert_eq!(count(&store, "SELECT count(*) FROM tasks WHERE state = 'done' AND attempt = 1"), 20);
}

#[test]
fn a_dead_worker_s_lease_is_void_at_once_and_it_can_publish_no_more() {
    let dir = tempfile::tempdir().unwrap();
    let store = fixture::store(dir.path(), 4);
    fixture::partition(&store, 1);
    let iteration = store.open_iteration(None, &settings(UpdateOrder::Jacobi)).unwrap();
    let dead = Worker::start(&store).unwrap();
    let lost = store.claim(&iteration, &dead, &mut first).unwrap().unwrap();
    let mut living = Worker::start(&store).unwrap();
    assert_eq!(store.claim(&iteration, &living, &mut first).unwrap(), None, "held by a living worker");
    assert!(matches!(store.claim_group(&iteration, &living, 0).unwrap(), GroupClaim::Held { pid: Some(_) }));
    drop(dead);
    let lease = store.claim(&iteration, &living, &mut first).unwrap().unwrap();
    let mut ghost = Worker::start(&store).unwrap();
    assert!(!solve(&store, &lost, &mut ghost, 9.0), "the lease is not its own any more");
    assert_eq!(count(&store, "SELECT count(*) FROM updates"), 0);
    assert!(solve(&store, &lease, &mut living, 1.0));
    assert!(!solve(&store, &lease, &mut living, 2.0), "published twice");
    assert_eq!(count(&store, "SELECT count(*) FROM updates"), 4);
    assert_eq!(store.claim_group(&iteration, &living, 0).unwrap(), GroupClaim::Done);
    assert_eq!(store.claim_group(&iteration, &living, 77).unwrap(), GroupClaim::Unknown);
}

#[test]
fn three_deaths_fail_a_group_until_it_is_forgiven_and_giving_back_is_no_death() {
    let dir = tempfile::tempdir().unwrap();
    let store = fixture::store(dir.path(), 4);
    fixture::partition(&store, 1);
    let iteration = store.open_iteration(None, &settings(UpdateOrder::Jacobi)).unwrap();
    let polite = Worker::start(&store).unwrap();
    let lease = store.claim(&iteration, &polite, &mut first).unwrap().unwrap();
    store.give_back(&lease, &polite).unwrap();
    for _ in 0..3 {
        let worker = Worker::start(&store).unwrap();
        assert!(store.claim(&iteration, &worker, &mut first).unwrap().is_some());
    }
    assert_eq!(store.claim(&iteration, &polite, &mut first).unwrap(), None);
    assert_eq!(store.claim_group(&iteration, &polite, 0).unwrap(), GroupClaim::Failed);
    store.forgive_deaths().unwrap();
    assert!(matches!(store.claim_group(&iteration, &polite, 0).unwrap(), GroupClaim::Granted(_)));
}

#[test]
fn a_worker_is_offered_groups_by_cost_with_what_it_and_others_hold() {
    let dir = tempfile::tempdir().unwrap();
    let store = fixture::store(dir.path(), 6);
    fixture::partition(&store, 3);
    let iteration = store.open_iteration(None, &settings(UpdateOrder::Jacobi)).unwrap();
    let (mut one, mut other) = (Worker::start(&store).unwrap(), Worker::start(&store).unwrap());
    one.holds(&[(ClusterId(0), 0), (ClusterId(3), 0)]).unwrap();
    other.holds(&[(ClusterId(0), 0), (ClusterId(1), 0)]).unwrap();
    let mut seen = Vec::new();
    store
        .claim(&iteration, &one, &mut |offer, held| {
            for free in &offer.free {
                let Held { here, elsewhere } = held(free.group)?;
                seen.push((free.group, here, elsewhere));
            }
            Ok(None)
        })
        .unwrap();
    assert_eq!(seen, [(2, 0.0, 0.0), (1, 0.0, 0.5), (0, 1.0, 0.0)]);
    one.holds(&[(ClusterId(3), 1), (ClusterId(4), 1)]).unwrap();
    let held = "SELECT group_concat(cluster || ':' || version, ' ') FROM residency WHERE worker = 1";
    let held: String = store.connection().query_row(held, [], |r| r.get(0)).unwrap();
    assert_eq!(held, "3:1 4:1", "what it holds no more is gone");
}

#[test]
fn other_settings_or_an_older_version_open_a_branch_that_later_callers_join() {
    let dir = tempfile::tempdir().unwrap();
    let store = fixture::store(dir.path(), 2);
    fixture::partition(&store, 1);
    let usual = settings(UpdateOrder::Jacobi);
    let finer = SolveSettings { options: SolveOptions { tolerance: 0.01, ..usual.options }, ..usual };
    assert_eq!(store.open_iteration(None, &usual).unwrap().branch, 0);
    assert_eq!(store.open_iteration(None, &finer).unwrap().branch, 1);
    assert_eq!(store.open_iteration(None, &finer).unwrap().branch, 1, "joins");
    assert_eq!(store.open_iteration(Some(0), &finer).unwrap().branch, 1, "its base is version 0");
    assert_eq!(store.open_iteration(Some(0), &usual).unwrap().branch, 0, "0 is the newest of its branch");
    assert_eq!(store.open_iteration(Some(9), &usual).err().unwrap().exit_code(), 2);
    assert_eq!(count(&store, "SELECT count(*) FROM tasks"), 2);
}

#[test]
fn solving_needs_a_partition_that_fits_the_visibility() {
    let dir = tempfile::tempdir().unwrap();
    let store = fixture::store(dir.path(), 2);
    assert_eq!(store.open_iteration(None, &settings(UpdateOrder::Jacobi)).err().unwrap().exit_code(), 13);
    fixture::partition(&store, 1);
    let mut visibility = store.stage(Stage::Visibility).unwrap().unwrap();
    visibility.options_hash = "other rays".to_owned();
    store.finish_stage(&visibility).unwrap();
    let error = store.open_iteration(None, &settings(UpdateOrder::Jacobi)).err().unwrap();
    assert!(error.exit_code() == 13 && error.to_string().contains("out of date partition"), "{error}");
}

#[test]
fn bytes_of_a_lost_task_are_garbage_that_goes_when_its_worker_does() {
    let dir = tempfile::tempdir().unwrap();
    let store = fixture::store(dir.path(), 2);
    fixture::partition(&store, 1);
    let mut worker = Worker::start(&store).unwrap();
    worker.segment.append(ExtentKind::Radiosity, 0, &fixture::light(0, 1.0)).unwrap();
    worker.segment.sync().unwrap();
    assert_eq!(store.drop_unreferenced_segments().unwrap(), 0, "a living worker's file stays");
    drop(worker);
    assert!(store.drop_unreferenced_segments().unwrap() > 0);
    assert!(Snapshot::newest(&store).unwrap().need(ExtentKind::Radiosity, ClusterId(1)).is_ok());
}
