//! The side of the benchmark that a town or a kind of unfamiliar object belongs to: no world mixes both.

use serde::{Deserialize, Serialize};

/// What towns, kinds of unfamiliar objects, and worlds made of them are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SceneSplit {
    /// For learning and for every choice.
    #[default]
    Dev,
    /// For reporting alone.
    Test,
}

impl SceneSplit {
    pub const ALL: [Self; 2] = [Self::Dev, Self::Test];

    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Dev => "dev",
            Self::Test => "test",
        }
    }
}
