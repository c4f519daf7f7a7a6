//! The audit of stored light: what `run` and `audit` say of it, against light that is known otherwise.

mod support;

use std::path::Path;
use std::time::Duration;

use clerestory::base::Quiet;
use clerestory::geom::polygon::Polygon;
use clerestory::model::audit::{Audit, AuditFigures};
use clerestory::stages::audit;
use clerestory::store::Store;
use clerestory::transport::kernel::form_factor::point_to_polygon;
use glam::DVec3;
use serde_json::Value;
use support::clerestory;

/// A room of 4 x 3 x 2 m whose ceiling emits 1 W/m2, and whose floor and walls reflect `rho`.
fn room(dir: &Path, rho: f64) {
    let obj = "mtllib m.mtl\no room\nv 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nv 0 0 2\nv 4 0 2\nv 4 3 2\nv 0 3 2\nusemtl wall\n\
               f 1 2 3 4\nf 5 6 2 1\nf 6 7 3 2\nf 7 8 4 3\nf 8 5 1 4\no lamp\nusemtl lamp\nf 8 7 6 5\n";
    let radiance = std::f64::consts::FRAC_1_PI;
    let mtl =
        format!("newmtl wall\nKd {rho} {rho} {rho}\nnewmtl lamp\nKd 0 0 0\nKe {radiance} {radiance} {radiance}\n");
    std::fs::write(dir.join("room.obj"), obj).unwrap();
    std::fs::write(dir.join("m.mtl"), mtl).unwrap();
}

/// Solves it with further flags; exit code and document.
fn run(dir: &Path, more: &[&str]) -> (i32, Value) {
    let args = ["run", "room.obj", "--workers", "1", "--groups", "1", "--json", "--progress", "none"];
    let out = clerestory(dir, &[&args, more].concat());
    let document = serde_json::from_slice(&out.stdout);
    (out.status.code().unwrap(), document.unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&out.stderr))))
}

fn document(dir: &Path, args: &[&str]) -> Value {
    let out = clerestory(dir, &[args, &["--json"]].concat());
    assert_eq!(out.status.code(), Some(0), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn number(document: &Value, key: &str) -> f64 {
    document[key].as_f64().unwrap_or_else(|| panic!("{key}: {document}"))
}

/// What an audit of a store finds: error, standard error, bias and its standard error.
fn audited(store: &Path, seed: u64, places: u64) -> [f64; 4] {
    let store = Store::open(store, Duration::from_secs(5)).unwrap();
    let options = audit::Options { places, seed, version: None, threads: 2, memory: support::MEMORY };
    let figures = audit::execute(&audit::plan(&store, &options).unwrap(), &Quiet).unwrap().figures;
    [figures.audited_nrms, figures.audited_se, figures.audited_bias, figures.bias_se].map(Option::unwrap)
}

/// Points every 10 cm on the insides of floor and walls, m: where, and the normal.
fn points() -> Vec<(DVec3, DVec3)> {
    let size = DVec3::new(4.0, 3.0, 2.0);
    let mut points = Vec::new();
    for (axis, sign) in [(2, 1.0), (0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut normal = DVec3::ZERO;
        normal[axis] = sign;
        for i in 0..(size[u] * 10.0) as u32 {
            for j in 0..(size[v] * 10.0) as u32 {
                let mut point = DVec3::ZERO;
                point[axis] = if sign > 0.0 { 0.0 } else { size[axis] };
                (point[u], point[v]) = (0.1 * f64::from(i) + 0.05, 0.1 * f64::from(j) + 0.05);
                points.push((point, normal));
            }
        }
    }
    points
}

/// Where nothing reflects the light is known in closed form, and with it the error of what is stored.
#[test]
fn of_twenty_seeds_most_find_the_true_error_within_three_standard_errors() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), 0.0);
    assert_eq!(run(dir.path(), &["--quality", "preview", "--audit", "0"]).0, 0);
    let ceiling = Polygon::new(&[(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)].map(|(x, y)| DVec3::new(x, y, 2.0)));
    let points = points();
    let line = |(at, n): &(DVec3, DVec3)| format!("{},{},{},{},{},{}\n", at.x, at.y, at.z, n.x, n.y, n.z);
    let table: String = points.iter().map(line).collect();
    std::fs::write(dir.path().join("p.csv"), format!("x,y,z,nx,ny,nz\n{table}")).unwrap();
    let out = clerestory(dir.path(), &["sample", "room.clr", "--points", "p.csv", "--stored", "-o", "-", "-q"]);
    let stored = String::from_utf8(out.stdout).unwrap();
    let (mut error, mut norm, mut sums) = (0.0, 0.0, [0.0; 2]);
    for (row, (at, normal)) in stored.lines().skip(1).zip(&points) {
        let stored: f64 = row.split(',').nth(6).unwrap().parse().unwrap();
        let truth = point_to_polygon(*at, *normal, &ceiling);
        (error, norm) = (error + (stored - truth).powi(2), norm + truth * truth);
        sums = [sums[0] + stored, sums[1] + truth];
    }
    let (truth, bias) = ((error / norm).sqrt(), sums[0] / sums[1] - 1.0);
    assert!(truth > 0.01, "{truth}");
    let all: Vec<[f64; 4]> = (1..=20).map(|seed| audited(&dir.path().join("room.clr"), seed, 256)).collect();
    let within = all.iter().filter(|[found, error, ..]| (found - truth).abs() <= 3.0 * error).count();
    assert!(within >= 17, "{within} of 20 for {truth}: {all:?}");
    let within = all.iter().filter(|[.., found, error]| (found - bias).abs() <= 3.0 * error).count();
    assert!(within >= 17, "{within} of 20 for a bias of {bias}: {all:?}");
    assert!(all.iter().all(|[_, error, ..]| *error < 0.3 * truth), "{all:?}");
}

