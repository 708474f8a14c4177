//! Boxes as files: one MCAP per episode, and `predictions.json` in nuScenes style.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use fs_err as fs;
use thiserror::Error;

use super::parts::{LIST_FILE, PredictionPart};
use crate::episode::{
    DetectionWriter, EpisodeEntry, EpisodeError, SampleDetections, SourceMeta, is_detections_file,
};
use crate::eval::json;
use crate::files::{self, FolderLock, remove_unfinished};
use crate::object::Detection;
use crate::store;

/// Why predictions could not be written.
#[derive(Debug, Error)]
pub enum PredictionsError {
    #[error("predictions exist already; give --force to replace them: {}", path.display())]
    Exists { path: PathBuf },
    #[error("a file of this name is there and holds no predictions; give another folder: {}", path.display())]
    Foreign { path: PathBuf },
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
    pub const FILE: &str = LIST_FILE;

    /// Takes a folder to write predictions into; refuses one that holds some already, unless they may be replaced. They are, by
    /// [`Self::write`]: what is made in vain costs nothing.
    ///
    /// # Errors
    /// [`PredictionsError::Exists`]; another process writes there.
    pub fn take_folder(folder: &Path, force: bool) -> Result<FolderLock, PredictionsError> {
        let lock = FolderLock::take(folder)?;
        if !force && files::is_there(&folder.join(Self::FILE))? {
            return Err(PredictionsError::Exists { path: folder.to_owned() });
        }
        remove_unfinished(folder)?;
        Ok(lock)
    }

    /// Writes the boxes of each sample of these episodes, whose samples have these ids and times in nanoseconds, in place of what
    /// predictions are there. `beside` writes what else belongs there; the list of all boxes comes last, and says that the rest is
    /// whole.
    ///
    /// # Errors
    /// A file cannot be written; one of another kind lies in an episode's place.
    pub fn write(
        &self,
        episodes: &[EpisodeEntry],
        samples: &[(String, u64)],
        found: &[Vec<Detection>],
        beside: &dyn Fn(&Path) -> std::io::Result<()>,
    ) -> Result<(), PredictionsError> {
        self.clear(episodes)?;
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
        beside(&self.folder)?;
        let path = self.folder.join(Self::FILE);
        let boxes = samples.iter().zip(found).map(|((id, _), found)| (id.as_str(), found.as_slice()));
        Ok(json::write_predictions(&path, boxes)?)
    }

    /// Deletes the predictions that are there, the list of all boxes first: boxes of two detectors are never one set.
    fn clear(&self, episodes: &[EpisodeEntry]) -> Result<(), PredictionsError> {
        fs::create_dir_all(&self.folder)?;
        let mut old = Vec::new();
        let wanted: BTreeSet<&OsStr> = episodes.iter().map(|entry| OsStr::new(&entry.name)).collect();
        for file in store::files_below(&self.folder)? {
            let is_inside = file.components().count() > 1;
            if is_inside || file.extension().is_none_or(|suffix| suffix != "mcap") {
                continue;
            }
            let path = self.folder.join(&file);
            if is_detections_file(&path) {
                old.push(path);
            } else if file.file_stem().is_some_and(|stem| wanted.contains(stem)) {
                return Err(PredictionsError::Foreign { path });
            }
        }
        let lists = [Self::FILE, PredictionPart::FILE].map(|name| self.folder.join(name));
        for path in lists.iter().chain(&old) {
            files::remove_if_there(path)?;
            store::discard(path);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::Split;
    use crate::episode::manifest::ObjectCounts;

    #[test]
    fn predictions_replace_all_that_are_there_and_nothing_else() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("boxes");
        let episodes = ["one", "two"].map(|name| EpisodeEntry {
            name: name.to_owned(),
            file: format!("episodes/{name}.mcap"),
            split: Split::Dev,
            seed: 0,
            town: String::new(),
            weather: String::new(),
            ood: false,
            n_samples: 1,
            n_objects: ObjectCounts::default(),
            sha256: String::new(),
        });
        let samples = [("one/0".to_owned(), 5), ("two/0".to_owned(), 5)];
        let found = vec![Vec::new(); samples.len()];
        let of = |set: &str| Predictions {
            folder: folder.clone(),
            set: set.to_owned(),
            config_toml: String::new(),
        };
        let nothing = |_: &Path| Ok(());
        let lock = Predictions::take_folder(&folder, false).unwrap();
        of("a").write(&episodes, &samples, &found, &nothing).unwrap();
        drop(lock);
        assert!(matches!(Predictions::take_folder(&folder, false), Err(PredictionsError::Exists { .. })));
        // Another split's, and what is somebody else's.
        let old = folder.join("old.mcap");
        fs::rename(folder.join(format!("{}.mcap", episodes[0].name)), &old).unwrap();
        let note = folder.join("note.mcap");
        fs::write(&note, "mine").unwrap();
        let part = folder.join(PredictionPart::FILE);
        fs::write(&part, "{}").unwrap();
        let _lock = Predictions::take_folder(&folder, true).unwrap();
        let stop = |folder: &Path| {
            assert!(!folder.join(Predictions::FILE).exists(), "the list comes last");
            Err(std::io::Error::other("stop"))
        };
        of("b").write(&episodes, &samples, &found, &stop).unwrap_err();
        of("b").write(&episodes, &samples, &found, &nothing).unwrap();
        assert!(!old.exists() && !part.exists() && note.is_file());
        fs::rename(&note, folder.join(format!("{}.mcap", episodes[0].name))).unwrap();
        let error = of("b").write(&episodes, &samples, &found, &nothing).unwrap_err();
        assert!(matches!(error, PredictionsError::Foreign { .. }), "{error}");
        assert!(folder.join(Predictions::FILE).is_file(), "nothing is lost");
    }
}
