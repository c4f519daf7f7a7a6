//! One solution version, read: each cluster's newest row along the version's chain of ancestors.

use std::cell::RefCell;
use std::num::NonZeroUsize;

use lru::LruCache;
use rusqlite::{OptionalExtension, params};

use super::{Extent, ExtentRef, Store, branches};
use crate::base::text::shown;
use crate::base::{ClusterId, Error, Result};
use crate::model::ExtentKind;

/// Places of extents remembered: about 1 MiB.
const KNOWN_PLACES: NonZeroUsize = NonZeroUsize::new(16_384).expect("not 0");

/// Kept versions that are named where one is asked for that is not.
const LISTED: usize = 8;

/// Clusters fetched from the catalogue at a time.
const PAGE: usize = 1024;

/// What the catalogue says of a cluster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClusterSummary {
    /// Its number.
    pub id: ClusterId,
    /// Its OBJ object.
    pub object: u32,
    /// Patches.
    pub patches: u32,
    /// Emitting patches.
    pub emitters: u32,
    /// Area, m2.
    pub area_m2: f64,
    /// Smallest corner of its box, m from the origin.
    pub min_m: [f32; 3],
    /// Largest corner.
    pub max_m: [f32; 3],
    /// Its group; `None` before partition.
    pub group: Option<u32>,
}

/// A solution version. Reads go to the store as needed; nothing here grows with the model.
pub struct Snapshot<'s> {
    store: &'s Store,
    version: u64,
    lineage: Lineage,
    places: RefCell<LruCache<(ExtentKind, u32), Option<ExtentRef>>>,
}

/// A version's chain of ancestors, itself included: of each branch on it, the newest version.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Lineage(Vec<(u64, u64)>);

impl Lineage {
    pub(super) fn of(store: &Store, version: u64) -> Result<Self> {
        let mut find = store.connection().prepare_cached(
            "SELECT v.branch, b.base_version, v.is_kept FROM solution_versions v
             JOIN branches b ON b.id = v.branch WHERE v.id = ?1",
        )?;
        let mut chain = Vec::new();
        let mut at = Some(version);
        while let Some(newest) = at {
            let row: Option<(u64, Option<u64>, bool)> =
                find.query_row([newest], |r| Ok((r.get(0)?, r.get(1)?, r.get(2)?))).optional()?;
            let Some((branch, base, kept)) = row else {
                if newest != version {
                    let detail = format!("version {version} goes back to version {newest}, which is not there");
                    return Err(Error::damaged(&store.dir().join(super::sql::CATALOGUE), detail));
                }
                if branches::version_row(store.connection(), newest)?.is_some() {
                    return Err(store.lacks(&format!("version {newest} is of a branch that is not there")));
                }
                return Err(store.no_such_version(newest, "there is no version"));
            };
            if newest == version && !kept {
                return Err(store.no_such_version(newest, "gc has removed version"));
            }
            chain.push((branch, newest));
            // Bases are older: the walk ends.
            at = base.filter(|&base| base < newest);
        }
        Ok(Self(chain))
    }

    /// Whether a version of a branch is on the chain.
    pub(super) fn holds(&self, branch: u64, version: u64) -> bool {
        self.0.iter().any(|&(b, newest)| b == branch && version <= newest)
    }
}

impl Store {
    /// The error of a version that can't be read, which names those that can.
    pub(super) fn no_such_version(&self, version: u64, what: &str) -> Error {
        let kept = self.kept_versions().unwrap_or_default();
        let listed: Vec<String> = kept.iter().rev().take(LISTED).rev().map(u64::to_string).collect();
        let more = if kept.len() > listed.len() { "..., " } else { "" };
        Error::Usage {
            message: format!("{}: {what} {version}", shown(self.dir())),
            help: match listed.last() {
                Some(newest) => {
                    format!("give `--version {newest}`, or another that is kept: {more}{}", listed.join(", "))
                }
                None => "leave out `--version`".to_owned(),
            },
        }
    }
}

impl<'s> Snapshot<'s> {
    /// Opens a version; a usage error if there is none of that number.
    pub fn at(store: &'s Store, version: u64) -> Result<Self> {
        let lineage = Lineage::of(store, version).map_err(|e| store.named(e))?;
        Ok(Self { store, version, lineage, places: RefCell::new(LruCache::new(KNOWN_PLACES)) })
    }

    /// Opens the newest version.
    pub fn newest(store: &'s Store) -> Result<Self> {
        Self::at(store, store.newest_version()?)
    }

    /// Its number.
    #[must_use]
    pub fn version(&self) -> u64 {
        self.version
    }

