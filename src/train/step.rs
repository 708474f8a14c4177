//! One step of a run: prepares and augments its samples and computes the gradients of their loss.

use std::time::{Duration, Instant};

use burn::optim::{GradientsAccumulator, GradientsParams};
use burn::tensor::Device;
use rand::RngExt;
use rayon::prelude::*;

use super::augment::{self, ObjectsByState};
use super::cache::{Cache, Key};
use super::config::TrainConfig;
use super::copies::{average_statistics, copy_detector};
use super::error::TrainError;
use super::losses::{LossParts, losses};
use super::paste::paste;
use super::plan::{Plan, Position, STAGES};
use super::targets::trainable;
use crate::dataset::Dataset;
use crate::device::is_cpu;
use crate::model::{Batch, Detector, Input};
use crate::random;

/// Computes the steps of a run, in any order: a step depends on its position alone.
pub struct Steps<'a> {
    plan: &'a Plan,
    dataset: &'a Dataset,
    config: &'a TrainConfig,
    device: &'a Device,
    cache: Cache,
    /// Time spent on preparing inputs.
    pub loading: Duration,
}

impl<'a> Steps<'a> {
    pub fn new(plan: &'a Plan, dataset: &'a Dataset, config: &'a TrainConfig, device: &'a Device) -> Self {
        let cache = Cache::new(config.cache_mib);
        Self { plan, dataset, config, device, cache, loading: Duration::ZERO }
    }

    /// Empties the cache: stages need different inputs.
    pub fn begin_stage(&self) {
        self.cache.clear();
    }

    /// Computes the gradients of one step and its loss, both as the mean over its batches.
    ///
    /// # Errors
    /// A sample is broken, or the loss is not finite.
    pub fn gradients(
        &mut self,
        detector: Detector,
        position: Position,
    ) -> Result<(Detector, GradientsParams, LossParts), TrainError> {
        let config = self.config;
        let batches = self.plan.step_samples(config, position);
        let started = Instant::now();
        let prepared = (batches.par_iter().enumerate())
            .map(|(batch_idx, chosen)| {
                let first_draw = (position.step * config.accumulate + batch_idx) * config.batch_size;
                let (inputs, objects) = self.prepare(chosen, position, first_draw)?;
                Ok((chosen.as_slice(), first_draw, inputs, objects))
            })
            .collect::<Result<Vec<_>, TrainError>>()?;
        let stack = |(chosen, first_draw, inputs, objects): (_, _, Vec<Input>, _)| {
            let inputs: Vec<&Input> = inputs.iter().collect();
            let batch = Batch::stack(&inputs, &config.model, position.stage == 1, self.device);
            Prepared { chosen, first_draw, batch, objects }
        };
        let prepared: Vec<Prepared> = if is_cpu(self.device) {
            prepared.into_par_iter().map(stack).collect()
        } else {
            prepared.into_iter().map(stack).collect()
        };
        self.loading += started.elapsed();
        let share = 1.0 / batches.len() as f64;
        let mut passes = Vec::new();
        let steps: &Self = self;
        for abreast in prepared.chunks(n_abreast(config, self.device)) {
            if let [alone] = abreast {
                passes.push(steps.pass(copy_detector(&detector), alone, position, share));
                continue;
            }
            // In the pool, so that no operation has to hand its work over to other threads and wait.
            let copies: Vec<_> =
                abreast.iter().map(|prepared| (copy_detector(&detector), prepared)).collect();
            let pass = |(copy, prepared): (_, &Prepared)| steps.pass(copy, prepared, position, share);
            passes.extend(copies.into_par_iter().map(pass).collect::<Vec<_>>());
        }
        let mut sum = GradientsAccumulator::new();
        let mut mean = Mean::default();
        let mut copies = Vec::new();
        for pass in passes {
            let (copy, gradients, parts) = pass?;
            mean.add(parts);
            sum.accumulate(&detector, gradients);
            copies.push(copy);
        }
        Ok((average_statistics(detector, &copies), sum.grads(), mean.mean()))
    }

    /// The samples of a step.
    pub fn samples(&self, position: Position) -> Vec<usize> {
        self.plan.step_samples(self.config, position).concat()
    }

