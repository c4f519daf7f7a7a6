//! Rays from places of elements and from points: to lamps, and over the hemisphere.

pub mod audit;
pub mod check;
pub mod hemisphere;
pub mod lamps;
pub mod path;
pub mod point;
