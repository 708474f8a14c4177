//! The same frames at other speeds and steering angles: does the set of harmful objects follow the zone's?
//!
//! At each value the detector gets the frame's own image and cloud with the changed state. The truth either
//! follows by the zone of the changed state (the paper's figures), or stays as it is (an error of the speed
//! or steering sensor). The rivals of the network's own harm, [`Judge`], are scored on the same boxes.

mod config;
mod curves;

use rayon::prelude::*;
use thiserror::Error;

pub use config::{Change, SweepConfig};
pub use curves::{SweepCurve, SweepPoint, Sweeps};

use super::judge::Judge;
use super::matching::Matching;
use super::protocol::Protocol;
use super::safety::{self, Early, harm_probability};
use super::sample::{EvalSample, Mode, ScoreError};
use super::{metrics, sample};
use crate::dataset::{Dataset, LabelledSample, count_points};
use crate::object::{Detection, Harm, LabelledObject};
use crate::sample::EgoState;
use crate::zone::{Zone, ZoneError};

/// Why a sweep could not be made.
#[derive(Debug, Error)]
pub enum SweepError {
    #[error(transparent)]
    Score(#[from] ScoreError),
    #[error("sample {sample} with {change} {value}: {source}", change = change.name())]
    Zone { sample: String, change: Change, value: f64, source: ZoneError },
}

/// The frames of a dataset with the network's boxes at the recorded state and at every value of every change.
pub struct Swept<'a> {
    frames: &'a [LabelledSample],
    zone: &'a Zone,
    values: Vec<(Change, f64)>,
    /// `[frame][state][box]`: the recorded state first, then the values'.
    found: Vec<Vec<Vec<Detection>>>,
    /// Who has decided on their harm.
    judged_by: Judge,
}

impl<'a> Swept<'a> {
    /// The boxes that a network found in each frame: `[frame][state][box]`, the recorded state first, then `values`; `judged_by` has decided on
    /// their harm already, and is not asked twice.
    #[must_use]
    pub fn new(
        dataset: &'a Dataset,
        frames: &'a [LabelledSample],
        values: Vec<(Change, f64)>,
        found: Vec<Vec<Vec<Detection>>>,
        judged_by: Judge,
    ) -> Self {
        Self { frames, zone: dataset.zone(), values, found, judged_by }
    }

    /// The frames that were swept.
    #[must_use]
    pub fn frames(&self) -> &'a [LabelledSample] {
        self.frames
    }

    /// The changes and values that were swept.
    #[must_use]
    pub fn values(&self) -> &[(Change, f64)] {
        &self.values
    }

    /// The network's boxes: `[frame][state][box]`, the recorded state first.
    #[must_use]
    pub fn found(&self) -> &[Vec<Vec<Detection>>] {
        &self.found
    }

    /// The network's boxes in a frame at its recorded state.
    #[must_use]
    pub fn recorded(&self, frame_idx: usize) -> &[Detection] {
        &self.found[frame_idx][0]
    }

    /// Judges and scores all of it.
    ///
    /// # Errors
    /// There is no frame, or a state is not valid.
    pub fn measure(&self, judges: &[Judge], protocol: &Protocol) -> Result<Sweeps, SweepError> {
        let is_ood = |frame: &LabelledSample| frame.objects.iter().any(|object| object.truth.is_ood());
        let mode = if self.frames.iter().any(is_ood) { Mode::Ood } else { Mode::Id };
        let n_points = self.count_points();
        let mut curves = Vec::new();
        for change in Change::ALL {
            for &judge in judges {
                let values = self.values.iter().enumerate().filter(|(_, (of, _))| *of == change);
                let points = values.map(|(i, &(_, value))| {
                    let samples = self.samples(1 + i, change, value, judge, &n_points)?;
                    Ok(point(value, &samples, protocol, mode)?)
                });
                let points = points.collect::<Result<Vec<_>, SweepError>>()?;
                if !points.is_empty() {
                    curves.push(SweepCurve { change, judge, truth_moves: change.moves_truth(), points });
                }
            }
        }
        Ok(Sweeps { n_samples: self.frames.len(), curves, early: self.early(protocol)? })
    }

    /// The frames at a value, as a judge sees them.
    fn samples(
        &self,
        state_idx: usize,
        change: Change,
        value: f64,
        judge: Judge,
        n_points: &[Vec<Vec<u32>>],
    ) -> Result<Vec<EvalSample>, SweepError> {
        type Predicted<'a> = (&'a LabelledSample, &'a Vec<Vec<Detection>>);
        let of_frame = |((frame, found), n_points): (Predicted<'_>, &Vec<Vec<u32>>)| {
            let fail = |source| SweepError::Zone { sample: frame.id.clone(), change, value, source };
            let state = change.apply(&frame.measured.ego_state, value);
            let judge = if judge == self.judged_by { Judge::Network } else { judge };
            let detections = judge.judge(&found[state_idx], &state, self.zone).map_err(fail)?;
            let moved = change.apply(&frame.true_state, value);
            let objects = label(frame, change.moves_truth().then_some(&moved), self.zone).map_err(fail)?;
            // A judge leaves the boxes as they are.
            let points_in = |detection: &Detection| {
                let counted = found[state_idx].iter().zip(n_points.get(state_idx)?);
                counted
                    .into_iter()
                    .find(|(found, _)| found.box_in_ego == detection.box_in_ego)
                    .map(|(_, &n)| n)
            };
            let n_points = detections.iter().map(points_in).collect();
            let sample = EvalSample::new(&frame.id, frame.facts.coverage(), objects, detections);
            Ok(EvalSample { n_points, ..sample })
        };
        self.frames.iter().zip(&self.found).zip(n_points).map(of_frame).collect()
    }

    /// The LiDAR points in every box, `[frame][state][box]`; nothing for frames of which no score asks for them.
    fn count_points(&self) -> Vec<Vec<Vec<u32>>> {
        let of_frame = |(frame, found): (&LabelledSample, &Vec<Vec<Detection>>)| {
            if !frame.facts.needs_points() {
                return Vec::new();
            }
            let boxes = found.iter().flatten().map(|found| &found.box_in_ego);
            let mut counts = count_points(&frame.measured, boxes).into_iter();
            found.iter().map(|of_state| counts.by_ref().take(of_state.len()).collect()).collect()
        };
        self.frames.par_iter().zip(&self.found).map(of_frame).collect()
    }

    fn early(&self, protocol: &Protocol) -> Result<Option<Early>, ScoreError> {
        let recorded: Vec<Vec<Detection>> = self.found.iter().map(|found| found[0].clone()).collect();
        let samples = sample::eval_samples(self.frames, &recorded);
        Ok(safety::measure(&Matching::new(&samples, protocol, Mode::Id)?).early)
    }
}

