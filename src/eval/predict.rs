//! Runs a detector over measured samples, with progress.

use burn::tensor::Device;
use rayon::prelude::*;
use thiserror::Error;

use super::json::Boxes;
use super::{EvalSample, EvalTruth, facts};
use crate::dataset::Dataset;
use crate::model::{Batch, Detector, Input, InputError, detections};
use crate::object::Detection;
use crate::progress::Progress;
use crate::sample::Measured;

/// Lowest score a reported box may have.
pub const MIN_SCORE: f32 = 0.01;

/// Samples that go through the network together.
const BATCH: usize = 4;

/// Why a sample could not be predicted.
#[derive(Debug, Error)]
#[error("sample {sample}: {source}")]
pub struct PredictError {
    pub sample: String,
    pub source: InputError,
}

/// Boxes of each sample, best first. The detector must be in inference mode (`valid()`); `with_camera` is
/// false only for one whose camera branch has not been trained yet.
///
/// # Errors
/// A sample's image is broken or its state is not finite.
pub fn predict(
    detector: &Detector,
    samples: &[(&str, &Measured)],
    with_camera: bool,
    device: &Device,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Detection>>, PredictError> {
    let config = detector.config();
    let mut found = Vec::with_capacity(samples.len());
    for chunk in samples.chunks(BATCH) {
        let inputs = chunk
            .par_iter()
            .map(|(id, measured)| {
                Input::prepare(measured, config, false, with_camera)
                    .map_err(|source| PredictError { sample: (*id).to_owned(), source })
            })
            .collect::<Result<Vec<_>, _>>()?;
        // Images of another size than the first one's go alone: a batch has one size.
        for same_size in inputs.chunk_by(|a, b| a.image_height_px() == b.image_height_px()) {
            let batch = Batch::stack(&same_size.iter().collect::<Vec<_>>(), config, with_camera, device);
            found.extend(detections(&detector.forward(&batch), config, MIN_SCORE));
        }
        progress.advance(chunk.len() as u64);
    }
    Ok(found)
}

/// The truth of each sample, to score any detector's boxes against.
pub fn truth_of(dataset: &Dataset) -> Boxes<EvalTruth> {
    let of_samples = dataset.samples().iter();
    let ids = || dataset.samples().iter().map(|sample| sample.id.clone());
    Boxes {
        path: dataset.path().to_owned(),
        samples: of_samples
            .map(|sample| (sample.id.clone(), sample.objects.iter().map(Into::into).collect()))
            .collect(),
        facts: ids().zip(facts::of_dataset(dataset)).collect(),
    }
}

/// Truth and detections of each sample, to be scored.
pub fn eval_samples(dataset: &Dataset, found: &[Vec<Detection>]) -> Vec<EvalSample> {
    dataset
        .samples()
        .iter()
        .zip(facts::of_dataset(dataset))
        .zip(found)
        .map(|((sample, facts), detections)| EvalSample {
            id: sample.id.clone(),
            facts,
            truths: sample.objects.iter().map(Into::into).collect(),
            detections: detections.iter().map(Into::into).collect(),
        })
        .collect()
}
