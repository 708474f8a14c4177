//! A labelled data set as what is scored: true boxes and facts of each sample, beside a detector's boxes.

use super::json::Boxes;
use super::{EvalSample, EvalTruth, facts};
use crate::dataset::Dataset;
use crate::object::Detection;

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
