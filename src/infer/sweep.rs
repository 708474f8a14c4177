//! Runs a network over the same frames at other speeds and steering angles.

use burn::tensor::Device;
use thiserror::Error;

use super::predict::{PredictError, own_judge, predict_states};
use crate::config::Checked;
use crate::dataset::Dataset;
use crate::eval::sweep::{Change, Series, SweepConfig, SweepError, Swept, most_changed};
use crate::model::Detector;
use crate::progress::{Progress, Silent};
use crate::sample::Measured;

/// Why a network could not be swept.
#[derive(Debug, Error)]
pub enum SweepRunError {
    #[error(transparent)]
    Predict(#[from] PredictError),
    #[error(transparent)]
    Sweep(#[from] SweepError),
}

/// The boxes of a detector in inference mode, in the first `config.n_episodes` episodes of a dataset at every
/// value of every change, with one pass over each frame's sensors; and the frames to draw.
///
/// # Errors
/// The config or a state is not valid, or a sample is broken.
pub fn sweep<'a>(
    detector: &Detector,
    dataset: &'a Dataset,
    config: &Checked<SweepConfig>,
    device: &Device,
    progress: &dyn Progress,
) -> Result<(Swept<'a>, Vec<Series<'a>>), SweepRunError> {
    let frames = dataset.first_episodes(config.n_episodes);
    let values: Vec<(Change, f64)> = Change::ALL
        .into_iter()
        .flat_map(|change| change.values(config).iter().map(move |&value| (change, value)))
        .collect();
    let states = |measured: &Measured| {
        let recorded = &measured.ego_state;
        let changed = values.iter().map(|&(change, value)| change.apply(recorded, value));
        std::iter::once(*recorded).chain(changed).collect()
    };
    let named = &dataset.named()[..frames.len()];
    progress.start("sweep", named.len() as u64);
    let with_camera = detector.config().use_camera;
    let found = predict_states(detector, named, &states, with_camera, device, progress)?;
    let mut series = Vec::new();
    for (change, values) in
        [(Change::SpeedMps, &config.picture_speed_mps), (Change::SteeringDeg, &config.picture_steering_deg)]
    {
        if let Some(frame) = most_changed(frames, dataset.zone(), change, values)? {
            let named = [(frame.id.as_str(), &frame.measured)];
            let states = |measured: &Measured| {
                values.iter().map(|&value| change.apply(&measured.ego_state, value)).collect()
            };
            let found = predict_states(detector, &named, &states, with_camera, device, &Silent)?;
            series.push(Series {
                frame,
                change,
                values: values.clone(),
                found: found.into_iter().flatten().collect(),
            });
        }
    }
    progress.finish();
    Ok((Swept::new(dataset, frames, values, found, own_judge(detector)), series))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::eval::Protocol;
    use crate::eval::judge::Judge;
    use crate::eval::sweep::Sweeps;
    use crate::infer::{predict, predict_for};
    use crate::model::{HeadJudge, ModelConfig};
    use crate::object::Detection;
    use burn::module::Module;

    fn detector() -> Detector {
        detector_of(HeadJudge::Network)
    }

    fn detector_of(judge: HeadJudge) -> Detector {
        let mut config = ModelConfig::default();
        config.head.judge = judge;
        (config.grid.cell_size_m, config.camera.cnn.image_width_px, config.head.n_queries) = (3.2, 64, 40);
        Detector::init(&config, 0, &Device::flex()).valid()
    }

    fn checked(config: SweepConfig) -> Checked<SweepConfig> {
        Checked::new(config).unwrap()
    }

    fn config() -> SweepConfig {
        SweepConfig {
            speed_mps: vec![0.0, 14.0],
            steering_deg: vec![20.0],
            speed_factor: vec![1.0],
            steering_offset_deg: vec![],
            judges: vec![Judge::Network, Judge::Zone],
            ..SweepConfig::default()
        }
    }

    #[test]
    fn one_pass_over_the_sensors_finds_what_a_pass_for_each_state_finds() {
        let (dataset, detector, device) = (test_data::dataset(2), detector(), Device::flex());
        let swept = sweep(&detector, &dataset, &checked(config()), &device, &Silent).unwrap().0;
        for (state_idx, (change, value)) in
            [(Change::SpeedFactor, 1.0)].iter().chain(swept.values()).copied().enumerate()
        {
            for (frame, of_frame) in dataset.samples().iter().zip(swept.found()) {
                let mut measured = frame.measured.clone();
                measured.ego_state = change.apply(&measured.ego_state, value);
                let alone = predict(&detector, &[("alone", &measured)], true, &device, &Silent);
                let (alone, at_once) = (&alone.unwrap()[0], &of_frame[state_idx]);
                assert_eq!(alone.len(), at_once.len(), "{change:?} {value}");
                let off = |(a, b): (&Detection, &Detection)| (a.score - b.score).abs();
                assert!(alone.iter().zip(at_once).map(off).all(|off| off < 1e-5));
            }
        }
        // Another speed gives the network's boxes other scores.
        assert_ne!(swept.found()[0][1], swept.found()[0][2]);
    }

    #[test]
    fn a_network_that_judges_together_with_the_zone_does_so_once() {
        let (dataset, device) = (test_data::dataset(2), Device::flex());
        let (alone, together) = (detector(), detector_of(HeadJudge::Both));
        let (named, frames) = (dataset.named(), dataset.samples());
        let of = |judge, detector| predict_for(judge, detector, &named, &device, &Silent).unwrap();
        let own_word = of(Judge::Network, &alone);
        let judged: Vec<Vec<Detection>> = own_word
            .iter()
            .zip(frames)
            .map(|(found, frame)| {
                Judge::Both.judge(found, &frame.measured.ego_state, dataset.zone()).unwrap()
            })
            .collect();
        assert_eq!(of(Judge::Network, &together), judged);
        assert_ne!(judged, own_word);
        // Another judge gets what the class branch says.
        assert!([Judge::Both, Judge::Zone].iter().all(|&judge| of(judge, &together) == own_word));
        let config = SweepConfig { judges: vec![Judge::Network, Judge::Both, Judge::Zone], ..config() };
        let points = |detector: &Detector, judge| {
            let swept = sweep(detector, &dataset, &checked(config.clone()), &device, &Silent).unwrap().0;
            let sweeps = swept.measure(&config.judges, &Protocol::default()).unwrap();
            sweeps.points(Change::SpeedMps, judge).to_vec()
        };
        assert_eq!(points(&together, Judge::Network), points(&alone, Judge::Both));
        assert_eq!(points(&together, Judge::Both), points(&alone, Judge::Both));
        assert_ne!(points(&alone, Judge::Network), points(&alone, Judge::Both));
    }

    #[test]
    fn each_value_has_a_point_for_each_judge_and_a_state_that_cannot_be_is_an_error() {
        let (dataset, detector, device) = (test_data::dataset(3), detector(), Device::flex());
        let swept = sweep(&detector, &dataset, &checked(config()), &device, &Silent).unwrap().0;
        let sweeps = swept.measure(&config().judges, &Protocol::default()).unwrap();
        assert_eq!((sweeps.n_samples, sweeps.curves.len()), (3, 6));
        let speeds = sweeps.points(Change::SpeedMps, Judge::Zone);
        assert_eq!(speeds.iter().map(|point| point.value).collect::<Vec<_>>(), [0.0, 14.0]);
        for point in sweeps.curves.iter().flat_map(|curve| &curve.points) {
            assert!(point.n_located <= point.n_truths && point.n_both <= point.n_harmful, "{point:?}");
            assert!(point.scores.id_matched.is_none(), "all objects are in distribution");
        }
        // The rival applies the rule itself: what it locates is right unless the box is off.
        let harmful = |judge| sweeps.points(Change::SpeedMps, judge)[1].n_harmful;
        assert_eq!(harmful(Judge::Zone), harmful(Judge::Network));
        assert!(sweeps.points(Change::SteeringOffsetDeg, Judge::Zone).is_empty());
        assert_eq!(sweeps.to_csv().lines().count(), 1 + 2 * 4);
        let again: Sweeps = serde_json::from_str(&sweeps.to_json()).unwrap();
        assert_eq!((again.to_csv(), again.early), (sweeps.to_csv(), sweeps.early));
        let broken = SweepConfig { speed_mps: vec![f64::NAN], ..config() };
        assert!(Checked::new(broken).is_err());
    }
}
