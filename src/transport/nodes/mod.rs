//! Elements: their shapes, where they are measured, how they lie above each other.

pub mod frame;
pub mod grading;
pub mod mesh;
pub mod places;
