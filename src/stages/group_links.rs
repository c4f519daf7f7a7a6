//! The links of a group while it is relaxed: streamed from the store, with those inside the group
//! decoded to positions in a cache of bounded bytes; or, with `--links discard`, made again whenever
//! they have dropped out of it.

use std::collections::HashMap;

use super::working_set::WorkingSet;
use crate::base::{ClusterId, NodeName, Result, Rgb};
use crate::model::ExtentKind;
use crate::model::links::{LinksView, index_of};
use crate::store::Extent;
use crate::store::tasks::UpdateRow;
use crate::transport::link_rows::{self, Link};
use crate::transport::relax::{InnerLink, InnerLinks, Member};
use crate::transport::row_parts;
use crate::transport::source_memo::SourceMemo;

/// A cluster's link extents, base first.
pub struct Chain(Vec<Extent>);

impl Chain {
    /// Their arrays.
    pub fn views(&self) -> Result<Vec<LinksView<'_>>> {
        self.0.iter().map(|e| e.parse(LinksView::parse)).collect()
    }
}

/// Makes a cluster's links anew.
pub type Recompute<'a> = &'a dyn Fn(usize) -> Result<Vec<(NodeName, Vec<Link>)>>;

/// Where the links of a group's clusters come from.
pub struct LinkStore<'a, 's> {
    /// The version that is read.
    pub set: &'a WorkingSet<'s>,
    /// What links lead to.
    pub sources: &'a SourceMemo,
    /// The group's clusters, ascending.
    pub clusters: &'a [ClusterId],
    /// Link extents written by this visit.
    pub new: &'a [UpdateRow],
    /// For links that are not kept.
    pub recompute: Recompute<'a>,
    /// Whether links are kept.
    pub keep: bool,
}

/// Sources that links are asked for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// Those outside the group, by their radiosity.
    Outside,
    /// Those inside, by their position; the light of others is not looked up.
    Inside,
}

/// What the names of a dictionary stand for during a visit.
pub struct SourceTable(Vec<Place>);

#[derive(Clone, Copy)]
enum Place {
    Outside(Rgb),
    Inside(u32),
}

impl SourceTable {
    /// Radiosity of a source outside the group, W/m2.
    #[must_use]
    pub fn outside(&self, source: usize) -> Option<Rgb> {
        match self.0[source] {
            Place::Outside(radiosity) => Some(radiosity),
            Place::Inside(_) => None,
        }
    }

    /// Position of a source inside the group.
    #[must_use]
    pub fn inside(&self, source: usize) -> Option<u32> {
        match self.0[source] {
            Place::Outside(_) => None,
            Place::Inside(position) => Some(position),
        }
    }
}

impl<'s> LinkStore<'_, 's> {
    /// A cluster's extents: those of the version, and `new` behind or instead of them.
    pub fn chain(set: &WorkingSet<'s>, id: ClusterId, new: Option<&UpdateRow>) -> Result<Chain> {
        let store = set.snapshot().store();
        let mut extents = match new {
            Some(row) if !row.delta => Vec::new(),
            _ => set.snapshot().links(id)?,
        };
        if let Some(row) = new {
            extents.push(store.extent(row.at, ExtentKind::Links)?);
        }
        Ok(Chain(extents))
    }

    fn resolve(&self, names: &[u64], members: &[Member], wanted: Wanted) -> Result<SourceTable> {
        let mut places = Vec::with_capacity(names.len());
        for &name in names {
            let name = NodeName(name);
            places.push(match self.clusters.binary_search(&name.cluster()) {
                Ok(index) => {
                    let member = &members[index];
                    Place::Inside((member.first + member.mesh.position(name)) as u32)
                }
                Err(_) if wanted == Wanted::Inside => Place::Outside(Rgb::BLACK),
                Err(_) => Place::Outside(self.sources.source(self.set, name)?.light.radiosity),
            });
        }
        Ok(SourceTable(places))
    }

    /// Calls `visit` with every link of a member, in the order of the store: (sources, position of the
    /// receiver in the member's mesh, position of the source in the table, link).
    pub fn visit(
        &self,
        index: usize,
        members: &[Member],
        wanted: Wanted,
        mut visit: impl FnMut(&SourceTable, usize, usize, &Link),
    ) -> Result<()> {
        let mesh = &members[index].mesh;
        if !self.keep {
            for (receiver, row) in (self.recompute)(index)? {
                let names: Vec<u64> = row.iter().map(|l| l.source.0).collect();
                let table = self.resolve(&names, members, wanted)?;
                for (at, link) in row.iter().enumerate() {
                    visit(&table, mesh.position(receiver), at, link);
                }
            }
            return Ok(());
        }
        let id = self.clusters[index];
        let new = self.new.iter().find(|r| r.cluster == id && r.kind == ExtentKind::Links);
        let chain = Self::chain(self.set, id, new)?;
        let views = chain.views()?;
        let tables: Vec<_> = views.iter().map(|v| self.resolve(v.sources, members, wanted)).collect::<Result<_>>()?;
        link_rows::for_each_row(&views, |receiver, view, range| {
            let table = &tables[views.iter().position(|v| std::ptr::eq(v, view)).expect("one of the views")];
            let receiver = mesh.position(receiver);
            for at in range {
                visit(table, receiver, index_of(view.packed[at]), &link_rows::link_at(view, at));
            }
        });
        Ok(())
    }
}

