//! Boxes as files: one MCAP per episode, and `predictions.json` in nuScenes style.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::io;
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

/// Where the predictions of a run's network lie in its folder, unless told otherwise.
const OF_RUN: &str = "predictions";

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

    /// Deletes the predictions that are there: boxes of two detectors are never one set.
    fn clear(&self, episodes: &[EpisodeEntry]) -> Result<(), PredictionsError> {
        fs::create_dir_all(&self.folder)?;
        let wanted: BTreeSet<&OsStr> = episodes.iter().map(|entry| OsStr::new(&entry.name)).collect();
        let (old, others) = mcap_files(&self.folder)?;
        let is_wanted = |path: &PathBuf| path.file_stem().is_some_and(|stem| wanted.contains(stem));
        if let Some(path) = others.into_iter().find(is_wanted) {
            return Err(PredictionsError::Foreign { path });
        }
        Ok(remove(&self.folder, &old)?)
    }

    /// Deletes the predictions that lie in the folder of a run, by its network; what else is there stays.
    ///
    /// # Errors
    /// Another process writes there; a file cannot be deleted.
    pub fn remove_of_run(run: &Path) -> io::Result<()> {
        let home = run.join(OF_RUN);
        if !files::is_dir(&home)? {
            return Ok(());
        }
        for entry in fs::read_dir(&home)? {
            let folder = entry?.path();
            // A link leads to a folder of the user's.
            if !files::is_dir(&folder)? || folder.is_symlink() {
                continue;
            }
            let lock = FolderLock::take(&folder)?;
            remove(&folder, &mcap_files(&folder)?.0)?;
            drop(lock);
            // It stays where anything else is in it.
            let _ = fs::remove_dir(&folder);
        }
        Ok(())
    }
}

/// The MCAP files in a folder, and not in those below it: predictions, then all others.
fn mcap_files(folder: &Path) -> io::Result<(Vec<PathBuf>, Vec<PathBuf>)> {
    let is_mcap = |file: &PathBuf| {
        file.components().count() == 1 && file.extension().is_some_and(|suffix| suffix == "mcap")
    };
    let files = store::files_below(folder)?.into_iter().filter(is_mcap);
    Ok(files.map(|file| folder.join(file)).partition(|path| is_detections_file(path)))
}

/// Deletes the predictions of a folder, the lists of all boxes first.
fn remove(folder: &Path, boxes: &[PathBuf]) -> io::Result<()> {
    let lists = [Predictions::FILE, PredictionPart::FILE].map(|name| folder.join(name));
    for path in lists.iter().chain(boxes) {
        files::remove_if_there(path)?;
        store::discard(path);
    }
    Ok(())
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
        let lock = Predictions::take_folder(&folder, true).unwrap();
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
        drop(lock);

        let run = home.path().join("run");
        let moved = run.join("predictions/boxes");
        fs::create_dir_all(run.join("predictions")).unwrap();
        fs::rename(&folder, &moved).unwrap();
        let [mine, theirs] = [0, 1].map(|i| moved.join(format!("{}.mcap", episodes[i].name)));
        assert!(theirs.is_file());
        Predictions::remove_of_run(&run).unwrap();
        assert!(mine.is_file() && !theirs.exists() && !moved.join(Predictions::FILE).exists());
        fs::remove_file(&mine).unwrap();
        Predictions::remove_of_run(&run).unwrap();
        assert!(!moved.exists(), "nothing else is in it");
    }
}
