//! Group relaxation: light from outside the group is gathered once, light between its clusters is
//! iterated to convergence.

use super::mesh::Mesh;
use super::push_pull::{Factors, Gathered, push_pull};
use super::sectors;
use crate::base::{Error, Progress, Result, Rgb};
use crate::model::geometry::SideMaterial;

/// A cluster of the group while it is relaxed.
pub struct Member {
    /// Its elements.
    pub mesh: Mesh,
    /// Reflectance and exitance of its patch sides.
    pub materials: Vec<SideMaterial>,
    /// What each node gathered from outside the group, by position.
    pub external: Vec<Gathered>,
    /// By position: see [`super::push_pull::factors`].
    pub factors: Vec<Factors>,
    /// Position of its first node among the group's.
    pub first: usize,
}

impl Member {
    /// Radiosity of every node, by position, W/m2.
    #[must_use]
    pub fn radiosities(&self) -> Vec<Rgb> {
        let mut all = sectors::radiosities(&self.mesh, &self.materials);
        all.extend((0..self.mesh.elements.len()).map(|at| self.radiosity(at)));
        all
    }

    /// Radiosity of an element, W/m2.
    #[must_use]
    pub fn radiosity(&self, at: usize) -> Rgb {
        let element = &self.mesh.elements[at];
        let material = &self.materials[element.name.patch_side().index()];
        Rgb::from_f32(material.exitance) + Rgb::from_f32(material.rho).times(element.irradiance)
    }
}

/// A link within the group: positions instead of names.
#[derive(Clone, Copy, Debug)]
pub struct InnerLink {
    /// Position in the receiving cluster's mesh.
    pub receiver: u32,
    /// Position among the group's elements.
    pub source: u32,
    /// Form factor.
    pub form_factor: f32,
    /// Its standard error.
    pub error: f32,
}

/// Gives a member's links within the group; decoded anew or from a bounded cache, always the same.
pub trait InnerLinks {
    /// Visits the links of member `index`, in the order of the store.
    fn each(&mut self, index: usize, members: &[Member], visit: &mut dyn FnMut(&InnerLink)) -> Result<()>;
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

/// What relaxation did.
#[derive(Clone, Copy, Debug, Default)]
pub struct Relaxed {
    /// Sweeps over the group.
    pub sweeps: u32,
    /// Links gathered over.
    pub links: u64,
}

/// Most sweeps of one visit: a bound against a tolerance below rounding.
const MOST_SWEEPS: u32 = 1000;

/// Relaxes the group: clusters in order, each with the newest light of the others.
pub fn relax(
    members: &mut [Member],
    links: &mut dyn InnerLinks,
    inner: Inner,
    progress: &dyn Progress,
) -> Result<Relaxed> {
    let mut radiosity: Vec<Rgb> = Vec::new();
    for member in members.iter() {
        debug_assert_eq!(member.first, radiosity.len());
        radiosity.extend(member.radiosities());
    }
    let mut done = Relaxed::default();
    let mut last_change = f64::INFINITY;
    loop {
        let (mut change, mut level) = (0.0, 0.0);
        for index in 0..members.len() {
            if progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let mut gathered = members[index].external.clone();
            links.each(index, members, &mut |link| {
                let (receiver, source) = (link.receiver as usize, link.source as usize);
                let (form_factor, error) = (f64::from(link.form_factor), f64::from(link.error));
                gathered[receiver].add(radiosity[source], form_factor, error);
                done.links += 1;
            })?;
            let member = &mut members[index];
            let before: Vec<Rgb> = member.mesh.elements.iter().map(|e| e.irradiance).collect();
            push_pull(&mut member.mesh, &gathered, &member.factors);
            for (at, old) in before.iter().enumerate() {
                let element = &member.mesh.elements[at];
                if element.is_leaf() {
                    change += element.area_m2 * (element.irradiance - *old).norm_squared();
                    level += element.area_m2 * element.irradiance.norm_squared();
                }
            }
            radiosity[member.first..member.first + member.mesh.node_count()].copy_from_slice(&member.radiosities());
        }
        done.sweeps += 1;
        let relative = if level > 0.0 { (change / level).sqrt() } else { 0.0 };
        let finished = match inner {
            Inner::Gathers(count) => done.sweeps >= count,
            Inner::Converge { tolerance, q } => {
                let ratio = (relative / last_change).clamp(0.0, q);
                relative == 0.0 || (done.sweeps > 1 && relative * ratio / (1.0 - ratio) <= tolerance)
            }
        };
        last_change = relative;
        if finished || done.sweeps >= MOST_SWEEPS {
            return Ok(done);
        }
    }
}
