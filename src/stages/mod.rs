//! One file per verb: each plans, then executes; here alone the store meets the pure rooms.

pub mod check;
pub mod children;
pub mod entry;
pub mod export;
pub mod gc;
pub mod group_links;
pub mod group_solver;
pub mod ingest;
pub mod leaves;
pub mod link_extent;
pub mod merge;
pub mod output;
pub mod partition;
pub mod point_light;
pub mod ray_scene;
pub mod render;
pub mod run;
pub mod sample;
pub mod sample_files;
pub mod settings;
pub mod solve_group;
pub mod status;
pub mod stored_light;
pub mod summary;
pub mod visibility;
pub mod working_set;
