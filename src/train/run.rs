//! The training loop: two stages. It can be resumed at any step and gives the same bytes however often it was stopped.
//!
//! Named streams of the run's seed give the order and augmentation of every step, so a step depends on its number
//! alone; a state is saved every `save_every_steps` steps.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use burn::module::Module as _;
use burn::tensor::Device;

use super::config::{StageConfig, TrainConfig};
use super::data_check::{self, idle_settings, is_any_annotated};
use super::dry_run::DryRun;
use super::epoch_table::EpochTable;
use super::error::TrainError;
use super::folder::{self, TrainOptions};
use super::learner::Learner;
use super::losses::LossParts;
use super::mean_loss::MeanLoss;
use super::plan::{Plan, Position, STAGES};
use super::state;
use super::step::Steps;
use super::time::Stopwatch;
use super::trained_on::{MADE_WITH_FILE, TrainedOn};
use super::validate::validate;
use crate::config::Checked;
use crate::dataset::{SampleSource, SeenEpisodes};
use crate::device::is_cpu;
use crate::files::{FolderLock, check_room, is_file};
use crate::history::{History, ScoreRow, StepRow};
use crate::interrupt::{self, SaveGuard};
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

/// What a run learns from, and what it is scored on between epochs.
#[derive(Debug, Clone, Copy)]
pub struct TrainingData<'a> {
    pub learned: SampleSource<'a>,
    pub validation: Option<SampleSource<'a>>,
}

impl<'a> TrainingData<'a> {
    pub fn new(learned: impl Into<SampleSource<'a>>, validation: Option<SampleSource<'a>>) -> Self {
        Self { learned: learned.into(), validation }
    }
}

