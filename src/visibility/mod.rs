//! Which clusters may exchange light, and how much. Pure.

pub mod sampled;