/// Links within the group, decoded, as many as there is room for. A member's links are counted when they are first
/// streamed and held from the second time on: so no more is taken than they need. What is held stays: sweeps go round,
/// and what was used least recently is what is needed next.
pub struct GroupLinks<'a, 's> {
    store: &'a LinkStore<'a, 's>,
    held: HashMap<usize, Vec<InnerLink>>,
    /// Links of members streamed before.
    counts: HashMap<usize, usize>,
    bytes: u64,
    limit_bytes: u64,
    reused: u64,
    recomputed: u64,
}

impl<'a, 's> GroupLinks<'a, 's> {
    /// An empty cache.
    #[must_use]
    pub fn new(store: &'a LinkStore<'a, 's>, limit_bytes: u64) -> Self {
        let (held, counts) = (HashMap::new(), HashMap::new());
        Self { store, held, counts, bytes: 0, limit_bytes, reused: 0, recomputed: 0 }
    }

    /// Links used again without being evaluated again.
    #[must_use]
    pub fn reused(&self) -> u64 {
        self.reused
    }

    /// Links evaluated again because they had been dropped.
    #[must_use]
    pub fn recomputed(&self) -> u64 {
        self.recomputed
    }

    /// Room for a member's links, if there is any.
    fn room(&self, index: usize) -> Option<Vec<InnerLink>> {
        // Links that would have to be made again are worth holding at once.
        let count = if self.store.keep { *self.counts.get(&index)? } else { 0 };
        self.has_room(count).then(|| Vec::with_capacity(count))
    }

    fn has_room(&self, links: usize) -> bool {
        self.bytes + bytes_of(links) <= self.limit_bytes
    }
}

fn bytes_of(links: usize) -> u64 {
    (links * size_of::<InnerLink>()) as u64
}

impl InnerLinks for GroupLinks<'_, '_> {
    fn each(&mut self, index: usize, members: &[Member], visit: &mut dyn FnMut(&InnerLink)) -> Result<()> {
        if let Some(known) = self.held.get(&index) {
            self.reused += known.len() as u64;
            known.iter().for_each(visit);
            return Ok(());
        }
        let mut held = self.room(index);
        let mut count = 0;
        let mesh = &members[index].mesh;
        self.store.visit(index, members, Wanted::Inside, |table, receiver, source, link| {
            if let Some(source) = table.inside(source)
                && link.form_factor > 0.0
            {
                let error = row_parts::error(link, mesh.is_leaf_at(receiver)) as f32;
                let link = InnerLink { receiver: receiver as u32, source, form_factor: link.form_factor, error };
                count += 1;
                visit(&link);
                if let Some(held) = &mut held {
                    held.push(link);
                }
            }
        })?;
        self.counts.insert(index, count);
        if self.store.keep {
            self.reused += count as u64;
        } else {
            self.recomputed += count as u64;
        }
        if let Some(mut links) = held {
            links.shrink_to_fit();
            if self.has_room(links.capacity()) {
                self.bytes += bytes_of(links.capacity());
                self.held.insert(index, links);
            }
        }
        Ok(())
    }
}
