//! Schedules that one can work out on paper.

use super::*;
use crate::recording::tests::recording;

const FREE: Costs = Costs { bandwidth: None, latency_s: 0.0 };
const MASTERS: [Master; 2] = [Master::Sync, Master::Async];
const POLICIES: [Policy; 4] = [Policy::Ffd, Policy::Ws, Policy::FfdWs { delta: 1 }, Policy::FfdWs { delta: 3 }];

fn settings(policy: Policy, master: Master, costs: Costs) -> Settings {
    Settings { policy, master, costs, merge_s: 0.0 }
}

#[test]
fn equal_tasks_speed_up_by_the_workers_while_there_are_groups() {
    let twelve = recording(&[&[1.0; 12], &[2.0; 12]]);
    for (policy, master) in POLICIES.into_iter().flat_map(|p| MASTERS.map(|m| (p, m))) {
        let row = |workers| replay(&twelve, settings(policy, master, FREE), workers).row();
        for workers in [1, 2, 3, 4, 6, 12] {
            let row = row(workers);
            assert_eq!(row.speedup, workers as f64, "{policy:?} {master:?}");
            assert_eq!((row.end_idle_share, row.next_bottleneck), (0.0, "none"), "{policy:?} {master:?}");
        }
        let five = row(5);
        assert_eq!((five.makespan_s, five.next_bottleneck), (9.0, "end-of-iteration idle"), "three rounds");
        assert_eq!(five.end_idle_share, 9.0 / 45.0);
        let many = row(1024);
        assert_eq!((many.speedup, many.next_bottleneck), (12.0, "longest group"));
    }
}

#[test]
fn one_long_group_bounds_the_makespan_if_it_comes_first() {
    let one_long = recording(&[&[1.0, 1.0, 10.0, 1.0, 1.0]]);
    for workers in [2, 3, 8] {
        let row = replay(&one_long, settings(Policy::Ffd, Master::Async, FREE), workers).row();
        assert_eq!((row.makespan_s, row.next_bottleneck), (10.0, "longest group"), "{workers} workers");
    }
    let mut misjudged = recording(&[&[1.0, 1.0, 10.0, 1.0, 1.0]]);
    misjudged.groups[2].cost = 0.0;
    let row = replay(&misjudged, settings(Policy::Ffd, Master::Async, FREE), 2).row();
    assert_eq!(row.makespan_s, 12.0, "its cost was foretold wrongly");
}

#[test]
fn moving_data_takes_no_time_where_bandwidth_and_latency_cost_nothing() {
    let run = recording(&[&[4.0, 3.0, 2.0, 1.0], &[1.0, 2.0, 3.0, 4.0]]);
    for master in MASTERS {
        let outcome = replay(&run, settings(Policy::Ffd, master, FREE), 2);
        assert!(outcome.download_bytes > 0 && outcome.upload_bytes == 8 * 20);
        assert_eq!((outcome.moving_s, outcome.latency_s, outcome.waiting_s), (0.0, 0.0, 0.0));
        // 5 s, and 6 s in the order of the first visits: 1 and 3 beside 2 and 4.
        assert_eq!((outcome.makespan_s, outcome.master_busy_s), (11.0, 0.0));
    }
}

#[test]
fn one_worker_downloads_geometry_once_and_light_once_an_iteration() {
    let run = recording(&[&[1.0; 4], &[1.0; 4], &[1.0; 4]]);
    let costs = Costs { bandwidth: Some(16), latency_s: 0.25 };
    let outcome = replay(&run, settings(Policy::Ffd, Master::Sync, costs), 1);
    // The only worker made all light and links but the first.
    assert_eq!(outcome.download_bytes, 4 * (100 + 10 + 1));
    assert_eq!(outcome.upload_bytes, 3 * 4 * 20);
    let moving_s = f64::from(4 * 111 + 12 * 20) / 16.0;
    // Twelve uploads, and a download for each first visit.
    assert_eq!((outcome.moving_s, outcome.latency_s), (moving_s, 16.0 * 0.25));
    assert_eq!(outcome.master_busy_s, moving_s + 4.0, "a synchronous master does it all");
    assert_eq!(outcome.makespan_s, 12.0 + outcome.master_busy_s);
}

#[test]
fn a_synchronous_master_s_time_adds_up_and_bounds_the_makespan() {
    let nothing_to_solve = recording(&[&[0.0; 6], &[0.0; 6]]);
    let costs = Costs { bandwidth: Some(16), latency_s: 0.0 };
    for workers in [1, 2, 3, 6, 64] {
        let outcome = replay(&nothing_to_solve, settings(Policy::Ws, Master::Sync, costs), workers);
        let bytes = outcome.download_bytes + outcome.upload_bytes;
        assert_eq!(outcome.makespan_s, bytes as f64 / 16.0, "{workers} workers: one transfer after the other");
        assert_eq!(outcome.row().master_busy_share, 1.0);
    }
}

/// Times of `count` tasks, s, that follow no rule.
fn odd_times(count: u32, seed: u32) -> Vec<f64> {
    (0..count).map(|i| f64::from((i + seed).wrapping_mul(2_654_435_761) >> 20) / 256.0).collect()
}

