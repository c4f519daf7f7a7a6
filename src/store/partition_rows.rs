//! What visibility and partition put into the catalogue.

use rusqlite::params;

use super::{ExtentRef, SegmentWriter, StageRecord, Store};
use crate::base::{ClusterId, Result};

/// What a cluster sees, in figures, and where the list lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisibilityRow {
    /// The cluster.
    pub id: ClusterId,
    /// Its list.
    pub list: ExtentRef,
    /// Clusters in the list.
    pub visible_clusters: u64,
    /// Rays cast from it.
    pub rays: u64,
    /// Estimated form factor to clusters not in the list.
    pub missing: f64,
    /// Share of its rays that left the model.
    pub escape: f64,
}

/// Figures of visibility over all clusters.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VisibilityFigures {
    /// Pairs of clusters that see each other: half the entries of all lists.
    pub pairs: u64,
    /// Rays cast.
    pub rays: u64,
    /// Mean over clusters of the form factor to clusters not in their lists.
    pub missing_mean: f64,
    /// Its largest.
    pub missing_max: f64,
    /// Mean over clusters of the share of rays that left the model.
    pub escape_mean: f64,
}

/// A group as partition makes it.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupRow {
    /// Its number, from 0.
    pub id: u32,
    /// Clusters.
    pub clusters: u64,
    /// Patches.
    pub patches: u64,
    /// Predicted cost of solving it once, in any one unit.
    pub predicted_cost: f64,
    /// Bytes of everything it can see or be shadowed by.
    pub working_set_bytes: u64,
    /// Share of its form factor that stays inside.
    pub intra_group_share: f64,
}

impl Store {
    /// Publishes what some clusters see; a resumable visibility does so block by block.
    pub fn publish_visibility(&self, writer: &mut SegmentWriter, rows: &[VisibilityRow]) -> Result<()> {
        writer.sync()?;
        self.write(|tx| {
            let mut put = tx.prepare_cached(
                "UPDATE clusters SET visibility_segment = ?2, visibility_offset = ?3, visibility_bytes = ?4,
                    visible_clusters = ?5, visibility_rays = ?6, missing_form_factor = ?7, escape_share = ?8 WHERE id = ?1",
            )?;
            for row in rows {
                let at = row.list;
                put.execute(params![
                    row.id.0,
                    at.segment,
                    at.offset,
                    at.bytes,
                    row.visible_clusters,
                    row.rays,
                    row.missing,
                    row.escape
                ])?;
            }
            writer.publish(tx)
        })
    }

    /// Figures of a finished visibility.
    pub fn visibility_figures(&self) -> Result<VisibilityFigures> {
        let mut query = self.connection().prepare_cached(
            "SELECT coalesce(sum(visible_clusters), 0), coalesce(sum(visibility_rays), 0),
                coalesce(avg(missing_form_factor), 0), coalesce(max(missing_form_factor), 0),
                coalesce(avg(escape_share), 0) FROM clusters",
        )?;
        Ok(query.query_row([], |row| {
            // Lists are symmetric: every pair of two clusters stands in both.
            let listed: u64 = row.get(0)?;
            Ok(VisibilityFigures {
                pairs: listed.div_ceil(2),
                rays: row.get(1)?,
                missing_mean: row.get(2)?,
                missing_max: row.get(3)?,
                escape_mean: row.get(4)?,
            })
        })?)
    }

    /// Marks a stage as finished from these inputs and options.
    pub fn finish_stage(&self, record: &StageRecord) -> Result<()> {
        self.write(|tx| record.insert(tx))
    }

    /// Replaces the groups. `group_of` gives every cluster and its group. Tasks of the old groups
    /// that are not merged yet are dropped.
    pub fn publish_partition(
        &self,
        record: &StageRecord,
        groups: &[GroupRow],
        group_of: &mut dyn Iterator<Item = (ClusterId, u32)>,
    ) -> Result<()> {
        self.write(|tx| {
            tx.execute("DELETE FROM tasks WHERE state <> 'merged'", [])?;
            tx.execute("DELETE FROM groups", [])?;
            let mut put = tx.prepare("INSERT INTO groups VALUES (?1, ?2, ?3, ?4, ?5, ?6)")?;
            for g in groups {
                put.execute(params![
                    g.id,
                    g.clusters,
                    g.patches,
                    g.predicted_cost,
                    g.working_set_bytes,
                    g.intra_group_share
                ])?;
            }
            let mut assign = tx.prepare("UPDATE clusters SET group_id = ?2 WHERE id = ?1")?;
            for (cluster, group) in group_of {
                assign.execute([cluster.0, group])?;
            }
            record.insert(tx)
        })
    }

    /// The groups, by number.
    pub fn groups(&self) -> Result<Vec<GroupRow>> {
        let mut query = self.connection().prepare_cached("SELECT * FROM groups ORDER BY id")?;
        let rows = query.query_map([], |row| {
            Ok(GroupRow {
                id: row.get(0)?,
                clusters: row.get(1)?,
                patches: row.get(2)?,
                predicted_cost: row.get(3)?,
                working_set_bytes: row.get(4)?,
                intra_group_share: row.get(5)?,
            })
        })?;
        Ok(rows.collect::<std::result::Result<_, _>>()?)
    }

    /// The clusters of a group, by number.
    pub fn clusters_of(&self, group: u32) -> Result<Vec<ClusterId>> {
        let mut query = self.connection().prepare_cached("SELECT id FROM clusters WHERE group_id = ?1 ORDER BY id")?;
        let rows = query.query_map([group], |r| r.get(0).map(ClusterId))?;
        Ok(rows.collect::<std::result::Result<_, _>>()?)
    }

    /// The group of a cluster; `None` before partition.
    pub fn group_of(&self, cluster: ClusterId) -> Result<Option<u32>> {
        let mut query = self.connection().prepare_cached("SELECT group_id FROM clusters WHERE id = ?1")?;
        Ok(query.query_row([cluster.0], |r| r.get(0))?)
    }
}