/// Trains a detector; continues where an earlier call with the same config and data stopped. Scores the
/// moving average on the validation data between epochs.
///
/// # Arguments
/// - `devices`: at least one; they share the batches of each step, and the first one does the rest
///
/// # Errors
/// [`TrainError`]; the last saved state stays.
///
/// # Panics
/// There is no device.
pub fn run(
    data: TrainingData<'_>,
    config: &Checked<TrainConfig>,
    out: &Path,
    options: TrainOptions<'_>,
    devices: &[Device],
    progress: &dyn Progress,
) -> Result<Summary, TrainError> {
    let started = Instant::now();
    let TrainingData { learned, validation } = data;
    let n_samples = learned.n_samples();
    if n_samples == 0 {
        return Err(TrainError::NoSamples { path: learned.path().to_owned() });
    }
    let inference_device = &devices[0];
    if let Some(bound) = options.bound {
        // The tensors of a step take the memory of their device.
        let step_bytes =
            if is_cpu(inference_device) { DryRun::unchecked(learned, config)?.memory.total } else { 0 };
        bound.check_start(step_bytes)?;
    }
    let lock = FolderLock::take(out)?;
    let final_path = out.join(CHECKPOINT);
    let device = inference_device.clone().autodiff();
    let is_finished = !options.force && is_file(&final_path)?;
    if !is_finished {
        check_before_steps(data, config, devices.len())?;
    }
    // Before the folder is touched: image weights that cannot be read leave nothing that refuses the mended command.
    let begins_anew = !is_finished && (options.force || !state::is_any(out)?);
    let begun =
        if begins_anew && config.image_weights.is_some() { Some(begin(config, &device)?) } else { None };
    folder::open(learned.fingerprint(), config, out, options)?;
    let run_sha256 = folder::sha256(out)?;
    let plan = Plan::new(config, learned);
    let summary = |n_steps_now, last_loss, loading| Summary {
        checkpoint: final_path.clone(),
        n_samples,
        n_steps: plan.n_steps.iter().sum(),
        n_steps_now,
        last_loss,
        elapsed: started.elapsed(),
        loading,
        image_weights: None,
    };
    if is_file(&final_path)? {
        if checkpoint::read_config(&final_path)? != config.model {
            return Err(TrainError::OtherNetwork { path: final_path });
        }
        // A run that was killed at its very end leaves them.
        state::clear(out)?;
        let steps = History::read_until(out, usize::MAX)?.steps;
        return Ok(summary(0, MeanLoss::of_last_epoch(&steps).mean(), Duration::ZERO));
    }

    let stopwatch = Stopwatch::start(out);
    let mut image_weights = None;
    let saved = state::load_newest(out, &run_sha256, &plan, config, &device, inference_device)?;
    let has_state = saved.is_some();
    let (mut position, mut learner, mut history) = if let Some(saved) = saved {
        saved
    } else {
        let (detector, report) = match begun {
            Some(begun) => begun,
            None => begin(config, &device)?,
        };
        image_weights = report;
        (Position { stage: 0, step: 0 }, Learner::start(detector, config), History::read_until(out, 0)?)
    };
    check_room(out, state::bytes_to_come(learner.detector().num_params(), has_state))?;
    let others = TrainedOn::note(out, devices)?;
    if !others.is_empty() {
        tracing::warn!(
            "the run was begun on another machine ({}); in its last bits the network may differ from one that was trained on one \
             alone: {}",
            others.join(", "),
            out.join(MADE_WITH_FILE).display()
        );
    }
    // A step and a validation may take longer than a process that was asked to end is given.
    let _guard = SaveGuard::hold();
    let mut steps = Steps::new(&plan, learned, config, devices);
    steps.look_at_memory();
    let mut n_steps_now = 0;
    // A run that goes on in the middle of an epoch, or after the last step, has its earlier steps in the log.
    let mut epoch_loss = MeanLoss::of_last_epoch(&history.steps);
    while position.stage < STAGES.len() {
        let stage = STAGES[position.stage];
        let n_steps = plan.n_steps[position.stage];
        if n_steps == 0 {
            position = Position { stage: position.stage + 1, step: 0 };
            continue;
        }
        steps.begin_stage();
        let mut table = EpochTable::new(&plan, position, config.batch_size * config.accumulate);
        progress.start(stage, n_steps as u64);
        progress.skip(position.step as u64);
        while position.step < n_steps {
            let StageConfig { schedule, max_learning_rate, .. } = plan.stages[position.stage];
            let pace = schedule.pace(position.step, n_steps, max_learning_rate, config.rise_share);
            let (parts, norm) = learner.step(&mut steps, position, pace)?;
            if let Some(bound) = options.bound {
                steps.keep_below(bound);
            }
            let epoch = position.step / plan.steps_per_epoch;
            if position.step % plan.steps_per_epoch == 0 {
                epoch_loss = MeanLoss::default();
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
            table.count(1);
            progress.note(&format!(
                "epoch {} loss {:.3}{} {:.1} samples/s",
                epoch + 1,
                epoch_loss.mean().total(),
                table.last_ap.as_ref().map_or_else(String::new, |ap| format!(" AP {ap}")),
                table.samples_per_second()
            ));
            progress.advance(1);
            let is_epoch_end = position.step % plan.steps_per_epoch == 0;
            let is_due = config.validate_every_epochs > 0
                && is_epoch_end
                && (epoch + 1).is_multiple_of(config.validate_every_epochs);
            if let Some(data) = validation.filter(|_| is_due) {
                let scores = validate(&learner.result(), data, inference_device, position.stage == 1)?;
                steps.look_at_memory();
                table.last_ap =
                    Some(scores.mean.map_or_else(|| "unknown".to_owned(), |ap| format!("{ap:.3}")));
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
            if is_epoch_end {
                table.tell(progress, stage, epoch, epoch_loss.mean(), plan.n_done(position));
            }
            let grown = options.bound.and_then(|bound| bound.check().err());
            let is_asked = interrupt::is_asked();
            let is_over = is_asked || grown.is_some();
            if n_done.is_multiple_of(config.save_every_steps) {
                lock.check()?;
            }
            if (is_over || n_done.is_multiple_of(config.save_every_steps)) && position.step < n_steps {
                history.write(out)?;
                stopwatch.save(out)?;
                state::save(out, &run_sha256, &history, position, &learner)?;
                store::push(out)?;
            }
            // Of a stage's last step the state is saved below.
            if is_asked && position.step < n_steps {
                interrupt::check()?;
            }
            if let Some(grown) = grown.filter(|_| position.step < n_steps) {
                return Err(grown);
            }
        }
        progress.finish();
        position = Position { stage: position.stage + 1, step: 0 };
        learner.restart_optimizer(config);
        history.write(out)?;
        stopwatch.save(out)?;
        state::save(out, &run_sha256, &history, position, &learner)?;
        store::push(out)?;
        interrupt::check()?;
    }
    stopwatch.save(out)?;
    let seen = SeenEpisodes::of(learned.episodes(), validation.map(SampleSource::episodes));
    checkpoint::save(&learner.result(), Some(&seen), &final_path)?;
    state::clear(out)?;
    Ok(Summary { image_weights, ..summary(n_steps_now, epoch_loss.mean(), steps.loading) })
}

/// Refuses data that would end the run at some later step, and warns of what it will leave idle or not learn.
fn check_before_steps(
    data: TrainingData<'_>,
    config: &TrainConfig,
    n_devices: usize,
) -> Result<(), TrainError> {
    data_check::check(data.learned, config)?;
    for told in idle_settings(config, n_devices, data.validation.is_some()) {
        tracing::warn!("{told}");
    }
    if let Some(validation) = data.validation
        && !is_any_annotated(validation)?
    {
        tracing::warn!(
            "nobody annotated the validation split: its scores stay unknown, and the training goes on without them"
        );
    }
    Ok(())
}

/// A network before its first step, and what was loaded into its image backbone.
fn begin(
    config: &TrainConfig,
    device: &Device,
) -> Result<(Detector, Option<ImageWeightsReport>), TrainError> {
    let mut detector = Detector::init(&config.model, config.seed, device);
    let report = match &config.image_weights {
        Some(path) => Some(detector.load_image_weights(path)?),
        None => None,
    };
    Ok((detector, report))
}
