//! What a RUN argument means: a run's folder, a checkpoint, or the name of a network inside the program.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use burn::module::Module;
use burn::tensor::Device;
use fs_err as fs;
use thiserror::Error;

use crate::dataset::SeenEpisodes;
use crate::eval::EvalConfig;
use crate::files::sha256_hex;
use crate::model::checkpoint::{self, CheckpointError};
use crate::model::{Detector, ModelConfig, OperatingScore, SHIPPED, Shipped};

/// Why a trained detector could not be found or read.
#[derive(Debug, Error)]
pub enum TrainedError {
    #[error(
        "no finished checkpoint; `harmzone train DATA --out {}` makes one, and the program has {} inside: {}",
        run.display(),
        SHIPPED.each_ref().map(|shipped| format!("`{}`", shipped.name)).join(", "),
        path.display()
    )]
    NotFound { run: PathBuf, path: PathBuf },
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("the network was replaced while the command ran; call it again: {}", path.display())]
    Changed { path: PathBuf },
    #[error("the dataset's folder has no name; give --out: {}", path.display())]
    NoName { path: PathBuf },
}

/// A trained detector that a command names.
#[derive(Debug)]
pub enum Trained {
    Shipped(&'static Shipped),
    File(CheckpointFile),
}

/// A checkpoint, read once: what is told of it, and what it does, are of the same bytes.
pub struct CheckpointFile {
    path: PathBuf,
    bytes: OnceLock<Vec<u8>>,
}

impl CheckpointFile {
    #[must_use]
    pub fn at(path: PathBuf) -> Self {
        Self { path, bytes: OnceLock::new() }
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn bytes(&self) -> std::io::Result<&[u8]> {
        if self.bytes.get().is_none() {
            let read = fs::read(&self.path)?;
            return Ok(self.bytes.get_or_init(|| read));
        }
        Ok(self.bytes.get().map_or(&[], Vec::as_slice))
    }
}

impl fmt::Debug for CheckpointFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("CheckpointFile").field(&self.path).finish()
    }
}

impl Trained {
    /// Finds what RUN names; the name of a network inside the program goes first, but `./small` is a path.
    ///
    /// # Errors
    /// Nothing is there; the message says what could be.
    pub fn find(run: &Path) -> Result<Self, TrainedError> {
        if let Some(shipped) = run.to_str().and_then(Shipped::named) {
            return Ok(Self::Shipped(shipped));
        }
        let path = if run.is_dir() { run.join(checkpoint::CHECKPOINT) } else { run.to_owned() };
        if !path.exists() {
            return Err(TrainedError::NotFound { run: run.to_owned(), path });
        }
        Ok(Self::File(CheckpointFile::at(path)))
    }

    /// The detector, in inference mode.
    ///
    /// # Errors
    /// The checkpoint is broken.
    pub fn load(&self, device: &Device) -> Result<Detector, TrainedError> {
        let detector = match self {
            Self::Shipped(shipped) => {
                checkpoint::unpack(shipped.checkpoint, Path::new(shipped.name), device)?
            }
            Self::File(file) => checkpoint::unpack(file.bytes()?, &file.path, device)?,
        };
        Ok(detector.valid())
    }

    /// The checkpoint's bytes, and where they lie.
    ///
    /// # Errors
    /// The checkpoint cannot be read.
    pub fn bytes(&self) -> Result<(PathBuf, &[u8]), TrainedError> {
        Ok(match self {
            Self::Shipped(shipped) => (shipped.name.into(), shipped.checkpoint),
            Self::File(file) => (file.path.clone(), file.bytes()?),
        })
    }

    /// SHA-256 of the checkpoint.
    ///
    /// # Errors
    /// The checkpoint cannot be read.
    pub fn sha256(&self) -> Result<String, TrainedError> {
        Ok(sha256_hex(self.bytes()?.1))
    }

