//! Boxes as files: one MCAP per episode, and `predictions.json` in nuScenes style.

use std::path::{Path, PathBuf};

use fs_err as fs;
use thiserror::Error;

use crate::episode::{DetectionWriter, EpisodeEntry, EpisodeError, SampleDetections, SourceMeta};
use crate::eval::json;
use crate::object::Detection;

/// Why predictions could not be written.
#[derive(Debug, Error)]
pub enum PredictionsError {
    #[error("predictions exist already; give --force to replace them: {}", path.display())]
    Exists { path: PathBuf },
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Json(#[from] json::JsonError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// A folder of predictions, and where its boxes come from, as its files record it.
#[derive(Debug)]
pub struct Predictions {
    pub folder: PathBuf,
    /// The detector's name.
    pub set: String,
    pub config_toml: String,
}

impl Predictions {
    /// Name of the file that holds the boxes of all episodes.
    pub const FILE: &str = "predictions.json";

    /// Refuses a folder that holds predictions already.
    ///
    /// # Errors
    /// [`PredictionsError::Exists`].
    pub fn check_free(folder: &Path) -> Result<(), PredictionsError> {
        if folder.join(Self::FILE).exists() {
            return Err(PredictionsError::Exists { path: folder.to_owned() });
        }
        Ok(())
    }

    /// Writes the boxes of each sample of these episodes, whose samples have these ids and times in nanoseconds.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(
        &self,
        episodes: &[EpisodeEntry],
        samples: &[(String, u64)],
        found: &[Vec<Detection>],
    ) -> Result<(), PredictionsError> {
        fs::create_dir_all(&self.folder)?;
        let mut pairs = samples.iter().zip(found);
        for entry in episodes {
            let meta = SourceMeta {
                episode: entry.name.clone(),
                episode_sha256: entry.sha256.clone(),
                set: self.set.clone(),
                config_toml: self.config_toml.clone(),
                generator_version: env!("CARGO_PKG_VERSION").to_owned(),
            };
            let path = self.folder.join(format!("{}.mcap", entry.name));
            let mut writer = DetectionWriter::create(&path, &meta)?;
            for (&(_, time_ns), detections) in pairs.by_ref().take(entry.n_samples) {
                let detections = detections.clone();
                writer.write(&SampleDetections { time_ns, detections })?;
            }
            writer.finish()?;
        }
        let path = self.folder.join(Self::FILE);
        let boxes = samples.iter().zip(found).map(|((id, _), found)| (id.as_str(), found.as_slice()));
        Ok(json::write_predictions(&path, boxes)?)
    }
}
