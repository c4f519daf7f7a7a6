//! `check`: verifies every checksum, reference and invariant of a store, names each damage and counts links by level.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::base::text::{for_shell, shown};
use crate::base::{Error, Progress, Result};
use crate::model::ExtentKind;
use crate::model::rays::{ClusterRef, TOP};
use crate::store::inventory::ExtentRow;
use crate::store::{Snapshot, Store};

/// Damages listed; more are only counted.
const LISTED: usize = 1000;

/// One thing that is wrong.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Damage {
    /// `catalogue`, `segment`, `reference`, or the kind of extent.
    pub kind: String,
    /// File.
    pub path: PathBuf,
    /// Which part of it: cluster, version, byte.
    pub id: String,
    /// What is wrong.
    pub detail: String,
}

/// What was verified.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// What is wrong, at most a thousand.
    pub damages: Vec<Damage>,
    /// All damages, listed or not.
    pub damages_total: u64,
    /// Segment files.
    pub segments: u64,
    /// Bytes whose checksums are right.
    pub bytes_verified: u64,
    /// The command to type next.
    pub next: Option<String>,
}

impl super::summary::Summary for Summary {
    fn lines(&self) -> Vec<String> {
        let mib = self.bytes_verified as f64 / f64::from(1 << 20);
        let mut lines =
            vec![format!("{} segments, {mib:.1} MiB verified, {} damages", self.segments, self.damages_total)];
        lines.extend(self.damages.iter().map(|d| format!("{}: {} {}: {}", shown(&d.path), d.kind, d.id, d.detail)));
        lines
    }

    fn shortfall(&self) -> Option<Error> {
        let first = self.damages.first()?;
        let place = if first.id.is_empty() { first.kind.clone() } else { format!("{} {}", first.kind, first.id) };
        let detail = format!("{place}: {} ({} damages in all)", first.detail, self.damages_total);
        let next = self.next.clone().unwrap_or_default();
        let then = if next.starts_with("mv") { ", then the command that made it" } else { ": it makes the store anew" };
        Some(Error::damaged(&first.path, detail).with_help_for_damage(|| format!("run `{next}`{then}")))
    }
}

struct Checker<'s> {
    store: &'s Store,
    summary: Summary,
    /// Extents already named as damaged: (segment, byte).
    known: BTreeSet<(u32, u64)>,
}

