//! What a point gets from lamps where they are surveyed: by rays of its own, drawn as those of elements are.

use std::collections::BTreeMap;

use super::bundle::SideCache;
use super::gather_point::{Gathered, Place, Seen};
use super::lamp_list::{LampTree, Lamps, Place as Start, target};
use super::point_survey::Survey;
use super::source::Clusters;
use crate::base::{NodeName, Result};
use crate::geom::sequence::{Sequence, mix, mix_point};
use crate::rays::RayScene;

/// Rays from a point to lamps.
const RAYS: u64 = 1024;

/// Keeps these rays apart from others of the same point.
const SALT: u64 = 0x6c61_6d70;

/// Adds what arrives from these lamps; those that are close are counted in the point's `survey`. Counts rays.
#[allow(clippy::too_many_arguments, reason = "a point, what it sees and where that goes")]
pub fn add_lamps(
    scene: &RayScene<'_>,
    clusters: &dyn Clusters,
    sides: &SideCache,
    place: &Place<'_>,
    lamps: &LampTree,
    survey: &Survey,
    gathered: &mut Gathered,
    rays: &mut u64,
) -> Result<()> {
    let (p, normal) = (place.point, place.leaf.normal);
    let mut lamps = Lamps::new(clusters, sides, lamps);
    let Some(aim) = lamps.aim(&Start::point(p, normal)) else { return Ok(()) };
    let sequence = Sequence::new(mix(mix_point(p)) ^ SALT);
    let mut found: BTreeMap<NodeName, f64> = BTreeMap::new();
    let (mut sum, mut squares) = (0.0, 0.0);
    for index in 0..RAYS {
        let [_, _, c, d] = sequence.point(index);
        let Some(drawn) = lamps.draw(&aim, p, normal, c)? else { continue };
        let Some(target) = target(&drawn.bundle, p, normal, [drawn.rest, d]) else { continue };
        *rays += 1;
        if !scene.blocked(p, target.to, &place.leaf.end, &target.on.end, &None) {
            let form_factor = target.form_factor / drawn.share / RAYS as f64;
            *found.entry(drawn.lamp.name).or_default() += form_factor;
            sum += form_factor;
            squares += form_factor * form_factor;
        }
    }
    if aim.may_be_close {
        for name in survey.close_lamps(clusters, p)? {
            *found.entry(name).or_default() += Survey::RAY;
            sum += Survey::RAY;
            squares += Survey::RAY * Survey::RAY;
        }
    }
    let error = (squares - sum * sum / RAYS as f64).max(0.0).sqrt();
    for (name, form_factor) in found {
        let radiosity = clusters.cluster(name.cluster())?.view().source(name).radiosity;
        gathered.add(radiosity, Seen { form_factor, error: error * (form_factor / sum).sqrt() });
    }
    Ok(())
}
