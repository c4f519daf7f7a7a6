//! Files in and out: only encoding, no decisions.

pub mod glb;
pub mod leaf_csv;
pub mod lines;
pub mod mtl;
pub mod obj;
pub mod picture;
pub mod ply;
pub mod points;
pub mod spool;
