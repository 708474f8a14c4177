//! A detector's boxes for a recording, which is read part by part.

use std::path::Path;

use burn::tensor::Device;
use thiserror::Error;

use super::predict::{PredictError, predict};
use super::predictions::{Predictions, PredictionsError};
use crate::dataset::MeasuredSplit;
use crate::episode::EpisodeError;
use crate::model::Detector;
use crate::object::Detection;
use crate::progress::Progress;
use crate::sample::Measured;

/// Why a recording could not be predicted.
#[derive(Debug, Error)]
pub enum RecordedError {
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Predict(#[from] PredictError),
    #[error(transparent)]
    Predictions(#[from] PredictionsError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// Predicts every sample of a recording by a detector in inference mode and writes the boxes, and what `beside` writes; returns how
/// many there are.
///
/// # Errors
/// [`RecordedError`].
pub fn predict_recording(
    detector: &Detector,
    recording: &MeasuredSplit,
    predictions: &Predictions,
    beside: &dyn Fn(&Path) -> std::io::Result<()>,
    device: &Device,
    progress: &dyn Progress,
) -> Result<usize, RecordedError> {
    progress.start("predict", recording.n_samples() as u64);
    let (mut samples, mut found): (Vec<(String, u64)>, Vec<Vec<Detection>>) = (Vec::new(), Vec::new());
    recording.for_each_part(|part| -> Result<(), RecordedError> {
        let named: Vec<(&str, &Measured)> =
            part.iter().map(|(id, measured)| (id.as_str(), measured)).collect();
        found.extend(predict(detector, &named, detector.config().use_camera, device, progress)?);
        samples.extend(part.iter().map(|(id, measured)| (id.clone(), measured.time_ns)));
        Ok(())
    })?;
    predictions.write(recording.episodes(), &samples, &found, beside)?;
    progress.finish();
    Ok(found.iter().map(Vec::len).sum())
}
