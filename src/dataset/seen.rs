//! The episodes that a network has seen, by their content: a figure on those that it learned from tells nothing.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::episode::EpisodeEntry;

/// The content hashes of the episodes that a training has seen.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeenEpisodes {
    /// Those that it learned from.
    pub learned: BTreeSet<String>,
    /// Those by which choices were made: it was scored on them between epochs, or its operating score was chosen on them.
    pub watched: BTreeSet<String>,
}

/// Episodes that a network learned from are to be scored.
#[derive(Debug, Error, PartialEq, Eq)]
#[error(
    "the network learned from {n_learned} of the {n_episodes} episodes to be scored, the first is `{first}`, so the \
     figures would not tell how it does on a drive that is new to it; score another split (val, dev or test), or give \
     --on-training-data"
)]
pub struct LearnedError {
    pub n_learned: usize,
    pub n_episodes: usize,
    /// The first episode's name.
    pub first: String,
}

impl SeenEpisodes {
    /// What a training on a split, watched on another, has seen.
    #[must_use]
    pub fn of(learned: &[EpisodeEntry], watched: Option<&[EpisodeEntry]>) -> Self {
        let hashes = |of: &[EpisodeEntry]| of.iter().map(|entry| entry.sha256.clone()).collect();
        Self { learned: hashes(learned), watched: watched.map(hashes).unwrap_or_default() }
    }

    /// The same, and these episodes watched too.
    #[must_use]
    pub fn with_watched<'a>(mut self, episodes: impl IntoIterator<Item = &'a EpisodeEntry>) -> Self {
        self.watched.extend(episodes.into_iter().map(|entry| entry.sha256.clone()));
        self
    }

    /// Refuses episodes of which the network learned from any.
    ///
    /// # Errors
    /// [`LearnedError`].
    pub fn check_unlearned(&self, episodes: &[EpisodeEntry]) -> Result<(), LearnedError> {
        let mut learned = episodes.iter().filter(|entry| self.learned.contains(&entry.sha256));
        let Some(first) = learned.next() else { return Ok(()) };
        Err(LearnedError {
            n_learned: 1 + learned.count(),
            n_episodes: episodes.len(),
            first: first.name.clone(),
        })
    }

    /// How many of the episodes the training was watched on.
    #[must_use]
    pub fn n_watched(&self, episodes: &[EpisodeEntry]) -> usize {
        episodes.iter().filter(|entry| self.watched.contains(&entry.sha256)).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::Split;
    use crate::episode::manifest::ObjectCounts;

    fn entry(name: &str, sha256: &str) -> EpisodeEntry {
        EpisodeEntry {
            name: name.into(),
            file: format!("episodes/{name}.mcap"),
            split: Split::Val,
            seed: 1,
            town: "downtown".into(),
            weather: "ClearNoon".into(),
            ood: false,
            n_samples: 1,
            n_objects: ObjectCounts::default(),
            sha256: sha256.into(),
        }
    }

    fn seen(learned: &[&str], watched: &[&str]) -> SeenEpisodes {
        let set = |hashes: &[&str]| hashes.iter().map(|&hash| hash.to_owned()).collect();
        SeenEpisodes { learned: set(learned), watched: set(watched) }
    }

    #[test]
    fn learned_episodes_are_known_by_content_under_any_name_and_split() {
        let episodes = [entry("new", "x"), entry("renamed", "a"), entry("other", "b")];
        let told = seen(&["a", "b"], &[]).check_unlearned(&episodes).unwrap_err();
        assert_eq!((told.n_learned, told.n_episodes, told.first.as_str()), (2, 3, "renamed"));
        assert!(told.to_string().contains("--on-training-data"));
        assert_eq!(seen(&["c"], &["a"]).check_unlearned(&episodes), Ok(()));
        assert_eq!(seen(&["c"], &["a"]).n_watched(&episodes), 1);
    }

    #[test]
    fn what_a_training_saw_survives_its_record() {
        let episodes = [entry("one", "a"), entry("two", "b")];
        let of_data = SeenEpisodes::of(&episodes, Some(&episodes[1..]));
        let more = of_data.clone().with_watched(&[entry("new", "xy")]);
        assert!(more.watched.contains("xy") && more.learned == of_data.learned);
        assert_eq!(of_data, seen(&["a", "b"], &["b"]));
        let seen = seen(&["a"], &["b", "c"]);
        let text = serde_json::to_string(&seen).unwrap();
        assert_eq!(serde_json::from_str::<SeenEpisodes>(&text).unwrap(), seen);
    }
}
