//! Form factors without occlusion.

pub mod form_factor;
#[cfg(test)]
mod form_factor_tests;
