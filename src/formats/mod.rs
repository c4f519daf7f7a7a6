//! Files in and out: only encoding, no decisions.

pub mod mtl;
pub mod obj;
pub mod points;
