//! The rows of a group while it is relaxed: streamed from the store, what comes from within the group resolved to leaves
//! and held in a cache of bounded bytes.

use std::collections::HashMap;
use std::rc::Rc;

use super::working_set::WorkingSet;
use crate::base::{ClusterId, NodeName, PatchSide, Result};
use crate::model::ExtentKind;
use crate::model::links::{LinksView, for_each_row};
use crate::store::Extent;
use crate::store::tasks::UpdateRow;
use crate::transport::iterate::relax::{Inside, Member, Outside};
use crate::transport::light::line::Halves;
use crate::transport::light::lit::{Lights, LitCluster};
use crate::transport::row::{add, slots};
use crate::transport::source::exitance;

/// A cluster's link extents, base first.
pub enum Chain {
    /// As stored.
    Stored(Vec<Extent>),
    /// Made by this visit, and kept nowhere.
    InMemory(Rc<Vec<u64>>),
}

impl Chain {
    /// Those of a version, and `new` behind or instead of them.
    pub fn of(set: &WorkingSet<'_>, id: ClusterId, new: Option<&UpdateRow>) -> Result<Self> {
        let store = set.snapshot().store();
        let mut extents = match new {
            Some(row) if !row.delta => Vec::new(),
            _ => set.snapshot().links(id)?,
        };
        if let Some(row) = new {
            extents.push(store.extent(row.at, ExtentKind::Links)?);
        }
        Ok(Self::Stored(extents))
    }

    /// Their arrays.
    pub fn views(&self) -> Result<Vec<LinksView<'_>>> {
        match self {
            Self::Stored(extents) => extents.iter().map(|e| e.parse(LinksView::parse)).collect(),
            Self::InMemory(payload) => {
                let view = LinksView::parse(bytemuck::cast_slice(payload));
                Ok(vec![view.expect("just made")])
            }
        }
    }
}

/// Where rows of a group's clusters come from.
pub struct RowStore<'a, 's> {
    /// The version that is read.
    pub set: &'a WorkingSet<'s>,
    /// The group's clusters, ascending.
    pub clusters: &'a [ClusterId],
    /// Extents written by this visit.
    pub new: &'a [UpdateRow],
    /// The rows of each cluster, where links are not kept.
    pub in_memory: &'a [Rc<Vec<u64>>],
}

/// What a name of a dictionary stands for during a visit.
enum Place {
    /// A side of a member.
    Inside(u16, PatchSide),
    /// A side of another cluster.
    Outside(Rc<LitCluster>, PatchSide),
    /// Nowhere, or not asked for.
    Nowhere,
}

/// What comes from one place within the group to one slot of a row.
#[derive(Clone, Copy)]
struct Entry {
    leaf: u32,
    member: u16,
    slot: u16,
    at: [f32; 2],
}

/// Rows of a member with what comes from within the group.
#[derive(Default)]
struct Resolved {
    /// Number of the row in the mesh, its first entry, share of a ray.
    rows: Vec<(u32, u32, f32)>,
    entries: Vec<Entry>,
}

impl Resolved {
    fn bytes(&self) -> u64 {
        (size_of_val(self.rows.as_slice()) + size_of_val(self.entries.as_slice())) as u64
    }
}

/// Which places a name of a dictionary is looked up for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wanted {
    Outside,
    Inside,
}

impl RowStore<'_, '_> {
    fn chain(&self, index: usize) -> Result<Chain> {
        if let Some(payload) = self.in_memory.get(index) {
            return Ok(Chain::InMemory(payload.clone()));
        }
        let id = self.clusters[index];
        let new = self.new.iter().find(|r| r.cluster == id && r.kind == ExtentKind::Links);
        Chain::of(self.set, id, new)
    }

    fn places(&self, names: &[u64], wanted: Wanted) -> Result<Vec<Place>> {
        let place = |&name: &u64| {
            let name = NodeName(name);
            if name == NodeName::ESCAPE {
                return Ok(Place::Nowhere);
            }
            Ok(match self.clusters.binary_search(&name.cluster()) {
                Ok(_) if wanted == Wanted::Outside => Place::Nowhere,
                Ok(index) => Place::Inside(index as u16, name.patch_side()),
                Err(_) if wanted == Wanted::Inside => Place::Nowhere,
                Err(_) => Place::Outside(self.set.lit(name.cluster())?, name.patch_side()),
            })
        };
        names.iter().map(place).collect()
    }