/// A frame's boxes at several values of one change, to be drawn side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct Series<'a> {
    pub frame: &'a LabelledSample,
    pub change: Change,
    pub values: Vec<f64>,
    /// `[value][box]`.
    pub found: Vec<Vec<Detection>>,
}

/// The frame with the most changes between harmful and harmless from value to value, among objects that the
/// LiDAR hit; the first of equals, `None` without values or frames.
///
/// # Errors
/// A state or an object is not valid.
pub fn most_changed<'a>(
    frames: &'a [LabelledSample],
    zone: &Zone,
    change: Change,
    values: &[f64],
) -> Result<Option<&'a LabelledSample>, SweepError> {
    let mut best: Option<(usize, &LabelledSample)> = None;
    for frame in frames.iter().filter(|_| !values.is_empty()) {
        let harms_at = |&value: &f64| {
            let fail = |source| SweepError::Zone { sample: frame.id.clone(), change, value, source };
            let state = change.apply(&frame.true_state, value);
            Ok(label(frame, Some(&state), zone).map_err(fail)?.iter().map(|object| object.harm).collect())
        };
        let harms = values.iter().map(harms_at).collect::<Result<Vec<Vec<Harm>>, SweepError>>()?;
        let changes = |i: &usize| harms.windows(2).any(|pair| pair[0][*i] != pair[1][*i]);
        let is_hit = |i: &usize| frame.objects[*i].truth.is_hit();
        let n_changed = (0..frame.objects.len()).filter(is_hit).filter(changes).count();
        if best.is_none_or(|(most, _)| n_changed > most) {
            best = Some((n_changed, frame));
        }
    }
    Ok(best.map(|(_, frame)| frame))
}

/// The objects of a frame, labelled by the zone of a state if one is given.
fn label(
    frame: &LabelledSample,
    changed: Option<&EgoState>,
    zone: &Zone,
) -> Result<Vec<LabelledObject>, ZoneError> {
    let mut objects = frame.objects.clone();
    if let Some(state) = changed {
        let zone = zone.at(state)?;
        for object in &mut objects {
            object.harm = zone.harm_of_object(&object.truth)?.harm;
        }
    }
    Ok(objects)
}

