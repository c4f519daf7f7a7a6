//! One file per verb: each plans, then executes; here alone the store meets the pure rooms.

pub mod merge;
