//! Gathering over rows until light no longer changes.

pub mod relax;
pub mod residual;
