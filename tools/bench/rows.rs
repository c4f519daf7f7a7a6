//! Measures all rows of the solved office anew, on one core: `cargo bench --bench rows`. One JSON line a figure.

mod common;

use clerestory::base::{Quiet, Result};
use clerestory::stages::link_extent::ChainRows;
use clerestory::stages::ray_scene::with_scene;
use clerestory::stages::working_set::WorkingSet;
use clerestory::store::{Snapshot, Store};
use clerestory::transport::measure::lamps::LightTree;
use clerestory::transport::norm::Norm;
use clerestory::transport::refine::{Around, Context, Sides, refine};
use clerestory::transport::row::Row;
use clerestory::transport::source::Loaded;

const SEED: u64 = 1;

fn measure(store: &Store) -> Result<()> {
    let set = WorkingSet::open(store, Snapshot::newest(store)?.version())?;
    with_scene(&set, |open| {
        let context = Context {
            scene: open.scene,
            clusters: &set,
            lights: &set,
            seed: SEED,
            threshold: f64::INFINITY,
            norm: Norm::UNKNOWN,
            gain: [1.0; 3],
            min_element_m: 0.0,
            made_bytes: u64::MAX,
            progress: &Quiet,
        };
        let mut clusters = Vec::new();
        for cluster in set.snapshot().clusters() {
            let loaded = set.mapped(cluster?.id)?;
            let view = loaded.view();
            let lamps = LightTree::of_clusters(&set, &set.visible(view.id)?.0)?;
            let around = Around { lamps, ..Around::default() };
            clusters.push((loaded.clone(), Sides::of(&view, &open.scene), around));
        }
        // Of rows that nobody has kept the light knows how they were measured.
        let ([rows, entries, rays], cpu_s) = common::best(|| {
            let mut done = [0; 3];
            for (loaded, sides, around) in &clusters {
                let none = ChainRows::of(&[]);
                let refined = refine(&context, loaded.view(), sides, around, &none, &mut |_| unreachable!())?;
                let entries = refined.made.iter().map(Row::len).sum::<usize>();
                let counts = [refined.made.len() as u64, entries as u64, refined.counts.rays];
                done = std::array::from_fn(|i| done[i] + counts[i]);
            }
            Ok(done.map(|count| count as f64))
        })?;
        common::print("office", "row_entries", entries, "1");
        common::print("office", "row_entries_per_s_core", entries / cpu_s, "1/s");
        common::print("office", "row_rays_per_s_core", rays / cpu_s, "1/s");
        common::print("office", "rows_per_s_core", rows / cpu_s, "1/s");
        Ok(())
    })
}

fn main() -> Result<()> {
    common::with_office("draft", measure)
}
