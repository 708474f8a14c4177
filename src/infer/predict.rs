//! Runs a detector over measured samples, with progress.

use burn::tensor::Device;
use rayon::prelude::*;
use thiserror::Error;

use crate::dataset::blind::Sensor;
use crate::dataset::{Dataset, LabelledSample, named};
use crate::device::is_cpu;
use crate::eval::judge::Judge;
use crate::model::{
    Batch, Classes, Detector, HeadJudge, Input, InputError, KindBox, Output, detections_by_state, kind_boxes,
};
use crate::object::{Detection, MIN_SCORE};
use crate::progress::Progress;
use crate::sample::{EgoState, Measured};
use crate::zone::{Zone, ZoneConfig, ZoneError};

/// Samples that go through the network together.
pub(super) const BATCH: usize = 4;

/// Samples that are copied together to blind a sensor.
const N_BLINDED: usize = 32;

/// Why samples could not be predicted.
#[derive(Debug, Error)]
pub enum PredictError {
    #[error("sample {sample}: {source}")]
    Input { sample: String, source: InputError },
    #[error(
        "sample {sample}: the network gives numbers without end, or none, by which it would find nothing; its weights are broken or too \
         large for 32 bits"
    )]
    NotFinite { sample: String },
    #[error("sample {sample}: its boxes cannot be judged (model.head.judge = \"both\"): {source}")]
    Judge { sample: String, source: ZoneError },
    #[error(
        "the network tells kinds of objects, not harm (model.head.classes = \"kind\"); \
         `harmzone baseline closed-msp RUN --data DIR --fit DIR` decides on harm by kind, `harmzone baseline zone RUN --data DIR` by box"
    )]
    TellsKinds,
    #[error(
        "the network tells harm, not kinds of objects; a closed set is trained by `harmzone train DATA --out RUN \
         --set model.head.classes=kind --set model.head.numeric_fusion=none --set validate_every_epochs=0`"
    )]
    TellsHarm,
}

/// Boxes of each sample, best first, with the harm that the network's own judge decides on (`model.head.judge`). The detector must be
/// in inference mode (`valid()`); `with_camera` is false only for one whose camera branch has not been trained yet.
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
    let recorded = |measured: &Measured| vec![measured.ego_state];
    let found = predict_states(detector, samples, &recorded, with_camera, device, progress)?;
    Ok(found.into_iter().flatten().collect())
}

