//! Rays: box hierarchies built by obvhs, our own edge-safe traversal. Pure: slices in, hits out.

pub mod build;
pub mod emitters;
pub mod first_look;
mod lanes;
pub mod locate;
pub mod node;
pub mod recent;
pub mod scene;
pub mod traverse;
mod walk;

pub use emitters::Emitters;
pub use first_look::FirstLook;
pub use scene::{PatchKey, RayScene};
pub use traverse::{Hit, RayEnd};
