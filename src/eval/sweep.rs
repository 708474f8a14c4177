//! The same frames with another speed or steering angle: does the detector's harmful set follow the zone's?
//!
//! At each value the network sees the frame's own image and cloud with the changed state. The truth either follows, by
//! the zone of the changed state (the paper's figures), or stays as it is (an error of the speed or steering sensor).

use burn::tensor::Device;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::metrics::ClassScores;
use super::predict::{PredictError, predict};
use super::protocol::Protocol;
use super::safety::located::Located;
use super::{EvalSample, EvalTruth, Mode, SampleFacts, ScoreError, score};
use crate::dataset::LabelledSample;
use crate::label::zone::{Zone, ZoneError};
use crate::model::Detector;
use crate::object::Harm;
use crate::progress::Progress;
use crate::sample::{EgoState, Measured};

/// What is changed of the ego's state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// The speed becomes the value, m/s.
    Speed,
    /// The steering angle becomes the value, radians, positive to the left.
    Steering,
    /// The speed is multiplied by the value.
    SpeedFactor,
    /// The value is added to the steering angle, radians.
    SteeringOffset,
}

impl Change {
    /// The state with one value of the change.
    #[must_use]
    pub fn apply(self, state: &EgoState, value: f64) -> EgoState {
        let mut changed = *state;
        match self {
            Self::Speed => changed.speed_mps = value,
            Self::Steering => changed.steering_angle_rad = value,
            Self::SpeedFactor => changed.speed_mps *= value,
            Self::SteeringOffset => changed.steering_angle_rad += value,
        }
        changed
    }
}

/// What the truth is at a changed state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TruthAt {
    /// What the zone says at the changed state.
    Changed,
    /// The labels as they are: the sensor errs, the world does not.
    Unchanged,
}

/// The frames at one value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepPoint {
    pub value: f64,
    pub scores: ClassScores,
    /// Truths that a detection lies on, after the filters.
    pub n_located: usize,
    /// Of these: harmful in truth, and by the greater of the two scores.
    pub n_harmful: usize,
    pub n_called_harmful: usize,
    /// Share of the located whose class is right.
    pub agreement: Option<f64>,
}

/// Why a sweep could not be made.
#[derive(Debug, Error)]
pub enum SweepError {
    #[error(transparent)]
    Predict(#[from] PredictError),
    #[error(transparent)]
    Score(#[from] ScoreError),
    #[error("sample {sample} with {change:?} {value}: {source}")]
    Zone { sample: String, change: Change, value: f64, source: ZoneError },
}

/// What is swept, and how it is judged.
#[derive(Debug, Clone, Copy)]
pub struct Sweep<'a> {
    pub change: Change,
    pub values: &'a [f64],
    pub truth: TruthAt,
    pub zone: &'a Zone,
    pub protocol: &'a Protocol,
}

impl Sweep<'_> {
    /// Runs the detector, in inference mode, on all frames at each value.
    ///
    /// # Errors
    /// [`SweepError`]: a broken sample, a state that cannot be, no sample at all.
    pub fn run(
        &self,
        detector: &Detector,
        frames: &[&LabelledSample],
        device: &Device,
        progress: &dyn Progress,
    ) -> Result<Vec<SweepPoint>, SweepError> {
        progress.start("sweep", (self.values.len() * frames.len()) as u64);
        let points = self.values.iter().map(|&value| {
            let changed: Vec<Measured> = frames
                .iter()
                .map(|frame| Measured {
                    ego_state: self.change.apply(&frame.measured.ego_state, value),
                    ..frame.measured.clone()
                })
                .collect();
            let named: Vec<(&str, &Measured)> =
                frames.iter().map(|frame| frame.id.as_str()).zip(&changed).collect();
            let found = predict(detector, &named, detector.config().use_camera, device, progress)?;
            let samples = frames
                .iter()
                .zip(found)
                .map(|(frame, detections)| {
                    Ok(EvalSample {
                        id: frame.id.clone(),
                        facts: SampleFacts::default(),
                        truths: self.truths(frame, value)?,
                        detections: detections.iter().map(Into::into).collect(),
                    })
                })
                .collect::<Result<Vec<_>, SweepError>>()?;
            self.point(value, &samples)
        });
        let points = points.collect();
        progress.finish();
        points
    }