impl Checker<'_> {
    fn add(&mut self, kind: &str, path: &Path, id: impl Into<String>, detail: impl Into<String>) {
        self.summary.damages_total += 1;
        if self.summary.damages.len() < LISTED {
            let (id, detail) = (id.into(), detail.into());
            self.summary.damages.push(Damage { kind: kind.to_owned(), path: path.to_path_buf(), id, detail });
        }
    }

    /// Adds an error of reading, unless it is not about damage.
    fn add_error(&mut self, kind: &str, id: String, error: Error) -> Result<()> {
        match error {
            Error::Damaged { path, detail, .. } => {
                self.add(kind, &path, id, detail);
                Ok(())
            }
            other => Err(other),
        }
    }

    /// Does a part of the checking; damage that ends it is named.
    fn whole(&mut self, kind: &str, part: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        part(self).or_else(|error| self.add_error("catalogue", kind.to_owned(), error))
    }

    /// What SQLite itself finds, and rows that are not what was written.
    fn catalogue(&mut self) -> Result<()> {
        let path = self.store.dir().join("scene.sqlite");
        self.whole("pages", |checker| {
            for detail in checker.store.catalogue_damages()? {
                checker.add("catalogue", &path, "", detail);
            }
            Ok(())
        })?;
        self.whole("rows", |checker| {
            let broken = checker.store.broken_seals()?;
            for (table, detail) in broken.into_iter().chain(checker.store.impossible_rows()?) {
                checker.add("catalogue", &path, table, detail);
            }
            Ok(())
        })
    }

    /// Whether there is a model to check; if its own row is damaged, which is named by then, too.
    fn has_model(&self) -> Result<bool> {
        match self.store.facts_if_any() {
            Err(Error::Damaged { .. }) => Ok(true),
            facts => Ok(facts?.is_some()),
        }
    }

    fn extents(&mut self, progress: &dyn Progress) -> Result<()> {
        for kind in ExtentKind::ALL {
            progress.begin("check", "extents", None);
            let mut done = 0;
            self.whole("places of extents", |checker| {
                checker.store.for_each_extent(kind, &mut |row| {
                    done += 1;
                    progress.step(done)?;
                    checker.extent(kind, row)
                })
            })?;
        }
        Ok(())
    }

    fn extent(&mut self, kind: ExtentKind, row: ExtentRow) -> Result<()> {
        let place = (row.at.segment, row.at.offset);
        if self.known.contains(&place) {
            return Ok(());
        }
        if let Err(error) = self.read(kind, row) {
            if self.known.len() < LISTED {
                self.known.insert(place);
            }
            let version = row.version.map_or(String::new(), |v| format!(", version {v}"));
            let word = format!("{kind:?}").to_lowercase();
            self.add_error(&word, format!("cluster {}{version}", row.cluster), error)?;
        }
        Ok(())
    }

    fn read(&self, kind: ExtentKind, row: ExtentRow) -> Result<()> {
        let extent = self.store.extent_checked_now(row.at, kind)?;
        if extent.header().cluster == row.cluster {
            return Ok(());
        }
        Err(extent.damage(format!("the catalogue says it is cluster {}'s", row.cluster)))
    }

    /// Every kept version gives every cluster its light and materials.
    fn versions(&mut self) -> Result<()> {
        let catalogue = self.store.dir().join("scene.sqlite");
        for version in self.store.kept_versions()? {
            let snapshot = Snapshot::at(self.store, version)?;
            for cluster in snapshot.clusters() {
                let id = cluster?.id;
                for kind in [ExtentKind::Radiosity, ExtentKind::Materials] {
                    if snapshot.place(kind, id)?.is_none() {
                        let detail = format!("no {} in this version", format!("{kind:?}").to_lowercase());
                        self.add("reference", &catalogue, format!("cluster {id}, version {version}"), detail);
                    }
                }
            }
        }
        Ok(())
    }

    /// The top level leads to every patch, and to what the structures really are.
    fn rays(&mut self) -> Result<()> {
        let mut found = Vec::new();
        let mut read = || -> Result<()> {
            let rays = self.store.rays()?;
            let top = rays.top()?;
            found.extend(top.clusters.iter().filter_map(|at| Some((at.cluster, rays.check(at).err()?))));
            // Whole faces, and the parts of those that are cut: a face of many clusters lies in one of them.
            let met = |at: &ClusterRef| i64::from(at.patches) - i64::from(at.cuts) + i64::from(at.parts);
            let (met, patches) = (top.clusters.iter().map(met).sum::<i64>(), self.store.facts()?.patches);
            if i64::try_from(patches) != Ok(met) {
                return Err(rays.damage(format!("it leads to {met} of {patches} patches")));
            }
            Ok(())
        };
        let whole = read();
        for (cluster, error) in found {
            // Its own extent may have been named by then.
            let id = format!("cluster {cluster}");
            if self.summary.damages.iter().any(|damage| damage.kind == "rays" && damage.id == id) {
                continue;
            }
            self.add_error("rays", format!("cluster {cluster}, as the top level has it"), error)?;
        }
        whole.or_else(|error| self.add_error("rays", format!("top level (cluster {TOP})"), error))
    }

    fn segments(&mut self, progress: &dyn Progress) -> Result<()> {
        let segments = self.store.segments()?;
        progress.begin("verify", "segments", Some(segments.len() as u64));
        for (i, row) in segments.iter().enumerate() {
            let mut found = Vec::new();
            match self.store.walk_segment(row, &mut |at, detail| found.push((at, detail))) {
                Ok(bytes) => self.summary.bytes_verified += bytes,
                Err(error) => self.add_error("segment", format!("segment {}", row.id), error)?,
            }
            for (at, detail) in found {
                if !self.known.contains(&(row.id, at)) {
                    let path = self.store.dir().join("segments").join(&row.name);
                    self.add("segment", &path, format!("byte {at}"), detail);
                }
            }
            self.summary.segments += 1;
            progress.at(i as u64 + 1);
        }
        Ok(())
    }
}

/// Verifies a store. Damages are in the summary, not in the error.
pub fn execute(store: &Store, progress: &dyn Progress) -> Result<Summary> {
    verify(store, progress).map_err(|error| store.named(error))
}

fn verify(store: &Store, progress: &dyn Progress) -> Result<Summary> {
    let mut checker = Checker { store, summary: Summary::default(), known: BTreeSet::new() };
    checker.catalogue()?;
    let has_model = checker.has_model()?;
    if has_model {
        checker.extents(progress)?;
        checker.rays()?;
        checker.whole("versions", Checker::versions)?;
    }
    checker.whole("segments", |checker| checker.segments(progress))?;
    let mut summary = checker.summary;
    summary.next = Some(if summary.damages.is_empty() {
        format!("clerestory status {}", for_shell(store.dir()))
    } else {
        mend(store)
    });
    Ok(summary)
}

/// What makes a damaged store anew: the command for its models, or else to set it aside.
fn mend(store: &Store) -> String {
    let name = for_shell(store.dir());
    match store.models() {
        Ok(models) if !models.is_empty() && models.iter().all(|model| model.is_file()) => {
            let models: Vec<String> = models.iter().map(for_shell).collect();
            format!("clerestory run {} --store {name} --fresh", models.join(" "))
        }
        // Where its models are not known or have gone.
        _ => format!("mv {name} {name}.damaged"),
    }
}

