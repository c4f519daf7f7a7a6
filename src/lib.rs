//! Clerestory computes diffuse global illumination for buildings far larger than memory.
//!
//! Data flows one way: `cli -> stages -> {transport, visibility, partition, render} -> rays ->
//! model -> geom -> base`. `store` and `formats` do all I/O and know only `model` and below; only
//! `stages` joins them to the pure rooms. `tests/layering.rs` enforces this.

pub mod base;
pub mod cli;
pub mod formats;
pub mod geom;
pub mod model;
pub mod partition;
pub mod rays;
pub mod render;
pub mod stages;
pub mod store;
pub mod transport;
pub mod visibility;
