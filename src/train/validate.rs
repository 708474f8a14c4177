//! Scores on the validation split during a run.

use burn::tensor::Device;

use crate::dataset::{DatasetError, SampleSource, named};
use crate::eval::{ClassScores, EvalConfig, Mode, Protocol, ScoreError, eval_samples, score};
use crate::infer::{PredictError, predict};
use crate::model::Detector;
use crate::progress::Silent;
use thiserror::Error;

/// Why a detector could not be scored.
#[derive(Debug, Error)]
pub enum ValidationError {
    #[error(transparent)]
    Data(#[from] DatasetError),
    #[error(transparent)]
    Predict(#[from] PredictError),
    #[error(transparent)]
    Score(#[from] ScoreError),
}

/// Scores a detector in inference mode on a split with the default protocol; without the camera until the
/// camera is trained. Of what is on disk, points and pictures are in memory a part at a time.
///
/// # Errors
/// A sample is broken, or its boxes cannot be scored.
pub fn validate(
    detector: &Detector,
    data: SampleSource<'_>,
    device: &Device,
    with_camera: bool,
) -> Result<ClassScores, ValidationError> {
    let mut scored = Vec::new();
    data.for_each_part(|samples| -> Result<(), ValidationError> {
        let found = predict(detector, &named(samples), with_camera, device, &Silent)?;
        scored.extend(eval_samples(samples, &found));
        Ok(())
    })?;
    // However many boxes the network has, they are scored: a run must not end here for its own config.
    let most = scored.iter().map(|sample| sample.detections.len()).max().unwrap_or(0);
    let config = EvalConfig::default();
    let protocol = EvalConfig { max_boxes: config.max_boxes.max(most), ..config };
    let protocol = Protocol::try_from(protocol).expect("the defaults are valid with any number of boxes");
    Ok(score(&scored, &protocol, Mode::Id)?.columns.total)
}
