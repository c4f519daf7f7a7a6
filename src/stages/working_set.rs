//! What a task may read: clusters of one version, mapped as needed. The cache holds places in
//! mappings, not their bytes.

use std::cell::{OnceCell, RefCell};
use std::num::NonZeroUsize;
use std::rc::Rc;

use lru::LruCache;

use crate::base::text::for_shell;
use crate::base::{ClusterId, Error, Result};
use crate::model::ExtentKind;
use crate::model::geometry::{GeometryView, SideMaterial};
use crate::model::layout::Arrays;
use crate::model::light::LightView;
use crate::model::visibility::{VisibilityHead, VisibilityView};
use crate::rays::Emitters;
use crate::store::{Extent, Snapshot, Store};
use crate::transport::light::lit::{Lights, LitCluster};
use crate::transport::nodes::mesh::Mesh;
use crate::transport::source::{ClusterView, Clusters, Loaded};

/// Clusters remembered: under 1 KiB each.
const REMEMBERED: NonZeroUsize = NonZeroUsize::new(8192).expect("not 0");

/// A cluster's mapped extents; parsed once when loaded, so that later parses cannot fail.
pub struct MappedCluster {
    id: ClusterId,
    geometry: Extent,
    materials: Extent,
    light: Extent,
}

fn side_materials(payload: &[u8]) -> std::result::Result<&[SideMaterial], String> {
    Arrays::new(payload).get(0)
}

impl MappedCluster {
    fn load(snapshot: &Snapshot<'_>, id: ClusterId) -> Result<Self> {
        let geometry = snapshot.need(ExtentKind::Geometry, id)?;
        let materials = snapshot.need(ExtentKind::Materials, id)?;
        let light = snapshot.need(ExtentKind::Radiosity, id)?;
        let (shapes, lit) = (geometry.parse(GeometryView::parse)?, light.parse(LightView::parse)?);
        let sides = 2 * shapes.patches.len();
        if materials.parse(side_materials)?.len() != sides {
            return Err(materials.damage("not two materials per patch"));
        }
        if lit.level(0).len() != sides {
            return Err(light.damage("not two roots per patch"));
        }
        Ok(Self { id, geometry, materials, light })
    }

    /// The payload of its radiosity extent.
    #[must_use]
    pub fn light_payload(&self) -> &[u8] {
        self.light.payload()
    }
}

impl Loaded for MappedCluster {
    fn view(&self) -> ClusterView<'_> {
        const CHECKED: &str = "parsed when it was loaded";
        ClusterView {
            id: self.id,
            geometry: GeometryView::parse(self.geometry.payload()).expect(CHECKED),
            materials: side_materials(self.materials.payload()).expect(CHECKED),
            light: LightView::parse(self.light.payload()).expect(CHECKED),
        }
    }
}

fn emitters(snapshot: &Snapshot<'_>) -> Result<Emitters> {
    // The catalogue counts emitters in the materials of the last ingest.
    let counts_hold = snapshot.store().has_ingested_materials(snapshot.version())?;
    let mut emitters = Emitters::default();
    for cluster in snapshot.clusters() {
        let cluster = cluster?;
        if counts_hold && cluster.emitters == 0 {
            continue;
        }
        let materials = snapshot.need(ExtentKind::Materials, cluster.id)?;
        let sides: &[SideMaterial] = materials.parse(side_materials)?;
        let emitting = sides.iter().enumerate().filter(|(_, side)| side.exitance != [0.0; 3]);
        emitters.add(cluster.id.0, emitting.map(|(i, _)| i));
    }
    Ok(emitters)
}

/// Bytes of light, ready to be looked up, that are held.
const LIT_BYTES: usize = 48 << 20;

struct LitCache {
    held: LruCache<u32, Rc<LitCluster>>,
    bytes: usize,
}

/// Clusters of one version.
pub struct WorkingSet<'s> {
    snapshot: Snapshot<'s>,
    clusters: RefCell<LruCache<u32, Rc<MappedCluster>>>,
    lit: RefCell<LitCache>,
    emitters: OnceCell<Emitters>,
}

impl<'s> WorkingSet<'s> {
    /// Opens a version.
    pub fn open(store: &'s Store, version: u64) -> Result<Self> {
        Ok(Self {
            snapshot: Snapshot::at(store, version)?,
            clusters: RefCell::new(LruCache::new(REMEMBERED)),
            lit: RefCell::new(LitCache { held: LruCache::unbounded(), bytes: 0 }),
            emitters: OnceCell::new(),
        })
    }

    /// The version.
    #[must_use]
    pub fn snapshot(&self) -> &Snapshot<'s> {
        &self.snapshot
    }

    /// The sides that emit; looked for once, since all groups of a version share them.
    pub fn emitters(&self) -> Result<&Emitters> {
        if let Some(known) = self.emitters.get() {
            return Ok(known);
        }
        let found = emitters(&self.snapshot)?;
        Ok(self.emitters.get_or_init(|| found))
    }

    /// A cluster.
    pub fn mapped(&self, id: ClusterId) -> Result<Rc<MappedCluster>> {
        let load = || MappedCluster::load(&self.snapshot, id).map(Rc::new);
        self.clusters.borrow_mut().try_get_or_insert(id.0, load).cloned()
    }

    /// Clusters that `id` may exchange light with, ascending, and how that was found.
    pub fn visible(&self, id: ClusterId) -> Result<(Vec<ClusterId>, VisibilityHead)> {
        let Some(list) = self.snapshot.extent(ExtentKind::Visibility, id)? else {
            return Err(Error::StageMissing {
                message: format!("cluster {id} has no visibility list"),
                help: format!("run `clerestory visibility {}` first", for_shell(self.snapshot.store().dir())),
            });
        };
        let view = list.parse(VisibilityView::parse)?;
        Ok((view.clusters.iter().map(|c| ClusterId(c.cluster)).collect(), *view.head))
    }

    /// Clusters remembered now, with the version: what a schedule may count on.
    #[must_use]
    pub fn remembered(&self) -> Vec<(ClusterId, u64)> {
        let version = self.snapshot.version();
        let mut ids: Vec<_> = self.clusters.borrow().iter().map(|(id, _)| (ClusterId(*id), version)).collect();
        ids.sort_unstable();
        ids
    }
}

impl Clusters for WorkingSet<'_> {
    fn cluster(&self, id: ClusterId) -> Result<Rc<dyn Loaded>> {
        Ok(self.mapped(id)?)
    }
}

impl Lights for WorkingSet<'_> {
    fn lit(&self, id: ClusterId) -> Result<Rc<LitCluster>> {
        let cache = &mut *self.lit.borrow_mut();
        if let Some(known) = cache.held.get(&id.0) {
            return Ok(known.clone());
        }
        let mapped = self.mapped(id)?;
        let view = mapped.view();
        let mesh = Mesh::load(id, view.geometry.patches, &view.light);
        let lit = Rc::new(LitCluster::of(&mesh, view.geometry.patches, view.materials));
        cache.bytes += lit.bytes();
        cache.held.put(id.0, lit.clone());
        while cache.bytes > LIT_BYTES && cache.held.len() > 1 {
            if let Some((_, dropped)) = cache.held.pop_lru() {
                cache.bytes -= dropped.bytes();
            }
        }
        Ok(lit)
    }
}
