//! One step of a run: prepares and augments its samples and computes the gradients of their loss.

use std::time::{Duration, Instant};

use burn::optim::{GradientsAccumulator, GradientsParams};
use burn::tensor::Device;
use rand::RngExt;
use rayon::prelude::*;

use super::augment::{self, ObjectsByState};
use super::cache::{Cache, Key};
use super::config::TrainConfig;
use super::copies::{average_statistics, copy_detector, copy_to_device};
use super::disturb::disturb;
use super::error::TrainError;
use super::lanes::Lanes;
use super::losses::{LossParts, losses};
use super::mean_loss::MeanLoss;
use super::memory::{MemoryBound, Rest};
use super::paste::paste;
use super::picture::{draw_objects, picture_loss};
use super::plan::{Plan, Position, STAGES};
use super::targets::{IgnoredGround, ignored_ground, trainable};
use super::windows::{Shown, Windows};
use crate::dataset::SampleSource;
use crate::device::is_cpu;
use crate::model::{Batch, Detector, Input, NormStatistics, Output};
use crate::object::LabelledObject;
use crate::random;
use crate::zone::Zone;

/// Computes the steps of a run, in any order: a step depends on its position alone.
pub struct Steps<'a> {
    /// Steps of each stage.
    stage_lengths: [usize; 2],
    windows: Windows<'a>,
    /// The samples of the latest step.
    shown: Vec<Shown<'a>>,
    zone: &'a Zone,
    config: &'a TrainConfig,
    lanes: Lanes,
    /// Pictures unpacked and resized.
    cache: Cache,
    /// What else is in memory.
    rest: Rest,
    /// Time spent on preparing inputs.
    pub loading: Duration,
}

/// What the passes of one device gave, a batch each, and the time in which they were stacked.
type LaneResult = (Vec<Result<Passed, TrainError>>, Duration);

/// What the pass through one batch gave: the copy with its running statistics, the gradients and the loss.
type Passed = (Detector, GradientsParams, LossParts);

impl<'a> Steps<'a> {
    /// Steps on some devices, at least one: the batches of a step are dealt out to them in turn.
    pub fn new(
        plan: &'a Plan,
        source: impl Into<SampleSource<'a>>,
        config: &'a TrainConfig,
        devices: &[Device],
    ) -> Self {
        let source = source.into();
        Self {
            stage_lengths: plan.n_steps,
            windows: Windows::new(plan, source).taken_by(config),
            shown: Vec::new(),
            zone: source.zone(),
            config,
            lanes: Lanes::new(devices),
            cache: Cache::new(config.cache_mib),
            rest: Rest::default(),
            loading: Duration::ZERO,
        }
    }

    /// Empties the cache: stages need different inputs.
    pub fn begin_stage(&self) {
        self.cache.clear();
    }

    /// Looks at what the run takes beside pictures: before its first step, and after what is none.
    pub fn look_at_memory(&mut self) {
        self.rest.look(self.cache.n_bytes());
    }

    /// Keeps pictures only in what a bound leaves, now that steps have shown what else they take.
    pub fn keep_below(&mut self, bound: MemoryBound) {
        self.look_at_memory();
        let room = bound.room_for_pictures(&self.rest);
        self.cache.limit(room.min(self.config.cache_mib << 20));
    }

    /// Computes the gradients of one step and its loss, both as the mean over its batches; the detector is on the first
    /// device.
    ///
    /// # Errors
    /// A sample is broken, or the loss is not finite.
    pub fn gradients(
        &mut self,
        detector: Detector,
        position: Position,
    ) -> Result<(Detector, GradientsParams, LossParts), TrainError> {
        let config = self.config;
        let started = Instant::now();
        // What the latest step showed keeps its windows in memory.
        self.shown.clear();
        self.shown = self.windows.step(position)?;
        let batches: Vec<&[Shown]> = self.shown.chunks(config.batch_size).collect();
        let augmented = (batches.par_iter().enumerate())
            .map(|(batch_idx, &chosen)| {
                let first_draw = (position.step * config.accumulate + batch_idx) * config.batch_size;
                let samples = self.prepare(chosen, position, first_draw)?;
                check_heights(chosen, &samples)?;
                Ok(Augmented { chosen, first_draw, samples })
            })
            .collect::<Result<Vec<_>, TrainError>>()?;
        let mut loading = started.elapsed();
        let share = 1.0 / batches.len() as f64;
        let devices = self.lanes.devices();
        let mut loads: Vec<(Detector, Vec<Augmented>)> = Vec::new();
        for device in devices {
            let is_first = loads.is_empty();
            let copy = if is_first { copy_detector(&detector) } else { copy_to_device(&detector, device) };
            loads.push((copy, Vec::new()));
        }
        for (batch_idx, batch) in augmented.into_iter().enumerate() {
            loads[batch_idx % devices.len()].1.push(batch);
        }
        let home = devices[0].clone().without_autodiff();
        let of_lanes = self.lanes.work(loads, |device, (detector, batches)| {
            self.lane(&detector, device, &home, batches, position, share)
        });
        loading += of_lanes.iter().map(|of_lane| of_lane.1).max().unwrap_or_default();
        let mut of_lanes: Vec<_> = of_lanes.into_iter().map(|(passes, _)| passes.into_iter()).collect();
        let mut sum = GradientsAccumulator::new();
        let mut mean = MeanLoss::default();
        let mut copies = Vec::new();
        // In the order of the batches, so that the sum is the same on any number of devices.
        for batch_idx in 0..batches.len() {
            let pass = of_lanes[batch_idx % devices.len()].next().expect("each batch was passed");
            let (copy, gradients, parts) = pass?;
            mean.add(parts);
            sum.accumulate(&detector, gradients);
            copies.push(copy);
        }
        self.loading += loading;
        Ok((average_statistics(detector, &copies), sum.grads(), mean.mean()))
    }

