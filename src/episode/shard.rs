//! A part of a data set that is made in a place of its own, such as one task of an array job.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// One of `of` parts, counted from 0: every `of`-th episode, so that each part sees all towns and weathers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shard {
    pub index: u32,
    pub of: u32,
}

/// Why a text names no shard.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("`{text}` names no shard; I/N is needed, with I from 0 to N - 1: of eight, 0/8 to 7/8")]
pub struct ShardError {
    pub text: String,
}

impl Shard {
    /// Whether an episode of the whole, by its number, is of this part.
    #[must_use]
    pub fn holds(self, episode_idx: u32) -> bool {
        episode_idx % self.of == self.index
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

impl FromStr for Shard {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Self, ShardError> {
        let parts =
            text.split_once('/').and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
        match parts {
            Some((index, of)) if index < of => Ok(Self { index, of }),
            _ => Err(ShardError { text: text.to_owned() }),
        }
    }
}

/// What a manifest says of a data set that is a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartOf {
    pub shard: Shard,
    /// Episodes of the whole.
    pub n_episodes: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_count_from_0_and_take_every_nth_episode() {
        let of_three: Vec<Shard> = ["0/3", "1/3", "2/3"].map(|text| text.parse().unwrap()).to_vec();
        assert_eq!(of_three[1].to_string(), "1/3");
        for i in 0..10 {
            assert_eq!(of_three.iter().filter(|shard| shard.holds(i)).count(), 1);
        }
        assert!(of_three[1].holds(7));
        for text in ["3/3", "1", "-1/3", "1/0", "a/b", ""] {
            let error = text.parse::<Shard>().unwrap_err().to_string();
            assert!(error.contains("0/8 to 7/8"), "{error}");
        }
    }
}