    /// Refuses another network than the one with this hash: who told it and who runs it may be two processes.
    ///
    /// # Errors
    /// [`TrainedError::Changed`]; the checkpoint cannot be read.
    pub fn check_sha256(&self, wanted: &str) -> Result<(), TrainedError> {
        if self.sha256()? == wanted {
            return Ok(());
        }
        Err(TrainedError::Changed { path: self.bytes()?.0 })
    }

    /// The network's config.
    ///
    /// # Errors
    /// The checkpoint is broken.
    pub fn config(&self) -> Result<ModelConfig, TrainedError> {
        Ok(match self {
            Self::Shipped(shipped) => checkpoint::config_in(shipped.checkpoint, Path::new(shipped.name))?,
            Self::File(file) => checkpoint::config_in(file.bytes()?, &file.path)?,
        })
    }

    /// The episodes that it has seen, where it says so: older checkpoints do not.
    ///
    /// # Errors
    /// The checkpoint cannot be read, or is broken.
    pub fn seen(&self) -> Result<Option<SeenEpisodes>, TrainedError> {
        let (path, bytes) = self.bytes()?;
        Ok(checkpoint::seen_in(bytes, &path)?)
    }

    /// The score from which on it warns, where one has been chosen.
    ///
    /// # Errors
    /// The checkpoint cannot be read, or is broken.
    pub fn operating_score(&self) -> Result<Option<OperatingScore>, TrainedError> {
        let (path, bytes) = self.bytes()?;
        Ok(checkpoint::operating_score_in(bytes, &path)?)
    }

    /// The score from which on a car brakes for what it says: the one chosen for that, else the one from which it warns.
    ///
    /// # Errors
    /// As [`Self::operating_score`].
    pub fn braking_score(&self) -> Result<Option<OperatingScore>, TrainedError> {
        let (path, bytes) = self.bytes()?;
        let own = checkpoint::braking_score_in(bytes, &path)?;
        Ok(own.or(checkpoint::operating_score_in(bytes, &path)?))
    }

    /// How it is scored where nothing else is said: the default, with the operating score of its own.
    ///
    /// # Errors
    /// As [`Self::operating_score`].
    pub fn eval_config(&self) -> Result<EvalConfig, TrainedError> {
        let mut config = EvalConfig::default();
        if let Some(own) = self.operating_score()? {
            config.operating_score = own.score;
        }
        Ok(config)
    }

    /// The default folder of its predictions for a dataset: in the run's folder, by the dataset's name; for
    /// a network inside the program in the dataset's folder, by the network's name.
    ///
    /// # Errors
    /// The dataset is not there, or its folder has no name.
    pub fn predictions_folder(&self, data: &Path) -> Result<PathBuf, TrainedError> {
        let checkpoint = match self {
            Self::Shipped(shipped) => return Ok(data.join("predictions").join(shipped.name)),
            Self::File(file) => &file.path,
        };
        let Some(name) = fs::canonicalize(data)?.file_name().map(ToOwned::to_owned) else {
            return Err(TrainedError::NoName { path: data.to_owned() });
        };
        Ok(checkpoint.parent().unwrap_or(Path::new(".")).join("predictions").join(name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_the_network_inside_and_a_path_is_a_path() {
        assert!(matches!(Trained::find(Path::new("small")), Ok(Trained::Shipped(_))));
        let message = Trained::find(Path::new("./small")).unwrap_err().to_string();
        assert!(message.contains("`small`") && message.contains("harmzone train"), "{message}");
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(checkpoint::CHECKPOINT), b"").unwrap();
        let found = Trained::find(folder.path()).unwrap();
        assert!(
            matches!(&found, Trained::File(file) if file.path().ends_with(checkpoint::CHECKPOINT)),
            "{found:?}"
        );
        // What was read once counts, whatever is written there meanwhile.
        let sha256 = found.sha256().unwrap();
        fs::write(folder.path().join(checkpoint::CHECKPOINT), b"another").unwrap();
        found.check_sha256(&sha256).unwrap();
        let error = Trained::find(folder.path()).unwrap().check_sha256(&sha256).unwrap_err();
        assert!(matches!(error, TrainedError::Changed { .. }), "{error}");
    }
}
