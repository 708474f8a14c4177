//! The training loop: two stages. It can be resumed at any step and gives the same bytes however often it was stopped.
//!
//! Named streams of the run's seed give the order and augmentation of every step, so a step depends on its number
//! alone; a state is saved every `save_every_steps` steps.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use burn::tensor::Device;

use super::config::{StageConfig, TrainConfig};
use super::error::TrainError;
use super::folder::{self, TrainOptions};
use super::learner::Learner;
use super::losses::LossParts;
use super::plan::{Plan, Position, STAGES};
use super::state;
use super::step::{Mean, Steps};
use super::time::Stopwatch;
use super::validate::validate;
use crate::config::Checked;
use crate::dataset::{Dataset, SeenEpisodes};
use crate::history::{History, ScoreRow, StepRow};
use crate::model::checkpoint::{self, CHECKPOINT};
use crate::model::{Detector, ImageWeightsReport};
use crate::progress::Progress;
use crate::store;

/// The outcome of a run.
#[derive(Debug, Clone)]
pub struct Summary {
    pub checkpoint: PathBuf,
    pub n_samples: usize,
    /// Steps of all stages, and the number that this call took.
    pub n_steps: usize,
    pub n_steps_now: usize,
    /// Mean loss over the last epoch.
    pub last_loss: LossParts,
    pub elapsed: Duration,
    /// The part of `elapsed` that was spent on preparing inputs.
    pub loading: Duration,
    /// Weights that this call loaded into the image backbone.
    pub image_weights: Option<ImageWeightsReport>,
}

/// Trains a detector; continues where an earlier call with the same config and data stopped. Scores the
/// moving average on `validation` between epochs.
///
/// # Errors
/// [`TrainError`]; the last saved state stays.
pub fn run(
    dataset: &Dataset,
    validation: Option<&Dataset>,
    config: &Checked<TrainConfig>,
    out: &Path,
    options: TrainOptions<'_>,
    device: &Device,
    progress: &dyn Progress,
) -> Result<Summary, TrainError> {
    let started = Instant::now();
    let samples = dataset.samples();
    if samples.is_empty() {
        return Err(TrainError::NoSamples { path: dataset.path().to_owned() });
    }
    folder::open(dataset, config, out, options)?;
    let plan = Plan::new(config, samples);
    let final_path = out.join(CHECKPOINT);
    let summary = |n_steps_now, last_loss, loading| Summary {
        checkpoint: final_path.clone(),
        n_samples: samples.len(),
        n_steps: plan.n_steps.iter().sum(),
        n_steps_now,
        last_loss,
        elapsed: started.elapsed(),
        loading,
        image_weights: None,
    };
    if final_path.exists() {
        return Ok(summary(0, LossParts::default(), Duration::ZERO));
    }

    let stopwatch = Stopwatch::start(out);
    let inference_device = device;
    let device = device.clone().autodiff();
    let mut image_weights = None;
    let saved = state::load_newest(out, config, &device, inference_device)?;
    let (mut position, mut learner) = if let Some(saved) = saved {
        saved
    } else {
        let mut detector = Detector::init(&config.model, config.seed, &device);
        if let Some(path) = &config.image_weights {
            image_weights = Some(detector.load_image_weights(path)?);
        }
        (Position { stage: 0, step: 0 }, Learner::start(detector, config))
    };
    let mut history = History::read_until(out, plan.n_done(position))?;
    let mut steps = Steps::new(&plan, dataset, config, &device);
    let mut n_steps_now = 0;
    let mut epoch_loss = Mean::default();
    while position.stage < STAGES.len() {
        let stage = STAGES[position.stage];
        let n_steps = plan.n_steps[position.stage];
        if n_steps == 0 {
            position = Position { stage: position.stage + 1, step: 0 };
            continue;
        }
        steps.begin_stage();
        progress.start(stage, n_steps as u64);
        progress.advance(position.step as u64);
        while position.step < n_steps {
            let StageConfig { schedule, max_learning_rate, .. } = plan.stages[position.stage];
            let pace = schedule.pace(position.step, n_steps, max_learning_rate, config.rise_share);
            let (parts, norm) = learner.step(&mut steps, position, pace)?;
            let epoch = position.step / plan.steps_per_epoch;
            if position.step % plan.steps_per_epoch == 0 {
                epoch_loss = Mean::default();
            }
            epoch_loss.add(parts);
            position.step += 1;
            n_steps_now += 1;
            let n_done = plan.n_done(position);
            history.steps.push(StepRow {
                n_done,
                stage: stage.to_owned(),
                epoch,
                learning_rate: pace.learning_rate,
                heatmap: parts.heatmap.into(),
                harm: parts.harm.into(),
                boxes: parts.boxes.into(),
                picture: parts.picture.into(),
                gradient_norm: norm.into(),
            });
            progress.note(&format!("epoch {} loss {:.3}", epoch + 1, epoch_loss.mean().total()));
            progress.advance(1);
            let is_epoch_end = position.step % plan.steps_per_epoch == 0;
            let is_due = config.validate_every_epochs > 0
                && is_epoch_end
                && (epoch + 1).is_multiple_of(config.validate_every_epochs);
            if let Some(data) = validation.filter(|_| is_due) {
                let scores = validate(&learner.result(), data, inference_device, position.stage == 1)?;
                let mean =
                    scores.mean.map_or_else(|| "unknown, no truth".to_owned(), |ap| format!("{ap:.3}"));
                progress.note(&format!("epoch {} mAP {mean}", epoch + 1));
                history.scores.push(ScoreRow {
                    n_done,
                    stage: stage.to_owned(),
                    epoch,
                    harmful: scores.harmful,
                    harmless: scores.harmless,
                    mean: scores.mean,
                });
                history.write(out)?;
                if let Some(tell) = options.after_validation {
                    tell(out);
                }
            }
            if n_done.is_multiple_of(config.save_every_steps) && position.step < n_steps {
                history.write(out)?;
                stopwatch.save(out)?;
                state::save(out, n_done, position, &learner)?;
                store::push(out)?;
            }
        }
        progress.finish();
        position = Position { stage: position.stage + 1, step: 0 };
        learner.restart_optimizer(config);
        history.write(out)?;
        stopwatch.save(out)?;
        state::save(out, plan.n_done(position), position, &learner)?;
        store::push(out)?;
    }
    stopwatch.save(out)?;
    let seen = SeenEpisodes::of(dataset, validation);
    checkpoint::save(&learner.result(), Some(&seen), &final_path)?;
    state::clear(out)?;
    Ok(Summary { image_weights, ..summary(n_steps_now, epoch_loss.mean(), steps.loading) })
}

