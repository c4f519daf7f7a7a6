//! Plain data, as it lies in segments: fixed-size little-endian records. No I/O, no algorithms.
//!
//! An extent's payload is a list of typed arrays ([`layout`]); each kind of extent has a module that
//! names its records and a view that borrows them from the payload. `schema/SEGMENTS.md` gives the
//! bytes.

pub mod audit;
pub mod cut;
pub mod figures;
pub mod free_group;
pub mod geometry;
pub mod invariants;
pub mod layout;
pub mod light;
pub mod links;
pub mod order;
pub mod origin;
pub mod rays;
pub mod report;
pub mod solve_options;
pub mod visibility;

pub use layout::{Arrays, ExtentKind};
