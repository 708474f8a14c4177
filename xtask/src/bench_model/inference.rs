//! Inference of one sample after the other: whole, and stage by stage.

use std::time::{Duration, Instant};

use burn::module::Module;

use super::{Bench, BenchError, InferenceReport, Times};
use harmzone::model::{Batch, Detector, Input, InputError, detect_by_stage, detections};
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
    let mut of_stages: Vec<(&str, Vec<Duration>)> = Vec::new();
    let mut totals = Vec::with_capacity(n_samples);
    progress.start("inference", n_samples as u64);
    for (i, sample) in bench.dataset.samples().iter().cycle().take(N_WARM_UP + n_samples).enumerate() {
        let fail = |source| BenchError::Input { sample: sample.id.clone(), source };
        let begin = Instant::now();
        detect(&detector, &sample.measured, bench).map_err(fail)?;
        let total = begin.elapsed();
        let mut spent = Vec::new();
        let mut waited = Ok(());
        let mut begin = Instant::now();
        detect_by_stage(&detector, &sample.measured, MIN_SCORE, bench.device, &mut |stage| {
            if waited.is_ok() {
                waited = bench.wait();
            }
            spent.push((stage, begin.elapsed()));
            begin = Instant::now();
        })
        .map_err(fail)?;
        waited?;
        if i >= N_WARM_UP {
            totals.push(total);
            of_stages.resize_with(spent.len(), Default::default);
            for (times, (stage, spent)) in of_stages.iter_mut().zip(spent) {
                times.0 = stage;
                times.1.push(spent);
            }
            progress.advance(1);
        }
    }
    progress.finish();
    let total = Times::of("total", &totals);
    Ok(InferenceReport {
        n_samples,
        stages: of_stages.iter().map(|(stage, times)| Times::of(stage, times)).collect(),
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
