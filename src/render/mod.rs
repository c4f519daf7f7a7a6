//! Pictures of a solution. Pure: light in, pixels out.

pub mod camera;
pub mod tone;