#[test]
fn bounces_that_are_missing_show_in_the_bias_alone_and_in_what_run_says() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), 0.8);
    let (code, early) = run(dir.path(), &["--quality", "draft", "--max-iterations", "1", "--inner", "1"]);
    assert_eq!(code, 3, "{early}");
    let [.., bias, error] = audited(&dir.path().join("room.clr"), 1, 256);
    assert!(bias < -0.1 && error < 0.03, "{bias} +- {error}");
    assert_eq!(number(&early, "audited_bias"), bias, "the same places, whoever asks");
    let (code, late) = run(dir.path(), &["--quality", "draft"]);
    assert_eq!((code, late["converged"].as_bool()), (0, Some(true)), "{late}");
    let [.., bias, error] = audited(&dir.path().join("room.clr"), 1, 256);
    assert!(bias.abs() < 3.0 * error, "{bias} +- {error}");
    let (audited, error, estimated) =
        (number(&late, "audited_nrms"), number(&late, "audited_se"), number(&late, "estimated_nrms"));
    assert!((audited - estimated).abs() < 3.0 * error + 0.5 * estimated, "{late}");
}

#[test]
fn an_audit_depends_on_version_seed_and_places_alone_and_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), 0.5);
    assert_eq!(run(dir.path(), &["--quality", "preview", "--audit", "64"]).0, 0);
    let ask = |more: &[&str]| document(dir.path(), &[&["audit", "room.clr", "--places", "100"], more].concat());
    let (first, again, other) = (ask(&[]), ask(&["--memory", "64M"]), ask(&["--seed", "2"]));
    for key in ["points", "audited_nrms", "audited_se", "audited_bias", "estimated_nrms", "worst"] {
        assert!(!first[key].is_null() && first[key] == again[key], "{key}: {first} {again}");
    }
    assert_eq!(first["points"], 100);
    assert_ne!(first["audited_nrms"], other["audited_nrms"]);
    let worst = first["worst"].as_array().unwrap();
    assert_eq!(worst.len(), 10);
    assert_eq!((worst[0]["object"].as_str(), worst[0]["cluster"].is_u64()), (Some("room"), true), "{worst:?}");
    for key in ["point_m", "stored_w_m2", "gathered_w_m2"] {
        assert_eq!(worst[0][key].as_array().map(Vec::len), Some(3), "{key}: {worst:?}");
    }
    let text = clerestory(dir.path(), &["audit", "room.clr", "--places", "100", "--dry-run"]);
    assert!(String::from_utf8_lossy(&text.stdout).contains("100 places"), "{text:?}");
    let catalogue = rusqlite::Connection::open(dir.path().join("room.clr/scene.sqlite")).unwrap();
    let mut query = catalogue.prepare("SELECT places, seed, audited_nrms FROM v_audit ORDER BY 1, 2").unwrap();
    let rows = query.query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?))).unwrap();
    let rows: Vec<(u64, u64, f64)> = rows.map(Result::unwrap).collect();
    assert_eq!(rows.iter().map(|row| (row.0, row.1)).collect::<Vec<_>>(), [(64, 1), (100, 1), (100, 2)]);
    assert_eq!(rows[1].2, number(&first, "audited_nrms"));
}

#[test]
fn a_run_whose_audit_contradicts_it_has_not_converged_and_ends_with_3() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), 0.5);
    let (code, document) = run(dir.path(), &["--quality", "preview"]);
    assert_eq!((code, document["converged"].as_bool()), (0, Some(true)), "{document}");
    let store = Store::open(&dir.path().join("room.clr"), Duration::from_secs(5)).unwrap();
    let found = store.audit(document["version"].as_u64().unwrap()).unwrap().unwrap();
    // As if more places had found what 256 have missed.
    let figures = AuditFigures { audited_nrms: Some(0.2), audited_se: Some(0.02), ..found.figures };
    store.put_audit(&Audit { places: 257, figures, ..found }).unwrap();
    drop(store);
    let out = clerestory(dir.path(), &["run", "--store", "room.clr", "--quality", "preview", "--json"]);
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(3), "{said}");
    assert!(
        said.contains("the audited error of the stored light is 20.00 % +- 2.00 %") && said.contains("help: "),
        "{said}"
    );
    let document: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((document["converged"].as_bool(), number(&document, "audited_nrms")), (Some(false), 0.2), "{document}");
}

#[test]
fn a_run_audits_unless_told_not_to_and_a_dark_model_has_nothing_to_audit() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), 0.5);
    let (_, left_out) = run(dir.path(), &["--quality", "preview", "--audit", "0"]);
    assert!(left_out["audited_nrms"].is_null() && left_out["estimated_nrms"].is_f64(), "{left_out}");
    let (code, document) = run(dir.path(), &["--quality", "preview"]);
    assert!(code == 0 && number(&document, "audited_nrms") < 0.15, "{document}");
    let out = clerestory(dir.path(), &["run", "--store", "room.clr", "--progress", "none"]);
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(said.contains("estimated ") && said.contains(" %, audited ") && said.contains("room at "), "{said}");
    std::fs::write(dir.path().join("m.mtl"), "newmtl wall\nKd 0.5 0.5 0.5\n").unwrap();
    let (code, dark) = run(dir.path(), &["--quality", "preview", "--store", "dark.clr"]);
    assert!(code == 0 && dark["audited_nrms"].is_null(), "{dark}");
    let dark = self::document(dir.path(), &["audit", "dark.clr"]);
    assert!(dark["points"] == 0 && dark["audited_nrms"].is_null() && dark["worst"] == serde_json::json!([]), "{dark}");
}
