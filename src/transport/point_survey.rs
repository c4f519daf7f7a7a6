//! What a point's own rays meet, and what arrives from there.

use glam::DVec3;

use super::gap::{Gap, Met, Surroundings, is_gap};
use super::gather_point::{Gathered, Place, Seen};
use super::lamp_list::is_close_lamp;
use super::source::Clusters;
use super::survey_row::counted_error;
use crate::base::{NodeName, Result, Rgb};
use crate::geom::sequence::Sequence;
use crate::rays::RayScene;

/// What a point's own rays meet.
pub struct Survey {
    met: Vec<Met>,
    /// Whether the point lies in a gap that elements are too large for: almost all that it sees is closer than they
    /// are wide.
    pub is_gap: bool,
    sequence: Sequence,
    min_element_m: f64,
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
pub fn survey(
    scene: &RayScene<'_>,
    clusters: &dyn Clusters,
    place: &Place<'_>,
    min_element_m: f64,
    rays: &mut u64,
) -> Result<Survey> {
    let around = Surroundings { scene, clusters, min_element_m };
    let (met, sequence) = around.cast(place.point, place.leaf, SURVEY_RAYS, rays)?;
    Ok(Survey { is_gap: is_gap(&met, SURVEY_RAYS, min_element_m), met, sequence, min_element_m })
}

/// Adds what arrives from all sides that are not in `linked` (ascending); in a gap by paths that are followed until
/// they leave it. Counts rays.
pub fn add_survey(
    scene: &RayScene<'_>,
    clusters: &dyn Clusters,
    survey: &Survey,
    linked: &[NodeName],
    gathered: &mut Gathered,
    rays: &mut u64,
) -> Result<()> {
    let around = Surroundings { scene, clusters, min_element_m: survey.min_element_m };
    let gap = Gap { around, sequence: survey.sequence, paths: SURVEY_RAYS };
    let (mut light, mut count) = (Rgb::BLACK, 0.0);
    let open = survey.met.iter().filter(|met| linked.binary_search(&met.side).is_err());
    for (index, met) in (1..).zip(open) {
        light += if survey.is_gap {
            gap.follow(index, *met, rays)?
        } else {
            clusters.cluster(met.side.cluster())?.view().source(met.element.name).radiosity
        };
        count += 1.0;
    }
    if count > 0.0 {
        let share = count * Survey::RAY;
        let error = counted_error(share, SURVEY_RAYS as f64);
        gathered.add(light * (1.0 / count), Seen { form_factor: share, error });
    }
    Ok(())
}
