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
use super::disturb::disturb;
use super::error::TrainError;
use super::losses::{LossParts, losses};
use super::paste::paste;
use super::picture::{draw_objects, picture_loss};
use super::plan::{Plan, Position, STAGES};
use super::targets::trainable;
use crate::dataset::Dataset;
use crate::device::is_cpu;
use crate::model::{Batch, CameraInput, Detector, Input};
use crate::object::LabelledObject;
use crate::random;

/// Computes the steps of a run, in any order: a step depends on its position alone.
pub struct Steps<'a> {
    plan: &'a Plan,
    dataset: &'a Dataset,
    config: &'a TrainConfig,
    device: &'a Device,
    /// Pictures unpacked and resized.
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
                Ok((chosen.as_slice(), first_draw, self.prepare(chosen, position, first_draw)?))
            })
            .collect::<Result<Vec<_>, TrainError>>()?;
        let stack = |(chosen, first_draw, samples): (_, _, Vec<PreparedSample>)| {
            let inputs: Vec<&Input> = samples.iter().map(|sample| &sample.input).collect();
            let batch = Batch::stack(&inputs, &config.model, position.stage == 1, self.device);
            let pictures = samples.iter().map(|sample| sample.picture.clone()).collect();
            let objects = samples.into_iter().map(|sample| sample.objects).collect();
            Prepared { chosen, first_draw, batch, objects, pictures }
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
        config.products.during(|| {
            let output = detector.forward(&prepared.batch);
            let mut loss = losses(&output, &prepared.objects, &config.model, &config.loss);
            if let (Some(logits), Some(targets)) = (output.picture_objects, &prepared.pictures) {
                let of_picture = picture_loss(logits, targets).mul_scalar(config.loss.picture_weight);
                loss.parts.picture = of_picture.clone().detach().into_scalar();
                loss.total = loss.total + of_picture;
            }
            if !loss.parts.total().is_finite() {
                return Err(self.not_finite(loss.parts.total(), position, prepared.chosen));
            }
            let gradients = loss.total.mul_scalar(share).backward();
            let gradients = GradientsParams::from_grads(gradients, &detector);
            Ok((detector, gradients, loss.parts))
        })
    }

    /// Augments and prepares the samples of a batch.
    fn prepare(
        &self,
        chosen: &[usize],
        position: Position,
        first_draw: usize,
    ) -> Result<Vec<PreparedSample>, TrainError> {
        let config = self.config;
        let samples = self.dataset.samples();
        let with_camera = position.stage == 1 && config.model.use_camera;
        let mut augment = config.augment_of_model();
        if !with_camera {
            augment.no_cloud_share = 0.0;
        }
        chosen
            .par_iter()
            .enumerate()
            .map(|(place, &sample_idx)| {
                let sample = &samples[sample_idx];
                let draw_idx = (first_draw + place) as u64;
                let stream_of = |name: &str| {
                    random::stream(config.seed, &format!("{name}-{}", STAGES[position.stage]), draw_idx)
                };
                let (mut rng, mut paste_rng) = (stream_of("augment"), stream_of("paste"));
                let zone = self.dataset.zone();
                let not_labelled = |source| TrainError::Label { sample: sample.id.clone(), source };
                let pasted = paste(sample, samples, zone, &augment, &mut paste_rng).map_err(not_labelled)?;
                let (measured, objects) = match &pasted {
                    Some(pasted) => (&pasted.measured, &pasted.objects),
                    None => (&sample.measured, &sample.objects),
                };
                let disturbed = disturb(measured, objects, &augment, &mut stream_of("disturb"));
                let (measured, objects) = match &disturbed {
                    Some(disturbed) => (&disturbed.measured, &disturbed.objects),
                    None => (measured, objects),
                };
                let view = augment::draw(&measured.ego_state, objects, zone, &augment, &mut rng)
                    .map_err(not_labelled)?;
                let not_prepared = |source| TrainError::Input { sample: sample.id.clone(), source };
                let key = Key { sample_idx, mirror: view.mirror };
                let unpack = || Input::picture(&sample.measured, view.mirror, &config.model.camera);
                let mut image =
                    with_camera.then(|| self.cache.get(key, unpack)).transpose().map_err(not_prepared)?;
                let colours = disturbed.as_ref().and_then(|disturbed| disturbed.colours.as_ref());
                if let (Some(image), Some(colours)) = (&mut image, colours) {
                    image.recolour(colours);
                }
                let input = Input::prepare_with(measured, &config.model, view.mirror, image.as_ref())
                    .and_then(|input| input.with_states(&view.states, view.mirror))
                    .map_err(not_prepared)?;
                let painted_view = input.camera.as_ref().and_then(CameraInput::painted_view);
                let min_px = config.loss.min_visible_px;
                let picture = painted_view.map(|of| draw_objects(&view.objects[0], of, min_px));
                let trained = |of: &Vec<LabelledObject>| trainable(of, &config.model.grid, &config.loss);
                Ok(PreparedSample { input, objects: view.objects.iter().map(trained).collect(), picture })
            })
            .collect()
    }
}

/// A sample ready for the network.
struct PreparedSample {
    input: Input,
    objects: ObjectsByState,
    /// Where the picture shows objects, if the network is asked.
    picture: Option<Vec<f32>>,
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
    /// `None` if one of the samples has none.
    pictures: Option<Vec<Vec<f32>>>,
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
        self.sum.picture += parts.picture;
        self.n += 1;
    }

    pub fn mean(&self) -> LossParts {
        let n = self.n.max(1) as f32;
        let LossParts { heatmap, harm, boxes, picture } = self.sum;
        LossParts { heatmap: heatmap / n, harm: harm / n, boxes: boxes / n, picture: picture / n }
    }
}
