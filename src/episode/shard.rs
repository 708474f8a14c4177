//! A part of a data set that is made in a place of its own, such as one task of an array job.

use std::fmt;
use std::str::FromStr;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use thiserror::Error;

/// Most episodes of a data set: hundreds of hours, and terabytes.
pub const MAX_EPISODES: u32 = 1_000_000;

/// Most parts of a data set.
pub const MAX_SHARDS: u32 = 100_000;

/// One of `of` parts, counted from 0: every `of`-th episode, so that each part sees all towns and weathers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields, try_from = "RawShard")]
pub struct Shard {
    pub index: u32,
    pub of: u32,
}

/// A shard as a file gives it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawShard {
    index: u32,
    of: u32,
}

impl TryFrom<RawShard> for Shard {
    type Error = ShardError;

    fn try_from(RawShard { index, of }: RawShard) -> Result<Self, ShardError> {
        if index < of && of <= MAX_SHARDS {
            Ok(Self { index, of })
        } else {
            Err(ShardError { text: format!("{index}/{of}") })
        }
    }
}

/// Why a text names no shard.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "`{text}` names no shard; I/N is needed, with N up to {MAX_SHARDS} and I from 0 to N - 1: of eight, 0/8 to 7/8"
)]
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
            Some((index, of)) => Self::try_from(RawShard { index, of }),
            None => Err(ShardError { text: text.to_owned() }),
        }
    }
}

/// What a manifest says of a data set that is a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartOf {
    pub shard: Shard,
    /// Episodes of the whole, at most [`MAX_EPISODES`].
    #[serde(deserialize_with = "read_n_episodes")]
    pub n_episodes: u32,
}

fn read_n_episodes<'de, D: Deserializer<'de>>(from: D) -> Result<u32, D::Error> {
    let n_episodes = u32::deserialize(from)?;
    if n_episodes > MAX_EPISODES {
        let message = format!("{n_episodes} episodes; a data set has {MAX_EPISODES} at most");
        return Err(D::Error::custom(message));
    }
    Ok(n_episodes)
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
        for text in ["3/3", "1", "-1/3", "1/0", "0/100001", "a/b", ""] {
            let error = text.parse::<Shard>().unwrap_err().to_string();
            assert!(error.contains("0/8 to 7/8"), "{error}");
        }
    }

    #[test]
    fn a_file_names_no_part_that_there_cannot_be() {
        let read = |index: u32, of: u32, n: u32| {
            let text = format!(r#"{{"shard": {{"index": {index}, "of": {of}}}, "n_episodes": {n}}}"#);
            serde_json::from_str::<PartOf>(&text).map_err(|error| error.to_string())
        };
        let part = read(1, 3, 9).unwrap();
        assert_eq!(part, PartOf { shard: "1/3".parse().unwrap(), n_episodes: 9 });
        assert_eq!(serde_json::from_str::<PartOf>(&serde_json::to_string(&part).unwrap()).unwrap(), part);
        assert!(read(0, 0, 9).unwrap_err().contains("`0/0` names no shard"));
        assert!(read(0, u32::MAX, 9).unwrap_err().contains("names no shard"));
        assert!(read(0, 3, u32::MAX).unwrap_err().contains("a data set has 1000000 at most"));
    }
}
