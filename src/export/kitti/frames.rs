//! The numbers of KITTI's frames: each sample of a data set has one.
//!
//! Samples imported from KITTI keep their own, as long as no two are the same; otherwise samples are numbered through all episodes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::episode::{EpisodeReader, Manifest};
use crate::export::ExportError;
use crate::interrupt;

/// Frames are named by six digits.
const MAX_FRAMES: usize = 1_000_000;

/// The names of a data set's samples.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameNames {
    /// By episode, in the order of its samples.
    of_episodes: BTreeMap<String, Vec<String>>,
}

impl FrameNames {
    /// # Errors
    /// A damaged episode, a signal that asks to end, or more samples than six digits can number.
    pub fn of(dataset: &Path, manifest: &Manifest) -> Result<Self, ExportError> {
        let n_samples: usize = manifest.episodes.iter().map(|entry| entry.n_samples).sum();
        if n_samples > MAX_FRAMES {
            let message = format!("{n_samples} samples; KITTI numbers {MAX_FRAMES} at most");
            return Err(ExportError::Unfit { message, path: dataset.to_owned() });
        }
        let own = own_names(dataset, manifest)?;
        let of_episodes = own.unwrap_or_else(|| number(manifest));
        Ok(Self { of_episodes })
    }

    /// The frame of a sample.
    #[must_use]
    pub fn get(&self, episode: &str, sample_idx: usize) -> Option<&str> {
        self.of_episodes.get(episode)?.get(sample_idx).map(String::as_str)
    }
}

fn number(manifest: &Manifest) -> BTreeMap<String, Vec<String>> {
    let mut next = 0..;
    let of_episode = |entry: &crate::episode::EpisodeEntry| {
        let names = next.by_ref().take(entry.n_samples).map(|number| format!("{number:06}")).collect();
        (entry.name.clone(), names)
    };
    manifest.episodes.iter().map(of_episode).collect()
}

/// The names that KITTI gave, if it gave one to each sample and no two alike.
fn own_names(
    dataset: &Path,
    manifest: &Manifest,
) -> Result<Option<BTreeMap<String, Vec<String>>>, ExportError> {
    let (mut all, mut of_episodes) = (BTreeSet::new(), BTreeMap::new());
    for entry in &manifest.episodes {
        interrupt::check()?;
        let reader = EpisodeReader::open_known(dataset, entry)?;
        let Some(log) = reader.log().filter(|log| log.format == "kitti") else { return Ok(None) };
        let names = reader.times_ns().iter().map(|&time_ns| log.sample_name(time_ns).map(str::to_owned));
        let Some(names) = names.collect::<Option<Vec<String>>>() else { return Ok(None) };
        let is_frame = |name: &String| name.len() == 6 && name.bytes().all(|byte| byte.is_ascii_digit());
        if !names.iter().all(|name| is_frame(name) && all.insert(name.clone())) {
            return Ok(None);
        }
        of_episodes.insert(entry.name.clone(), names);
    }
    Ok(Some(of_episodes))
}
