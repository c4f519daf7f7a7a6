//! Words every other room uses: names, colours, units, errors, progress, memory, threads, text of bytes.

pub mod error;
pub mod memory;
pub mod name;
pub mod parallel;
pub mod progress;
pub mod rgb;
pub mod text;

pub use error::{Error, Result};
pub use name::{ClusterId, NodeKind, NodeName, PatchSide};
pub use progress::{Progress, Quiet};
pub use rgb::{Rgb, lux};
