//! Indirect light: cosine-weighted rays from the places of an element (Malley's method).

use crate::base::{ClusterId, Result};
use crate::geom::sequence::cosine_direction;
use crate::rays::RayScene;
use crate::rays::node::Node;
use crate::rays::traverse::Nearest;
use crate::transport::light::lit::{Lights, met};
use crate::transport::nodes::places::{Draws, Places};
use crate::transport::row::{GONE, Hit};

/// Casts the rays of some rounds: one of each half from each open place. In the order of rows.
pub fn cast(
    scene: &RayScene<'_>,
    lights: &dyn Lights,
    node: &Node,
    places: &Places,
    draws: &Draws,
    rounds: std::ops::Range<u16>,
) -> Result<Vec<Hit>> {
    let mut hits = Vec::with_capacity(rounds.len() * 2 * places.open.count_ones() as usize);
    for round in rounds {
        for place in places.each() {
            let from = places.at(place, round);
            for half in 0..2 {
                let [u, v, ..] = draws.draw(half, place, u32::from(round));
                let direction = cosine_direction(node.normal, u, v);
                hits.push(match scene.nearest(from, direction, Some(&node.end)) {
                    Nearest::Met(hit) => {
                        let cluster = ClusterId(hit.key.cluster);
                        met(&*lights.lit(cluster)?, cluster, hit.side(), from + direction * hit.t)
                    }
                    Nearest::Escaped | Nearest::Covered => GONE,
                });
            }
        }
    }
    Ok(hits)
}
