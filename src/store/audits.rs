//! Audits of versions: what `run` and `audit` found when they measured stored light anew.

use rusqlite::{OptionalExtension, params};

use super::Store;
use super::sql::is_full;
use crate::base::Result;
use crate::model::audit::{Audit, AuditFigures};

impl Store {
    /// Keeps an audit; not where one may only read, or the disk is full: it has been said then, and can be done again.
    pub fn put_audit(&self, audit: &Audit) -> Result<()> {
        if !self.is_writable() {
            return Ok(());
        }
        let Audit { version, places, seed, points, figures: f, worst } = audit;
        let worst = serde_json::to_string(worst).expect("plain text and numbers");
        let kept = self.write(|tx| {
            tx.execute(
                "INSERT OR REPLACE INTO audits VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, unixepoch('subsec'))",
                params![
                    version,
                    places,
                    *seed as i64,
                    points,
                    f.audited_nrms,
                    f.audited_se,
                    f.audited_bias,
                    f.bias_se,
                    worst
                ],
            )?;
            Ok(())
        });
        match kept {
            Err(error) if is_full(&error) => Ok(()),
            kept => kept,
        }
    }

    /// The audit of a version that rests on most places; of those the newest.
    pub fn audit(&self, version: u64) -> Result<Option<Audit>> {
        let mut query = self.connection().prepare_cached(
            "SELECT places, seed, points, audited_nrms, audited_se, audited_bias, audited_bias_se, worst
             FROM audits WHERE version = ?1 ORDER BY places DESC, made_at DESC LIMIT 1",
        )?;
        let row = query.query_row([version], |r| {
            let figures = AuditFigures {
                audited_nrms: r.get(3)?,
                audited_se: r.get(4)?,
                audited_bias: r.get(5)?,
                bias_se: r.get(6)?,
            };
            let (places, seed, points) = (r.get(0)?, r.get::<_, i64>(1)? as u64, r.get(2)?);
            Ok((Audit { version, places, seed, points, figures, worst: Vec::new() }, r.get::<_, String>(7)?))
        });
        let Some((audit, worst)) = row.optional()? else { return Ok(None) };
        let worst = serde_json::from_str(&worst)
            .map_err(|e| self.lacks(&format!("the worst places of an audit of version {version}: {e}")))?;
        Ok(Some(Audit { worst, ..audit }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::audit::WorstPlace;
    use crate::store::fixture;

    #[test]
    fn an_audit_comes_back_and_the_one_with_most_places_counts() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 2);
        assert_eq!(store.audit(0).unwrap(), None);
        let figures = AuditFigures { audited_nrms: Some(0.03), audited_se: Some(0.01), ..Default::default() };
        let worst = WorstPlace {
            cluster: 1,
            object: "desk".to_owned(),
            point_m: [1.0, 2.0, 0.1],
            stored_w_m2: [0.5; 3],
            gathered_w_m2: [0.25; 3],
        };
        let large = Audit { places: 512, seed: u64::MAX, points: 500, figures, worst: vec![worst], ..Audit::default() };
        store.put_audit(&large).unwrap();
        store.put_audit(&large).unwrap();
        store.put_audit(&Audit { places: 256, ..large.clone() }).unwrap();
        assert_eq!(store.audit(0).unwrap(), Some(large));
        assert_eq!((store.broken_seals().unwrap(), store.impossible_rows().unwrap()), (vec![], vec![]));
        let seen: (u64, String, f64) = store
            .connection()
            .query_row("SELECT count(*), worst_object, worst_y_m FROM v_audit", [], |r| {
                Ok((r.get(0)?, r.get(1)?, r.get(2)?))
            })
            .unwrap();
        assert_eq!(seen, (2, "desk".to_owned(), 2.0));
        store.empty().unwrap();
        assert_eq!(store.audit(0).unwrap(), None);
    }
}
