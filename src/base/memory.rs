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

/// A line of a text like `/proc/self/status`.
#[must_use]
pub fn proc_field(text: &str, key: &str) -> Option<u64> {
    text.lines().find_map(|line| line.strip_prefix(key)?.split_whitespace().next()?.parse().ok())
}

/// A line of `/proc/self/status`, from KiB to bytes; 0 where the kernel does not say.
#[must_use]
pub fn status_bytes(key: &str) -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    proc_field(&text, key).unwrap_or(0) * 1024
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
