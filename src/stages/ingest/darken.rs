//! The light of a cluster whose materials change: nothing arrives, on the elements that it had. The
//! rows that stay are of those.

use super::records::ClusterRecords;
use crate::base::{ClusterId, Result};
use crate::model::ExtentKind;
use crate::model::geometry::GeometryView;
use crate::model::light::LightView;
use crate::store::Snapshot;
use crate::transport::light::line::{Fit, Line};
use crate::transport::nodes::mesh::Mesh;
use crate::transport::records::encode;

/// The radiosity payload of a cluster in the version that brings its new materials.
pub fn light_on_known_elements(newest: &Snapshot<'_>, cluster: &ClusterRecords) -> Result<Vec<u8>> {
    let id = ClusterId(cluster.head.cluster);
    let (geometry, light) = (newest.extent(ExtentKind::Geometry, id)?, newest.extent(ExtentKind::Radiosity, id)?);
    let (Some(geometry), Some(light)) = (geometry, light) else { return Ok(cluster.light_at_start()) };
    if geometry.payload() != cluster.geometry() {
        return Ok(cluster.light_at_start());
    }
    let view = geometry.parse(GeometryView::parse)?;
    let mut mesh = Mesh::load(id, view.patches, &light.parse(LightView::parse)?);
    for element in &mut mesh.elements {
        element.line = Line::default();
    }
    for row in &mut mesh.rows {
        row.fit = Fit::default();
    }
    Ok(encode(&mesh))
}
