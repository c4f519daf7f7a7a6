//! What ingest puts into the catalogue, all in one transaction: a killed ingest leaves nothing.

use rusqlite::{Transaction, TransactionBehavior, params};

use super::{ExtentRef, ModelFacts, SegmentWriter, StageRecord, Store};
use crate::base::{ClusterId, Result};

/// A cluster as ingest makes it.
#[derive(Clone, Debug, PartialEq)]
pub struct ClusterRow {
    /// Its number.
    pub id: ClusterId,
    /// Its OBJ object, from [`IngestTx::add_object`].
    pub object: u32,
    /// Patches, 1..=256.
    pub patches: u32,
    /// Emitting patches.
    pub emitters: u32,
    /// Area, each patch once, m2.
    pub area_m2: f64,
    /// Smallest corner of its box, m from the origin.
    pub min_m: [f32; 3],
    /// Largest corner.
    pub max_m: [f32; 3],
    /// Patches and tree.
    pub geometry: ExtentRef,
    /// Ray structure.
    pub rays: ExtentRef,
    /// Input faces.
    pub provenance: ExtentRef,
    /// Corners as modelled, if anything there is to bake.
    pub bake: Option<ExtentRef>,
    /// Reflectance and exitance.
    pub materials: ExtentRef,
    /// Light of version 0: nothing arrives anywhere.
    pub radiosity: ExtentRef,
}

/// An ingest under way. Dropped without [`IngestTx::finish`], it leaves no row.
pub struct IngestTx<'s> {
    store: &'s Store,
    tx: Transaction<'s>,
}

impl<'s> IngestTx<'s> {
    /// Begins; the store must hold no model. Make the segment writers first: each needs a transaction.
    pub fn begin(store: &'s Store) -> Result<Self> {
        let begin = || -> Result<_> {
            store.ledger()?.clear();
            let tx = Transaction::new_unchecked(store.connection(), TransactionBehavior::Immediate)?;
            tx.execute("INSERT INTO branches (id, cause, opened_at) VALUES (0, 'ingest', unixepoch('subsec'))", [])?;
            tx.execute(
                "INSERT INTO solution_versions (id, branch, iteration, is_iteration_end, made_at)
                 VALUES (0, 0, 0, 1, unixepoch('subsec'))",
                [],
            )?;
            Ok(tx)
        };
        Ok(Self { store, tx: begin().map_err(|e| store.named(e))? })
    }

    /// Adds an input file (`kind` obj or mtl; `hash` of its bytes) and gives its number.
    pub fn add_file(&mut self, path: &str, kind: &str, bytes: u64, hash: &str) -> Result<u32> {
        let mut put =
            self.tx.prepare_cached("INSERT INTO input_files (path, kind, bytes, hash) VALUES (?1, ?2, ?3, ?4)")?;
        Ok(put.insert(params![path, kind, bytes, hash])? as u32)
    }

    /// Adds an OBJ object or group of a file and gives its number.
    pub fn add_object(&mut self, file: u32, name: &str) -> Result<u32> {
        let mut put = self.tx.prepare_cached("INSERT INTO objects (file, name) VALUES (?1, ?2)")?;
        Ok(put.insert(params![file, name])? as u32)
    }

    /// Adds a face that was left out: the line of its `f` record, and why, in a word or two.
    pub fn add_skipped(&mut self, file: u32, line: u64, cause: &str) -> Result<()> {
        let mut put = self.tx.prepare_cached("INSERT INTO skipped_faces VALUES (?1, ?2, ?3)")?;
        put.execute(params![file, line, cause])?;
        Ok(())
    }