    /// The truths of a frame at a value.
    fn truths(&self, frame: &LabelledSample, value: f64) -> Result<Vec<EvalTruth>, SweepError> {
        let mut truths: Vec<EvalTruth> = frame.objects.iter().map(Into::into).collect();
        if self.truth == TruthAt::Unchanged {
            return Ok(truths);
        }
        let fail = |source| SweepError::Zone { sample: frame.id.clone(), change: self.change, value, source };
        let zone = self.zone.rect(&self.change.apply(&frame.measured.ego_state, value)).map_err(fail)?;
        for truth in &mut truths {
            truth.harm = zone.harm_of(&truth.box_in_ego).map_err(fail)?.harm;
        }
        Ok(truths)
    }

    fn point(&self, value: f64, samples: &[EvalSample]) -> Result<SweepPoint, SweepError> {
        let scores = score(samples, self.protocol, Mode::Id)?.columns.total;
        let (kept, _) = super::metrics::filtered(samples, self.protocol.config());
        let located = Located::of_samples(&kept, self.protocol.config().tp_threshold_m);
        let labels: Vec<(bool, bool)> = located
            .iter()
            .filter_map(|found| Some((found.truth.harm == Harm::Harmful, found.harm_probability()? >= 0.5)))
            .collect();
        let count = |fits: fn(&(bool, bool)) -> bool| labels.iter().filter(|label| fits(label)).count();
        let n_right = count(|(truth, called)| truth == called);
        Ok(SweepPoint {
            value,
            scores,
            n_located: labels.len(),
            n_harmful: count(|&(truth, _)| truth),
            n_called_harmful: count(|&(_, called)| called),
            agreement: (!labels.is_empty()).then(|| n_right as f64 / labels.len() as f64),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::model::ModelConfig;
    use crate::progress::Silent;
    use burn::module::Module;

    fn sweep<'a>(values: &'a [f64], truth: TruthAt, zone: &'a Zone, protocol: &'a Protocol) -> Sweep<'a> {
        Sweep { change: Change::Speed, values, truth, zone, protocol }
    }

    #[test]
    fn the_truth_follows_the_speed_or_stays() {
        let (dataset, protocol) = (test_data::dataset(6), Protocol::default());
        let n_harmful = |truth, value| -> usize {
            let sweep = sweep(&[], truth, dataset.zone(), &protocol);
            let of_frame = |frame| sweep.truths(frame, value).unwrap();
            let truths = dataset.samples().iter().flat_map(of_frame);
            truths.filter(|truth| truth.harm == Harm::Harmful).count()
        };
        assert!(n_harmful(TruthAt::Changed, 0.0) < n_harmful(TruthAt::Changed, 20.0));
        assert_eq!(n_harmful(TruthAt::Unchanged, 0.0), n_harmful(TruthAt::Unchanged, 20.0));
        let state = dataset.samples()[0].measured.ego_state;
        assert_eq!(Change::SpeedFactor.apply(&state, 1.1).speed_mps, 1.1 * state.speed_mps);
        let turned = Change::SteeringOffset.apply(&state, -0.03).steering_angle_rad;
        assert!((state.steering_angle_rad - turned - 0.03).abs() < 1e-12);
    }

    #[test]
    fn each_value_has_a_point_and_a_state_that_cannot_be_is_named() {
        let (dataset, protocol) = (test_data::dataset(2), Protocol::default());
        let mut config = ModelConfig::default();
        (config.grid.cell_size_m, config.camera.cnn.image_width_px, config.head.n_queries) = (3.2, 64, 40);
        let device = Device::flex();
        let detector = Detector::init(&config, 0, &device).valid();
        let frames: Vec<&LabelledSample> = dataset.samples().iter().collect();
        let run = |values: &[f64]| {
            let sweep = sweep(values, TruthAt::Changed, dataset.zone(), &protocol);
            sweep.run(&detector, &frames, &device, &Silent)
        };
        let points = run(&[0.0, 14.0]).unwrap();
        assert_eq!(points.iter().map(|point| point.value).collect::<Vec<_>>(), [0.0, 14.0]);
        for point in points {
            assert!(point.n_located <= 10 && point.n_harmful <= point.n_located, "{point:?}");
            assert_eq!(point.agreement.is_none(), point.n_located == 0);
        }
        assert!(run(&[f64::NAN]).is_err());
    }
}
