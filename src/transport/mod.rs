//! The physics: form factors, visibility of links, oracle, refinement, push-pull, closure, relaxation.
//! Pure: views of records in, records out.

pub mod bundle;
mod cells;
pub mod closure;
pub mod contour;
pub mod form_factor;
mod gap;
pub mod gather_lamps;
pub mod gather_point;
pub mod lamp_list;
pub mod lamp_survey;
pub mod lamps;
pub mod link_rows;
#[cfg(test)]
mod memory_scene;
pub mod mesh;
pub mod oracle;
pub mod pairs;
pub mod point_survey;
pub mod push_pull;
pub mod records;
pub mod refine;
pub mod relax;
pub mod residual;
pub mod row_parts;
pub mod sectors;
pub mod sight;
pub mod solve_cluster;
pub mod source;
pub mod source_memo;
pub mod survey;
pub mod survey_row;
mod survey_verdict;

#[cfg(test)]
mod form_factor_tests;
#[cfg(test)]
mod occlusion_tests;
#[cfg(test)]
mod physics_tests;
