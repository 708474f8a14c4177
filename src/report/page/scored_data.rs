//! The data set that a side's scores are of, for pictures of its faults; or why there is none to draw.

use std::io;
use std::path::{Path, PathBuf};

use super::{ReportError, ScoresRequest};
use crate::dataset::Fingerprint;
use crate::episode::{EpisodeEntry, EpisodeError, Manifest};
use crate::report::provenance::Provenance;
use crate::report::view::{LabelledView, ViewError};

/// The label set of scores that do not name theirs.
const DEFAULT_SET: &str = "rect";

/// The data set of a side.
#[derive(Debug, Clone, PartialEq)]
pub struct SideData {
    pub path: PathBuf,
    pub labels: String,
    pub manifest: Manifest,
    /// Whether a flag names it: then it is an error if a part of it is missing.
    is_by_flag: bool,
}

/// Why there is nothing to draw.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NoData {
    /// The scores do not name it, or it is not there.
    Unknown,
    /// What lies there now was not scored.
    Changed,
    /// Its label set is missing.
    Unlabelled { path: PathBuf, labels: String },
}

impl SideData {
    /// The data set that a flag names, else the one that the scores name.
    ///
    /// # Errors
    /// It cannot be read, or a flag names what is no data set.
    pub fn find(
        request: &ScoresRequest,
        source: Option<&Provenance>,
    ) -> Result<Result<Self, NoData>, ReportError> {
        let is_there = |path: &PathBuf| path.join(Manifest::FILE).is_file();
        let of_scores = || source.and_then(|source| source.data.clone()).filter(is_there);
        let Some(path) = request.data.clone().or_else(of_scores) else { return Ok(Err(NoData::Unknown)) };
        let is_by_flag = request.data.is_some();
        let labels = source.and_then(|source| source.labels.clone());
        let labels = labels.unwrap_or_else(|| DEFAULT_SET.to_owned());
        let manifest = Manifest::read(&path)?;
        let scored = source.and_then(|source| source.fingerprint.as_ref());
        Ok(match is_same(scored, &path, &labels)? {
            Some(false) => Err(NoData::Changed),
            // Without its labels, the first picture of what a flag names is an error.
            None if !is_by_flag => Err(NoData::Unlabelled { path, labels }),
            _ => Ok(Self { path, labels, manifest, is_by_flag }),
        })
    }

    /// Reads a sample with its labels; `None` if its labels or its file are missing.
    ///
    /// # Errors
    /// A broken file; where a flag names the data set, also a missing one.
    pub fn read(&self, entry: &EpisodeEntry, sample_idx: usize) -> Result<Option<LabelledView>, ViewError> {
        match LabelledView::read(&self.path, &self.labels, entry, sample_idx) {
            Err(error) if !self.is_by_flag && tells_absence(&error) => Ok(None),
            read => read.map(Some),
        }
    }
}

/// Whether a data set is still the one that was scored, as far as the scores tell; `None` if its label set is missing.
fn is_same(scored: Option<&Fingerprint>, path: &Path, labels: &str) -> io::Result<Option<bool>> {
    let Some(scored) = scored else { return Ok(Some(true)) };
    match Fingerprint::of(path, labels) {
        Err(error) if is_absence(&error) => Ok(None),
        found => Ok(Some(found? == *scored)),
    }
}

/// Whether a sample cannot be read since something is not there.
fn tells_absence(error: &ViewError) -> bool {
    match error {
        ViewError::NoLabels { .. } | ViewError::NotLabelled { .. } => true,
        ViewError::Io(error) | ViewError::Episode(EpisodeError::Io(error)) => is_absence(error),
        _ => false,
    }
}

fn is_absence(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}
