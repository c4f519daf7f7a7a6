//! Refinement of one receiving cluster: tests stored links, links sources not yet linked, splits
//! receivers where light changes. Foreign sources are refined by name alone.

use super::bundle::{Bundle, SideCache};
use super::lamp_list::LampTree;
use super::lamp_survey;
use super::link_rows::Link;
use super::mesh::Mesh;
use super::oracle::{self, Case, Tolerances, Verdict};
use super::pairs::Sources;
use super::sight::{self, Care, Known, Sight};
use super::source::{ClusterView, Clusters};
use super::source_memo::{KnownSource, SourceMemo};
use super::survey;
use crate::base::name::MAX_DEPTH;
use crate::base::{ClusterId, Error, NodeName, PatchSide, Progress, Result, Rgb};
use crate::geom::quadtree;
use crate::model::links::Visibility;
use crate::rays::RayScene;
use crate::rays::node::Node;

/// Which sources are linked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Emitters alone, as in the first iteration.
    Lights,
    /// All sides that are seen; dark ones too where anything lights the receiver, so that rows close.
    Everything,
}

/// What stays the same over a task.
pub struct Context<'a> {
    /// What rays can meet.
    pub scene: RayScene<'a>,
    /// The version that is read.
    pub clusters: &'a dyn Clusters,
    /// Errors that matter.
    pub tolerances: Tolerances,
    /// From `--seed`.
    pub seed: u64,
    /// Which sources to link.
    pub scope: Scope,
    /// Sides of clusters, as sector nodes bundle them.
    pub sides: &'a SideCache,
    /// Sources that links lead to.
    pub sources: &'a SourceMemo,
    /// Where interruption is asked for.
    pub progress: &'a dyn Progress,
}

/// What refinement did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Links whose form factor was computed, kept or not.
    pub evaluated: u64,
    /// Links tested and kept as stored.
    pub reused: u64,
    /// Rays cast.
    pub rays: u64,
}

/// A receiving cluster in the making.
pub struct Receiver<'a> {
    pub(super) view: ClusterView<'a>,
    /// Its elements.
    pub mesh: Mesh,
    /// Links of each node of the mesh, by position.
    pub rows: Vec<Vec<Link>>,
    /// Nodes whose rows were changed.
    pub changed: Vec<bool>,
    /// What was done.
    pub counts: Counts,
}

impl<'a> Receiver<'a> {
    /// Over stored nodes and links (`rows` by position in the mesh).
    #[must_use]
    pub fn new(view: ClusterView<'a>, mesh: Mesh, rows: Vec<Vec<Link>>) -> Self {
        let changed = vec![false; rows.len()];
        Self { view, mesh, rows, changed, counts: Counts::default() }
    }

    /// Brings the links up to date with the light of `context`'s version; `visible` are the clusters
    /// that this one may exchange light with.
    pub fn refine(&mut self, context: &Context<'_>, visible: &[ClusterId]) -> Result<()> {
        let lamps = LampTree::of_clusters(context.clusters, context.sides, visible)?;
        let many_lamps = lamps.count > FEW_LAMPS;
        let surveys = many_lamps || !sees_few(context, visible)?;
        self.test_stored(context, &lamps)?;
        let sides: Vec<Node> = (0..2 * self.view.geometry.patches.len())
            .filter(|&i| self.view.takes_part(i))
            .map(|i| {
                let at = PatchSide::from_index(i);
                Node::root(self.view.id, &self.view.geometry.patches[usize::from(at.patch)], at)
            })
            .collect();
        let all: Vec<usize> = (0..sides.len()).collect();
        let mut linked = self.linked_sides(context)?;
        if surveys {
            if many_lamps {
                self.survey_lamps(context, &lamps)?;
            } else {
                self.link_lamps(context, visible, &sides, &mut linked)?;
            }
            if context.scope == Scope::Everything {
                self.survey_all(context)?;
            }
        } else if context.scope == Scope::Lights {
            self.link_sources(context, visible, &sides, &all, &mut linked, Sources::Emitting)?;
        } else {
            self.link_sources(context, visible, &sides, &all, &mut linked, Sources::Lit)?;
            let lit_sides = self.sides_that_matter();
            let lit: Vec<usize> = all.into_iter().filter(|&i| lit_sides[sides[i].name.patch_side().index()]).collect();
            self.link_sources(context, visible, &sides, &lit, &mut linked, Sources::Dark)?;
        }
        for row in &mut self.rows {
            row.sort_by_key(|l| l.source);
            row.shrink_to_fit();
        }
        Ok(())
    }

