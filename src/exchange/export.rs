//! Our predictions in the format of another tool.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::error::ExchangeError;
use super::samples::{NamedSample, NamedSamples};
use crate::episode::Split;
use crate::eval::json::{self, JsonError};
use crate::infer::Predictions;
use crate::object::Detection;
use crate::progress::Progress;

/// A file or folder of another tool's that is being written.
pub trait WriteBoxes {
    /// Adds the boxes of a sample.
    ///
    /// # Errors
    /// The format cannot hold them, or the disk fails.
    fn add(&mut self, sample: &NamedSample<'_>, found: &[Detection]) -> Result<(), ExchangeError>;

    /// Gives what was written its name.
    ///
    /// # Errors
    /// The disk fails.
    fn finish(self: Box<Self>) -> Result<(), ExchangeError>;
}

/// Which predictions of ours are exported.
#[derive(Debug)]
pub struct ExportPredictions<'a> {
    /// A folder with `predictions.json`, or such a file.
    pub predictions: &'a Path,
    /// The data set that they are of.
    pub data: &'a Path,
    pub split: Option<Split>,
}

/// Writes the boxes of each sample of a split; returns how many samples and boxes there are.
///
/// # Errors
/// No such predictions, a sample without a list of boxes, or the format cannot hold them.
pub fn export_predictions(
    request: &ExportPredictions<'_>,
    mut writer: Box<dyn WriteBoxes + '_>,
    progress: &dyn Progress,
) -> Result<(usize, usize), ExchangeError> {
    let path = file_in(request.predictions);
    let read = json::read_predictions(&path)?;
    let found: HashMap<String, Vec<Detection>> = read.samples.into_iter().collect();
    let samples = NamedSamples::open(request.data, request.split)?;
    let (mut n_samples, mut n_boxes) = (0, 0);
    samples.for_each("export", progress, |sample| {
        let Some(boxes) = found.get(sample.id) else {
            let (other, path, sample) = (request.data.to_owned(), path.clone(), sample.id.to_owned());
            return Err(JsonError::MissingSamples { n_missing: 1, sample, other, path }.into());
        };
        (n_samples, n_boxes) = (n_samples + 1, n_boxes + boxes.len());
        writer.add(&sample, boxes)
    })?;
    writer.finish()?;
    Ok((n_samples, n_boxes))
}

/// The file of boxes that a path names.
fn file_in(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(Predictions::FILE) } else { path.to_owned() }
}
