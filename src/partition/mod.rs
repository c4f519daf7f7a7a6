//! Clusters to groups: the paper's four methods, and the order in which groups are solved. Pure.

pub mod graph;
pub mod merge;
pub mod plain;
pub mod schedule;
pub mod split;
