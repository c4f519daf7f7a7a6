//! The memory promise: a cap on anonymous memory that every stage plans within.

use super::{Error, Result};

/// Cap on this process' anonymous memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryBudget {
    /// Bytes, from `--memory`.
    pub limit_bytes: u64,
}

impl MemoryBudget {
    /// Part of the cap, e.g. for one cache.
    #[must_use]
    pub fn share(self, percent: u64) -> u64 {
        self.limit_bytes / 100 * percent
    }

    /// Refuses what would not fit (exit code 14), and says how much would do.
    ///
    /// * `what` — what needs `needed_bytes`, as the subject of a sentence.
    /// * `or_else` — what would help besides more memory, behind the flag and its value.
    pub fn require(self, what: &str, needed_bytes: u64, or_else: &str) -> Result<()> {
        if needed_bytes <= self.limit_bytes {
            return Ok(());
        }
        let (needed, limit) = (needed_bytes.div_ceil(1 << 20), self.limit_bytes >> 20);
        Err(Error::TooLarge {
            message: format!("{what} needs {needed} MiB, over the limit of {limit} MiB"),
            help: format!("give `--memory {needed}M`{or_else}"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_refused_with_the_memory_that_would_do() {
        let needed = (3 << 20) + 1;
        let small = MemoryBudget { limit_bytes: needed - 1 };
        let error = small.require("a picture", needed, ", or a smaller `--size`").unwrap_err();
        assert_eq!(error.to_string(), "a picture needs 4 MiB, over the limit of 3 MiB");
        assert_eq!(error.remedy(), "give `--memory 4M`, or a smaller `--size`");
        assert!(MemoryBudget { limit_bytes: needed }.require("a picture", needed, "").is_ok());
    }
}
