//! The memory promise: a cap on anonymous memory that every stage plans within.

/// Cap on this process' anonymous memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryBudget {
    /// Bytes, from `--memory`.
    pub limit_bytes: u64,
}

impl MemoryBudget {
    /// The default of `--memory`: 512 MiB.
    pub const DEFAULT: Self = Self { limit_bytes: 512 << 20 };

    /// Part of the cap, e.g. for one cache.
    #[must_use]
    pub fn share(self, percent: u64) -> u64 {
        self.limit_bytes / 100 * percent
    }
}
