//! Group relaxation: light from outside the group is gathered once, light between its clusters is iterated to
//! convergence.

use crate::base::{Progress, Result};
use crate::model::geometry::SideMaterial;
use crate::transport::light::line::Halves;
use crate::transport::light::lit::LitCluster;
use crate::transport::nodes::mesh::Mesh;
use crate::transport::refine::{Measured, Sides};
use crate::transport::row::{Part, scaled};
use crate::transport::source::ClusterView;

/// A cluster of the group while it is relaxed.
pub struct Member {
    /// Its elements and rows.
    pub mesh: Mesh,
    /// Reflectance and exitance of its patch sides.
    pub materials: Vec<SideMaterial>,
    /// Its light now.
    pub lit: LitCluster,
    /// Rows that each element has its light from: see [`Mesh::rows_above`].
    pub above: Vec<[u32; 2]>,
    /// What each indirect row receives from outside the group, in order.
    pub external: Vec<Halves>,
    /// Share of each row's rays that leaves the model.
    pub escapes: Vec<f32>,
}

/// Gives what a member's rows receive from lamps and from outside the group.
pub trait Outside {
    /// Calls `visit` for every row of member `index` in order, with the share of its rays that leaves the model.
    fn each(&self, index: usize, visit: &mut dyn FnMut(&Halves, f32)) -> Result<()>;
}

/// Gives what a member's rows receive from within the group.
pub trait Inside {
    /// Calls `visit` for every indirect row of member `index` with its number and the sum of what it receives from
    /// outside and, by the light of `members` now, from within.
    fn each(&mut self, index: usize, members: &[Member], visit: &mut dyn FnMut(usize, &Halves)) -> Result<()>;
}

/// The shapes of a member: where its rows were measured.
pub trait Shapes {
    /// Calls `with` for a member.
    fn with(&self, index: usize, with: &mut dyn FnMut(&ClusterView<'_>, &Sides)) -> Result<()>;
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inner {
    /// After so many gathers.
    Gathers(u32),
    /// When what is left to change is below this, relative to the group's irradiance.
    Converge {
        /// In the norm of `--tolerance`.
        tolerance: f64,
        /// Largest reflectance: bounds the ratio of successive changes.
        q: f64,
    },
}

/// Most sweeps of one visit: a bound against a tolerance below rounding.
const MOST_SWEEPS: u32 = 1000;

/// Takes over what comes from lamps and from outside: it does not change while the group is relaxed, so direct rows are
/// fitted once. `seed`: the places of rows derive from it. What arrives is multiplied by `gain`.
pub fn take_over(
    members: &mut [Member],
    shapes: &dyn Shapes,
    outside: &dyn Outside,
    (seed, gain): (u64, [f32; 3]),
    progress: &dyn Progress,
) -> Result<()> {
    for (index, member) in members.iter_mut().enumerate() {
        let Member { mesh, external, escapes, .. } = member;
        let mut result = Ok(());
        shapes.with(index, &mut |view, sides| {
            let mut rows = mesh.rows.iter_mut();
            result = outside.each(index, &mut |halves, escape| {
                let row = rows.next().expect("rows are those of the mesh");
                escapes.push(escape);
                if row.part == Part::Indirect {
                    external.push(*halves);
                    return;
                }
                let name = mesh.elements[row.element as usize].name;
                row.fit = Measured::of(view, sides, name, row.part, seed).fit(row.rounds, &scaled(halves, gain));
            });
        })?;
        result?;
        progress.at(index as u64 + 1);
    }
    Ok(())
}

/// Relaxes the group: clusters in order, each with the newest light of the others. Returns the sweeps.
pub fn relax(
    members: &mut [Member],
    shapes: &dyn Shapes,
    inside: &mut dyn Inside,
    inner: Inner,
    (seed, gain): (u64, [f32; 3]),
    progress: &dyn Progress,
) -> Result<u32> {
    let mut sweeps = 0;
    let mut last_change = f64::INFINITY;
    loop {
        let (mut change, mut level) = (0.0, 0.0);
        for index in 0..members.len() {
            progress.go_on()?;
            let mut fits = Vec::new();
            {
                let members = &*members;
                let mesh = &members[index].mesh;
                let mut result = Ok(());
                shapes.with(index, &mut |view, sides| {
                    result = inside.each(index, members, &mut |row, halves| {
                        let of = &mesh.rows[row];
                        let name = mesh.elements[of.element as usize].name;
                        let measured = Measured::of(view, sides, name, of.part, seed);
                        fits.push((row, measured.fit(of.rounds, &scaled(halves, gain))));
                    });
                })?;
                result?;
            }
            let member = &mut members[index];
            for (row, fit) in fits {
                member.mesh.rows[row].fit = fit;
            }
            let before: Vec<_> = member.mesh.elements.iter().map(|e| e.line.mean).collect();
            member.mesh.push_pull(&member.above);
            for (element, old) in member.mesh.elements.iter().zip(before).filter(|(e, _)| e.is_leaf()) {
                change += element.area_m2 * (element.line.mean - old).norm_squared();
                level += element.area_m2 * element.line.mean.norm_squared();
            }
            member.lit.relight(&member.mesh, &member.materials);
        }
        sweeps += 1;
        let relative = if level > 0.0 { (change / level).sqrt() } else { 0.0 };
        let finished = match inner {
            Inner::Gathers(count) => sweeps >= count,
            Inner::Converge { tolerance, q } => {
                let ratio = (relative / last_change).clamp(0.0, q);
                relative == 0.0 || (sweeps > 1 && relative * ratio / (1.0 - ratio) <= tolerance)
            }
        };
        last_change = relative;
        if finished || sweeps >= MOST_SWEEPS {
            return Ok(sweeps);
        }
    }
}
