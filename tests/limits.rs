//! What must not grow: chains of link extents, and memory past its limit.

mod common;

use std::time::Duration;

use clerestory::model::links::{LinksView, for_each_row};
use clerestory::stages::link_extent::live_bytes;
use clerestory::store::{Snapshot, Store};
use common::{assert_sound, clerestory, finish, light_of, run, write_rooms};

fn scene() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_rooms(&dir.path().join("rooms.obj"), 2);
    dir
}

#[test]
fn a_chain_of_link_extents_is_at_most_half_garbage_however_many_iterations_add_to_it() {
    let dir = scene();
    // Each tolerance is a branch of its own that goes on from the links of the one before.
    for tolerance in ["0.12", "0.1", "0.085", "0.07", "0.06", "0.05"] {
        let args = ["run", "rooms.obj", "--groups", "2", "--keep", "100", "--tolerance", tolerance, "--json", "-q"];
        assert_eq!(finish(clerestory().current_dir(dir.path()).args(args)).0, 0);
    }
    let path = dir.path().join("rooms.clr");
    assert_sound(&path);
    let store = Store::open(&path, Duration::from_secs(10)).unwrap();
    let mut longest = 0;
    for version in 0..=store.newest_version().unwrap() {
        let snapshot = Snapshot::at(&store, version).unwrap();
        for cluster in snapshot.clusters() {
            let id = cluster.unwrap().id;
            let chain = snapshot.links(id).unwrap();
            longest = longest.max(chain.len());
            if chain.len() < 2 {
                continue;
            }
            let views: Vec<_> = chain.iter().map(|e| e.parse(LinksView::parse).unwrap()).collect();
            let (mut rows, mut entries) = (0, 0);
            for_each_row(&views, |_, row| {
                rows += 1;
                entries += row.count as usize;
            });
            let bytes = chain.iter().map(|e| e.payload().len() as u64).sum::<u64>();
            let live = live_bytes(rows, entries as u64);
            assert!(
                bytes <= 2 * live,
                "version {version}, cluster {id}: {} extents hold {bytes} bytes for {live}",
                chain.len()
            );
        }
    }
    assert!(longest > 2, "nothing was tested: no chain is longer than {longest}");
}

#[test]
fn a_group_that_does_not_fit_is_refused_before_it_is_solved_and_is_solved_with_more_memory() {
    let dir = scene();
    let solve = |more: &[&str]| {
        let mut command = clerestory();
        command.current_dir(dir.path()).args(["solve-group", "rooms.clr", "--tolerance", "0.1", "--link-cache", "1M"]);
        command.args(more).output().unwrap()
    };
    assert_eq!(finish(&mut run(dir.path(), &["--max-iterations", "1"])).0, 3);
    let before = light_of(&dir.path().join("rooms.clr"));
    // The least that is known before the light of the version is looked at.
    let refused = solve(&["--next", "--memory", "33M"]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(14), "{said}");
    assert!(said.contains("group ") && said.contains("over the limit of 33 MiB"), "{said}");
    assert!(said.contains("--memory"), "{said}");
    assert_eq!(
        said.contains("--groups"),
        !said.contains(" in 1 clusters"),
        "more groups help where there are clusters: {said}"
    );
    assert!(light_of(&dir.path().join("rooms.clr")) == before, "nothing was published");
    assert_eq!(solve(&["--next", "--memory", "64M"]).status.code(), Some(0));
    assert_eq!(finish(&mut run(dir.path(), &[])).0, 0, "the group that was refused is free");
    assert_sound(&dir.path().join("rooms.clr"));
}

#[test]
fn a_graph_of_clusters_that_does_not_fit_is_refused_with_the_memory_that_would_do() {
    let dir = scene();
    assert_eq!(finish(&mut run(dir.path(), &["--max-iterations", "1"])).0, 3);
    let group = |memory: &str| {
        let args = ["partition", "rooms.clr", "--groups", "3", "--memory", memory];
        let out = clerestory().current_dir(dir.path()).args(args).output().unwrap();
        (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
    };
    let (code, said) = group("8M");
    assert_eq!(code, Some(14), "{said}");
    assert!(said.contains("pairs of clusters needs 17 MiB, over the limit of 8 MiB"), "{said}");
    assert_eq!(group("17M").0, Some(0), "what the error asks for is enough");
}
