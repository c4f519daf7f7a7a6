//! A cluster's rows during a visit: brought up to date, and what changed of them written. Those made are held up to a number
//! of bytes, then put away in the segment and read back through the mapping, like those of earlier visits.

use std::rc::Rc;

use super::group_links::Chain;
use super::group_solver::GroupSolver;
use super::link_extent::{ChainRows, LinkExtent, live_bytes};
use crate::base::{ClusterId, NodeName, Result};
use crate::model::ExtentKind;
use crate::model::figures::Work;
use crate::model::links::{LinksView, for_each_row};
use crate::store::tasks::UpdateRow;
use crate::store::{Extent, SegmentWriter, segment};
use crate::transport::measure::lamps::LightTree;
use crate::transport::nodes::mesh::Mesh;
use crate::transport::refine::{self, Around, PutAway, Refined, Sides};
use crate::transport::row::{Hit, Kept, Part, Row};
use crate::transport::source::ClusterView;

/// A cluster after its rows were brought up to date.
pub struct RowsNow {
    /// Its elements and rows.
    pub mesh: Mesh,
    /// What was written of the rows, if any changed.
    pub written: Option<UpdateRow>,
    /// All of them, where links are kept nowhere.
    pub in_memory: Option<Rc<Vec<u64>>>,
}

impl GroupSolver<'_, '_> {
    /// Brings a cluster's rows up to date. Adds what was done.
    pub(super) fn rows(
        &self,
        id: ClusterId,
        view: &ClusterView<'_>,
        sides: &Sides,
        writer: &mut SegmentWriter,
        work: &mut Work,
    ) -> Result<RowsNow> {
        let chain = Chain::of(self.set, id, None)?;
        let mut views = chain.views()?;
        if let Some((mesh, entries)) = self.unchanged(view, &views) {
            work.links_stored += entries;
            work.links_reused += entries;
            return Ok(RowsNow { mesh, written: None, in_memory: None });
        }
        let stored = views.len();
        let mut away: Vec<Extent> = Vec::new();
        let refined = self.refine(id, view, sides, &ChainRows::of(&views), &mut |rows| {
            let at = LinkExtent::new(&ChainRows::of(&[]), rows, Some(&[])).write(id, writer)?;
            writer.sync()?;
            away.push(self.set.snapshot().store().extent(at, ExtentKind::Links)?);
            Ok(())
        })?;
        let Refined { mesh, made, gone, counts } = refined;
        views.extend(away.iter().map(|extent| extent.parse(LinksView::parse)).collect::<Result<Vec<_>>>()?);
        let put_away = ChainRows::of(&views[stored..]);
        let stay = ChainRows::of(&views).without(&gone, &made);
        let made_bytes = made.iter().map(Row::len).sum::<usize>() * size_of::<Hit>();
        let entries = stay.entries() + made.iter().map(|row| row.len() as u64).sum::<u64>();
        work.rays += counts.rays;
        work.links_evaluated += counts.entries;
        work.links_stored += entries;
        work.links_reused += entries.saturating_sub(counts.entries);
        let (mut written, mut in_memory) = (None, None);
        if !self.settings.keep_links {
            in_memory = Some(Rc::new(LinkExtent::new(&stay, &made, None).in_memory()?));
        } else if !(gone.is_empty() && made.is_empty() && away.is_empty()) {
            // Behind the chain that they came from, or all anew where there is none or more than half would be garbage.
            let chain_bytes = self.set.snapshot().links_bytes(id)?;
            let room = 2 * live_bytes(mesh.rows.len(), entries);
            let behind = (0 < chain_bytes && chain_bytes < room)
                .then(|| LinkExtent::new(&put_away, &made, Some(&gone)))
                .filter(|delta| chain_bytes + delta.bytes() <= room);
            let delta = behind.is_some();
            let at = behind.unwrap_or_else(|| LinkExtent::new(&stay, &made, None)).write(id, writer)?;
            written = Some(UpdateRow { cluster: id, kind: ExtentKind::Links, delta, at });
        }
        drop(made);
        if made_bytes > MANY_BYTES || !away.is_empty() {
            segment::give_back_freed_memory();
        }
        Ok(RowsNow { mesh, written, in_memory })
    }

    /// A cluster whose stored rows are those that its light tells of, and cover all its sides, where nothing is to be
    /// done about them; and the entries of these.
    fn unchanged(&self, view: &ClusterView<'_>, views: &[LinksView<'_>]) -> Option<(Mesh, u64)> {
        if self.settings.threshold < f64::INFINITY || !self.settings.keep_links {
            return None;
        }
        let mesh = Mesh::load(view.id, view.geometry.patches, &view.light);
        let mut known = mesh.rows.iter().map(|row| (mesh.elements[row.element as usize].name, row.part));
        let (mut is_same, mut entries) = (true, 0);
        let mut covered = vec![[false; 2]; 2 * view.geometry.patches.len()];
        for_each_row(views, |_, head| {
            entries += u64::from(head.count);
            let part = Part::ALL[usize::from(head.part)];
            is_same &= known.next() == Some((NodeName(head.element), part));
            covered[NodeName(head.element).patch_side().index()][part as usize] = true;
        });
        let is_same = is_same && known.next().is_none();
        let are_covered = (0..covered.len()).all(|side| !view.takes_part(side) || covered[side] == [true; 2]);
        (is_same && are_covered).then_some((mesh, entries))
    }

    fn refine(
        &self,
        id: ClusterId,
        view: &ClusterView<'_>,
        sides: &Sides,
        kept: &dyn Kept,
        put_away: &mut PutAway<'_>,
    ) -> Result<Refined> {
        let (visible, found) = self.set.visible(id)?;
        let visible = if self.settings.is_dark { Vec::new() } else { visible };
        let (escapes, emitted_w) = (found.escape > 0.0, self.settings.emitted_w);
        let around = Around { lamps: LightTree::of_clusters(self.set, &visible)?, escapes, emitted_w };
        refine::refine(&self.context(), *view, sides, &around, kept, put_away)
    }
}

/// Rows of one cluster that are worth giving back at once.
const MANY_BYTES: usize = 4 << 20;