    /// The error of a gradient of the latest step that is not finite.
    pub fn not_finite(&self, found: f32, position: Position) -> TrainError {
        not_finite(found, position, &self.shown)
    }

    /// Passes through the batches of one device; `detector` is on it. The gradients are brought home.
    fn lane(
        &self,
        detector: &Detector,
        device: &Device,
        home: &Device,
        batches: Vec<Augmented<'_>>,
        position: Position,
        share: f64,
    ) -> LaneResult {
        let config = self.config;
        let started = Instant::now();
        let prepared: Vec<Prepared> = if is_cpu(device) {
            batches.into_par_iter().map(|batch| batch.stack(config, position, device)).collect()
        } else {
            batches.into_iter().map(|batch| batch.stack(config, position, device)).collect()
        };
        let stacking = started.elapsed();
        let mut passes = Vec::new();
        for abreast in prepared.chunks(n_abreast(config, device)) {
            if let [alone] = abreast {
                passes.push(self.pass(copy_detector(detector), device, alone, position, share));
                continue;
            }
            // In the pool, so that no operation has to hand its work over to other threads and wait.
            let copies: Vec<_> = abreast.iter().map(|prepared| (copy_detector(detector), prepared)).collect();
            let pass = |(copy, prepared): (_, &Prepared)| self.pass(copy, device, prepared, position, share);
            passes.extend(copies.into_par_iter().map(pass).collect::<Vec<_>>());
        }
        let bring_home = |passed: Result<Passed, TrainError>| {
            let (copy, gradients, parts) = passed?;
            let is_home = *device == *home;
            let gradients = if is_home { gradients } else { gradients.to_device(home, &copy) };
            Ok((copy, gradients, parts))
        };
        (passes.into_iter().map(bring_home).collect(), stacking)
    }

    /// Passes forward and backward through one batch.
    fn pass(
        &self,
        detector: Detector,
        device: &Device,
        prepared: &Prepared,
        position: Position,
        share: f64,
    ) -> Result<Passed, TrainError> {
        let config = self.config;
        let norms = if self.is_past(config.norms_until, position) {
            NormStatistics::Running
        } else {
            NormStatistics::OfBatch
        };
        let work = || {
            let output = self.forward(&detector, device, prepared, position);
            let mut loss = losses(&output, &prepared.objects, &prepared.ignored, &config.model, &config.loss);
            if let (Some(logits), Some(targets)) = (output.picture_objects, &prepared.pictures) {
                let of_picture = picture_loss(logits, targets).mul_scalar(config.loss.picture_weight);
                loss.parts.picture = of_picture.clone().detach().into_scalar();
                loss.total = loss.total + of_picture;
            }
            if !loss.parts.total().is_finite() {
                return Err(not_finite(loss.parts.total(), position, prepared.chosen));
            }
            let gradients = loss.total.mul_scalar(share).backward();
            let gradients = GradientsParams::from_grads(gradients, &detector);
            Ok((detector, gradients, loss.parts))
        };
        config.products.during(|| norms.during(work))
    }

    /// Whether a step comes after this share of its stage's.
    fn is_past(&self, share: f64, position: Position) -> bool {
        position.step as f64 >= share * self.stage_lengths[position.stage] as f64
    }

    /// Passes forward. What it draws depends on the step alone, however often the run was stopped and whatever other devices
    /// do.
    fn forward(
        &self,
        detector: &Detector,
        device: &Device,
        prepared: &Prepared,
        position: Position,
    ) -> Output {
        let config = self.config;
        if !config.model.draws_in_training() {
            return detector.forward(&prepared.batch);
        }
        let name = format!("dropout-{}", STAGES[position.stage]);
        let seed = random::stream(config.seed, &name, prepared.first_draw as u64).random();
        Detector::with_generator(device, seed, || detector.forward(&prepared.batch))
    }

