//! What figures on a split may be used for: only those on `test` are for reporting.

use std::fmt;

use crate::episode::Split;

/// The split that figures are on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Standing {
    /// Unknown for scores that an older program wrote.
    pub split: Option<Split>,
    pub data_version: u32,
}

impl Standing {
    /// Whether the figures are for choosing. Before version 2, `test` had towns and kinds of the other splits.
    #[must_use]
    pub fn is_development(self) -> bool {
        self.split != Some(Split::Test) || self.data_version < 2
    }
}

impl fmt::Display for Standing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let split = self.split.map_or("a split that the scores do not name", Split::name);
        if !self.is_development() {
            return write!(f, "Figures on {split}, which is for reporting: choose nothing by them.");
        }
        write!(f, "Development figures, on {split}")?;
        if self.data_version < 2 {
            write!(f, " of a data set of version {}", self.data_version)?;
        }
        write!(f, ": to choose by, not to report. `gen --split test` makes data to report on.")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_figures_on_test_of_version_2_are_for_reporting() {
        let told = |split, data_version| Standing { split, data_version }.to_string();
        assert!(told(Some(Split::Test), 2).starts_with("Figures on test, which is for reporting"));
        for split in [Split::Train, Split::Val, Split::Dev] {
            let wanted = format!("Development figures, on {}: to choose by", split.name());
            assert!(told(Some(split), 2).starts_with(&wanted), "{}", told(Some(split), 2));
        }
        assert!(
            told(Some(Split::Test), 1).starts_with("Development figures, on test of a data set of version 1")
        );
        assert!(told(None, 1).starts_with("Development figures, on a split that the scores do not name"));
    }
}
