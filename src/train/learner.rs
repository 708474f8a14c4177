//! The state that training changes: a detector, its optimizer and the moving average of its weights.

use burn::module::Module;
use burn::optim::GradientsParams;

use super::average::Average;
use super::config::TrainConfig;
use super::error::TrainError;
use super::losses::LossParts;
use super::optimizer::{Optimizer, number_parameters};
use super::plan::Position;
use super::schedule::Pace;
use super::step::Steps;
use crate::model::Detector;

/// A detector in training.
pub struct Learner {
    /// `None` only during a step.
    detector: Option<Detector>,
    optimizer: Optimizer,
    average: Average,
    has_average: bool,
}

impl Learner {
    /// Goes on with a detector on an autodiff device; `average` is its moving average so far, on the inference device.
    #[must_use]
    pub fn new(detector: Detector, average: Detector, optimizer: Optimizer, config: &TrainConfig) -> Self {
        Self {
            detector: Some(number_parameters(detector)),
            optimizer,
            average: Average::new(average, config.average_decay),
            has_average: config.average_decay > 0.0,
        }
    }

    /// Starts with a detector that has not been trained yet.
    #[must_use]
    pub fn start(detector: Detector, config: &TrainConfig) -> Self {
        let average = detector.valid();
        Self::new(detector, average, Optimizer::new(config), config)
    }

    /// The detector as the last step left it.
    pub fn detector(&self) -> &Detector {
        self.detector.as_ref().expect("each step gives the detector back")
    }

    pub fn optimizer(&self) -> &Optimizer {
        &self.optimizer
    }

    /// The moving average; without one (`average_decay` 0) the weights at the start.
    pub fn average(&self) -> &Detector {
        self.average.detector()
    }

    /// The result of a run: the moving average, or the last weights if there is none.
    #[must_use]
    pub fn result(&self) -> Detector {
        if self.has_average { self.average().clone() } else { self.detector().valid() }
    }

    /// Forgets the optimizer's moments, as between stages.
    pub fn restart_optimizer(&mut self, config: &TrainConfig) {
        self.optimizer = Optimizer::new(config);
    }

    /// Takes one whole step; returns the mean loss and the norm of the gradients before clipping.
    ///
    /// # Errors
    /// A sample is broken, or the loss or a gradient is not finite; the detector is lost then.
    pub fn step(
        &mut self,
        steps: &mut Steps,
        position: Position,
        pace: Pace,
    ) -> Result<(LossParts, f32), TrainError> {
        let detector = self.detector.take().expect("each step gives the detector back");
        let (detector, gradients, parts) = steps.gradients(detector, position)?;
        self.detector = Some(detector);
        let norm = self.apply(gradients, pace);
        if !norm.is_finite() {
            return Err(steps.not_finite(norm, position));
        }
        self.update_average(position.step);
        Ok((parts, norm))
    }

    /// Changes the weights by their gradients; returns the norm of the gradients before clipping.
    pub fn apply(&mut self, gradients: GradientsParams, pace: Pace) -> f32 {
        let detector = self.detector.take().expect("each step gives the detector back");
        let (detector, norm) = self.optimizer.step(detector, gradients, pace);
        self.detector = Some(detector);
        norm
    }

    /// Moves the average towards the weights after step `step` of a stage.
    pub fn update_average(&mut self, step: usize) {
        if self.has_average {
            let latest = self.detector().valid();
            self.average.update(&latest, step);
        }
    }
}
