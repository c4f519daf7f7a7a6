//! (shaft)
