//! One cluster's share of a visit: its links are brought up to date with the light of the version, and
//! its rows are closed. No I/O: the program gives what is stored, tests in
//! memory what they hold.

use super::closure::{self, Row};
use super::link_rows::Link;
use super::mesh::Mesh;
use super::push_pull::{self, Factors};
use super::refine::{Context, Counts, Receiver, Scope};
use super::source::ClusterView;
use crate::base::{ClusterId, NodeName, Result};
use crate::model::links::LeafClosure;
use crate::model::visibility::VisibilityHead;
use crate::rays::node::Node;

/// A cluster's links as an earlier visit left them; empty if there was none.
#[derive(Clone, Default)]
pub struct StoredLinks {
    /// The rows that hold any links.
    pub rows: Vec<(NodeName, Vec<Link>)>,
    /// How the leaves' rows were closed, ascending by leaf.
    pub closure: Vec<LeafClosure>,
}

/// A cluster before its visit.
pub struct Unsolved<'a> {
    /// The cluster, in the version that is read.
    pub view: ClusterView<'a>,
    /// Clusters that it may exchange light with, ascending.
    pub visible: Vec<ClusterId>,
    /// How they were found.
    pub found: VisibilityHead,
    /// Links to begin with.
    pub stored: StoredLinks,
}

/// A cluster whose light can be gathered. What is one for each node goes by position in the mesh.
pub struct SolvedCluster {
    /// Its nodes, with the light of the version that was read.
    pub mesh: Mesh,
    /// Links of each node.
    pub rows: Vec<Vec<Link>>,
    /// Nodes whose rows were changed.
    pub changed: Vec<bool>,
    /// How the leaves' rows are closed, ascending by leaf.
    pub closure: Vec<LeafClosure>,
    /// What each node's light is multiplied by: see [`push_pull::factors`].
    pub factors: Vec<Factors>,
    /// Whether rows or closure differ from what was stored.
    pub stored_changed: bool,
    /// What was done.
    pub counts: Counts,
}

/// Solves a cluster as far as it can be without the light of others at the end of the visit. A function of its arguments
/// and of the version in `context`. Fails if clusters cannot be read, or when the user interrupts.
pub fn solve_cluster(context: &Context<'_>, cluster: Unsolved<'_>) -> Result<SolvedCluster> {
    let Unsolved { view, visible, found, stored } = cluster;
    let mesh = Mesh::load(view.id, &view.geometry, &view.light);
    let mut rows = vec![Vec::new(); mesh.node_count()];
    for (name, row) in stored.rows {
        rows[mesh.position(name)] = row;
    }
    let known = |leaf: NodeName| {
        let at = stored.closure.binary_search_by_key(&leaf.0, |c| c.leaf);
        at.ok().map(|at| &stored.closure[at])
    };
    let mut receiver = Receiver::new(view, mesh, rows);
    receiver.refine(context, &visible)?;
    let Receiver { mesh, rows, changed, mut counts, .. } = receiver;
    let emits = |leaf: NodeName| view.emits(leaf);
    let complete = context.scope == Scope::Everything;
    let measured = |leaf: NodeName| {
        let escape_rays = closure::escape_rays(emits(leaf));
        let escape = match known(leaf) {
            Some(stored) => f64::from(stored.measured_escape),
            None if found.escape > 0.0 => {
                let node = Node::at(view.id, &view.geometry.patches[usize::from(leaf.patch_side().patch)], leaf);
                closure::measure_escape(&context.scene, &node, escape_rays, context.seed, &mut counts.rays)
            }
            None => 0.0,
        };
        Row { escape, escape_rays, unseen: f64::from(found.missing), complete, ..Row::default() }
    };
    let closure = closure::rows(&mesh, &rows, emits, measured);
    let factors = push_pull::factors(&mesh, &closure);
    let stored_changed = closure != stored.closure || changed.contains(&true);
    Ok(SolvedCluster { mesh, rows, changed, closure, factors, stored_changed, counts })
}
