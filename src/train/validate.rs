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
/// camera is trained. Of what is on disk, points and pictures are in memory a part at a time. A split that nobody annotated has
/// no score, which is no reason to stop a training.
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
    match score(&scored, &protocol, Mode::Id) {
        Ok(metrics) => Ok(metrics.columns.total),
        Err(ScoreError::NothingLabelled { .. }) => Ok(ClassScores::new(None, None)),
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Dataset, test_data};
    use crate::model::ModelConfig;

    #[test]
    fn a_split_that_nobody_annotated_has_no_score_and_ends_nothing() {
        let (mut data, device) = (test_data::dataset(2), Device::flex());
        let detector = Detector::init(&ModelConfig::in_little()[0], 0, &device);
        let scores = |data: &Dataset| validate(&detector, data.into(), &device, true).unwrap();
        assert!(scores(&data).mean.is_some());
        (0..2).for_each(|i| data.sample_mut(i).facts.is_unlabelled = true);
        assert_eq!(scores(&data), ClassScores::new(None, None));
    }
}
