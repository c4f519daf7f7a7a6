//! Light over elements: the line through what was measured, and what leaves the places that rays meet.

pub mod at;
pub mod line;
pub mod lit;
pub mod sheet;
pub mod shrink;