    /// Adds a cluster with its state in version 0.
    pub fn add_cluster(&mut self, row: &ClusterRow) -> Result<()> {
        let mut put = self.tx.prepare_cached(
            "INSERT INTO clusters (id, object, patches, emitters, area_m2,
                min_x_m, min_y_m, min_z_m, max_x_m, max_y_m, max_z_m,
                geometry_segment, geometry_offset, geometry_bytes, rays_segment, rays_offset, rays_bytes,
                provenance_segment, provenance_offset, provenance_bytes, bake_segment, bake_offset, bake_bytes)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, ?18, ?19, ?20,
                ?21, ?22, ?23)",
        )?;
        let ([x0, y0, z0], [x1, y1, z1]) = (row.min_m, row.max_m);
        let (g, r, p, b) = (row.geometry, row.rays, row.provenance, row.bake);
        put.execute(params![
            row.id.0,
            row.object,
            row.patches,
            row.emitters,
            row.area_m2,
            x0,
            y0,
            z0,
            x1,
            y1,
            z1,
            g.segment,
            g.offset,
            g.bytes,
            r.segment,
            r.offset,
            r.bytes,
            p.segment,
            p.offset,
            p.bytes,
            b.map(|b| b.segment),
            b.map(|b| b.offset),
            b.map(|b| b.bytes)
        ])?;
        for (sql, at) in [
            ("INSERT INTO cluster_materials VALUES (?1, 0, ?2, ?3, ?4)", row.materials),
            ("INSERT INTO cluster_states VALUES (?1, 0, ?2, ?3, ?4)", row.radiosity),
        ] {
            self.tx.prepare_cached(sql)?.execute(params![row.id.0, at.segment, at.offset, at.bytes])?;
        }
        Ok(())
    }

    /// Brings all segments to the disk, then commits everything at once.
    pub fn finish(self, facts: &ModelFacts, record: &StageRecord, writers: &mut [SegmentWriter]) -> Result<()> {
        for writer in writers.iter_mut() {
            writer.sync()?;
        }
        let Self { store, tx } = self;
        let commit = || -> Result<()> {
            facts.insert(&tx)?;
            record.insert(&tx)?;
            tx.execute("UPDATE solution_versions SET clusters_changed = ?1 WHERE id = 0", [facts.clusters])?;
            for writer in writers.iter() {
                writer.publish(&tx)?;
            }
            store.ledger()?.settle(&tx)?;
            tx.commit()?;
            Ok(())
        };
        commit().map_err(|e| store.named(e))
    }
}

/// New materials of clusters that keep their geometry and links, and what follows from them.
pub struct MaterialsRow {
    /// The cluster.
    pub id: ClusterId,
    /// Emitting patches.
    pub emitters: u32,
    /// Reflectance and exitance.
    pub materials: ExtentRef,
    /// Light of the new root version: nothing arrives anywhere.
    pub radiosity: ExtentRef,
}

impl Store {
    /// Opens a branch whose first version is emission only again, with other materials: `rows` must
    /// give every cluster. Geometry stays, and the links of `base` (version 0 has none). Returns the version.
    pub fn replace_materials(
        &self,
        facts: &ModelFacts,
        record: &StageRecord,
        base: u64,
        writers: &mut [SegmentWriter],
        rows: &mut dyn Iterator<Item = Result<MaterialsRow>>,
    ) -> Result<u64> {
        for writer in writers.iter_mut() {
            writer.sync()?;
        }
        self.write(|tx| {
            let version: u64 = tx.query_row("SELECT max(id) + 1 FROM solution_versions", [], |r| r.get(0))?;
            let branch: u64 = tx.query_row("SELECT max(id) + 1 FROM branches", [], |r| r.get(0))?;
            tx.execute(
                "INSERT INTO branches (id, base_version, cause, opened_at)
                 VALUES (?1, ?2, 'materials', unixepoch('subsec'))",
                [branch, base],
            )?;
            tx.execute(
                "INSERT INTO solution_versions (id, parent, branch, iteration, is_iteration_end, clusters_changed, made_at)
                 VALUES (?1, ?2, ?3, 0, 1, ?4, unixepoch('subsec'))",
                [version, base, branch, facts.clusters],
            )?;
            let mut emitters = tx.prepare("UPDATE clusters SET emitters = ?2 WHERE id = ?1")?;
            let mut materials = tx.prepare("INSERT INTO cluster_materials VALUES (?1, ?2, ?3, ?4, ?5)")?;
            let mut state = tx.prepare("INSERT INTO cluster_states VALUES (?1, ?2, ?3, ?4, ?5)")?;
            for row in rows {
                let row = row?;
                emitters.execute([row.id.0, row.emitters])?;
                for (put, at) in [(&mut materials, row.materials), (&mut state, row.radiosity)] {
                    put.execute(params![row.id.0, version, at.segment, at.offset, at.bytes])?;
                }
            }
            facts.insert(tx)?;
            record.insert(tx)?;
            for writer in writers.iter() {
                writer.publish(tx)?;
            }
            Ok(version)
        })
    }
}