    /// Augments and prepares the samples of a batch.
    fn prepare(
        &self,
        chosen: &[Shown],
        position: Position,
        first_draw: usize,
    ) -> Result<Vec<PreparedSample>, TrainError> {
        let config = self.config;
        let with_camera = position.stage == 1 && config.model.use_camera;
        let mut augment = config.augment_of_model();
        if !with_camera {
            augment.no_cloud_share = 0.0;
        }
        if self.is_past(augment.paste_until, position) {
            augment.max_pasted = 0;
        }
        chosen
            .par_iter()
            .enumerate()
            .map(|(place, shown)| {
                let sample = shown.sample();
                let draw_idx = (first_draw + place) as u64;
                let stream_of = |name: &str| {
                    random::stream(config.seed, &format!("{name}-{}", STAGES[position.stage]), draw_idx)
                };
                let (mut rng, mut paste_rng) = (stream_of("augment"), stream_of("paste"));
                let zone = self.zone;
                let not_labelled = |source| TrainError::Label { sample: sample.id.clone(), source };
                let pasted =
                    paste(sample, shown.donors(), zone, &augment, &mut paste_rng).map_err(not_labelled)?;
                let (measured, objects) = match &pasted {
                    Some(pasted) => (&pasted.measured, &pasted.objects),
                    None => (&sample.measured, &sample.objects),
                };
                let disturbed = disturb(
                    measured,
                    objects,
                    config.loss.min_visible_px,
                    &augment,
                    &mut stream_of("disturb"),
                );
                let (measured, objects) = match &disturbed {
                    Some(disturbed) => (&disturbed.measured, &disturbed.objects),
                    None => (measured, objects),
                };
                let view = augment::draw(&measured.ego_state, objects, zone, &augment, &mut rng)
                    .map_err(not_labelled)?;
                let not_prepared = |source| TrainError::Input { sample: sample.id.clone(), source };
                let key = Key { sample_idx: shown.number(), mirror: view.mirror };
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
                let painted_view = input.camera.as_ref().and_then(|of| of.painted_view(&config.model));
                let ignored = ignored_ground(&sample.facts.ignored, view.mirror);
                let picture =
                    painted_view.map(|of| draw_objects(&view.objects[0], &ignored, of, &config.loss));
                let trained = |of: &Vec<LabelledObject>| trainable(of, &config.model.grid, &config.loss);
                let objects = view.objects.iter().map(trained).collect();
                Ok(PreparedSample { input, objects, ignored, picture })
            })
            .collect()
    }
}

/// A sample ready for the network.
struct PreparedSample {
    input: Input,
    objects: ObjectsByState,
    ignored: IgnoredGround,
    /// Where the picture shows objects, if the network is asked.
    picture: Option<Vec<f32>>,
}

/// Refuses a batch of pictures of two heights, which no tensor holds.
fn check_heights(chosen: &[Shown], samples: &[PreparedSample]) -> Result<(), TrainError> {
    let id = |i: usize| chosen[i].sample().id.clone();
    let height_px = |i: usize| samples[i].input.image_height_px();
    match (1..samples.len()).find(|&i| height_px(i) != height_px(0)) {
        Some(i) => {
            let (one_px, other_px) = (height_px(0), height_px(i));
            Err(TrainError::PictureHeights { one: id(0), one_px, other: id(i), other_px })
        }
        None => Ok(()),
    }
}

/// The error of a loss or a gradient that is not finite.
fn not_finite(found: f32, position: Position, chosen: &[Shown]) -> TrainError {
    TrainError::NotFinite {
        found,
        step: position.step,
        stage: STAGES[position.stage],
        samples: chosen.iter().map(|shown| shown.sample().id.clone()).collect(),
    }
}

/// Number of a step's batches that run in parallel on a device: one for each thread. It is 1 if the network has dropout,
/// which draws from one generator, and on a GPU, which one batch keeps busy.
#[must_use]
pub fn n_abreast(config: &TrainConfig, device: &Device) -> usize {
    if config.model.draws_in_training() || !is_cpu(device) {
        1
    } else {
        config.accumulate.min(rayon::current_num_threads())
    }
}

/// The samples of one batch of a step, each ready for the network.
struct Augmented<'a> {
    chosen: &'a [Shown<'a>],
    first_draw: usize,
    samples: Vec<PreparedSample>,
}

impl<'a> Augmented<'a> {
    fn stack(self, config: &TrainConfig, position: Position, device: &Device) -> Prepared<'a> {
        let Self { chosen, first_draw, samples } = self;
        let inputs: Vec<&Input> = samples.iter().map(|sample| &sample.input).collect();
        let batch = Batch::stack(&inputs, &config.model, position.stage == 1, device);
        let pictures = samples.iter().map(|sample| sample.picture.clone()).collect();
        let (objects, ignored) = samples.into_iter().map(|sample| (sample.objects, sample.ignored)).unzip();
        Prepared { chosen, first_draw, batch, objects, ignored, pictures }
    }
}

/// One batch of a step, ready for the network.
struct Prepared<'a> {
    chosen: &'a [Shown<'a>],
    first_draw: usize,
    batch: Batch,
    objects: Vec<ObjectsByState>,
    ignored: Vec<IgnoredGround>,
    /// `None` if one of the samples has none.
    pictures: Option<Vec<Vec<f32>>>,
}