    /// Links `r` (element `at` of the mesh) to `s`, as finely as the oracle asks for.
    pub(super) fn link<'c>(
        &mut self,
        context: &Context<'c>,
        source_view: &ClusterView<'_>,
        at: usize,
        r: &Node,
        s: &Node,
        known: &Known<'c>,
    ) {
        let source = source_view.source(s.name);
        let strength = self.strength(at, source.radiosity);
        let case = self.case(at, r, PARTIAL_VARIATION);
        let care = Care {
            allowed: context.tolerances.row_w_m2 / strength,
            can_split: oracle::can_split(&case, &context.tolerances, 2.0),
            seed: context.seed,
            tries: None,
        };
        let judge = |found: &Sight| {
            let case = Case { source_variation: variation(r, s, found.class), ..case };
            oracle::judge(found, strength, &source, &case, &context.tolerances)
        };
        let Some(look) = sight::look(&context.scene, r, s, known, care, &judge, &mut self.counts.rays) else {
            return;
        };
        let found = look.sight;
        let below = Known { class: found.class, blockers: look.blockers };
        self.counts.evaluated += 1;
        match look.verdict {
            Verdict::Keep => self.keep(self.position(at), s.name, &found),
            Verdict::SplitReceiver => self.link_children(context, source_view, at, r, s, &below),
            Verdict::SplitSource => {
                for quarter in 0..4 {
                    self.link(context, source_view, at, r, &s.child(quarter), &below);
                }
            }
        }
    }

    /// Position among all nodes of the mesh of an element.
    pub(super) fn position(&self, element: usize) -> usize {
        self.mesh.sectors.len() + element
    }

    /// Adds a link to the node at `position`.
    pub(super) fn keep(&mut self, position: usize, source: NodeName, sight: &Sight) {
        let row = &mut self.rows[position];
        if row.len() == row.capacity() {
            // Rows are most of what a task holds: they do not grow by doubling.
            row.reserve_exact((row.len() / 8).max(4));
        }
        row.push(Link {
            source,
            form_factor: sight.form_factor as f32,
            spread: sight.spread as f32,
            uncertainty: sight.uncertainty as f32,
            class: sight.class,
        });
        self.changed[position] = true;
    }

    /// Gives an element children.
    pub(super) fn split(&mut self, at: usize) {
        if self.mesh.elements[at].is_leaf() {
            let patch = &self.view.geometry.patches[usize::from(self.mesh.elements[at].name.patch_side().patch)];
            self.mesh.split(at, patch);
            self.rows.resize_with(self.mesh.node_count(), Vec::new);
            self.changed.resize(self.mesh.node_count(), true);
        }
    }

    fn link_children<'c>(
        &mut self,
        context: &Context<'c>,
        source_view: &ClusterView<'_>,
        at: usize,
        r: &Node,
        s: &Node,
        known: &Known<'c>,
    ) {
        self.split(at);
        let first = self.mesh.elements[at].first_child as usize;
        for quarter in 0..4u32 {
            self.link(context, source_view, first + quarter as usize, &r.child(quarter), s, known);
        }
    }

    pub(super) fn strength(&self, at: usize, radiosity: Rgb) -> f64 {
        let element = &self.mesh.elements[at];
        oracle::strength(radiosity, element.irradiance, element.spread())
    }

    pub(super) fn case(&self, at: usize, r: &Node, source_variation: f64) -> Case {
        Case {
            receiver_area_m2: self.mesh.elements[at].area_m2,
            child_edge_m: quadtree::child_edge_m(&r.shape),
            receiver_has_levels: r.name.depth() < MAX_DEPTH,
            source_variation,
        }
    }

    /// Tests every stored link against today's light and refines those that no longer do. Casts no
    /// ray and changes nothing where all do.
    fn test_stored(&mut self, context: &Context<'_>, lamps: &LampTree) -> Result<()> {
        for position in 0..self.mesh.node_count() {
            if context.progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let row = std::mem::take(&mut self.rows[position]);
            let survey_stays = row.iter().any(survey::is_mark) && self.survey_holds(context, position, &row)?;
            let lamps_stay =
                row.iter().any(lamp_survey::is_mark) && self.lamp_survey_holds(context, lamps, position, &row)?;
            let mut kept = Vec::with_capacity(row.len());
            for link in row {
                let stays = match link.class {
                    Visibility::Surveyed if lamps_stay == survey_stays => survey_stays,
                    Visibility::Surveyed => {
                        let source = context.sources.source(context.clusters, link.source)?;
                        if lamp_survey::holds(&source, &link) { lamps_stay } else { survey_stays }
                    }
                    Visibility::Hidden => true,
                    _ => self.test_elements(context, position - self.mesh.sectors.len(), &link)?,
                };
                if stays {
                    self.counts.reused += 1;
                    kept.push(link);
                } else {
                    self.changed[position] = true;
                }
            }
            // New links of this row went in while it was out.
            kept.reserve_exact(self.rows[position].len());
            kept.append(&mut self.rows[position]);
            self.rows[position] = kept;
        }
        Ok(())
    }

    /// Tests a link between elements; one that does not hold is replaced by finer ones.
    fn test_elements(&mut self, context: &Context<'_>, at: usize, link: &Link) -> Result<bool> {
        let splits_receiver = match self.test(context, at, link)? {
            Verdict::Keep => return Ok(true),
            Verdict::SplitReceiver => true,
            Verdict::SplitSource => false,
        };
        let loaded = context.clusters.cluster(link.source.cluster())?;
        let view = &loaded.view();
        let r = &self.node_of_element(at);
        if link.source.is_sector() {
            let lamp = &Bundle::of(context.sides, view, link.source);
            if splits_receiver {
                self.link_quarters(context, view, at, r, lamp);
            } else {
                self.link_parts(context, view, at, r, lamp);
            }
            return Ok(false);
        }
        let (s, known) = (&node(view, link.source), &Known::stored(link.class));
        if splits_receiver {
            self.link_children(context, view, at, r, s, known);
        } else {
            for quarter in 0..4 {
                self.link(context, view, at, r, &s.child(quarter), known);
            }
        }
        Ok(false)
    }

    /// What is to be done with a stored link in today's light.
    fn test(&mut self, context: &Context<'_>, at: usize, link: &Link) -> Result<Verdict> {
        let KnownSource { light, .. } = context.sources.source(context.clusters, link.source)?;
        let strength = self.strength(at, light.radiosity);
        let sight = sight_of(link);
        // The cheap bound first: shapes are needed only where it does not do.
        let bound = (0.5 * sight.spread + sight.uncertainty) * strength
            + oracle::SOURCE_SIGN * sight.form_factor * light.spread * PARTIAL_VARIATION;
        if bound <= context.tolerances.of_link(sight.form_factor + sight.uncertainty) {
            return Ok(Verdict::Keep);
        }
        let r = &self.node_of_element(at);
        if link.source.is_sector() {
            let case = self.case(at, r, PARTIAL_VARIATION);
            return Ok(oracle::judge(&sight, strength, &light, &case, &context.tolerances));
        }
        let s = node(&context.clusters.cluster(link.source.cluster())?.view(), link.source);
        let case = self.case(at, r, variation(r, &s, link.class));
        Ok(oracle::judge(&sight, strength, &light, &case, &context.tolerances))
    }

    /// An element of the receiver with its shape.
    fn node_of_element(&self, at: usize) -> Node {
        node(&self.view, self.mesh.elements[at].name)
    }
}