#[cfg(test)]
mod tests {
    use super::super::{Schedule, TrainingTime};
    use super::*;
    use crate::dataset::test_data;
    use crate::history::{SCORES_FILE, STEPS_FILE};
    use crate::model::{
        CameraConfig, CnnConfig, GridConfig, HeadConfig, LidarConfig, ModelConfig, PillarConfig,
    };
    use crate::progress::Silent;
    use fs_err as fs;

    fn tiny() -> TrainConfig {
        let stage = |epochs, schedule| StageConfig { epochs, max_learning_rate: 2e-3, schedule };
        TrainConfig {
            batch_size: 1,
            accumulate: 2,
            // The two that change beta1 from step to step.
            lidar_stage: stage(2, Schedule::Cyclic),
            fused_stage: stage(1, Schedule::WarmupCosine),
            save_every_steps: 1,
            model: ModelConfig {
                grid: GridConfig { cell_size_m: 3.2, ..GridConfig::default() },
                fuser_channels: 16,
                lidar: LidarConfig {
                    pillars: PillarConfig { channels: 8, bev_channels: [16, 16], ..PillarConfig::default() },
                    ..LidarConfig::default()
                },
                camera: CameraConfig {
                    cnn: CnnConfig { image_width_px: 64, n_depth_bins: 12, ..CnnConfig::default() },
                    ..CameraConfig::default()
                },
                head: HeadConfig { channels: 16, n_queries: 8, ffn_channels: 32, ..HeadConfig::default() },
                ..ModelConfig::default()
            },
            ..TrainConfig::default()
        }
    }

    fn checked(config: &TrainConfig) -> Checked<TrainConfig> {
        Checked::new(config.clone()).unwrap()
    }

    fn train(data: &Dataset, config: &TrainConfig, out: &Path) -> Result<Summary, TrainError> {
        run(
            data,
            None,
            &Checked::new(config.clone())?,
            out,
            TrainOptions::default(),
            &Device::flex(),
            &Silent,
        )
    }

    /// Stops a run after some steps, as a kill would, by a watcher that panics.
    struct Stop {
        after: std::sync::atomic::AtomicI64,
    }

    impl Progress for Stop {
        fn start(&self, _stage: &str, _total: u64) {}
        fn advance(&self, n: u64) {
            let left = self.after.fetch_sub(n as i64, std::sync::atomic::Ordering::SeqCst) - n as i64;
            assert!(left > 0, "stopped on purpose");
        }
        fn note(&self, _text: &str) {}
        fn finish(&self) {}
    }

