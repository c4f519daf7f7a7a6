//! Which versions to keep, and forgetting the rows that none of those resolves to.

use std::collections::BTreeSet;

use rusqlite::{Transaction, params};

use super::Store;
use super::snapshot::Lineage;
use crate::base::Result;

/// Clusters whose rows are gone through in one transaction.
const BATCH: u64 = 512;

/// Tables of rows by cluster and version.
const VERSIONED: [(&str, bool); 3] = [("cluster_states", false), ("cluster_materials", false), ("cluster_links", true)];

impl Store {
    /// Removes all versions but 0, the newest `keep` ends of iterations of each branch, and those
    /// that somebody goes on from or reads; gives how many. Their figures stay.
    pub fn forget_old_versions(&self, keep: u64) -> Result<u64> {
        let being_read = self.versions_being_read()?;
        let removed = self.write(|tx| {
            let mut kept = being_read.into_iter().collect::<BTreeSet<u64>>();
            collect(tx, NEEDED, &mut kept)?;
            let mut ends = tx.prepare(
                "SELECT id FROM (SELECT id, row_number() OVER (PARTITION BY branch ORDER BY id DESC) AS age
                                 FROM solution_versions WHERE is_iteration_end = 1) WHERE age <= ?1",
            )?;
            let mut rows = ends.query([keep])?;
            while let Some(row) = rows.next()? {
                kept.insert(row.get(0)?);
            }
            let mut all = BTreeSet::new();
            collect(tx, "SELECT id FROM solution_versions WHERE is_kept = 1", &mut all)?;
            let mut forget = tx.prepare("UPDATE solution_versions SET is_kept = 0 WHERE id = ?1")?;
            let mut removed = 0;
            for id in all.difference(&kept) {
                removed += forget.execute([id])? as u64;
            }
            Ok(removed)
        })?;
        self.forget_unresolved_rows()?;
        Ok(removed)
    }

    /// Deletes rows of clusters that no kept version resolves to.
    fn forget_unresolved_rows(&self) -> Result<()> {
        let newest = self.newest_version()?;
        let mut kept = BTreeSet::new();
        let mut query = self.connection().prepare("SELECT id FROM solution_versions WHERE is_kept = 1")?;
        let mut rows = query.query([])?;
        while let Some(row) = rows.next()? {
            kept.insert(row.get::<_, u64>(0)?);
        }
        drop(rows);
        let chains: Vec<(u64, Lineage)> =
            kept.iter().map(|&id| Ok((id, Lineage::of(self, id)?))).collect::<Result<_>>()?;
        // From cluster to cluster that is there: a number may be anything.
        let mut find = self.connection().prepare("SELECT min(id) FROM clusters WHERE id >= ?1")?;
        let mut next = 0;
        while let Some(first) = find.query_row([next], |r| r.get::<_, Option<u64>>(0))? {
            for (table, has_deltas) in VERSIONED {
                self.forget_batch(table, has_deltas, first, newest, &chains)?;
            }
            next = first + BATCH;
        }
        Ok(())
    }

    fn forget_batch(
        &self,
        table: &str,
        has_deltas: bool,
        first: u64,
        newest: u64,
        chains: &[(u64, Lineage)],
    ) -> Result<()> {
        let delta = if has_deltas { "s.delta" } else { "0" };
        let mut query = self.connection().prepare_cached(&format!(
            "SELECT s.cluster, s.version, v.branch, {delta} FROM {table} s JOIN solution_versions v ON v.id = s.version
             WHERE s.cluster BETWEEN ?1 AND ?2 AND s.version <= ?3 ORDER BY s.cluster, s.version DESC"
        ))?;
        let mut rows = query.query(params![first, first + BATCH - 1, newest])?;
        let mut unused: Vec<(u64, u64)> = Vec::new();
        let mut at = None;
        // Chains that have not found all they need of this cluster.
        let mut open: Vec<&(u64, Lineage)> = Vec::new();
        while let Some(row) = rows.next()? {
            let (cluster, version, branch): (u64, u64, u64) = (row.get(0)?, row.get(1)?, row.get(2)?);
            let is_delta: bool = row.get(3)?;
            if at != Some(cluster) {
                at = Some(cluster);
                open = chains.iter().collect();
            }
            let reaches = |(id, chain): &&(u64, Lineage)| version <= *id && chain.holds(branch, version);
            if !open.iter().any(reaches) {
                unused.push((cluster, version));
            } else if !is_delta {
                open.retain(|chain| !reaches(chain));
            }
        }
        drop(rows);
        if unused.is_empty() {
            return Ok(());
        }
        self.write(|tx| {
            let mut delete = tx.prepare(&format!("DELETE FROM {table} WHERE cluster = ?1 AND version = ?2"))?;
            for (cluster, version) in unused {
                delete.execute([cluster, version])?;
            }
            Ok(())
        })
    }
}

/// Version 0, the newest, and those that tasks or branches under way start from.
const NEEDED: &str = "SELECT 0 UNION SELECT max(id) FROM solution_versions
    UNION SELECT base_version FROM tasks WHERE state <> 'merged'
    UNION SELECT coalesce((SELECT max(v.id) FROM solution_versions v WHERE v.branch = b.id), b.base_version)
        FROM branches b WHERE b.id = (SELECT max(id) FROM branches)
        OR EXISTS (SELECT 1 FROM tasks t WHERE t.branch = b.id AND t.state <> 'merged')
    UNION SELECT max(id) FROM solution_versions WHERE is_iteration_end = 1";

fn collect(tx: &Transaction<'_>, sql: &str, into: &mut BTreeSet<u64>) -> Result<()> {
    let mut query = tx.prepare(sql)?;
    let mut rows = query.query([])?;
    while let Some(row) = rows.next()? {
        into.extend(row.get::<_, Option<u64>>(0)?);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use crate::store::fixture;

    #[test]
    fn forgetting_takes_no_longer_for_a_cluster_with_a_large_number() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 3);
        store.connection().pragma_update(None, "foreign_keys", false).unwrap();
        store.connection().execute("UPDATE clusters SET id = 4000000000 WHERE id = 2", []).unwrap();
        let begun = Instant::now();
        store.forget_old_versions(1).unwrap();
        // Batch by batch up to that number there are eight million.
        assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    }
}