    /// What comes to a member from within the group.
    fn resolve(&self, index: usize, members: &[Member]) -> Result<Resolved> {
        let chain = self.chain(index)?;
        let views = chain.views()?;
        let places: Vec<_> = views.iter().map(|v| self.places(v.sides, Wanted::Inside)).collect::<Result<_>>()?;
        let mut number = 0;
        let mut resolved = Resolved::default();
        for_each_row(&views, |of, head| {
            if head.part == 1 {
                let first = resolved.entries.len() as u32;
                resolved.rows.push((number, first, 1.0 / f32::from(head.rounds)));
                for (hit, slot) in views[of].entries(head).1.iter().zip(slots(head.open)) {
                    if let Place::Inside(member, side) = places[of][hit.side as usize] {
                        let lit = &members[usize::from(member)].lit;
                        let (leaf, at) = lit.leaf_at(side, lit.frame(side.patch).unpack(hit.at));
                        resolved.entries.push(Entry { leaf, member, slot: slot as u16, at });
                    }
                }
            }
            number += 1;
        });
        Ok(resolved)
    }
}

impl Outside for RowStore<'_, '_> {
    fn each(&self, index: usize, visit: &mut dyn FnMut(&Halves, f32)) -> Result<()> {
        let chain = self.chain(index)?;
        let views = chain.views()?;
        let places: Vec<_> = views.iter().map(|v| self.places(v.sides, Wanted::Outside)).collect::<Result<_>>()?;
        let exitances: Vec<Vec<[f32; 3]>> = views
            .iter()
            .map(|v| v.sides.iter().map(|&name| exitance(self.set, NodeName(name))).collect())
            .collect::<Result<_>>()?;
        for_each_row(&views, |of, head| {
            let (view, places) = (&views[of], &places[of]);
            let mut halves = Halves::default();
            let (shares, hits) = view.entries(head);
            let weight = 1.0 / f32::from(head.rounds);
            for share in shares {
                add(&mut halves, usize::from(share.slot()), exitances[of][share.lamp()], share.factor * weight);
            }
            let mut gone = 0u32;
            for (hit, slot) in hits.iter().zip(slots(head.open)) {
                gone += u32::from(view.sides[hit.side as usize] == NodeName::ESCAPE.0);
                if let Place::Outside(lit, side) = &places[hit.side as usize] {
                    add(&mut halves, slot, lit.leaving_from(*side, hit.at), weight);
                }
            }
            visit(&halves, gone as f32 / hits.len().max(1) as f32);
        });
        Ok(())
    }
}

/// What comes from within the group, held as far as there is room: what is held stays, since sweeps go round, and what
/// was used least recently is what is needed next.
pub struct GroupLinks<'a, 's> {
    store: &'a RowStore<'a, 's>,
    held: HashMap<usize, Resolved>,
    bytes: u64,
    limit_bytes: u64,
}

impl<'a, 's> GroupLinks<'a, 's> {
    /// An empty cache.
    #[must_use]
    pub fn new(store: &'a RowStore<'a, 's>, limit_bytes: u64) -> Self {
        Self { store, held: HashMap::new(), bytes: 0, limit_bytes }
    }
}

fn gather(resolved: &Resolved, member: &Member, members: &[Member], visit: &mut dyn FnMut(usize, &Halves)) {
    let ends = resolved.rows.iter().skip(1).map(|r| r.1).chain([resolved.entries.len() as u32]);
    for ((&(row, first, weight), end), external) in resolved.rows.iter().zip(ends).zip(&member.external) {
        let mut halves = *external;
        for entry in &resolved.entries[first as usize..end as usize] {
            let light = members[usize::from(entry.member)].lit.leaving(entry.leaf, entry.at);
            add(&mut halves, usize::from(entry.slot), light, weight);
        }
        visit(row as usize, &halves);
    }
}

impl Inside for GroupLinks<'_, '_> {
    fn each(&mut self, index: usize, members: &[Member], visit: &mut dyn FnMut(usize, &Halves)) -> Result<()> {
        if let Some(known) = self.held.get(&index) {
            gather(known, &members[index], members, visit);
            return Ok(());
        }
        let resolved = self.store.resolve(index, members)?;
        gather(&resolved, &members[index], members, visit);
        if self.bytes + resolved.bytes() <= self.limit_bytes {
            self.bytes += resolved.bytes();
            self.held.insert(index, resolved);
        }
        Ok(())
    }
}
