//! Scores on the validation split during a run.

use burn::tensor::Device;

use crate::dataset::Dataset;
use crate::eval::{ClassScores, Mode, Protocol, ScoreError, eval_samples, score};
use crate::infer::{PredictError, predict};
use crate::model::Detector;
use crate::progress::Silent;
use thiserror::Error;

/// Why a detector could not be scored.
#[derive(Debug, Error)]
pub enum ValidationError {
    #[error(transparent)]
    Predict(#[from] PredictError),
    #[error(transparent)]
    Score(#[from] ScoreError),
}

/// Scores a detector in inference mode on a split with the default protocol; without the camera until the
/// camera is trained.
///
/// # Errors
/// A sample is broken, or its boxes cannot be scored.
pub fn validate(
    detector: &Detector,
    data: &Dataset,
    device: &Device,
    with_camera: bool,
) -> Result<ClassScores, ValidationError> {
    let found = predict(detector, &data.named(), with_camera, device, &Silent)?;
    Ok(score(&eval_samples(data.samples(), &found), &Protocol::default(), Mode::Id)?.columns.total)
}
