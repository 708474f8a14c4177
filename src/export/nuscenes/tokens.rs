//! Tokens of exported samples, which results of detectors name too.

use crate::episode::LogFacts;
use crate::nuscenes::Token;

/// The token of a sample: the log's own in an episode that was imported from nuScenes, else made of the episode's name.
#[must_use]
pub fn sample_token(log: Option<&LogFacts>, episode: &str, sample_idx: usize, time_ns: u64) -> Token {
    let of_nuscenes = log.filter(|log| log.format == "nuscenes");
    let own = of_nuscenes.and_then(|log| log.sample_name(time_ns));
    own.map_or_else(|| Token::of("sample", &format!("{episode}/{sample_idx}")), Token::from)
}
