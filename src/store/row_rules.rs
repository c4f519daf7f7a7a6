//! What must be true of the catalogue's rows, whoever wrote them: a seal tells only that a row is the one that was
//! sealed, and who forges rows can forge seals.

use rusqlite::{Connection, OptionalExtension};

use super::Store;

use crate::base::Result;

/// A table, a query that gives one text for each row or figure that is wrong, and what is wrong with it.
struct Rule {
    table: &'static str,
    wrong: String,
    what: String,
}

fn rule(table: &'static str, wrong: impl Into<String>, what: impl Into<String>) -> Rule {
    Rule { table, wrong: wrong.into(), what: what.into() }
}

/// Largest coordinate, m: light and rays compute in f32.
const FARTHEST_M: &str = "3.4e38";

/// The rows of a table for which a condition does not hold.
fn each(table: &'static str, key: &str, holds: &str, what: &str) -> Rule {
    rule(table, format!("SELECT {key} FROM {table} WHERE ({holds}) IS NOT 1"), what)
}

/// The columns of a table in which places of extents stand: prefixes.
const PLACES: [(&str, &str, &[&str]); 6] = [
    ("model", "id", &["rays_top_"]),
    ("clusters", "id", &["geometry_", "rays_", "provenance_", "bake_", "visibility_"]),
    ("cluster_materials", "cluster", &[""]),
    ("cluster_states", "cluster", &[""]),
    ("cluster_links", "cluster", &[""]),
    ("updates", "cluster", &[""]),
];

fn rules() -> Vec<Rule> {
    let within = |column: &str, low: &str, high: &str| format!("{column} BETWEEN {low} AND {high}");
    let all = |conditions: Vec<String>| conditions.join(" AND ");
    let finite = |columns: &[&str]| all(columns.iter().map(|c| format!("abs({c}) < 9e999")).collect());
    let boxed = || {
        all(["x", "y", "z"]
            .iter()
            .map(|axis| {
                format!("min_{axis}_m <= max_{axis}_m AND min_{axis}_m > -{FARTHEST_M} AND max_{axis}_m < {FARTHEST_M}")
            })
            .collect())
    };
    let positive = |column: &str| format!("{column} > 0 AND {column} < 9e999");
    let not_negative = |column: &str| format!("{column} >= 0 AND {column} < 9e999");
    let counts = |columns: &[&str]| all(columns.iter().map(|c| format!("{c} >= 0")).collect());
    let mut rules = vec![
        each("model", "id", &finite(&["origin_x", "origin_y", "origin_z"]), "its origin is not finite"),
        each("model", "id", &positive("metres_per_unit"), "its unit is not above 0 m"),
        each("model", "id", &not_negative("snap_m"), "its snap is not 0 m or more"),
        each("model", "id", &boxed(), "its box is not one"),
        each(
            "model",
            "id",
            &all(vec![positive("area_m2"), positive("mean_patch_area_m2")]),
            "an area is not above 0 m2",
        ),
        each(
            "model",
            "id",
            // A mean of ones may be a rounding above one.
            &all(vec![within("mean_reflectance", "0", "1.000001"), within("max_reflectance", "0", "1")]),
            "a reflectance lies outside 0..=1",
        ),
        each(
            "model",
            "id",
            &all(["emitted_r_w", "emitted_g_w", "emitted_b_w"].map(not_negative).to_vec()),
            "a power is negative or not finite",
        ),
        each(
            "model",
            "id",
            &counts(&[
                "patches",
                "patches_uncut",
                "crossings",
                "contacts",
                "outlines",
                "clusters",
                "emitters",
                "input_polygons",
            ]),
            "a count is negative",
        ),
        each("clusters", "id", &boxed(), "its box is not one"),
        each("clusters", "id", &positive("area_m2"), "its area is not above 0 m2"),
        each(
            "clusters",
            "id",
            &all(vec![within("patches", "1", "256"), within("emitters", "0", "patches")]),
            "its patches or emitters can't be that many",
        ),
        each(
            "clusters",
            "id",
            "group_id IS NULL OR group_id IN (SELECT id FROM groups)",
            "it belongs to a group that is not there",
        ),
        rule(
            "clusters",
            "SELECT count(*) FROM clusters HAVING count(*) > 0 AND (min(id) <> 0 OR max(id) <> count(*) - 1)",
            "their numbers are not 0, 1, 2... without gaps",
        ),
        rule(
            "model",
            "SELECT clusters FROM model WHERE clusters <> (SELECT count(*) FROM clusters)",
            "there are not so many clusters",
        ),
        rule(
            "model",
            "SELECT patches FROM model WHERE patches <> (SELECT coalesce(sum(patches), 0) FROM clusters)",
            "the clusters do not have so many patches",
        ),
        rule("clusters", "SELECT id FROM clusters WHERE NOT EXISTS (SELECT 1 FROM model)", "there is no model"),
        each("groups", "id", &counts(&["clusters", "patches", "working_set_bytes"]), "a count is negative"),
        each("groups", "id", &finite(&["predicted_cost", "intra_group_share"]), "a figure is not finite"),
        rule(
            "groups",
            "SELECT count(*) FROM groups HAVING count(*) > 0 AND (min(id) <> 0 OR max(id) <> count(*) - 1)",
            "their numbers are not 0, 1, 2... without gaps",
        ),
        each("branches", "id", "id >= 0", "its number is negative"),
        each("solution_versions", "id", "id >= 0 AND iteration >= 0", "its number or iteration is negative"),
        each("solution_versions", "id", "parent IS NULL OR parent BETWEEN 0 AND id - 1", "its parent is not older"),
        rule(
            "solution_versions",
            "SELECT id FROM solution_versions WHERE parent NOT IN (SELECT id FROM solution_versions)",
            "its parent is not there",
        ),
        rule(
            "solution_versions",
            "SELECT id FROM solution_versions WHERE branch NOT IN (SELECT id FROM branches)",
            "its branch is not there",
        ),
        each("audits", "version", &counts(&["places", "points"]), "a count is negative"),
        rule(
            "audits",
            "SELECT version FROM audits WHERE version NOT IN (SELECT id FROM solution_versions)",
            "its version is not there",
        ),
        rule(
            "branches",
            "SELECT b.id FROM branches b JOIN solution_versions v ON v.branch = b.id
             WHERE b.base_version IS NOT NULL AND NOT b.base_version BETWEEN 0 AND v.id - 1",
            "it starts from a version that is not older than its own",
        ),
        rule(
            "branches",
            "SELECT id FROM branches WHERE base_version NOT IN (SELECT id FROM solution_versions)",
            "the version that it starts from is not there",
        ),
        rule(
            "branches",
            "SELECT 'none' FROM model WHERE NOT EXISTS (SELECT 1 FROM branches)",
            "there is a model, but no branch",
        ),
        rule(
            "solution_versions",
            "SELECT 'none' FROM model WHERE NOT EXISTS (SELECT 1 FROM solution_versions WHERE is_iteration_end = 1)",
            "there is a model, but no version ends an iteration",
        ),
    ];
    for (table, key, prefixes) in PLACES {
        for place in prefixes {
            let holds = format!(
                "{place}segment IS NULL OR ({place}segment IN (SELECT id FROM segments)
                 AND {place}offset >= 0 AND {place}bytes >= 0)"
            );
            rules.push(each(table, key, &holds, "it refers to a place that is in no segment"));
        }
    }
    rules
}