    /// The store it lies in.
    #[must_use]
    pub fn store(&self) -> &'s Store {
        self.store
    }

    /// Where a cluster's extent of a kind lies in this version, if it has one. For links see
    /// [`Snapshot::links`].
    pub fn place(&self, kind: ExtentKind, cluster: ClusterId) -> Result<Option<ExtentRef>> {
        let key = (kind, cluster.0);
        if let Some(known) = self.places.borrow_mut().get(&key) {
            return Ok(*known);
        }
        let found = match kind {
            ExtentKind::Radiosity => self.newest_row(
                "SELECT s.segment, s.offset, s.bytes, s.version, v.branch FROM cluster_states s
                 JOIN solution_versions v ON v.id = s.version
                 WHERE s.cluster = ?1 AND s.version <= ?2 ORDER BY s.version DESC",
                cluster,
            )?,
            ExtentKind::Materials => self.newest_row(
                "SELECT s.segment, s.offset, s.bytes, s.version, v.branch FROM cluster_materials s
                 JOIN solution_versions v ON v.id = s.version
                 WHERE s.cluster = ?1 AND s.version <= ?2 ORDER BY s.version DESC",
                cluster,
            )?,
            ExtentKind::Links => self.link_places(cluster)?.last().copied(),
            ExtentKind::Geometry => self.own("geometry", cluster)?,
            ExtentKind::Rays => self.own("rays", cluster)?,
            ExtentKind::Bake => self.own("bake", cluster)?,
            ExtentKind::Provenance => self.own("provenance", cluster)?,
            ExtentKind::Visibility => self.own("visibility", cluster)?,
        };
        self.places.borrow_mut().put(key, found);
        Ok(found)
    }

    fn newest_row(&self, sql: &str, cluster: ClusterId) -> Result<Option<ExtentRef>> {
        let mut query = self.store.connection().prepare_cached(sql)?;
        let mut rows = query.query(params![cluster.0, self.version])?;
        while let Some(row) = rows.next()? {
            if self.lineage.holds(row.get(4)?, row.get(3)?) {
                return Ok(Some(ExtentRef::from_row(row, 0)?));
            }
        }
        Ok(None)
    }

    fn own(&self, columns: &str, cluster: ClusterId) -> Result<Option<ExtentRef>> {
        let sql = format!("SELECT {columns}_segment, {columns}_offset, {columns}_bytes FROM clusters WHERE id = ?1");
        let mut query = self.store.connection().prepare_cached(&sql)?;
        let found = query.query_row([cluster.0], |row| ExtentRef::from_row_if_any(row, 0)).optional()?;
        Ok(found.flatten())
    }

    /// A cluster's extent of a kind in this version, if it has one.
    pub fn extent(&self, kind: ExtentKind, cluster: ClusterId) -> Result<Option<Extent>> {
        let place = self.place(kind, cluster).map_err(|e| self.store.named(e))?;
        place.map(|at| self.checked(at, kind, cluster)).transpose()
    }

    /// A cluster's extent of a kind that every cluster has; damage if it is missing.
    pub fn need(&self, kind: ExtentKind, cluster: ClusterId) -> Result<Extent> {
        self.extent(kind, cluster)?.ok_or_else(|| {
            let detail = format!("cluster {cluster} has no {kind:?} in version {}", self.version);
            Error::damaged(&self.store.dir().join(super::sql::CATALOGUE), detail)
        })
    }

    fn checked(&self, at: ExtentRef, kind: ExtentKind, cluster: ClusterId) -> Result<Extent> {
        let extent = self.store.extent(at, kind)?;
        if extent.header().cluster != cluster.0 {
            return Err(extent.damage(format!("the catalogue says it is cluster {cluster}'s")));
        }
        Ok(extent)
    }

    fn link_places(&self, cluster: ClusterId) -> Result<Vec<ExtentRef>> {
        let mut query = self.store.connection().prepare_cached(
            "SELECT s.segment, s.offset, s.bytes, s.version, v.branch, s.delta FROM cluster_links s
             JOIN solution_versions v ON v.id = s.version
             WHERE s.cluster = ?1 AND s.version <= ?2 ORDER BY s.version DESC",
        )?;
        let mut rows = query.query(params![cluster.0, self.version])?;
        let mut chain = Vec::new();
        while let Some(row) = rows.next()? {
            if !self.lineage.holds(row.get(4)?, row.get(3)?) {
                continue;
            }
            chain.push(ExtentRef::from_row(row, 0)?);
            if !row.get::<_, bool>(5)? {
                break;
            }
        }
        chain.reverse();
        Ok(chain)
    }

    /// A cluster's link extents: the base, then its deltas, oldest first; of a row that several
    /// hold the last wins. Empty if none are stored.
    pub fn links(&self, cluster: ClusterId) -> Result<Vec<Extent>> {
        let chain = self.link_places(cluster).map_err(|e| self.store.named(e))?;
        chain.into_iter().map(|at| self.checked(at, ExtentKind::Links, cluster)).collect()
    }

    /// Bytes of a cluster's chain of link extents, as stored.
    pub fn links_bytes(&self, cluster: ClusterId) -> Result<u64> {
        let chain = self.link_places(cluster).map_err(|e| self.store.named(e))?;
        Ok(chain.iter().map(|at| at.bytes).sum())
    }

    /// All clusters, by number, fetched page by page.
    pub fn clusters(&self) -> Clusters<'s> {
        Clusters { store: self.store, page: Vec::new().into_iter(), after: -1, ended: false }
    }
}

