//! `gc`: removes all but version 0 and the newest ends of iterations of each branch, and unused bytes.

use serde::Serialize;

use crate::base::text::for_shell;
use crate::base::{Progress, Result};
use crate::store::{Store, reserve};

/// What `gc` did.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// Versions that can no longer be read.
    pub versions_removed: u64,
    /// Bytes given back to the disk.
    pub bytes_freed: u64,
    /// The command to type next.
    pub next: Option<String>,
}

impl super::summary::Summary for Summary {
    fn lines(&self) -> Vec<String> {
        let mib = self.bytes_freed as f64 / f64::from(1 << 20);
        vec![format!("{} versions removed, {mib:.1} MiB freed", self.versions_removed)]
    }
}

/// Keeps version 0 and the newest `keep` ends of iterations of each branch. Gives room back from the first step on, since a full disk is where it is needed most: the reserve, what needs no
/// row written, then rows and whole files, then files that are mostly garbage.
pub fn execute(store: &Store, keep: u64, progress: &dyn Progress) -> Result<Summary> {
    progress.begin("remove", "versions", None);
    let mut bytes_freed = store.truncate_segments()?;
    bytes_freed += store.drop_unreferenced_segments()?;
    let versions_removed = store.forget_old_versions(keep)?;
    progress.at(versions_removed);
    bytes_freed += store.drop_unreferenced_segments()?;
    bytes_freed += store.compact_segments()?;
    bytes_freed += store.truncate_segments()?;
    store.checkpoint()?;
    reserve::keep(store.dir());
    let next = Some(format!("clerestory status {}", for_shell(store.dir())));
    Ok(Summary { versions_removed, bytes_freed, next })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{ClusterId, Quiet};
    use crate::model::ExtentKind;
    use crate::model::order::UpdateOrder;
    use crate::stages::merge;
    use crate::store::{Snapshot, Worker, fixture};

    #[test]
    fn kept_versions_keep_their_bytes_and_removed_ones_say_so() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 7);
        fixture::partition(&store, 3);
        // Group 0 changes in even iterations only: version 7 resolves to its rows of version 6.
        for i in 1..=8u8 {
            let mut worker = Worker::start(&store).unwrap();
            let iteration = store.open_iteration(None, &fixture::settings(UpdateOrder::Jacobi)).unwrap();
            while let Some(lease) = store.claim(&iteration, &worker, &mut fixture::first).unwrap() {
                let irradiance = if lease.group == 0 { i / 2 + 1 } else { i };
                assert!(fixture::solve(&store, &lease, &mut worker, f32::from(irradiance)));
            }
            drop(worker);
            merge::execute(&store, merge::plan(&store).unwrap(), &Quiet).unwrap();
        }
        let bytes = |version| -> Vec<Vec<u8>> {
            let snapshot = Snapshot::at(&store, version).unwrap();
            (0..7).map(|c| snapshot.need(ExtentKind::Radiosity, ClusterId(c)).unwrap().payload().to_vec()).collect()
        };
        let before: Vec<_> = [0, 6, 7, 8].map(&bytes).to_vec();
        let summary = execute(&store, 3, &Quiet).unwrap();
        assert_eq!(summary.versions_removed, 5);
        assert!(summary.bytes_freed > 0);
        assert_eq!([0, 6, 7, 8].map(&bytes).to_vec(), before);
        assert_eq!(Snapshot::at(&store, 5).err().unwrap().exit_code(), 2);
        assert!(store.version(5).unwrap().unwrap().residual.is_some(), "figures stay");
        let again = execute(&store, 3, &Quiet).unwrap();
        assert_eq!((again.versions_removed, again.bytes_freed), (0, 0));
    }

    #[test]
    fn what_is_in_use_of_a_file_that_is_mostly_garbage_moves_and_the_file_goes() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 7);
        fixture::partition(&store, 3);
        // Group 0 never changes again: its rows, and with them the file, stay those of version 1.
        for i in 1..=4u8 {
            let mut worker = Worker::start(&store).unwrap();
            let iteration = store.open_iteration(None, &fixture::settings(UpdateOrder::Jacobi)).unwrap();
            while let Some(lease) = store.claim(&iteration, &worker, &mut fixture::first).unwrap() {
                let irradiance = if lease.group == 0 { 1 } else { i };
                assert!(fixture::solve(&store, &lease, &mut worker, f32::from(irradiance)));
            }
            drop(worker);
            merge::execute(&store, merge::plan(&store).unwrap(), &Quiet).unwrap();
        }
        let files = |word: &str| {
            let names = std::fs::read_dir(dir.path().join("segments")).unwrap();
            names.filter(|f| f.as_ref().unwrap().file_name().to_str().unwrap().contains(word)).count()
        };
        let bytes = || -> Vec<Vec<u8>> {
            let snapshot = Snapshot::at(&store, 4).unwrap();
            (0..7).map(|c| snapshot.need(ExtentKind::Radiosity, ClusterId(c)).unwrap().payload().to_vec()).collect()
        };
        let before = bytes();
        assert_eq!(files("update"), 4);
        let somebody = Store::open(dir.path(), std::time::Duration::ZERO).unwrap();
        execute(&store, 1, &Quiet).unwrap();
        assert_eq!((files("update"), files("compact")), (2, 0), "another process may read it");
        drop(somebody);
        execute(&store, 1, &Quiet).unwrap();
        assert_eq!((files("update"), files("compact")), (1, 1));
        assert_eq!(execute(&store, 1, &Quiet).unwrap().bytes_freed, 0, "there is nothing left to move");
        assert!(bytes() == before);
    }
}
