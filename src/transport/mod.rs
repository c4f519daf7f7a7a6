//! The physics: rows of light measured by rays, linear light on elements, refinement where the whole model's error is,
//! group relaxation. Pure: views of records in, records out.

#[cfg(test)]
mod audit_tests;
pub mod iterate;
pub mod kernel;
pub mod light;
pub mod measure;
#[cfg(test)]
mod memory_scene;
pub mod nodes;
pub mod norm;
pub mod numbers;
#[cfg(test)]
mod occlusion_tests;
pub mod oracle;
#[cfg(test)]
mod physics_tests;
#[cfg(test)]
mod point_tests;
pub mod records;
pub mod refine;
pub mod row;
pub mod source;
pub mod steer;
