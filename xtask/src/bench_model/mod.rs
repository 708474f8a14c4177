//! How fast a detector is: inference stage by stage, training steps part by part, and one side of a race against
//! the same network elsewhere.

mod dump;
mod inference;
mod race;
mod text;
mod training;

use std::path::PathBuf;
use std::time::Duration;

use burn::tensor::Device;
use serde::Serialize;
use thiserror::Error;

use harmzone::config::Checked;
use harmzone::dataset::Dataset;
use harmzone::model::checkpoint::{self, CheckpointError};
use harmzone::model::{Classes, Detector, InputError};
use harmzone::progress::Progress;
use harmzone::train::{BETA_1, Pace, TrainConfig, TrainError};

pub use dump::dump;
pub use race::{Contest, race};

/// Pace of measured steps; slow, so that weights stay near where they were.
const PACE: Pace = Pace { learning_rate: 1e-5, beta_1: BETA_1 };

/// Why nothing could be measured.
#[derive(Debug, Error)]
pub enum BenchError {
    #[error("sample {sample}: {source}")]
    Input { sample: String, source: InputError },
    #[error(transparent)]
    Train(#[from] TrainError),
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error("cannot write what the race needs: {0}")]
    Io(#[from] std::io::Error),
    #[error("cannot pack what the race needs: {message}: {}", path.display())]
    Pack { message: String, path: PathBuf },
    #[error("the split holds {found} samples; at least {wanted} are needed: {}", path.display())]
    TooFewSamples { found: usize, wanted: usize, path: PathBuf },
    #[error("the device failed: {message}")]
    Device { message: String },
    #[error("only the `small` network has a twin to race against; the model has {found}")]
    NoTwin { found: &'static str },
    #[error(
        "only a network that tells harm is measured; this one tells kinds (model.head.classes = \"kind\")"
    )]
    TellsKinds,
}

/// What is measured.
pub struct Bench<'a> {
    pub dataset: &'a Dataset,
    /// Its `model` is the checkpoint's, where there is one.
    pub config: &'a Checked<TrainConfig>,
    /// Where it lies, and its bytes. Random weights of the config's seed without it.
    pub checkpoint: Option<(PathBuf, &'a [u8])>,
    pub device: &'a Device,
}

/// How much is measured.
#[derive(Debug, Clone, Copy)]
pub struct BenchOptions {
    /// Samples of inference, timed.
    pub n_samples: usize,
    /// Steps of each training stage, timed.
    pub n_steps: usize,
}

/// All figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    pub n_threads: usize,
    pub inference: InferenceReport,
    pub training: Vec<TrainingReport>,
}

/// Inference, one sample at a time, from cloud and packed picture to boxes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InferenceReport {
    pub n_samples: usize,
    /// By the stages' functions, one after the other.
    pub stages: Vec<Times>,
    /// By the whole functions, measured by itself: more than the stages where these are cheaper alone, less where
    /// some run at once.
    pub total: Times,
    /// What the mean total makes.
    pub samples_per_s: f64,
}

/// Steps of one stage of training.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrainingReport {
    pub stage: &'static str,
    pub batch_size: usize,
    /// Batches of a step.
    pub accumulate: usize,
    /// Speeds and steering angles asked about for each sample.
    pub n_states: usize,
    pub n_steps: usize,
    /// Whole steps as a run takes them, inputs in its cache.
    pub step: Times,
    /// Part of them: inputs.
    pub loading: Times,
    /// One batch, measured by itself: forward, loss, backward, optimizer (clipping too), moving average.
    pub parts: Vec<Times>,
}

/// Times of one thing done repeatedly.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Times {
    pub name: &'static str,
    pub mean_ms: f64,
    pub p50_ms: f64,
    pub p90_ms: f64,
    pub p99_ms: f64,
}

impl Times {
    fn of(name: &'static str, times: &[Duration]) -> Self {
        let mut ms: Vec<f64> = times.iter().map(|&time| in_ms(time)).collect();
        ms.sort_by(f64::total_cmp);
        let mean_ms = ms.iter().sum::<f64>() / ms.len().max(1) as f64;
        let at = |share| nearest_rank(&ms, share);
        Self { name, mean_ms, p50_ms: at(0.5), p90_ms: at(0.9), p99_ms: at(0.99) }
    }
}