    #[test]
    fn a_run_stopped_in_either_stage_and_called_again_ends_with_the_same_bytes() {
        let data = test_data::dataset(6);
        let config = tiny();
        let folder = tempfile::tempdir().unwrap();
        let options = TrainOptions::default();
        let path = folder.path().join("whole");
        let told = std::cell::RefCell::new(Vec::new());
        let tell = |run: &Path| {
            let history = History::read(run).unwrap();
            told.borrow_mut().push((history.steps.len(), history.scores.len()));
        };
        let telling = TrainOptions { after_validation: Some(&tell), ..options };
        let whole =
            run(&data, Some(&data), &checked(&config), &path, telling, &Device::flex(), &Silent).unwrap();
        assert_eq!(told.into_inner(), [(3, 1), (6, 2), (9, 3)], "logs are up to date at each validation");
        let broken = folder.path().join("broken");
        for after in [2, 5, 2] {
            let watcher = Stop { after: after.into() };
            let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                run(
                    &data,
                    Some(&data),
                    &checked(&config),
                    &broken,
                    TrainOptions::default(),
                    &Device::flex(),
                    &watcher,
                )
            }));
            assert!(stopped.is_err() && !broken.join(CHECKPOINT).exists());
        }
        let resumed =
            run(&data, Some(&data), &checked(&config), &broken, options, &Device::flex(), &Silent).unwrap();
        assert!(resumed.n_steps_now < whole.n_steps_now);
        assert_eq!(TrainingTime::read(&broken).unwrap().n_calls, 3);
        assert!(fs::read(&whole.checkpoint).unwrap() == fs::read(&resumed.checkpoint).unwrap());
        for name in [STEPS_FILE, SCORES_FILE] {
            assert_eq!(fs::read(path.join(name)).unwrap(), fs::read(broken.join(name)).unwrap(), "{name}");
        }
    }

    #[test]
    fn a_folder_with_another_run_is_left_alone_without_force() {
        let data = test_data::dataset(2);
        let folder = tempfile::tempdir().unwrap();
        train(&data, &tiny(), folder.path()).unwrap();
        let before = fs::read(folder.path().join(CHECKPOINT)).unwrap();
        let other = TrainConfig { seed: 1, ..tiny() };
        assert!(matches!(train(&data, &other, folder.path()), Err(TrainError::OtherRun { .. })));
        assert_eq!(fs::read(folder.path().join(CHECKPOINT)).unwrap(), before);
        let forced = TrainOptions { force: true, ..TrainOptions::default() };
        run(&data, None, &checked(&other), folder.path(), forced, &Device::flex(), &Silent).unwrap();
        assert_ne!(fs::read(folder.path().join(CHECKPOINT)).unwrap(), before);
    }

    #[test]
    fn a_broken_sample_is_named() {
        let mut data = test_data::dataset(2);
        data.sample_mut(1).measured.ego_state.steering_angle_rad = f64::NAN;
        let config = TrainConfig {
            augment: super::super::AugmentConfig { n_redrawn_states: 0, ..Default::default() },
            ..tiny()
        };
        let folder = tempfile::tempdir().unwrap();
        let message = train(&data, &config, folder.path()).unwrap_err().to_string();
        assert!(message.contains("made/1") && message.contains("steering_angle_rad"), "{message}");
    }

    #[test]
    fn resuming_where_there_is_nothing_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let options = TrainOptions { resume: true, ..TrainOptions::default() };
        let ended = run(
            &test_data::dataset(2),
            None,
            &checked(&tiny()),
            folder.path(),
            options,
            &Device::flex(),
            &Silent,
        );
        assert!(matches!(ended, Err(TrainError::NothingToResume { .. })));
    }

    #[test]
    fn training_lowers_the_loss() {
        let data = test_data::dataset(4);
        let stage = StageConfig { epochs: 30, max_learning_rate: 4e-3, schedule: Schedule::OneCycle };
        let config = TrainConfig { lidar_stage: stage, ..tiny() };
        let folder = tempfile::tempdir().unwrap();
        train(&data, &config, folder.path()).unwrap();
        let steps = History::read(folder.path()).unwrap().steps;
        let losses: Vec<f64> = steps.iter().map(|row| row.heatmap + row.harm + row.boxes).collect();
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        assert!(mean(&losses[50..60]) < 0.5 * mean(&losses[..4]), "{losses:?}");
    }
}