fn point(
    value: f64,
    samples: &[EvalSample],
    protocol: &Protocol,
    mode: Mode,
) -> Result<SweepPoint, ScoreError> {
    let matching = Matching::new(samples, protocol, mode)?;
    // The true label, and the detector's where a detection lies on the object.
    let labels: Vec<(bool, Option<bool>)> = matching
        .objects
        .iter()
        .zip(harm_probability::measure(&matching))
        .map(|(of, probability)| (of.object.harm == Harm::Harmful, probability.map(|p| p >= 0.5)))
        .collect();
    let count = |fits: fn(&(bool, Option<bool>)) -> bool| labels.iter().filter(|label| fits(label)).count();
    let n_harmful = count(|&(truth, _)| truth);
    let n_called_harmful = count(|&(_, called)| called == Some(true));
    let n_both = count(|&(truth, called)| truth && called == Some(true));
    let n_located = count(|(_, called)| called.is_some());
    let n_right = count(|&(truth, called)| called == Some(truth));
    let share = |n: usize, of: usize| (of > 0).then(|| n as f64 / of as f64);
    Ok(SweepPoint {
        value,
        scores: metrics::measure(&matching).columns,
        n_truths: labels.len(),
        n_located,
        n_harmful,
        n_called_harmful,
        n_both,
        set_iou: share(n_both, n_harmful + n_called_harmful - n_both),
        agreement: share(n_right, n_located),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{SampleFacts, test_data};
    use crate::eval::matching::tests::{found, truth};
    use crate::zone::ZoneKind;

    #[test]
    fn the_truth_follows_the_speed_or_stays() {
        let dataset = test_data::dataset(6);
        let n_harmful = |change: Change, value: f64| -> usize {
            let of_frame = |frame: &LabelledSample| {
                let state = change.apply(&frame.measured.ego_state, value);
                label(frame, change.moves_truth().then_some(&state), dataset.zone()).unwrap()
            };
            let objects = dataset.samples().iter().flat_map(of_frame);
            objects.filter(|object| object.harm == Harm::Harmful).count()
        };
        assert!(n_harmful(Change::SpeedMps, 0.0) < n_harmful(Change::SpeedMps, 20.0));
        assert_eq!(n_harmful(Change::SpeedFactor, 0.0), n_harmful(Change::SpeedFactor, 20.0));
        let state = dataset.samples()[0].measured.ego_state;
        assert_eq!(Change::SpeedFactor.apply(&state, 1.1).speed_mps, 1.1 * state.speed_mps);
        let turned = Change::SteeringOffsetDeg.apply(&state, -2.0).steering_angle_rad;
        assert!((state.steering_angle_rad - turned - 2f64.to_radians()).abs() < 1e-12);
    }

    #[test]
    fn the_truth_follows_the_zone_of_every_shape() {
        for kind in ZoneKind::ALL {
            let dataset = test_data::dataset_of(6, kind);
            let harms = |change: Change, value: f64| -> Vec<Harm> {
                let of_frame = |frame: &LabelledSample| {
                    let state = change.apply(&frame.measured.ego_state, value);
                    label(frame, Some(&state), dataset.zone()).unwrap()
                };
                dataset.samples().iter().flat_map(of_frame).map(|object| object.harm).collect()
            };
            let n_harmful =
                |speed| harms(Change::SpeedMps, speed).iter().filter(|&&harm| harm == Harm::Harmful).count();
            assert!(n_harmful(0.0) < n_harmful(14.0), "{kind:?}");
            // Every angle that a car steers works, and the far ones differ.
            let turned: Vec<_> = (-35..=35).map(|deg| harms(Change::SteeringDeg, f64::from(deg))).collect();
            assert!(turned[0] != turned[35] && turned[35] != turned[70], "{kind:?}");
        }
    }

    #[test]
    fn the_frame_with_most_objects_that_change_sides_is_drawn() {
        let dataset = test_data::dataset(8);
        let n_changed = |frame: &LabelledSample| {
            let at = |value| {
                let state = Change::SpeedMps.apply(&frame.measured.ego_state, value);
                label(frame, Some(&state), dataset.zone()).unwrap()
            };
            at(0.0).into_iter().zip(at(14.0)).filter(|(a, b)| a.harm != b.harm).count()
        };
        let chosen = most_changed(dataset.samples(), dataset.zone(), Change::SpeedMps, &[0.0, 14.0]);
        let chosen = chosen.unwrap().unwrap();
        let most = dataset.samples().iter().map(n_changed).max().unwrap();
        assert!(most > 0 && n_changed(chosen) == most);
        assert!(most_changed(dataset.samples(), dataset.zone(), Change::SpeedMps, &[]).unwrap().is_none());
    }

    #[test]
    fn both_sets_are_counted_over_all_truths() {
        use crate::object::Distribution::Id;
        use Harm::{Harmful, Harmless};
        let sample = EvalSample {
            id: "s".into(),
            facts: SampleFacts::default(),
            n_points: vec![],
            objects: vec![
                truth(10.0, Harmful, Id),  // called harmful
                truth(15.0, Harmful, Id),  // called harmless
                truth(20.0, Harmful, Id),  // not located
                truth(25.0, Harmless, Id), // called harmful
                truth(30.0, Harmless, Id), // called harmless
            ],
            detections: vec![
                found(10.0, Harmful, 0.9),
                found(15.0, Harmful, 0.2),
                found(15.0, Harmless, 0.4),
                found(25.0, Harmful, 0.3),
                found(30.0, Harmless, 0.3),
            ],
        };
        let point = point(5.0, &[sample], &Protocol::default(), Mode::Id).unwrap();
        assert_eq!((point.n_truths, point.n_located), (5, 4));
        assert_eq!((point.n_harmful, point.n_called_harmful, point.n_both), (3, 2, 1));
        assert_eq!((point.set_iou, point.agreement), (Some(0.25), Some(0.5)));
    }
}
