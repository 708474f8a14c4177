//! The steps of a run and the places of each, from config, seed and the sizes of the data alone.
//!
//! An epoch shuffles the episodes, cuts them into windows, and shows the samples of one window after the other, shuffled. What
//! is in memory as a whole is one window.

use std::ops::Range;

use rand::RngExt;
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::config::{StageConfig, TrainConfig};
use crate::dataset::SampleSource;
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
    /// Of each part that is read as one (an episode, or all that is in memory), the number of samples before it; then the
    /// number of all.
    begins: Vec<usize>,
    /// Parts of a window.
    n_window_parts: usize,
    harmful_share: f64,
    seed: u64,
}

/// A pass over all samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Epoch {
    pub stage: usize,
    /// Its number in the stage.
    pub number: usize,
}

/// The windows of an epoch.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EpochWindows {
    pub epoch: Epoch,
    /// The parts of each window, ascending.
    pub parts: Vec<Vec<usize>>,
    /// Of each window, the number of samples before it; then the number of all.
    begins: Vec<usize>,
}

impl EpochWindows {
    /// The windows that places of the epoch fall into.
    #[must_use]
    pub fn holding(&self, places: &Range<usize>) -> Range<usize> {
        let window_of = |place: usize| self.begins.partition_point(|&begin| begin <= place) - 1;
        window_of(places.start)..window_of(places.end - 1) + 1
    }

    /// The window of a place, and the place in it.
    #[must_use]
    pub fn locate(&self, place: usize) -> (usize, usize) {
        let window = self.holding(&(place..place + 1)).start;
        (window, place - self.begins[window])
    }
}

impl Plan {
    /// The plan of a run over all samples of a split; only what is on disk is cut into windows.
    pub fn new<'a>(config: &TrainConfig, source: impl Into<SampleSource<'a>>) -> Self {
        let sizes = match source.into() {
            SampleSource::InMemory(dataset) => vec![dataset.samples().len()],
            SampleSource::OnDisk(split) => split.episodes().iter().map(|entry| entry.n_samples).collect(),
        };
        let begins = running_sum(sizes.iter().copied());
        let n_samples = begins[sizes.len()];
        let samples_per_step = config.batch_size * config.accumulate;
        let steps_per_epoch = n_samples.div_ceil(samples_per_step);
        let stages = [config.lidar_stage, config.fused_stage];
        Self {
            stages,
            steps_per_epoch,
            n_steps: stages.map(|stage| stage.epochs * steps_per_epoch),
            samples_per_step,
            n_samples,
            begins,
            n_window_parts: match config.stream.window_episodes {
                0 => sizes.len(),
                n => n,
            },
            harmful_share: config.harmful_share,
            seed: config.seed,
        }
    }

    /// Number of steps before a position, over all stages.
    pub fn n_done(&self, position: Position) -> usize {
        self.n_steps[..position.stage].iter().sum::<usize>() + position.step
    }

    /// Whether a run can stand there: before one of its steps, or behind the last of a stage.
    pub fn has(&self, position: Position) -> bool {
        position.stage == STAGES.len() && position.step == 0
            || self.n_steps.get(position.stage).is_some_and(|&n_steps| position.step <= n_steps)
    }

    /// The epoch of a step.
    #[must_use]
    pub fn epoch(&self, position: Position) -> Epoch {
        Epoch { stage: position.stage, number: position.step / self.steps_per_epoch }
    }

    /// The epoch after another; `None` after the last.
    #[must_use]
    pub fn epoch_after(&self, epoch: Epoch) -> Option<Epoch> {
        let Epoch { stage, number } = epoch;
        if number + 1 < self.stages[stage].epochs {
            return Some(Epoch { stage, number: number + 1 });
        }
        let later = (stage + 1..self.stages.len()).find(|&stage| self.stages[stage].epochs > 0)?;
        Some(Epoch { stage: later, number: 0 })
    }

    /// The places in its epoch that a step shows; the last step of an epoch may have fewer.
    #[must_use]
    pub fn places(&self, position: Position) -> Range<usize> {
        let first = position.step % self.steps_per_epoch * self.samples_per_step;
        first..(first + self.samples_per_step).min(self.n_samples)
    }

    /// The numbers that a part's samples have among all.
    #[must_use]
    pub fn numbers(&self, part: usize) -> Range<usize> {
        self.begins[part]..self.begins[part + 1]
    }

    /// Shuffles the parts of an epoch and cuts them into windows.
    #[must_use]
    pub fn windows(&self, epoch: Epoch) -> EpochWindows {
        let mut order: Vec<usize> = (0..self.begins.len() - 1).collect();
        let name = format!("windows-{}", STAGES[epoch.stage]);
        order.shuffle(&mut random::stream(self.seed, &name, epoch.number as u64));
        let sorted = |parts: &[usize]| {
            let mut parts = parts.to_vec();
            parts.sort_unstable();
            parts
        };
        let parts: Vec<Vec<usize>> = order.chunks(self.n_window_parts).map(sorted).collect();
        let size = |parts: &Vec<usize>| parts.iter().map(|&part| self.numbers(part).len()).sum();
        let begins = running_sum(parts.iter().map(size));
        EpochWindows { epoch, parts, begins }
    }

    /// The samples of a window in the order in which they are shown. A share of the places goes to samples with something
    /// harmful ahead, of the same window.
    ///
    /// # Arguments
    /// - `window`: its place in the epoch
    /// - `harmful`: the window's samples with something harmful ahead
    #[must_use]
    pub fn order(
        &self,
        windows: &EpochWindows,
        window: usize,
        n_samples: usize,
        harmful: &[usize],
    ) -> Vec<usize> {
        let mut order: Vec<usize> = (0..n_samples).collect();
        let Epoch { stage, number } = windows.epoch;
        let draw_idx = number * windows.parts.len() + window;
        let mut rng = random::stream(self.seed, &format!("order-{}", STAGES[stage]), draw_idx as u64);
        order.shuffle(&mut rng);
        if !harmful.is_empty() {
            for place in &mut order {
                if rng.random::<f64>() < self.harmful_share {
                    *place = harmful[rng.random_range(0..harmful.len())];
                }
            }
        }
        order
    }
}

/// The sum before each number, then that of all.
fn running_sum(numbers: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut sums = vec![0];
    sums.extend(numbers.scan(0, |sum, number| {
        *sum += number;
        Some(*sum)
    }));
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_stands_at_its_steps_and_nowhere_else() {
        let plan = Plan {
            stages: [TrainConfig::default().lidar_stage; 2],
            steps_per_epoch: 3,
            n_steps: [0, 6],
            samples_per_step: 1,
            n_samples: 3,
            begins: vec![0, 3],
            n_window_parts: 1,
            harmful_share: 0.0,
            seed: 0,
        };
        let has = |stage, step| plan.has(Position { stage, step });
        assert!(has(0, 0) && has(1, 0) && has(1, 6) && has(2, 0));
        assert!(!has(0, 1) && !has(1, 7) && !has(2, 1) && !has(3, 0) && !has(1, usize::MAX));
    }
}