#[cfg(test)]
mod tests {
    use std::fs::OpenOptions;
    use std::os::unix::fs::FileExt;
    use std::time::Duration;

    use super::*;
    use crate::base::{ClusterId, Quiet};
    use crate::model::order::UpdateOrder;
    use crate::stages::merge;
    use crate::store::fixture;

    fn check(dir: &Path) -> Summary {
        let store = Store::open(dir, Duration::from_secs(5)).unwrap();
        execute(&store, &Quiet).unwrap()
    }

    fn solved(dir: &Path) -> Store {
        let store = fixture::store(dir, 5);
        fixture::partition(&store, 2);
        fixture::solve_all(&store, UpdateOrder::Jacobi, 2.0);
        merge::execute(&store, merge::plan(&store).unwrap(), &Quiet).unwrap();
        store
    }

    #[test]
    fn a_sound_store_has_no_damages_and_all_its_bytes_are_verified() {
        let dir = tempfile::tempdir().unwrap();
        drop(solved(dir.path()));
        let summary = check(dir.path());
        assert_eq!(summary.damages, []);
        assert_eq!(summary.segments, 3);
        assert!(summary.bytes_verified > 5000, "{}", summary.bytes_verified);
    }

    #[test]
    fn a_flipped_bit_is_named_with_its_file_cluster_and_version() {
        let dir = tempfile::tempdir().unwrap();
        let store = solved(dir.path());
        let at = Snapshot::at(&store, 1).unwrap().place(ExtentKind::Radiosity, ClusterId(3)).unwrap().unwrap();
        drop(store);
        let name = format!("segments/{:06}-update.seg", at.segment);
        let file = OpenOptions::new().write(true).open(dir.path().join(&name)).unwrap();
        file.write_at(&[0xAA], at.payload_at() + at.bytes / 2).unwrap();
        let summary = check(dir.path());
        assert_eq!(summary.damages_total, 1, "{:?}", summary.damages);
        let damage = &summary.damages[0];
        assert_eq!((damage.kind.as_str(), damage.id.as_str()), ("radiosity", "cluster 3, version 1"));
        assert!(damage.path.ends_with(name) && damage.detail.contains("checksum"));
    }

    #[test]
    fn a_bit_flipped_in_the_rays_of_a_cluster_is_named_once() {
        let dir = tempfile::tempdir().unwrap();
        let store = solved(dir.path());
        let at = Snapshot::at(&store, 0).unwrap().place(ExtentKind::Rays, ClusterId(3)).unwrap().unwrap();
        drop(store);
        let name = format!("segments/{:06}-rays.seg", at.segment);
        let file = OpenOptions::new().write(true).open(dir.path().join(&name)).unwrap();
        file.write_at(&[0xAA], at.payload_at() + 50).unwrap();
        let summary = check(dir.path());
        let named: Vec<_> = summary.damages.iter().map(|d| (d.kind.as_str(), d.id.as_str())).collect();
        assert_eq!(named, [("rays", "cluster 3")]);
    }

    #[test]
    fn a_version_whose_base_is_not_there_is_damage() {
        let dir = tempfile::tempdir().unwrap();
        let store = solved(dir.path());
        drop(store);
        let stranger = rusqlite::Connection::open(dir.path().join("scene.sqlite")).unwrap();
        stranger
            .execute("INSERT INTO branches (id, base_version, cause, opened_at) VALUES (7, 0, 'x', 0)", [])
            .unwrap();
        stranger.execute("UPDATE solution_versions SET branch = 7 WHERE id = 1", []).unwrap();
        stranger.pragma_update(None, "foreign_keys", false).unwrap();
        stranger.execute("DELETE FROM solution_versions WHERE id = 0", []).unwrap();
        drop(stranger);
        let details: Vec<String> = check(dir.path()).damages.into_iter().map(|d| d.detail).collect();
        assert!(details.iter().any(|d| d == "version 1 goes back to version 0, which is not there"), "{details:?}");
    }

    #[test]
    fn light_that_is_negative_behind_a_right_checksum_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 3);
        fixture::partition(&store, 1);
        fixture::solve_all(&store, UpdateOrder::Jacobi, -1.0);
        drop(store);
        let summary = check(dir.path());
        assert_eq!(summary.damages_total, 3, "one per cluster");
        assert!(summary.damages[0].detail.contains("receives"), "{}", summary.damages[0].detail);
    }

    #[test]
    fn a_missing_segment_is_named() {
        let dir = tempfile::tempdir().unwrap();
        drop(solved(dir.path()));
        std::fs::remove_file(dir.path().join("segments/000003-update.seg")).unwrap();
        let summary = check(dir.path());
        assert!(summary.damages.iter().all(|d| d.detail.contains("missing")), "{:?}", summary.damages);
        assert_eq!(summary.damages_total, 6, "five clusters and the file");
    }
}
