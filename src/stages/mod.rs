//! One file per verb; joins the pure rooms with store and formats. Every stage plans, then executes.

pub mod group_links;
pub mod group_solver;
pub mod partition;
pub mod point_light;
pub mod sample;
pub mod tolerances;
pub mod visibility;
pub mod working_set;