/// As [`predict`], at several speeds and steering angles: `[sample][state][box]`. A sample's sensors pass
/// through the network once, since its state joins the last layers only.
///
/// # Arguments
/// - `states`: equally many for each sample
///
/// # Errors
/// A sample's image is broken or one of its states is not finite.
pub fn predict_states(
    detector: &Detector,
    samples: &[(&str, &Measured)],
    states: &(dyn Fn(&Measured) -> Vec<EgoState> + Sync),
    with_camera: bool,
    device: &Device,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Vec<Detection>>>, PredictError> {
    let mut found = predict_unjudged(detector, samples, states, with_camera, device, progress)?;
    let judge = own_judge(detector);
    if judge == Judge::Network {
        return Ok(found);
    }
    let zone = Zone::try_from(ZoneConfig::default()).expect("the default is valid");
    let judge_sample = |(found, (sample, measured)): (&mut Vec<Vec<Detection>>, &(&str, &Measured))| {
        for (found, state) in found.iter_mut().zip(states(measured)) {
            let judged = judge.judge(found, &state, &zone);
            *found = judged.map_err(|source| PredictError::Judge { sample: (*sample).to_owned(), source })?;
        }
        Ok(())
    };
    let told: Vec<Result<(), PredictError>> = found.par_iter_mut().zip(samples).map(judge_sample).collect();
    // The first error in the order of the samples.
    told.into_iter().collect::<Result<(), _>>()?;
    Ok(found)
}

/// What a network's own word on harm is: its class branch alone, or together with the expected zone.
pub(super) fn own_judge(detector: &Detector) -> Judge {
    match detector.config().head.judge {
        HeadJudge::Network => Judge::Network,
        HeadJudge::Both => Judge::Both,
    }
}

/// As [`predict_states`], with the harm of the class branch alone.
fn predict_unjudged(
    detector: &Detector,
    samples: &[(&str, &Measured)],
    states: &(dyn Fn(&Measured) -> Vec<EgoState> + Sync),
    with_camera: bool,
    device: &Device,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Vec<Detection>>>, PredictError> {
    if detector.config().head.classes != Classes::Harm {
        return Err(PredictError::TellsKinds);
    }
    let read = |output: &Output| detections_by_state(output, detector.config(), MIN_SCORE);
    forward(detector, samples, states, with_camera, device, progress, &read)
}

/// Boxes of each sample with their kinds, best first, of a detector of kinds; otherwise as [`predict`].
///
/// # Errors
/// The detector detects harm, not kinds; a sample's image is broken or its state is not finite.
pub fn predict_kinds(
    detector: &Detector,
    samples: &[(&str, &Measured)],
    device: &Device,
    progress: &dyn Progress,
) -> Result<Vec<Vec<KindBox>>, PredictError> {
    if detector.config().head.classes != Classes::Kind {
        return Err(PredictError::TellsHarm);
    }
    let recorded = |measured: &Measured| vec![measured.ego_state];
    let read = |output: &Output| kind_boxes(output, detector.config(), MIN_SCORE);
    forward(detector, samples, &recorded, detector.config().use_camera, device, progress, &read)
}

/// Boxes for a judge: for `network` as [`predict`], and with the harm of the class branch alone for one that judges them anew. One that rules
/// on boxes alone takes those of a detector of kinds as they are, whose class means nothing then.
///
/// # Errors
/// As [`predict`].
pub fn predict_for(
    judge: Judge,
    detector: &Detector,
    samples: &[(&str, &Measured)],
    device: &Device,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Detection>>, PredictError> {
    let with_camera = detector.config().use_camera;
    if judge == Judge::Network {
        return predict(detector, samples, with_camera, device, progress);
    }
    if judge.asks_the_network() || detector.config().head.classes == Classes::Harm {
        let recorded = |measured: &Measured| vec![measured.ego_state];
        let found = predict_unjudged(detector, samples, &recorded, with_camera, device, progress)?;
        return Ok(found.into_iter().flatten().collect());
    }
    let found = predict_kinds(detector, samples, device, progress)?;
    Ok(found.iter().map(|found| found.iter().map(KindBox::to_detection).collect()).collect())
}

/// Boxes of named samples, as [`Dataset::named`] gives them, by a detector in inference mode.
///
/// # Errors
/// As [`predict`].
pub fn detect(
    detector: &Detector,
    samples: &[(&str, &Measured)],
    device: &Device,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Detection>>, PredictError> {
    progress.start("predict", samples.len() as u64);
    let found = predict(detector, samples, detector.config().use_camera, device, progress)?;
    progress.finish();
    Ok(found)
}

/// As [`detect`], for a judge as [`predict_for`], with one sensor blinded where one is named; a few samples are copied at a time.
///
/// # Errors
/// As [`predict`].
pub fn detect_for(
    judge: Judge,
    detector: &Detector,
    samples: &[LabelledSample],
    blind: Option<Sensor>,
    device: &Device,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Detection>>, PredictError> {
    progress.start("predict", samples.len() as u64);
    let Some(sensor) = blind else {
        let found = predict_for(judge, detector, &named(samples), device, progress)?;
        progress.finish();
        return Ok(found);
    };
    let mut found = Vec::with_capacity(samples.len());
    for part in samples.chunks(N_BLINDED) {
        let mut part = part.to_vec();
        part.iter_mut().for_each(|sample| sensor.blind(&mut sample.measured));
        found.extend(predict_for(judge, detector, &named(&part), device, progress)?);
    }
    progress.finish();
    Ok(found)
}

/// As [`detect`], for a detector of kinds; `stage` names the progress.
///
/// # Errors
/// As [`predict_kinds`].
pub fn detect_kinds(
    detector: &Detector,
    dataset: &Dataset,
    stage: &str,
    device: &Device,
    progress: &dyn Progress,
) -> Result<Vec<Vec<KindBox>>, PredictError> {
    progress.start(stage, dataset.samples().len() as u64);
    let found = predict_kinds(detector, &dataset.named(), device, progress)?;
    progress.finish();
    Ok(found)
}

/// Runs the network and applies `read` to each sample's part of its output. On the CPU the threads take batches of their own.
fn forward<T: Send>(
    detector: &Detector,
    samples: &[(&str, &Measured)],
    states: &(dyn Fn(&Measured) -> Vec<EgoState> + Sync),
    with_camera: bool,
    device: &Device,
    progress: &dyn Progress,
    read: &(dyn Fn(&Output) -> Vec<T> + Sync),
) -> Result<Vec<T>, PredictError> {
    let config = detector.config();
    let of_chunk = |chunk: &[(&str, &Measured)]| -> Result<Vec<T>, PredictError> {
        let inputs = chunk
            .par_iter()
            .map(|(id, measured)| {
                Input::prepare(measured, config, false, with_camera)
                    .and_then(|input| input.with_states(&states(measured), false))
                    .map_err(|source| PredictError::Input { sample: (*id).to_owned(), source })
            })
            .collect::<Result<Vec<_>, _>>()?;
        let (mut found, mut n_done) = (Vec::with_capacity(chunk.len()), 0);
        // Images of another size than the first one's go alone: a batch has one size.
        for same_size in inputs.chunk_by(|a, b| a.image_height_px() == b.image_height_px()) {
            let batch = Batch::stack(&same_size.iter().collect::<Vec<_>>(), config, with_camera, device);
            let output = detector.forward(&batch);
            if let Some(i) = output.first_not_finite() {
                return Err(PredictError::NotFinite { sample: chunk[n_done + i].0.to_owned() });
            }
            n_done += same_size.len();
            found.extend(read(&output));
        }
        progress.advance(chunk.len() as u64);
        Ok(found)
    };
    let of_chunks: Vec<_> = if is_cpu(device) {
        samples.par_chunks(BATCH).map(of_chunk).collect()
    } else {
        samples.chunks(BATCH).map(of_chunk).collect()
    };
    // The first error in the order of the samples.
    let found: Vec<Vec<T>> = of_chunks.into_iter().collect::<Result<_, _>>()?;
    Ok(found.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use burn::module::{Module as _, ModuleMapper, Param};
    use burn::tensor::Tensor;

    use super::*;
    use crate::dataset::test_data;
    use crate::model::ModelConfig;
    use crate::progress::Silent;

    /// Weights whose products have no end in 32 bits.
    struct Vast;

    impl ModuleMapper for Vast {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            let (id, tensor, mapper) = param.consume();
            Param::from_mapped_value(id, tensor.mul_scalar(1e30), mapper)
        }
    }

    #[test]
    fn a_network_of_numbers_without_end_is_told_and_does_not_find_nothing() {
        let (data, device) = (test_data::dataset(2), Device::flex());
        let detector = Detector::init(&ModelConfig::in_little()[0], 0, &device);
        let find = |detector: &Detector| predict(detector, &data.named(), true, &device, &Silent);
        assert_eq!(find(&detector).unwrap().len(), data.samples().len());
        let told = find(&detector.map(&mut Vast)).unwrap_err().to_string();
        assert!(told.contains(data.named()[0].0) && told.contains("weights are broken"), "{told}");
    }
}
