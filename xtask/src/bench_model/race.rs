//! One side of a race: repetition by repetition, on demand, so that two programs can take turns.

use std::time::Instant;

use burn::module::Module;
use serde::{Deserialize, Serialize};

use super::training::{learner, step};
use super::{Bench, BenchError, in_ms};
use harmzone::model::{Batch, Input};
use harmzone::train::{AugmentConfig, Plan, Position, Steps, TrainConfig};

/// What is done once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Contest {
    /// A step of the LiDAR stage, as a run takes it.
    LidarStep,
    /// A step of the fused stage.
    FusedStep,
    /// The network on one sample's prepared inputs.
    Inference,
    /// One sample from cloud and packed picture to boxes; the split's samples in turn.
    Whole,
}

/// Takes contests from `next` until there are none, and tells each one's milliseconds to `tell`. Steps are of one
/// step's samples, again and again, with their inputs in the cache.
///
/// # Errors
/// [`BenchError`], or what `tell` returns.
pub fn race<E: From<BenchError>>(
    bench: &Bench,
    mut next: impl FnMut() -> Option<Contest>,
    mut tell: impl FnMut(Contest, f64) -> Result<(), E>,
) -> Result<(), E> {
    bench.check()?;
    let dataset = bench.dataset.first(bench.samples_per_step());
    // Mirrored and disturbed inputs are others; drawn states cost the same whichever they are.
    let mut config = TrainConfig::clone(bench.config);
    config.augment = AugmentConfig {
        mirror: false,
        disturbed_share: 0.0,
        thinned_share: 0.0,
        no_cloud_share: 0.0,
        no_picture_share: 0.0,
        ..config.augment
    };
    let plan = Plan::new(&config, &dataset);
    let mut of_stages = Vec::new();
    for stage in [0, 1] {
        let steps = Steps::new(&plan, &dataset, &config, std::slice::from_ref(bench.device));
        of_stages.push((learner(bench)?, steps, stage, 0));
    }
    let detector = bench.detector(bench.device)?.valid();
    let (first, model) = (&dataset.samples()[0], detector.config());
    let input = Input::prepare(&first.measured, model, false, model.use_camera)
        .map_err(|source| BenchError::Input { sample: first.id.clone(), source })?;
    let batch = Batch::stack(&[&input], model, model.use_camera, bench.device);
    let mut in_turn = bench.dataset.samples().iter().cycle();
    while let Some(contest) = next() {
        let ms = match contest {
            Contest::LidarStep | Contest::FusedStep => {
                let (learner, steps, stage, step_idx) =
                    &mut of_stages[usize::from(contest == Contest::FusedStep)];
                let position = Position { stage: *stage, step: *step_idx };
                *step_idx += 1;
                in_ms(step(bench, learner, steps, position)?)
            }
            Contest::Inference => {
                let begin = Instant::now();
                let output = detector.forward(&batch);
                bench.wait()?;
                let time = begin.elapsed();
                drop(output);
                in_ms(time)
            }
            Contest::Whole => {
                let sample = in_turn.next().expect("a cycle over samples that there are");
                let begin = Instant::now();
                super::inference::detect(&detector, &sample.measured, bench)
                    .map_err(|source| BenchError::Input { sample: sample.id.clone(), source })?;
                in_ms(begin.elapsed())
            }
        };
        tell(contest, ms)?;
    }
    Ok(())
}
