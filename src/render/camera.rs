//! A pinhole camera, in metres from the store's origin.

use glam::DVec3;

use crate::geom::bounds::Bounds;

/// Where rays start and where they go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    eye: DVec3,
    /// Centre of the picture plane at distance 1, its half width to the right and half height up.
    centre: DVec3,
    right: DVec3,
    up: DVec3,
    /// What lies above this height along the vertical is cut away.
    cut: Option<(DVec3, f64)>,
}

/// What a camera looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Position, m.
    pub eye: DVec3,
    /// A point in the middle of the picture, m.
    pub look: DVec3,
    /// Up in the picture.
    pub up: DVec3,
    /// Vertical field of view, degrees.
    pub fov_degrees: f64,
    /// Width over height.
    pub aspect: f64,
}

impl Camera {
    /// From a view; `None` if it looks nowhere, or along its up.
    #[must_use]
    pub fn new(view: &View) -> Option<Self> {
        let forward = (view.look - view.eye).try_normalize()?;
        let right = forward.cross(view.up).try_normalize()?;
        let half_height = libm::tan(0.5 * view.fov_degrees.to_radians());
        let up = right.cross(forward) * half_height;
        Some(Self { eye: view.eye, centre: forward, right: right * (half_height * view.aspect), up, cut: None })
    }

    /// The whole model from above and a little from the front, with what lies above the heads of the
    /// topmost storey cut away, so that ceilings do not hide the rooms. `vertical`: unit.
    #[must_use]
    pub fn overview(bounds: Bounds, vertical: DVec3, aspect: f64) -> Option<Self> {
        const FOV_DEGREES: f64 = 30.0;
        let size = bounds.size();
        let height = size.dot(vertical);
        let plan = size - vertical * height;
        let across = plan.max_element().max(1e-9);
        let front =
            if plan.x >= plan.max_element() { plan_axis(vertical, DVec3::X) } else { plan_axis(vertical, DVec3::Y) };
        let distance = 0.48 * across.max(plan.length() / aspect) / libm::tan(0.5 * FOV_DEGREES.to_radians());
        let toward = (vertical * 0.9 - front * 0.43).normalize();
        let look = bounds.centre();
        let view =
            View { eye: look + toward * (distance + 0.5 * height), look, up: front, fov_degrees: FOV_DEGREES, aspect };
        let top = bounds.max.dot(vertical).max(bounds.min.dot(vertical));
        let mut camera = Self::new(&view)?;
        camera.cut = Some((vertical, top - 0.28 * height.min(3.5)));
        Some(camera)
    }

    /// The ray through a point of the picture: `x` from left to right, `y` from top to bottom, 0..=1.
    #[must_use]
    pub fn ray(&self, x: f64, y: f64) -> (DVec3, DVec3) {
        let along = self.centre + self.right * (2.0 * x - 1.0) - self.up * (2.0 * y - 1.0);
        let mut from = self.eye;
        if let Some((vertical, height)) = self.cut {
            let above = from.dot(vertical) - height;
            let sinking = -along.dot(vertical);
            if above > 0.0 && sinking > 0.0 {
                from += along * (above / sinking);
            }
        }
        (from, along)
    }
}

/// The horizontal direction that is up in a plan: across the longer side.
fn plan_axis(vertical: DVec3, across: DVec3) -> DVec3 {
    let up = vertical.cross(across);
    if up.length() > 0.5 { up.normalize() } else { vertical.cross(DVec3::Z).normalize() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_the_picture_is_what_the_camera_looks_at() {
        let view =
            View { eye: DVec3::new(1.0, -4.0, 1.5), look: DVec3::ZERO, up: DVec3::Z, fov_degrees: 60.0, aspect: 1.5 };
        let (from, along) = Camera::new(&view).unwrap().ray(0.5, 0.5);
        assert!((along.normalize() - (view.look - from).normalize()).length() < 1e-12);
        let camera = Camera::new(&view).unwrap();
        let angle = camera.ray(0.5, 0.0).1.angle_between(camera.ray(0.5, 1.0).1).to_degrees();
        assert!((angle - 60.0).abs() < 1e-9, "{angle}");
    }

    #[test]
    fn the_overview_starts_below_the_ceiling() {
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(10.0, 6.0, 2.8) };
        let camera = Camera::overview(bounds, DVec3::Z, 1.5).unwrap();
        let (from, along) = camera.ray(0.5, 0.5);
        assert!(from.z < 2.8 && from.z > 1.5 && along.z < 0.0, "{from}");
    }
}
