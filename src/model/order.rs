//! In which order updates become versions.

use std::fmt;
use std::str::FromStr;

/// `--order`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpdateOrder {
    /// All groups read the same version; one new version per iteration.
    #[default]
    Jacobi,
    /// The paper's copy-update-replace: each update is a version; later tasks read the newest.
    Replace,
    /// Gauss-Seidel: group by group, each reads what the one before wrote.
    Sequential,
}

impl UpdateOrder {
    /// As typed and stored.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Jacobi => "jacobi",
            Self::Replace => "replace",
            Self::Sequential => "sequential",
        }
    }
}

impl fmt::Display for UpdateOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for UpdateOrder {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Jacobi, Self::Replace, Self::Sequential]
            .into_iter()
            .find(|order| order.name() == text)
            .ok_or_else(|| format!("{text}: not one of jacobi, replace, sequential"))
    }
}