    /// The error of a loss or a gradient that is not finite.
    pub fn not_finite(&self, found: f32, position: Position, chosen: &[usize]) -> TrainError {
        TrainError::NotFinite {
            found,
            step: position.step,
            stage: STAGES[position.stage],
            samples: chosen.iter().map(|&i| self.dataset.samples()[i].id.clone()).collect(),
        }
    }

    /// Passes forward and backward through one batch.
    fn pass(
        &self,
        detector: Detector,
        prepared: &Prepared,
        position: Position,
        share: f64,
    ) -> Result<(Detector, GradientsParams, LossParts), TrainError> {
        let config = self.config;
        // So dropout depends on the step alone, however often the run was stopped.
        let name = format!("dropout-{}", STAGES[position.stage]);
        Detector::seed(self.device, random::stream(config.seed, &name, prepared.first_draw as u64).random());
        let loss = losses(&detector.forward(&prepared.batch), &prepared.objects, &config.model, &config.loss);
        if !loss.parts.total().is_finite() {
            return Err(self.not_finite(loss.parts.total(), position, prepared.chosen));
        }
        let gradients = loss.total.mul_scalar(share).backward();
        let gradients = GradientsParams::from_grads(gradients, &detector);
        Ok((detector, gradients, loss.parts))
    }

    /// Augments and prepares the samples of a batch.
    fn prepare(
        &self,
        chosen: &[usize],
        position: Position,
        first_draw: usize,
    ) -> Result<(Vec<Input>, Vec<ObjectsByState>), TrainError> {
        let config = self.config;
        let samples = self.dataset.samples();
        let with_camera = position.stage == 1;
        let augment = config.augment_of_model();
        let prepared = chosen
            .par_iter()
            .enumerate()
            .map(|(place, &sample_idx)| {
                let sample = &samples[sample_idx];
                let draw_idx = (first_draw + place) as u64;
                let mut rng =
                    random::stream(config.seed, &format!("augment-{}", STAGES[position.stage]), draw_idx);
                let mut paste_rng =
                    random::stream(config.seed, &format!("paste-{}", STAGES[position.stage]), draw_idx);
                let zone = self.dataset.zone();
                let not_labelled = |source| TrainError::Label { sample: sample.id.clone(), source };
                let pasted = paste(sample, samples, zone, &augment, &mut paste_rng).map_err(not_labelled)?;
                let (measured, objects) = match &pasted {
                    Some(pasted) => (&pasted.measured, &pasted.objects),
                    None => (&sample.measured, &sample.objects),
                };
                let view = augment::draw(&measured.ego_state, objects, zone, &augment, &mut rng)
                    .map_err(not_labelled)?;
                let key = Key { sample_idx, mirror: view.mirror, with_camera };
                let prepare = || Input::prepare(measured, &config.model, view.mirror, with_camera);
                let input = if pasted.is_some() { prepare() } else { self.cache.get(key, prepare) }
                    .and_then(|input| input.with_states(&view.states, view.mirror))
                    .map_err(|source| TrainError::Input { sample: sample.id.clone(), source })?;
                Ok((input, view.objects.iter().map(|of| trainable(of, &config.model.grid)).collect()))
            })
            .collect::<Result<Vec<_>, TrainError>>()?;
        Ok(prepared.into_iter().unzip())
    }
}

/// Number of a step's batches that run in parallel: one for each thread. It is 1 if the network has dropout,
/// which draws from one generator, and on a GPU, which one batch keeps busy.
#[must_use]
pub fn n_abreast(config: &TrainConfig, device: &Device) -> usize {
    if config.model.draws_in_training() || !is_cpu(device) {
        1
    } else {
        config.accumulate.min(rayon::current_num_threads())
    }
}

/// One batch of a step, ready for the network.
struct Prepared<'a> {
    chosen: &'a [usize],
    first_draw: usize,
    batch: Batch,
    objects: Vec<ObjectsByState>,
}

/// Running mean of losses.
#[derive(Default)]
pub struct Mean {
    sum: LossParts,
    n: usize,
}

impl Mean {
    pub fn add(&mut self, parts: LossParts) {
        self.sum.heatmap += parts.heatmap;
        self.sum.harm += parts.harm;
        self.sum.boxes += parts.boxes;
        self.n += 1;
    }

    pub fn mean(&self) -> LossParts {
        let n = self.n.max(1) as f32;
        LossParts { heatmap: self.sum.heatmap / n, harm: self.sum.harm / n, boxes: self.sum.boxes / n }
    }
}
