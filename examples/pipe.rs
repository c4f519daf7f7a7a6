use clerestory::base::*;
use clerestory::stages::*;
use clerestory::store::Store;
use std::path::PathBuf;
use std::time::*;
struct P;
impl Progress for P {
    fn begin(&self, p: &str, _: &str, t: Option<u64>) {
        if std::env::var("V").is_ok() {
            eprintln!("{p} {t:?}");
        }
    }
    fn at(&self, _: u64) {}
    fn warn(&self, m: &str) {
        eprintln!("warn {m}");
    }
    fn interrupted(&self) -> bool {
        false
    }
}
fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let a: Vec<String> = std::env::args().collect();
    let dir = PathBuf::from(&a[2]);
    let tol: f64 = std::env::var("TOL").map(|s| s.parse().unwrap()).unwrap_or(0.02);
    let t0 = Instant::now();
    match a[1].as_str() {
        "solve" => {
            let o = ingest::Options {
                store: dir.clone(),
                models: vec![PathBuf::from(&a[3])],
                units: ingest::Units::M,
                up: None,
                both_sides: true,
                materials: None,
                emit_both: false,
                max_cluster_patches: 64,
                snap_m: None,
                memory: memory::MemoryBudget::DEFAULT,
                fresh: true,
                wait: Duration::from_secs(5),
            };
            let plan = ingest::plan(&o)?;
            let s = ingest::execute(plan, &P)?;
            println!("{:.1?} ingest {s:?}", t0.elapsed());
            let store = Store::open(&dir, Duration::from_secs(5))?;
            let vo = visibility::Options { missing: 0.005, seed: 1, workers: 2, memory_bytes: 512 << 20 };
            let s = visibility::execute(&visibility::plan(&store, &vo)?, &P)?;
            println!("{:.1?} visibility {s:?}", t0.elapsed());
            let po = partition::Options { method: None, groups: None, memory_bytes: 512 << 20 };
            let s = partition::execute(&partition::plan(&store, &po)?, &P)?;
            println!("{:.1?} partition {s:?}", t0.elapsed());
            for it in 0..20 {
                let ws: Vec<_> = (0..2)
                    .map(|_| {
                        std::process::Command::new(std::env::current_exe().unwrap())
                            .arg("work")
                            .arg(&dir)
                            .spawn()
                            .unwrap()
                    })
                    .collect();
                for mut w in ws {
                    let st = w.wait()?;
                    if !st.success() {
                        return Err("worker".into());
                    }
                }
                let m = merge::execute(&store, merge::plan(&store, &merge::Options {})?, &P)?;
                println!("{:.1?} it {it} {m:?}", t0.elapsed());
                if m.converged {
                    break;
                }
            }
        }
        "work" => {
            let store = Store::open(&dir, Duration::from_secs(5))?;
            let o = solve_group::Options {
                which: solve_group::Which::UntilDone,
                version: None,
                tolerance: tol,
                min_element_m: None,
                inner: solve_group::InnerOption::Converge,
                keep_links: true,
                link_cache_bytes: 32 << 20,
                order: Default::default(),
                schedule: clerestory::partition::schedule::Policy::FfdWs { delta: 16 },
                seed: 1,
                memory_bytes: 512 << 20,
            };
            let p = solve_group::plan(&store, &o)?;
            let s = solve_group::execute(&p, &|| Default::default(), &P)?;
            println!("{:.1?} worker min_el {} {s:?}", t0.elapsed(), p.min_element_m);
        }
        "sample" => {
            let store = Store::open(&dir, Duration::from_secs(5))?;
            let f = std::io::BufReader::new(std::fs::File::open(&a[3])?);
            let mut pts = clerestory::formats::points::PointReader::new(f, &PathBuf::from(&a[3]));
            let mut out = std::io::BufWriter::new(std::fs::File::create(&a[4])?);
            let s = sample::execute(&store, &Default::default(), &mut pts, &mut out, &P)?;
            println!("{:.1?} {s:?}", t0.elapsed());
        }
        "dbg" => {
            use clerestory::rays::node::Node;
            use clerestory::transport::source::{Clusters, Loaded};
            use clerestory::transport::{gather_point::*, link_rows};
            let store = Store::open(&dir, Duration::from_secs(5))?;
            let set = working_set::WorkingSet::open(&store, store.newest_version()?)?;
            let facts = store.facts()?;
            let (top, file) = store.ray_top()?.unwrap();
            let scene = clerestory::rays::RayScene::new(
                top.parse(clerestory::model::rays::TopRaysView::parse)?,
                &file,
                facts.snap_m,
            )
            .unwrap();
            let v: Vec<f64> = a[3].split(',').map(|x| x.parse().unwrap()).collect();
            let p =
                (glam::DVec3::new(v[0], v[1], v[2]) - glam::DVec3::from_array(facts.origin)) * facts.metres_per_unit;
            let n = glam::DVec3::new(v[3], v[4], v[5]);
            let depth: usize = a[4].parse()?;
            let place = scene.locate(p, n, facts.snap_m).unwrap();
            let mut stack = vec![(place.key.cluster, place.key.patch, place.side, p, 0usize)];
            while let Some((c, pa, side, p, d)) = stack.pop() {
                let id = ClusterId(c);
                let loaded = set.mapped(id)?;
                let view = loaded.view();
                let mut node = Node::root(id, &view.geometry.patches[pa as usize], PatchSide { patch: pa as u8, side });
                while view.light.has_children(node.name) {
                    node = node.child(clerestory::geom::quadtree::child_at(&node.shape, p));
                }
                println!(
                    "{}at {p} leaf {:?} H {:?} edge {:.3} cut {}",
                    "    ".repeat(d),
                    node.name,
                    view.light.find(node.name).unwrap().irradiance,
                    node.shape.longest_edge(),
                    clerestory::rays::region::is_cut(&scene, &node)
                );
                let chain = group_links::LinkStore::chain(&set, id, None)?;
                let views = chain.views()?;
                let mut all = vec![];
                link_rows::for_each_row(&views, |name, vw, range| {
                    if name.contains(node.name) {
                        for i in range {
                            all.push((name, link_rows::link_at(vw, i)));
                        }
                    }
                });
                let mut list = vec![];
                for (name, l) in all {
                    let s = set.cluster(l.source.cluster())?;
                    let sv = s.view();
                    let so = sv.source(l.source);
                    let sn = Node::at(sv.id, &sv.geometry.patches[l.source.patch_side().patch as usize], l.source);
                    list.push((f64::from(l.form_factor) * so.radiosity.0[0], name, l, so, sn));
                }
                list.sort_by(|a, b| b.0.total_cmp(&a.0));
                for (w, name, l, so, sn) in list.iter().take(6) {
                    println!(
                        "{}  {w:.6} depth {} <- {:?} F {:.5} unc {:.5} {:?} B {:.5} spread {:.4} div {} edge {:.3} at {:.3} cut {}",
                        "    ".repeat(d),
                        name.depth(),
                        l.source,
                        l.form_factor,
                        l.uncertainty,
                        l.class,
                        so.radiosity.0[0],
                        so.spread,
                        so.divided,
                        sn.shape.longest_edge(),
                        sn.shape.centroid(),
                        clerestory::rays::region::is_cut(&scene, sn)
                    );
                }
                if d < depth {
                    for (_, _, l, _, sn) in list.iter().take(2) {
                        stack.push((
                            l.source.cluster().0,
                            l.source.patch_side().patch.into(),
                            l.source.patch_side().side,
                            sn.shape.centroid(),
                            d + 1,
                        ));
                    }
                }
            }
        }
        _ => {}
    }
    Ok(())
}
