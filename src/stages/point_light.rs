//! The light at one place of a surface: a gather over the stored links of the elements that hold it,
//! or that of the element where no links are stored.

use std::rc::Rc;

use glam::DVec3;
use lru::LruCache;

use super::group_links::LinkStore;
use super::tolerances;
use super::working_set::WorkingSet;
use crate::base::{ClusterId, NodeName, PatchSide, Result, Rgb};
use crate::model::links::{LeafClosure, Visibility};
use crate::rays::RayScene;
use crate::rays::locate::Place;
use crate::store::ModelFacts;
use crate::transport::bundle::{Bundle, SideCache};
use crate::transport::gather_lamps;
use crate::transport::gather_point::{self, Gathered};
use crate::transport::lamp_list::LampTree;
use crate::transport::lamp_survey;
use crate::transport::link_rows::{self, Link};
use crate::transport::point_survey;
use crate::transport::source::{Clusters, Loaded};

/// Rows and closures of a receiving cluster, by name.
struct Rows {
    rows: Vec<(NodeName, Vec<Link>)>,
    closure: Vec<LeafClosure>,
    /// The lamps in sight, where they are surveyed.
    lamps: Option<LampTree>,
    /// At most so many bytes of links.
    bytes: usize,
}

/// Share of what arrives that a source's unresolved light may make up at a point.
const SOURCE_SHARE: f64 = 0.02;

/// Gathers at points of surfaces.
pub struct PointLight<'a, 's> {
    set: &'a WorkingSet<'s>,
    scene: RayScene<'a>,
    /// No element edge is below this, m.
    min_element_m: f64,
    sides: SideCache,
    /// Error of a source's light that does not matter, W/m2.
    allowed_w_m2: f64,
    held: LruCache<u32, Rc<Rows>>,
    held_bytes: usize,
    limit_bytes: usize,
    /// Rays cast so far.
    pub rays: u64,
}

impl<'a, 's> PointLight<'a, 's> {
    /// Over a version solved with elements no smaller than `min_element_m`, of a model with these `facts`. Holds
    /// `limit_bytes` of links, or those of one cluster: points come in runs.
    #[must_use]
    pub fn new(
        set: &'a WorkingSet<'s>,
        scene: RayScene<'a>,
        min_element_m: f64,
        facts: &ModelFacts,
        limit_bytes: usize,
    ) -> Self {
        Self {
            set,
            scene,
            min_element_m,
            sides: SideCache::default(),
            allowed_w_m2: SOURCE_SHARE * tolerances::typical_irradiance(facts),
            held: LruCache::unbounded(),
            held_bytes: 0,
            limit_bytes,
            rays: 0,
        }
    }

    /// Irradiance at a point (m from the store's origin) of a patch side, W/m2.
    pub fn irradiance(&mut self, at: Place, point: DVec3) -> Result<Rgb> {
        let id = ClusterId(at.key.cluster);
        let mapped = self.set.mapped(id)?;
        let leaf = mapped.view().leaf_at(PatchSide { patch: at.key.patch as u8, side: at.side }, point);
        let rows = self.rows(id)?;
        let closure = rows.closure.binary_search_by_key(&leaf.name.0, |c| c.leaf).ok().map(|i| &rows.closure[i]);
        // Exactly on the plane: what lies in it must not count as above or below.
        let on_plane = point - leaf.normal * leaf.height(point);
        let stored = mapped.view().light.find(leaf.name).map_or([0.0; 3], |e| e.irradiance);
        if rows.rows.is_empty() {
            // Links were discarded, or nothing shines here: the element knows as much as there is.
            return Ok(Rgb::from_f32(stored));
        }
        let typical_w_m2 = Rgb::from_f32(stored).max();
        let place = gather_point::Place { point: on_plane, leaf: &leaf, typical_w_m2, relative: SOURCE_SHARE };
        let mut gathered = Gathered::default();
        let survey = point_survey::survey(&self.scene, self.set, &place, self.min_element_m, &mut self.rays)?;
        let (mut linked, mut is_surveyed) = (Vec::new(), survey.is_gap);
        let mut above = Some(leaf.name);
        while let Some(name) = above {
            if let Ok(i) = rows.rows.binary_search_by_key(&name, |r| r.0) {
                for link in &rows.rows[i].1 {
                    if link.class == Visibility::Surveyed {
                        is_surveyed = true;
                        continue;
                    }
                    let source = self.set.cluster(link.source.cluster())?;
                    // In a gap what does not emit is followed.
                    if survey.is_gap && !source.view().emits(link.source) {
                        continue;
                    }
                    let sides = if link.source.is_sector() {
                        let lamp = Bundle::of(&self.sides, &source.view(), link.source);
                        lamp.sides().iter().map(|side| side.node.name).collect()
                    } else {
                        vec![link.source]
                    };
                    for side in sides {
                        linked.push(side.whole_side());
                        gather_point::add_link(
                            &self.scene,
                            &place,
                            &source.view(),
                            &Link { source: side, ..*link },
                            self.allowed_w_m2,
                            &mut gathered,
                            &mut self.rays,
                        );
                    }
                }
            }
            above = name.parent();
        }
        if let Some(lamps) = &rows.lamps {
            let rays = &mut self.rays;
            gather_lamps::add_lamps(&self.scene, self.set, &self.sides, &place, lamps, &survey, &mut gathered, rays)?;
            linked.extend(survey.emitters(self.set)?);
        }
        if is_surveyed {
            linked.sort_unstable();
            linked.dedup();
            let (before, rays) = (gathered, &mut self.rays);
            point_survey::add_survey(&self.scene, self.set, &survey, &linked, &mut gathered, rays)?;
            return Ok(gather_point::finish_surveyed(&before, &gathered, survey.met_share()));
        }
        let is_full = closure.is_some_and(|c| c.escape == 0.0 && c.unlinked == 0.0 && c.closed_sum > 0.8);
        Ok(gather_point::finish(&gathered, is_full))
    }

    fn rows(&mut self, id: ClusterId) -> Result<Rc<Rows>> {
        if let Some(known) = self.held.get(&id.0) {
            return Ok(known.clone());
        }
        let chain = LinkStore::chain(self.set, id, None)?;
        let views = chain.views()?;
        let bytes = views.iter().map(|v| v.packed.len()).sum::<usize>() * size_of::<Link>();
        while self.held_bytes + bytes > self.limit_bytes {
            let Some((_, dropped)) = self.held.pop_lru() else { break };
            self.held_bytes -= dropped.bytes;
        }
        self.held_bytes += bytes;
        let mut rows: Vec<(NodeName, Vec<Link>)> = Vec::new();
        link_rows::for_each_row(&views, |name, view, range| {
            rows.push((name, range.map(|i| link_rows::link_at(view, i)).collect()));
        });
        let closure = views.last().map_or_else(Vec::new, |newest| newest.closure.to_vec());
        let lamps = if rows.iter().any(|(_, row)| row.iter().any(lamp_survey::is_mark)) {
            Some(LampTree::of_clusters(self.set, &self.sides, &self.set.visible(id)?.0)?)
        } else {
            None
        };
        let rows = Rc::new(Rows { rows, closure, lamps, bytes });
        self.held.put(id.0, rows.clone());
        Ok(rows)
    }
}
