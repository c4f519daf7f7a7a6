//! What a point's own rays meet, and what arrives from there.

use glam::DVec3;

use super::gap::{Gap, Met, cast, is_gap};
use super::gather_point::{Gathered, Place, Seen};
use super::lamp_list::is_close_lamp;
use super::met::weights;
use super::source::Clusters;
use super::survey_row::counted_error;
use crate::base::{NodeName, Result, Rgb};
use crate::geom::sequence::Sequence;
use crate::rays::region::Cuts;

/// What a point's own rays meet.
pub struct Survey {
    met: Vec<Met>,
    /// Whether the point lies in a gap that elements are too large for: almost all that it sees is closer than they
    /// are wide.
    pub is_gap: bool,
    sequence: Sequence,
}

impl Survey {
    /// What a ray that meets a side stands for.
    pub(super) const RAY: f64 = 1.0 / SURVEY_RAYS as f64;

    /// Share of the rays that met something.
    #[must_use]
    pub fn met_share(&self) -> f64 {
        self.met.len() as f64 * Self::RAY
    }

    /// The sides of close lamps that rays from the point met, one for each ray.
    pub(super) fn close_lamps(&self, clusters: &dyn Clusters, point: DVec3) -> Result<Vec<NodeName>> {
        let mut close = Vec::new();
        for met in &self.met {
            if is_close_lamp(&clusters.cluster(met.side.cluster())?.view(), met.side, point, met.to) {
                close.push(met.side);
            }
        }
        Ok(close)
    }

    /// The emitting sides among what was met.
    pub fn emitters(&self, clusters: &dyn Clusters) -> Result<Vec<NodeName>> {
        let mut sides: Vec<NodeName> = self.met.iter().map(|met| met.side).collect();
        sides.sort_unstable();
        sides.dedup();
        let mut emitters = Vec::new();
        for side in sides {
            if clusters.cluster(side.cluster())?.view().emits(side) {
                emitters.push(side);
            }
        }
        Ok(emitters)
    }
}

/// Rays of a point's own survey.
const SURVEY_RAYS: u64 = 1024;

/// Casts a point's own rays. Counts them.
pub fn survey(cuts: &Cuts<'_>, clusters: &dyn Clusters, place: &Place<'_>, rays: &mut u64) -> Result<Survey> {
    let (met, sequence) = cast(cuts, clusters, place.point, place.leaf, SURVEY_RAYS, rays)?;
    Ok(Survey { is_gap: is_gap(&met, SURVEY_RAYS, place.min_element_m), met, sequence })
}

/// Adds what arrives from all sides that are not in `linked` (ascending); in a gap by paths that are followed until
/// they leave it. Counts rays.
pub fn add_survey(
    cuts: &Cuts<'_>,
    clusters: &dyn Clusters,
    place: &Place<'_>,
    survey: &Survey,
    linked: &[NodeName],
    gathered: &mut Gathered,
    rays: &mut u64,
) -> Result<()> {
    let met: Vec<&Met> = survey.met.iter().filter(|found| linked.binary_search(&found.side).is_err()).collect();
    let kinds: Vec<_> = met.iter().map(|found| (found.side.cluster(), found.answer.kind())).collect();
    let gap = Gap { cuts, clusters, min_element_m: place.min_element_m, sequence: survey.sequence, paths: SURVEY_RAYS };
    let (mut light, mut all) = (Rgb::BLACK, 0.0);
    for ((index, found), weight) in (1..).zip(&met).zip(weights(&kinds)) {
        let Some(leaf) = found.answer.element else { continue };
        let radiosity = if survey.is_gap {
            gap.follow(index, **found, rays)?
        } else {
            clusters.cluster(found.side.cluster())?.view().source(leaf.name).radiosity
        };
        light += radiosity * weight;
        all += weight;
    }
    if all > 0.0 {
        let share = met.len() as f64 / SURVEY_RAYS as f64;
        let error = counted_error(share, SURVEY_RAYS as f64);
        gathered.add(light * (1.0 / all), Seen { form_factor: share, error });
    }
    Ok(())
}
