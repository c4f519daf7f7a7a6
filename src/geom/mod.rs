//! Geometry: polygons, quadtree elements, clipping, sampling. Pure; f64.

pub mod bounds;
pub mod cut_tree;
pub mod grid;
pub mod grouping;
pub mod morton;
pub mod polygon;
pub mod quadtree;
pub mod sequence;
pub mod split;
pub mod triangulation;