/// Walks the clusters by number.
pub struct Clusters<'s> {
    store: &'s Store,
    page: std::vec::IntoIter<ClusterSummary>,
    after: i64,
    ended: bool,
}

impl Clusters<'_> {
    fn fetch(&mut self) -> Result<()> {
        let mut query = self.store.connection().prepare_cached(
            "SELECT id, object, patches, emitters, area_m2, min_x_m, min_y_m, min_z_m, max_x_m, max_y_m, max_z_m,
                    group_id FROM clusters WHERE id > ?1 ORDER BY id LIMIT ?2",
        )?;
        let rows = query.query_map(params![self.after, PAGE], |row| {
            Ok(ClusterSummary {
                id: ClusterId(row.get(0)?),
                object: row.get(1)?,
                patches: row.get(2)?,
                emitters: row.get(3)?,
                area_m2: row.get(4)?,
                min_m: [row.get(5)?, row.get(6)?, row.get(7)?],
                max_m: [row.get(8)?, row.get(9)?, row.get(10)?],
                group: row.get(11)?,
            })
        })?;
        let page: Vec<_> = rows.collect::<std::result::Result<_, _>>()?;
        match page.last() {
            Some(last) => self.after = i64::from(last.id.0),
            None => self.ended = true,
        }
        self.page = page.into_iter();
        Ok(())
    }
}

impl Iterator for Clusters<'_> {
    type Item = Result<ClusterSummary>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(cluster) = self.page.next() {
                return Some(Ok(cluster));
            }
            if self.ended {
                return None;
            }
            if let Err(e) = self.fetch() {
                self.ended = true;
                return Some(Err(self.store.named(e)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::light::LightView;
    use crate::model::rays::RayNode;
    use crate::store::fixture;

    #[test]
    fn version_0_gives_every_cluster_and_its_extents() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 1500);
        let snapshot = Snapshot::newest(&store).unwrap();
        let ids: Vec<u32> = snapshot.clusters().map(|c| c.unwrap().id.0).collect();
        assert_eq!(ids, (0..1500).collect::<Vec<_>>(), "over several pages");
        let light = snapshot.need(ExtentKind::Radiosity, ClusterId(7)).unwrap();
        assert_eq!(light.parse(LightView::parse).unwrap().elements.len(), 2);
        assert_eq!(light.header().channels, 3);
        assert!(snapshot.extent(ExtentKind::Bake, ClusterId(7)).unwrap().is_none());
        assert!(snapshot.links(ClusterId(7)).unwrap().is_empty());
        let rays = store.rays().unwrap();
        let (top, file) = (rays.top().unwrap(), rays.file());
        let at = top.clusters[7].nodes_at as usize;
        let node: RayNode = bytemuck::pod_read_unaligned(&file[at..at + size_of::<RayNode>()]);
        assert_eq!(node.bounds_m(0).0, [0.0, 0.0, 7.0], "places are those of the whole file");
        assert_eq!(store.facts().unwrap().diagonal_m(), (2.0f64 + 1500.0 * 1500.0).sqrt());
        assert_eq!(Snapshot::at(&store, 5).err().unwrap().exit_code(), 2);
    }

    #[test]
    fn a_cluster_whose_row_points_at_another_s_extent_is_damage() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 3);
        let swap = "UPDATE cluster_states SET offset = (SELECT offset FROM cluster_states WHERE cluster = 2) WHERE cluster = 1";
        store.connection().execute(swap, []).unwrap();
        let error = Snapshot::newest(&store).unwrap().need(ExtentKind::Radiosity, ClusterId(1)).err().unwrap();
        assert!(error.exit_code() == 12 && error.to_string().contains("cluster 1's"), "{error}");
    }

    #[test]
    fn an_ingest_that_is_not_finished_leaves_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), std::time::Duration::ZERO).unwrap();
        let mut ingest = crate::store::IngestTx::begin(&store).unwrap();
        ingest.add_file("a.obj", "obj", 1, "").unwrap();
        drop(ingest);
        assert_eq!(store.newest_version().err().unwrap().exit_code(), 13);
        assert!(store.facts_if_any().unwrap().is_none());
    }

    #[test]
    fn an_emptied_store_has_no_rows_and_no_files_and_takes_the_next_model() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 3);
        store.empty().unwrap();
        assert_eq!(std::fs::read_dir(dir.path().join("segments")).unwrap().count(), 0);
        drop(store);
        let store = fixture::store(dir.path(), 2);
        assert_eq!(Snapshot::newest(&store).unwrap().clusters().count(), 2);
    }
}