/// Patch sides in sight up to which a cluster is linked with each of them, as exactly as the oracle asks for: beyond,
/// surveys, which begin with as many rays, are cheaper and no less exact.
const FEW_SIDES: usize = 64;

/// Lamps in sight up to which each is linked for itself, and that alone asks for no survey.
const FEW_LAMPS: usize = 32;

/// Whether the clusters in sight have few sides.
fn sees_few(context: &Context<'_>, visible: &[ClusterId]) -> Result<bool> {
    let mut count = 0;
    for &id in visible {
        let loaded = context.clusters.cluster(id)?;
        let view = loaded.view();
        count += (0..2 * view.geometry.patches.len()).filter(|i| view.takes_part(*i)).count();
        if count > FEW_SIDES {
            return Ok(false);
        }
    }
    Ok(true)
}

pub(super) fn sight_of(link: &Link) -> Sight {
    Sight {
        form_factor: f64::from(link.form_factor),
        spread: f64::from(link.spread),
        uncertainty: f64::from(link.uncertainty),
        class: link.class,
    }
}

pub(super) fn node(view: &ClusterView<'_>, name: NodeName) -> Node {
    Node::at(view.id, &view.geometry.patches[usize::from(name.patch_side().patch)], name)
}

/// A patch side as part of a name.
pub(super) fn side_key(name: NodeName) -> u64 {
    name.0 >> 29
}

/// Factor on a source's spread where visibility is partial: what hides part of a source hides its dark
/// part (what lies under a box is dark and unseen), an error that does not average out over links.
pub(super) const PARTIAL_VARIATION: f64 = 4.0;

/// How much the kernel may vary over the source: all of it where visibility does, little from afar.
pub(super) fn variation(r: &Node, s: &Node, class: Visibility) -> f64 {
    if class == Visibility::Partial {
        return PARTIAL_VARIATION;
    }
    (3.0 * s.shape.radius() / r.shape.centre().distance(s.shape.centre()).max(f64::MIN_POSITIVE)).min(1.0)
}
