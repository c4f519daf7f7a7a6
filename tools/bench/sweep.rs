//! Gathers over the stored rows of the solved office as one group, on one core: `cargo bench --bench sweep`. One JSON
//! line a figure.

mod common;

use std::hint::black_box;

use clerestory::base::{ClusterId, NodeName, Quiet, Result};
use clerestory::model::links::for_each_row;
use clerestory::stages::group_links::{Chain, GroupLinks, RowStore};
use clerestory::stages::ray_scene::with_scene;
use clerestory::stages::working_set::WorkingSet;
use clerestory::store::{Snapshot, Store};
use clerestory::transport::iterate::relax::{Inner, Inside, Member, Shapes, relax, take_over};
use clerestory::transport::light::lit::LitCluster;
use clerestory::transport::nodes::mesh::Mesh;
use clerestory::transport::refine::Sides;
use clerestory::transport::source::{ClusterView, Loaded};

const SEED: u64 = 1;
/// Sweeps that are timed together.
const SWEEPS: u32 = 8;

struct Shaped<'a, 's> {
    set: &'a WorkingSet<'s>,
    clusters: &'a [ClusterId],
    sides: Vec<Sides>,
}

impl Shapes for Shaped<'_, '_> {
    fn with(&self, index: usize, with: &mut dyn FnMut(&ClusterView<'_>, &Sides)) -> Result<()> {
        with(&self.set.mapped(self.clusters[index])?.view(), &self.sides[index]);
        Ok(())
    }
}

fn member(view: &ClusterView<'_>) -> Member {
    let mesh = Mesh::load(view.id, view.geometry.patches, &view.light);
    let lit = LitCluster::of(&mesh, view.geometry.patches, view.materials);
    let (materials, above) = (view.materials.to_vec(), mesh.rows_above());
    Member { mesh, materials, lit, above, external: Vec::new(), escapes: Vec::new() }
}

/// Entries of a cluster that come from surfaces.
fn entries(set: &WorkingSet<'_>, id: ClusterId) -> Result<usize> {
    let chain = Chain::of(set, id, None)?;
    let views = chain.views()?;
    let mut count = 0;
    for_each_row(&views, |of, row| {
        let is_surface = |side: u32| views[of].sides[side as usize] != NodeName::ESCAPE.0;
        count += views[of].entries(row).1.iter().filter(|hit| is_surface(hit.side)).count();
    });
    Ok(count)
}

/// Gathers over all rows.
fn sweep(links: &mut GroupLinks<'_, '_>, members: &[Member]) -> Result<()> {
    for index in 0..members.len() {
        links.each(index, members, &mut |row, halves| {
            black_box((row, halves));
        })?;
    }
    Ok(())
}

fn measure(store: &Store) -> Result<()> {
    let set = WorkingSet::open(store, Snapshot::newest(store)?.version())?;
    let clusters = set.snapshot().clusters().map(|c| c.map(|c| c.id)).collect::<Result<Vec<_>>>()?;
    let rows = RowStore { set: &set, clusters: &clusters, new: &[], in_memory: &[] };
    let (mut members, mut shapes) = (Vec::new(), Shaped { set: &set, clusters: &clusters, sides: Vec::new() });
    let mut count = 0;
    with_scene(&set, |open| {
        for &id in &clusters {
            let loaded = set.mapped(id)?;
            members.push(member(&loaded.view()));
            shapes.sides.push(Sides::of(&loaded.view(), &open.scene));
            count += entries(&set, id)?;
        }
        Ok(())
    })?;
    let (count, same) = (count as f64, (SEED, [1.0; 3]));
    take_over(&mut members, &shapes, &rows, same, &Quiet)?;
    let (mut links, first_s) = common::best(|| {
        let mut links = GroupLinks::new(&rows, u64::MAX);
        sweep(&mut links, &members)?;
        Ok(links)
    })?;
    let ((), sweeps_s) = common::best(|| (0..SWEEPS).try_for_each(|_| sweep(&mut links, &members)))?;
    let sweep_s = sweeps_s / f64::from(SWEEPS);
    let (_, relaxed_s) =
        common::best(|| relax(&mut members, &shapes, &mut links, Inner::Gathers(SWEEPS), same, &Quiet))?;
    common::print("office", "stored_links", count, "1");
    common::print("office", "name_resolution_per_s_core", count / (first_s - sweep_s), "1/s");
    common::print("office", "stored_link_sweep_per_s_core", count / sweep_s, "1/s");
    // With lines fitted to what arrives, pushed and pulled.
    common::print("office", "relaxed_links_per_s_core", f64::from(SWEEPS) * count / relaxed_s, "1/s");
    Ok(())
}

fn main() -> Result<()> {
    common::with_office("standard", measure)
}