/// Every table with a row that can't be, and why: the first of each kind.
pub(super) fn broken(connection: &Connection) -> Result<Vec<(&'static str, String)>> {
    let mut found = Vec::new();
    for Rule { table, wrong, what } in rules() {
        let row = connection
            .prepare(&format!("SELECT CAST(({wrong} LIMIT 1) AS TEXT)"))?
            .query_row([], |row| row.get::<_, Option<String>>(0))
            .optional()?;
        if let Some(row) = row.flatten() {
            found.push((table, format!("table {table}, row {row}: {what}")));
        }
    }
    Ok(found)
}

impl Store {
    /// Every table with a row that can't be, and why.
    pub fn impossible_rows(&self) -> Result<Vec<(&'static str, String)>> {
        self.read(|| broken(self.connection()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::order::UpdateOrder;
    use crate::store::fixture;

    #[test]
    fn the_rows_of_a_solved_store_are_possible_and_each_rule_can_fail() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 5);
        fixture::partition(&store, 2);
        fixture::solve_all(&store, UpdateOrder::Jacobi, 2.0);
        assert_eq!(store.impossible_rows().unwrap(), []);
        store.connection().pragma_update(None, "foreign_keys", false).unwrap();
        for (table, sql) in [
            ("model", "UPDATE model SET metres_per_unit = 0"),
            ("model", "UPDATE model SET snap_m = -1"),
            ("model", "UPDATE model SET origin_x = 9e999"),
            ("model", "UPDATE model SET min_x_m = max_x_m + 1"),
            ("model", "UPDATE model SET area_m2 = 0"),
            ("model", "UPDATE model SET max_reflectance = 1.5"),
            ("model", "UPDATE model SET emitted_g_w = -1"),
            ("model", "UPDATE model SET clusters = 4"),
            ("model", "UPDATE model SET patches = patches + 1"),
            ("clusters", "UPDATE clusters SET id = 4000000000 WHERE id = 4"),
            ("clusters", "UPDATE clusters SET group_id = 9 WHERE id = 1"),
            ("clusters", "UPDATE clusters SET area_m2 = -1 WHERE id = 1"),
            ("clusters", "UPDATE clusters SET geometry_segment = 77 WHERE id = 2"),
            ("cluster_states", "UPDATE cluster_states SET segment = 77 WHERE cluster = 2"),
            ("cluster_materials", "UPDATE cluster_materials SET offset = -64 WHERE cluster = 2"),
            ("groups", "UPDATE groups SET id = 5 WHERE id = 1"),
            ("solution_versions", "UPDATE solution_versions SET parent = id"),
            ("solution_versions", "DELETE FROM solution_versions"),
            ("audits", "INSERT INTO audits VALUES (99, 1, 1, 1, NULL, NULL, NULL, NULL, '[]', 0)"),
            ("audits", "INSERT INTO audits VALUES (0, 1, 1, -1, NULL, NULL, NULL, NULL, '[]', 0)"),
            ("branches", "UPDATE branches SET base_version = 0"),
            ("branches", "DELETE FROM branches"),
        ] {
            let tx = store.connection().unchecked_transaction().unwrap();
            assert!(tx.execute(sql, []).unwrap() > 0, "{sql}");
            let found = broken(&tx).unwrap();
            assert!(found.iter().any(|(name, _)| *name == table), "{sql}: {found:?}");
        }
    }

    #[test]
    fn a_row_that_cannot_be_is_damage_though_its_seal_is_whole() {
        let dir = tempfile::tempdir().unwrap();
        let store = fixture::store(dir.path(), 5);
        store.require_sealed_rows().unwrap();
        store.write(|tx| Ok(tx.execute("UPDATE model SET snap_m = -1", [])?)).unwrap();
        assert_eq!(store.broken_seals().unwrap(), []);
        assert_eq!(store.require_sealed_rows().unwrap_err().exit_code(), 12);
    }
}
