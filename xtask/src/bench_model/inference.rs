//! Inference of one sample after the other: whole, and stage by stage.

use std::time::{Duration, Instant};

use burn::module::Module;

use super::{Bench, BenchError, InferenceReport, Times};
use harmzone::model::{Batch, Detector, InferenceStage, Input, InputError, detect_by_stage, detections};
use harmzone::object::Detection;
use harmzone::object::MIN_SCORE;
use harmzone::progress::Progress;
use harmzone::sample::Measured;

/// Samples before the first that counts.
const N_WARM_UP: usize = 20;

pub fn measure(
    bench: &Bench,
    n_samples: usize,
    progress: &dyn Progress,
) -> Result<InferenceReport, BenchError> {
    let detector = bench.detector(bench.device)?.valid();
    let mut of_stages = vec![Vec::with_capacity(n_samples); InferenceStage::ALL.len()];
    let mut totals = Vec::with_capacity(n_samples);
    progress.start("inference", n_samples as u64);
    for (i, sample) in bench.dataset.samples().iter().cycle().take(N_WARM_UP + n_samples).enumerate() {
        let fail = |source| BenchError::Input { sample: sample.id.clone(), source };
        let begin = Instant::now();
        detect(&detector, &sample.measured, bench).map_err(fail)?;
        let total = begin.elapsed();
        let mut spent = [Duration::ZERO; InferenceStage::ALL.len()];
        let mut waited = Ok(());
        detect_by_stage(&detector, &sample.measured, MIN_SCORE, bench.device, &mut |stage, work| {
            let begin = Instant::now();
            work();
            if waited.is_ok() {
                waited = bench.wait();
            }
            let place = InferenceStage::ALL.iter().position(|&of| of == stage);
            spent[place.expect("ALL holds all stages")] = begin.elapsed();
        })
        .map_err(fail)?;
        waited?;
        if i >= N_WARM_UP {
            totals.push(total);
            of_stages.iter_mut().zip(spent).for_each(|(times, spent)| times.push(spent));
            progress.advance(1);
        }
    }
    progress.finish();
    let total = Times::of("total", &totals);
    let stages = InferenceStage::ALL.iter().zip(&of_stages);
    Ok(InferenceReport {
        n_samples,
        stages: stages.map(|(stage, times)| Times::of(stage.name(), times)).collect(),
        samples_per_s: 1e3 / total.mean_ms,
        total,
    })
}

/// As `harmzone predict` does it, of one sample.
pub fn detect(detector: &Detector, measured: &Measured, bench: &Bench) -> Result<Vec<Detection>, InputError> {
    let config = detector.config();
    let input = Input::prepare(measured, config, false, config.use_camera)?;
    let batch = Batch::stack(&[&input], config, config.use_camera, bench.device);
    Ok(detections(&detector.forward(&batch), config, MIN_SCORE).concat())
}
