//! Training steps: whole, as a run takes them, and one batch part by part.

use std::time::{Duration, Instant};

use burn::optim::GradientsParams;
use burn::tensor::Device;

use super::{Bench, BenchError, PACE, Times, TrainingReport};
use harmzone::dataset::Dataset;
use harmzone::model::{Batch, Input};
use harmzone::progress::Progress;
use harmzone::random;
use harmzone::train::{
    Learner, ObjectsByState, Plan, Position, STAGES, Steps, TrainConfig, TrainError, draw, losses, trainable,
};

/// Epochs over the measured samples before the first step that counts: all inputs are in the cache then.
const N_WARM_UP_EPOCHS: usize = 4;
/// Steps of an epoch over the measured samples.
const N_EPOCH_STEPS: usize = 4;

const PARTS: [&str; 5] = ["forward", "loss", "backward", "optimizer", "moving average"];

/// The detector in training.
pub fn learner(bench: &Bench) -> Result<Learner, BenchError> {
    Ok(Learner::start(bench.detector(&bench.device.clone().autodiff())?, bench.config))
}

/// Takes one whole step, from its samples to the moving average; returns its time.
pub fn step(
    bench: &Bench,
    learner: &mut Learner,
    steps: &mut Steps,
    position: Position,
) -> Result<Duration, BenchError> {
    let begin = Instant::now();
    learner.step(steps, position, PACE)?;
    bench.wait()?;
    Ok(begin.elapsed())
}

/// What [`parts`] trains on: one batch of the first samples, each with its recorded state and some drawn anew.
pub fn batch(
    bench: &Bench,
    stage: usize,
    n_samples: usize,
    device: &Device,
) -> Result<(Vec<Input>, Batch, Vec<ObjectsByState>), BenchError> {
    let config = bench.config;
    let with_camera = stage == 1;
    let augment = harmzone::train::AugmentConfig { mirror: false, ..config.augment_of_model() };
    let (mut inputs, mut objects) = (Vec::new(), Vec::new());
    for (i, sample) in bench.dataset.samples()[..n_samples].iter().enumerate() {
        let mut rng = random::stream(config.seed, "bench-states", i as u64);
        let recorded = &sample.measured.ego_state;
        let view = draw(recorded, &sample.objects, bench.dataset.zone(), &augment, &mut rng)
            .map_err(|source| TrainError::Label { sample: sample.id.clone(), source })?;
        let input = Input::prepare(&sample.measured, &config.model, false, with_camera)
            .and_then(|input| input.with_states(&view.states, false))
            .map_err(|source| BenchError::Input { sample: sample.id.clone(), source })?;
        inputs.push(input);
        objects.push(view.objects.iter().map(|of| trainable(of, &config.model.grid, &config.loss)).collect());
    }
    let batch = Batch::stack(&inputs.iter().collect::<Vec<_>>(), &config.model, with_camera, device);
    Ok((inputs, batch, objects))
}

pub fn measure(
    bench: &Bench,
    stage: usize,
    n_steps: usize,
    progress: &dyn Progress,
) -> Result<TrainingReport, BenchError> {
    let config = bench.config;
    progress.start(STAGES[stage], 2 * n_steps as u64);
    let few = bench.dataset.first(N_EPOCH_STEPS * bench.samples_per_step());
    let (step_times, loading) = whole_steps(bench, &few, stage, n_steps, progress)?;
    let parts = parts(bench, stage, n_steps, progress)?;
    progress.finish();
    Ok(TrainingReport {
        stage: STAGES[stage],
        batch_size: config.batch_size,
        accumulate: config.accumulate,
        n_states: 1 + config.augment_of_model().n_redrawn_states,
        n_steps,
        step: Times::of("step", &step_times),
        loading: Times::of("loading", &loading),
        parts: PARTS.into_iter().zip(&parts).map(|(name, times)| Times::of(name, times)).collect(),
    })
}

/// Times of steps, and of the loading in them.
fn whole_steps(
    bench: &Bench,
    dataset: &Dataset,
    stage: usize,
    n_steps: usize,
    progress: &dyn Progress,
) -> Result<(Vec<Duration>, Vec<Duration>), BenchError> {
    let plan = Plan::new(bench.config, dataset);
    let mut steps = Steps::new(&plan, dataset, bench.config, std::slice::from_ref(bench.device));
    let mut learner = learner(bench)?;
    let (mut times, mut loading) = (Vec::new(), Vec::new());
    let n_warm_up = N_WARM_UP_EPOCHS * plan.steps_per_epoch;
    for step_idx in 0..n_warm_up + n_steps {
        let loaded_before = steps.loading;
        let time = step(bench, &mut learner, &mut steps, Position { stage, step: step_idx })?;
        if step_idx >= n_warm_up {
            times.push(time);
            loading.push(steps.loading.saturating_sub(loaded_before));
            progress.advance(1);
        }
    }
    Ok((times, loading))
}

/// Times of the parts of a step over one batch.
fn parts(
    bench: &Bench,
    stage: usize,
    n_steps: usize,
    progress: &dyn Progress,
) -> Result<[Vec<Duration>; PARTS.len()], BenchError> {
    let config: &TrainConfig = bench.config;
    let device = bench.device.clone().autodiff();
    let (_, batch, objects) = batch(bench, stage, config.batch_size, &device)?;
    let mut learner = learner(bench)?;
    let mut times: [Vec<Duration>; PARTS.len()] = Default::default();
    for step_idx in 0..2 + n_steps {
        let mut spent = Vec::with_capacity(PARTS.len());
        let mut begin = Instant::now();
        let mut lap = || {
            bench.wait()?;
            spent.push(begin.elapsed());
            begin = Instant::now();
            Ok::<_, BenchError>(())
        };
        let output = learner.detector().forward(&batch);
        lap()?;
        let loss = losses(&output, &objects, &[], &config.model, &config.loss);
        lap()?;
        let gradients = GradientsParams::from_grads(loss.total.backward(), learner.detector());
        lap()?;
        learner.apply(gradients, PACE);
        lap()?;
        learner.update_average(step_idx);
        lap()?;
        // The first steps find memory and moments not yet there.
        if step_idx >= 2 {
            times.iter_mut().zip(spent).for_each(|(times, spent)| times.push(spent));
            progress.advance(1);
        }
    }
    Ok(times)
}
