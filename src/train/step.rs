//! One step of a run: its samples prepared and augmented, and the gradients of their loss.

use std::time::{Duration, Instant};

use burn::optim::{GradientsAccumulator, GradientsParams};
use burn::tensor::Device;
use rand::RngExt;
use rayon::prelude::*;

use super::augment::{self, ObjectsByState};
use super::cache::{Cache, Key};
use super::config::TrainConfig;
use super::losses::{LossParts, losses};
use super::plan::{Plan, STAGES};
use super::run::TrainError;
use super::state::Position;
use super::targets::trainable;
use crate::dataset::{Dataset, LabelledSample};
use crate::model::{Batch, Detector, Input};
use crate::random;

/// Takes the steps of a run, in any order: a step depends on its position alone.
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

    /// Stages need different inputs.
    pub fn begin_stage(&self) {
        self.cache.clear();
    }

    /// Gradients of one step, the mean over its batches, and the mean loss.
    ///
    /// # Errors
    /// A sample is broken, or the loss is not finite.
    pub fn gradients(
        &mut self,
        detector: &Detector,
        position: Position,
    ) -> Result<(GradientsParams, LossParts), TrainError> {
        let config = self.config;
        let samples = self.dataset.samples();
        let batches = self.plan.step_samples(config, position);
        let mut sum = GradientsAccumulator::new();
        let mut mean = Mean::default();
        for (batch_idx, chosen) in batches.iter().enumerate() {
            let first_draw = (position.step * config.accumulate + batch_idx) * config.batch_size;
            let started = Instant::now();
            let (batch, objects) = self.prepare(chosen, position, first_draw)?;
            self.loading += started.elapsed();
            // What training drops at random depends on the step alone, however often the run was stopped.
            let name = format!("dropout-{}", STAGES[position.stage]);
            Detector::seed(self.device, random::stream(config.seed, &name, first_draw as u64).random());
            let loss = losses(&detector.forward(&batch), &objects, &config.model, &config.loss);
            if !loss.parts.total().is_finite() {
                return Err(not_finite(loss.parts.total(), position, chosen, samples));
            }
            mean.add(loss.parts);
            let scaled = loss.total.div_scalar(batches.len() as f64);
            sum.accumulate(detector, GradientsParams::from_grads(scaled.backward(), detector));
        }
        Ok((sum.grads(), mean.mean()))
    }

    /// Augments and stacks the samples of a batch.
    fn prepare(
        &self,
        chosen: &[usize],
        position: Position,
        first_draw: usize,
    ) -> Result<(Batch, Vec<ObjectsByState>), TrainError> {
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
                let view = augment::draw(
                    &sample.measured.ego_state,
                    &sample.objects,
                    self.dataset.zone(),
                    &augment,
                    &mut rng,
                )
                .map_err(|source| TrainError::Label { sample: sample.id.clone(), source })?;
                let key = Key { sample_idx, mirror: view.mirror, with_camera };
                let prepare = || Input::prepare(&sample.measured, &config.model, view.mirror, with_camera);
                let input = self
                    .cache
                    .get(key, prepare)
                    .and_then(|input| input.with_states(&view.states, view.mirror))
                    .map_err(|source| TrainError::Input { sample: sample.id.clone(), source })?;
                Ok((input, view.objects.iter().map(|of| trainable(of, &config.model.grid)).collect()))
            })
            .collect::<Result<Vec<_>, TrainError>>()?;
        let (inputs, objects): (Vec<_>, Vec<_>) = prepared.into_iter().unzip();
        let batch = Batch::stack(&inputs.iter().collect::<Vec<_>>(), &config.model, with_camera, self.device);
        Ok((batch, objects))
    }
}

/// The error of a loss or a gradient that is not finite.
pub fn not_finite(
    found: f32,
    position: Position,
    chosen: &[usize],
    samples: &[LabelledSample],
) -> TrainError {
    TrainError::NotFinite {
        found,
        step: position.step,
        stage: STAGES[position.stage],
        samples: chosen.iter().map(|&i| samples[i].id.clone()).collect(),
    }
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