fn in_ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// The least value that a share of all does not exceed; 0 of none.
fn nearest_rank(ascending: &[f64], share: f64) -> f64 {
    let rank = (share * ascending.len() as f64).ceil().max(1.0) as usize;
    ascending.get(rank - 1).copied().unwrap_or_default()
}

impl Bench<'_> {
    /// Measures inference, then training.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, options: BenchOptions, progress: &dyn Progress) -> Result<BenchReport, BenchError> {
        self.check()?;
        let inference = inference::measure(self, options.n_samples, progress)?;
        let mut training = Vec::new();
        for stage in [0, 1] {
            training.push(training::measure(self, stage, options.n_steps, progress)?);
        }
        Ok(BenchReport { n_threads: rayon::current_num_threads(), inference, training })
    }

    /// Samples of one step.
    fn samples_per_step(&self) -> usize {
        self.config.batch_size * self.config.accumulate
    }

    fn check(&self) -> Result<(), BenchError> {
        if self.config.model.head.classes != Classes::Harm {
            return Err(BenchError::TellsKinds);
        }
        let (found, wanted) = (self.dataset.samples().len(), self.samples_per_step());
        if found < wanted {
            let path = self.dataset.path().to_owned();
            return Err(BenchError::TooFewSamples { found, wanted, path });
        }
        Ok(())
    }

    /// Waits for the device: a GPU has only queued what it was asked for.
    fn wait(&self) -> Result<(), BenchError> {
        self.device.sync().map_err(|error| BenchError::Device { message: error.reason().to_owned() })
    }

    /// The detector on a device.
    fn detector(&self, device: &Device) -> Result<Detector, BenchError> {
        Ok(match &self.checkpoint {
            Some((path, bytes)) => checkpoint::unpack(bytes, path, device)?,
            None => Detector::init(&self.config.model, self.config.seed, device),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmzone::dataset::test_data;
    use harmzone::progress::Silent;

    #[test]
    fn percentiles_are_values_that_occurred() {
        let hundred: Vec<Duration> = (1..=100).rev().map(Duration::from_millis).collect();
        let times = Times::of("x", &hundred);
        assert_eq!((times.p50_ms, times.p90_ms, times.p99_ms), (50.0, 90.0, 99.0));
        assert!((times.mean_ms - 50.5).abs() < 1e-9);
        assert_eq!(Times::of("x", &[]).p99_ms, 0.0);
    }

    fn tiny() -> Checked<TrainConfig> {
        let mut config = TrainConfig { batch_size: 2, accumulate: 1, ..TrainConfig::default() };
        let model = &mut config.model;
        (model.grid.cell_size_m, model.camera.cnn.image_width_px, model.head.n_queries) = (3.2, 64, 20);
        Checked::new(config).unwrap()
    }

    #[test]
    fn every_stage_and_part_is_measured_as_often_as_asked() {
        let (data, config, device) = (test_data::dataset(3), tiny(), Device::flex());
        let bench = Bench { dataset: &data, config: &config, checkpoint: None, device: &device };
        let report = bench.run(BenchOptions { n_samples: 5, n_steps: 2 }, &Silent).unwrap();
        assert_eq!(report.inference.n_samples, 5);
        assert!(report.inference.total.p50_ms > 0.0 && report.inference.samples_per_s > 0.0);
        let branch = report.inference.stages.iter().find(|stage| stage.name == "LiDAR branch").unwrap();
        assert!(branch.p50_ms > 0.0 && branch.p50_ms <= branch.p99_ms);
        for (of, stage) in report.training.iter().zip(["lidar", "fused"]) {
            assert_eq!((of.stage, of.n_states, of.n_steps), (stage, 8, 2));
            assert!(of.parts.iter().all(|part| part.p50_ms > 0.0), "{:?}", of.parts);
            assert!(of.loading.p50_ms < of.step.p50_ms);
        }
        assert!(report.to_string().contains("| lift and splat |"), "{report}");
    }

    #[test]
    fn a_split_with_less_than_a_step_is_refused() {
        let (data, config, device) = (test_data::dataset(1), tiny(), Device::flex());
        let bench = Bench { dataset: &data, config: &config, checkpoint: None, device: &device };
        let refused = bench.run(BenchOptions { n_samples: 1, n_steps: 1 }, &Silent).unwrap_err();
        assert!(matches!(refused, BenchError::TooFewSamples { found: 1, wanted: 2, .. }));
    }
}