#[test]
fn every_second_of_every_worker_is_accounted_for() {
    let (first, second) = (odd_times(40, 1), odd_times(40, 2));
    let mut run = recording(&[&first, &second, &first]);
    run.iterations[1].replaces = true;
    let costs = Costs { bandwidth: Some(64), latency_s: 0.125 };
    for (policy, master) in POLICIES.into_iter().flat_map(|p| MASTERS.map(|m| (p, m))) {
        for workers in [1, 2, 7, 39, 100] {
            let settings = Settings { merge_s: 2.0, ..settings(policy, master, costs) };
            let o = replay(&run, settings, workers);
            let sum = o.work_s + o.latency_s + o.moving_s + o.waiting_s + o.end_idle_s + o.merge_s * workers as f64;
            let all = o.makespan_s * workers as f64;
            assert!((sum - all).abs() < 1e-9 * all, "{policy:?} {master:?} {workers}: {sum} of {all} s");
            assert!(o.master_busy_s <= o.makespan_s && o.longest_idle_s <= o.end_idle_s, "{o:?}");
        }
    }
}

/// Who does what when says the same as the sums.
#[test]
fn visits_of_a_worker_follow_each_other_and_add_up_to_the_totals() {
    let (first, second) = (odd_times(40, 1), odd_times(40, 2));
    let mut run = recording(&[&first, &second, &first]);
    run.iterations[1].replaces = true;
    let slow = Costs { bandwidth: Some(64), latency_s: 0.125 };
    let ways = POLICIES.into_iter().flat_map(|p| MASTERS.map(|m| (p, m))).flat_map(|way| [(way, FREE), (way, slow)]);
    for (((policy, master), costs), workers) in ways.flat_map(|way| [1, 2, 7, 100].map(|workers| (way, workers))) {
        let settings = settings(policy, master, costs);
        let (visits, o) = (timeline(&run, settings, workers), replay(&run, settings, workers));
        let mut free_s = vec![0.0; workers];
        for visit in &visits {
            assert!(free_s[visit.worker] <= visit.download_begin_s, "{visit:?} after {}", free_s[visit.worker]);
            assert!(visit.download_begin_s <= visit.begin_s && visit.begin_s <= visit.end_s, "{visit:?}");
            free_s[visit.worker] = visit.end_s;
        }
        let last_s = free_s.into_iter().fold(0.0, f64::max);
        // Uploads come after.
        let is_end = if costs.bandwidth.is_none() { last_s == o.makespan_s } else { last_s < o.makespan_s };
        assert!(is_end, "{policy:?} {master:?} {workers}: {last_s} of {} s", o.makespan_s);
        let work_s: f64 = visits.iter().map(|visit| visit.end_s - visit.begin_s).sum();
        assert!((work_s - o.work_s).abs() < 1e-9 * o.work_s, "rounding alone: {work_s} of {} s", o.work_s);
        assert_eq!(visits.iter().map(|visit| visit.download_bytes).sum::<u64>(), o.download_bytes);
        assert_eq!(visits.iter().map(|visit| visit.upload_bytes).sum::<u64>(), o.upload_bytes);
        let mut solved: Vec<_> = visits.iter().map(|visit| (visit.iteration, visit.group)).collect();
        solved.sort_unstable();
        assert!(solved.into_iter().eq((1..4).flat_map(|i| (0..40).map(move |group| (i, group)))), "each once");
    }
}

#[test]
fn results_do_not_depend_on_the_order_of_groups_and_tasks() {
    let times = odd_times(30, 3);
    let run = recording(&[&times, &times]);
    let mut groups = run.groups.clone();
    groups.reverse();
    let mut iterations = run.iterations.clone();
    for iteration in &mut iterations {
        iteration.tasks.iter_mut().for_each(|task| task.group = groups.len() - 1 - task.group);
        iteration.tasks.rotate_left(7);
    }
    let turned = Recording::new(groups, run.fixed_bytes.clone(), iterations);
    let costs = Costs { bandwidth: Some(64), latency_s: 0.125 };
    for (policy, master) in POLICIES.into_iter().flat_map(|p| MASTERS.map(|m| (p, m))) {
        let settings = settings(policy, master, costs);
        assert_eq!(replay(&run, settings, 4), replay(&turned, settings, 4), "{policy:?} {master:?}");
    }
}

#[test]
fn the_policy_is_the_real_one() {
    let times = odd_times(64, 4);
    let run = recording(&[&times, &times, &times]);
    let costs = Costs { bandwidth: Some(64), latency_s: 0.0 };
    let outcome = |policy| replay(&run, settings(policy, Master::Async, costs), 4);
    assert_eq!(outcome(Policy::FfdWs { delta: 1 }), outcome(Policy::Ffd));
    assert_eq!(outcome(Policy::FfdWs { delta: 1000 }), outcome(Policy::Ws));
    let [ffd, ws] = [Policy::Ffd, Policy::Ws].map(|policy| outcome(policy).download_bytes);
    assert!(ws < ffd, "what is held is taken first: {ws} of {ffd} bytes");
}

#[test]
fn the_dearest_loss_is_named() {
    let run = recording(&[&[4.0; 8]]);
    let named = |master, costs, merge_s, workers| {
        replay(&run, Settings { policy: Policy::Ffd, master, costs, merge_s }, workers).row().next_bottleneck
    };
    let slow = Costs { bandwidth: Some(16), latency_s: 0.0 };
    assert_eq!(named(Master::Async, slow, 0.0, 8), "bandwidth");
    assert_eq!(named(Master::Sync, slow, 0.0, 8), "master");
    assert_eq!(named(Master::Async, Costs { bandwidth: None, latency_s: 9.0 }, 0.0, 8), "latency");
    assert_eq!(named(Master::Async, FREE, 1.0, 8), "merge");
}
