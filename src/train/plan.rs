//! The steps of a run and the samples of each, from config, seed and data alone.

use rand::RngExt;
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::config::{StageConfig, TrainConfig};
use crate::dataset::LabelledSample;
use crate::object::Harm;
use crate::random;

/// Names of the stages.
pub const STAGES: [&str; 2] = ["lidar", "fused"];

/// A step of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Position {
    /// 0 LiDAR, 1 fused.
    pub stage: usize,
    /// Step within the stage.
    pub step: usize,
}

/// The run's steps.
pub struct Plan {
    pub stages: [StageConfig; 2],
    pub steps_per_epoch: usize,
    pub n_steps: [usize; 2],
    samples_per_step: usize,
    n_samples: usize,
    /// Samples with something harmful ahead.
    harmful: Vec<usize>,
    harmful_share: f64,
}

impl Plan {
    pub fn new(config: &TrainConfig, samples: &[LabelledSample]) -> Self {
        let n_samples = samples.len();
        let is_harmful =
            |sample: &LabelledSample| sample.objects.iter().any(|object| object.harm == Harm::Harmful);
        let harmful = (0..n_samples).filter(|&i| is_harmful(&samples[i])).collect();
        let steps_per_epoch = n_samples.div_ceil(config.batch_size * config.accumulate);
        let stages = [config.lidar_stage, config.fused_stage];
        Self {
            stages,
            steps_per_epoch,
            n_steps: stages.map(|stage| stage.epochs * steps_per_epoch),
            samples_per_step: config.batch_size * config.accumulate,
            n_samples,
            harmful,
            harmful_share: config.harmful_share,
        }
    }

    /// Number of steps before a position, over all stages.
    pub fn n_done(&self, position: Position) -> usize {
        self.n_steps[..position.stage].iter().sum::<usize>() + position.step
    }

    /// The batches of a step.
    pub fn step_samples(&self, config: &TrainConfig, position: Position) -> Vec<Vec<usize>> {
        self.samples_of(config.seed, position).chunks(config.batch_size).map(<[usize]>::to_vec).collect()
    }

    /// The samples of a step: each epoch is shuffled and cut into steps, of which the last may be short. A share of the
    /// places goes to samples with something harmful ahead.
    fn samples_of(&self, seed: u64, position: Position) -> Vec<usize> {
        let n_samples = self.n_samples;
        let epoch = position.step / self.steps_per_epoch;
        let mut order: Vec<usize> = (0..n_samples).collect();
        let mut rng = random::stream(seed, &format!("order-{}", STAGES[position.stage]), epoch as u64);
        order.shuffle(&mut rng);
        if !self.harmful.is_empty() {
            for place in &mut order {
                if rng.random::<f64>() < self.harmful_share {
                    *place = self.harmful[rng.random_range(0..self.harmful.len())];
                }
            }
        }
        let first = position.step % self.steps_per_epoch * self.samples_per_step;
        order[first..(first + self.samples_per_step).min(n_samples)].to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    fn epoch(config: &TrainConfig) -> Vec<usize> {
        let data = test_data::dataset(7);
        let plan = Plan::new(config, data.samples());
        (0..plan.steps_per_epoch)
            .flat_map(|step| plan.step_samples(config, Position { stage: 0, step }).concat())
            .collect()
    }

    #[test]
    fn an_epoch_shows_every_sample_once() {
        let mut shown = epoch(&TrainConfig { batch_size: 2, ..TrainConfig::default() });
        shown.sort_unstable();
        assert_eq!(shown, [0, 1, 2, 3, 4, 5, 6]);
    }

    #[test]
    fn with_a_share_of_one_only_samples_with_harmful_objects_are_shown() {
        let data = test_data::dataset(7);
        let is_harmful =
            |i: usize| data.samples()[i].objects.iter().any(|object| object.harm == Harm::Harmful);
        assert!((0..7).any(is_harmful), "the made data hold something harmful");
        let shown = epoch(&TrainConfig { harmful_share: 1.0, ..TrainConfig::default() });
        assert!(shown.len() == 7 && shown.into_iter().all(is_harmful));
    }
}
