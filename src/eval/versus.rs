//! Detectors side by side on the same samples: what each finds of a part of them, and what it gains over the first.
//!
//! Each is scored on the same resamples of the episodes ([`super::bootstrap`]), and a gain's interval is that of the differences within
//! them. Detectors fail on the same episodes, so it is far narrower than the intervals of the two suggest. Runs of one training
//! that differ in their seed may count as one detector: its figures are their means, over all and in each resample. An interval
//! then tells what other episodes would change. Another interval of the gain tells what other episodes and other seeds would change: its ends
//! move away by the standard error of the gain's mean, times the quantile of Student's t for so few, as two independent errors add (the
//! root of the squares' sum). Where both detectors are of as many runs, the gains run by run tell that error; else the runs' scatter, pooled.
//!
//! A part of the samples (fog, night, few rings) is scored with all of its false positives. Of a part of the objects only what was
//! made on them counts, as in the breakdowns: such a score tells how a part fares with each detector, not how it fares
//! beside other parts.

mod line;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use self::line::Runs;
pub use self::line::{VersusFigure, VersusLine};

use super::bootstrap::{Cell, Confidence, Resamples};
use super::matching::Matching;
use super::metrics::{Column, mean};
use super::part::Part;
use super::protocol::{MissingClass, Protocol};
use super::safety::{EventShares, event_shares};
use super::sample::{EvalSample, Mode, ScoreError};
use crate::object::{Harm, LabelledObject};

/// What detectors came to on the same samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Versus {
    /// Share of resamples within an interval.
    pub level: f64,
    pub n_resamples: usize,
    pub n_episodes: usize,
    pub n_samples: usize,
    /// Share of the harmful events that is missed, a line for each number of false alarms a kilometre; empty where there is none,
    /// or it is not known where the ego was or which object is which.
    pub missed: Vec<VersusLine>,
    /// Share of the harmful events that is warned of in time, a line for each number of false alarms a kilometre and each
    /// deceleration by which an event was to be stopped for; empty as of `missed`.
    #[serde(default)]
    pub warned: Vec<VersusLine>,
    /// AP of the class harmful, a line for each part that has something harmful.
    pub harmful: Vec<VersusLine>,
    /// AP, mean of both classes, a line for each part that has an object.
    pub mean: Vec<VersusLine>,
}

/// Name of the line of AP that is of a column.
#[must_use]
pub fn column_name(column: Column) -> String {
    Part::Column(column).name()
}

/// A run of a detector, by their places among those given, that cannot be scored.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{source}")]
pub struct DetectorError {
    pub detector: usize,
    pub run: usize,
    pub source: ScoreError,
}

/// Scores detectors on the same samples, each beside the first; each is the samples with what its runs found, one run or more.
///
/// # Errors
/// Names the run that cannot be scored: as of [`super::score`], or its samples are not the first one's in their order.
pub fn versus(
    detectors: &[Vec<Vec<EvalSample>>],
    protocol: &Protocol,
    mode: Mode,
) -> Result<Versus, DetectorError> {
    let places: Vec<(usize, usize)> =
        detectors.iter().enumerate().flat_map(|(i, of)| (0..of.len()).map(move |run| (i, run))).collect();
    let fail = |place: usize| {
        let (detector, run) = places.get(place).copied().unwrap_or_default();
        move |source: ScoreError| DetectorError { detector, run, source }
    };
    if let Some(detector) = detectors.iter().position(Vec::is_empty) {
        return Err(DetectorError { detector, run: 0, source: ScoreError::NoSamples });
    }
    let ends = detectors.iter().scan(0, |end, of| {
        let start = *end;
        *end += of.len();
        Some(start..*end)
    });
    let runs = Runs(ends.collect());
    let detectors: Vec<&Vec<EvalSample>> = detectors.iter().flatten().collect();
    let first = *detectors.first().ok_or(ScoreError::NoSamples).map_err(fail(0))?;
    let is_same_truth = |(a, b): (&LabelledObject, &LabelledObject)| {
        a.harm == b.harm && a.truth.box_in_ego == b.truth.box_in_ego
    };
    let is_same = |of: &&Vec<EvalSample>| {
        let pairs = || of.iter().zip(first);
        of.len() == first.len()
            && pairs().all(|(a, b)| a.id == b.id && a.objects.len() == b.objects.len())
            && pairs().all(|(a, b)| a.objects.iter().zip(&b.objects).all(is_same_truth))
    };
    if let Some(place) = detectors.iter().position(|of| !is_same(of)) {
        return Err(fail(place)(ScoreError::OtherSamples));
    }
    let matchings = detectors.iter().enumerate();
    let matchings = matchings.map(|(i, samples)| Matching::new(samples, protocol, mode).map_err(fail(i)));
    let matchings: Vec<Matching<'_>> = matchings.collect::<Result<_, _>>()?;
    let is_zero = protocol.config().missing_class == MissingClass::Zero;
    let resamples = Resamples::always(&matchings[0]);
    let (missed, warned) = of_events(&matchings, &resamples, &runs);
    let mut versus = Versus {
        level: Confidence::LEVEL,
        n_resamples: resamples.n(),
        n_episodes: resamples.n_episodes,
        n_samples: matchings[0].samples.len(),
        missed,
        warned,
        harmful: Vec::new(),
        mean: Vec::new(),
    };
    for part in Part::all(mode) {
        let cells: Vec<[Cell; 2]> = matchings
            .iter()
            .map(|matching| Harm::ALL.map(|class| part.cell(matching, class, &resamples)))
            .collect();
        let n_truths = Harm::ALL.map(|class| cells[0][class.index()].n_positives());
        // By run: AP of the class harmful, and the mean of the classes that there are.
        let aps = |n_drawn: &[u32]| -> Vec<[Option<f64>; 2]> {
            let of_detector = |of: &[Cell; 2]| {
                let aps = of.each_ref().map(|cell| cell.ap(n_drawn, protocol));
                // A class that is not there at all is left out, or counts as in nuScenes.
                let of_class = |i: usize| match n_truths[i] {
                    0 => is_zero.then_some(Some(0.0)),
                    _ => Some(aps[i]),
                };
                let there: Option<Vec<f64>> = (0..aps.len()).filter_map(of_class).collect();
                [aps[Harm::Harmful.index()], there.filter(|aps| !aps.is_empty()).map(|aps| mean(&aps))]
            };
            cells.iter().map(of_detector).collect()
        };
        let whole = aps(&vec![1; resamples.n_episodes]);
        let resampled = resamples.map(aps);
        let line = |i: usize, n_truths: usize| {
            let values: Vec<Option<f64>> = whole.iter().map(|of| of[i]).collect();
            let of_resample = |of: &Vec<[Option<f64>; 2]>| of.iter().map(|of| of[i]).collect();
            let resampled: Vec<Vec<Option<f64>>> = resampled.iter().map(of_resample).collect();
            (n_truths > 0).then(|| VersusLine::new(part.name(), n_truths, &values, &resampled, &runs))
        };
        versus.harmful.extend(line(0, n_truths[Harm::Harmful.index()]));
        versus.mean.extend(line(1, n_truths.iter().sum()));
    }
    Ok(versus)
}

/// Missed events of each detector, a line for each number of false alarms; and those warned of in time, one more for each
/// deceleration.
fn of_events(
    matchings: &[Matching<'_>],
    resamples: &Resamples,
    runs: &Runs,
) -> (Vec<VersusLine>, Vec<VersusLine>) {
    let of: Option<Vec<EventShares>> = matchings.iter().map(|of| event_shares(of, resamples)).collect();
    let Some(of) = of.filter(|of| of[0].n_events > 0) else { return Default::default() };
    let line = |name: String, n_events: usize, i: usize, share: usize| {
        let values: Vec<Option<f64>> = of.iter().map(|of| of.whole[i][share]).collect();
        let of_resample = |k: usize| of.iter().map(|of| of.resampled[k][i][share]).collect();
        let resampled: Vec<Vec<Option<f64>>> = (0..resamples.n()).map(of_resample).collect();
        VersusLine::new(name, n_events, &values, &resampled, runs)
    };
    let config = &matchings[0].config().safety;
    let (mut missed, mut warned) = (Vec::new(), Vec::new());
    for (i, per_km) in config.false_alarms_per_km.iter().enumerate() {
        let at = format!("at {per_km} false alarms/km");
        missed.push(line(at.clone(), of[0].n_events, i, 0));
        for (k, deceleration_mps2) in config.decelerations_mps2.iter().enumerate() {
            let n_stoppable = of[0].n_stoppable[k];
            if n_stoppable > 0 {
                warned.push(line(format!("{at}, {deceleration_mps2} m/s²"), n_stoppable, i, k + 1));
            }
        }
    }
    (missed, warned)
}

#[cfg(test)]
mod tests {
    use super::super::matching::tests::{found, truth};
    use super::super::safety::episode;
    use super::super::{EvalConfig, evaluate};
    use super::*;
    use crate::dataset::SampleFacts;
    use crate::object::Distribution;

    /// `n` episodes of one sample with a truth of each class; those whose number `finds` takes are found.
    fn samples(n: usize, finds: impl Fn(usize) -> bool) -> Vec<EvalSample> {
        let of = |i: usize| {
            let facts = SampleFacts {
                mor_m: Some(if i.is_multiple_of(2) { 100.0 } else { 20_000.0 }),
                n_lidar_rings: Some(if i % 4 < 2 { 16 } else { 64 }),
                ..SampleFacts::default()
            };
            let place_m = |harm: Harm| 8.0 + 30.0 * harm.index() as f64;
            let objects = Harm::ALL.map(|harm| truth(place_m(harm), harm, Distribution::Id)).into();
            let detections = Harm::ALL.map(|harm| found(place_m(harm), harm, 0.5));
            let detections = if finds(i) { detections.into() } else { Vec::new() };
            EvalSample::new(format!("{i}/0"), facts, objects, detections)
        };
        (0..n).map(of).collect()
    }

    fn line<'a>(lines: &'a [VersusLine], name: &str) -> &'a VersusLine {
        lines.iter().find(|line| line.name.contains(name)).unwrap_or_else(|| panic!("{name}: {lines:?}"))
    }

    #[test]
    fn a_gain_on_every_episode_is_sure_although_both_scores_vary() {
        // The second finds what the first does, and two more of twenty.
        let (a, b) = (samples(20, |i| i < 8), samples(20, |i| i < 10));
        let of = versus(&[vec![a.clone()], vec![b]], &Protocol::default(), Mode::Id).unwrap();
        let [first, second] = &line(&of.mean, "total").figures[..] else { panic!() };
        let alone = evaluate(&a, &Protocol::default(), Mode::Id).unwrap();
        assert_eq!(first.value, alone.metrics.columns.total.mean);
        assert_eq!(first.interval, alone.confidence.unwrap().columns.total.mean, "the same resamples");
        assert_eq!((first.over_first, first.over_first_interval), (Some(0.0), Some([0.0; 2])));
        let [low, high] = second.over_first_interval.unwrap();
        assert!(low >= 0.0 && high < 0.3 && second.over_first.unwrap() > 0.05, "{low} {high}");
        assert!(second.interval.unwrap()[0] < first.interval.unwrap()[1], "the scores themselves overlap");
        assert!(of.missed.is_empty(), "nobody knows where the ego was");
    }

    #[test]
    fn parts_hold_their_samples_and_objects_only() {
        let of = |finds: fn(usize) -> bool| {
            versus(&[vec![samples(8, finds)]], &Protocol::default(), Mode::Id).unwrap()
        };
        let (all, in_fog) = (of(|_| true), of(|i| i.is_multiple_of(2)));
        let value = |of: &Versus, name: &str| line(&of.mean, name).figures[0].value.unwrap();
        assert!(all.mean.iter().all(|line| line.figures[0].value.unwrap() > 0.999));
        assert!(value(&in_fog, "fog") > 0.999 && value(&in_fog, "total") < 0.6);
        assert_eq!(["fog", "rings", "nearer"].map(|name| line(&all.mean, name).n_truths), [8; 3]);
        assert_eq!(line(&all.harmful, "nearer").n_truths, 8);
        assert!(all.harmful.iter().all(|line| !line.name.contains("beyond")), "there nothing is harmful");
        assert!(all.mean.iter().all(|line| !line.name.contains("night")), "no sample is of the night");
    }

    #[test]
    fn missed_and_warned_events_are_those_of_the_scoring() {
        let mut samples = episode("a", "hhh");
        samples.extend(episode("b", "hhh"));
        // So slow that it can stop at the second sample still.
        samples.iter_mut().for_each(|sample| sample.facts.speed_mps = Some(3.0));
        let blind = samples.clone();
        for (sample, place_m) in samples.iter_mut().zip([20.0, 15.0]) {
            sample.detections = vec![found(place_m, Harm::Harmful, 0.5)];
        }
        let of = versus(&[vec![blind], vec![samples.clone()]], &Protocol::default(), Mode::Id).unwrap();
        let alone = evaluate(&samples, &Protocol::default(), Mode::Id).unwrap().safety.alarms.unwrap();
        for (line, point) in of.missed.iter().zip(&alone.points) {
            let [first, second] = &line.figures[..] else { panic!() };
            assert_eq!((first.value, second.value), (Some(1.0), point.missed_per_event));
            assert_eq!(second.interval, point.missed_per_event_interval);
            assert_eq!((second.over_first, line.n_truths), (Some(-0.5), 2));
        }
        assert_eq!(of.missed.len(), 3);
        let warned = alone.points.iter().flat_map(|point| &point.warned).filter(|of| of.n_stoppable > 0);
        let warned: Vec<_> = warned.map(|of| (of.n_stoppable, of.in_time, of.in_time_interval)).collect();
        assert!(warned.iter().any(|(_, in_time, _)| *in_time == Some(0.5)), "{warned:?}");
        let of_lines = of.warned.iter().map(|line| {
            let of = &line.figures[1];
            (line.n_truths, of.value, of.interval)
        });
        assert_eq!(of_lines.collect::<Vec<_>>(), warned);
    }

    #[test]
    fn objects_are_told_by_range_points_and_size_and_samples_by_weather_and_beams() {
        let mut samples = samples(4, |i| i == 0);
        // From 38 m to where the middle begins.
        samples[0].objects[1] = truth(10.0, Harm::Harmless, Distribution::Id);
        samples[0].detections[1] = found(10.0, Harm::Harmless, 0.5);
        for (i, sample) in samples.iter_mut().enumerate() {
            sample.facts.weather = Some(if i == 0 { "FogNight" } else { "FogNoon" }.to_owned());
            sample.facts.rain_rate_mmph = Some(if i == 0 { 0.1 } else { 0.0 });
            sample.facts.n_lidar_rings = Some(if i == 0 { 17 } else { 16 });
            for object in &mut sample.objects {
                object.truth.n_lidar_points = Some(if i == 0 { 9 } else { 10 });
                let of = &mut object.truth.box_in_ego;
                let size_m = if i == 0 { 0.99 } else { 1.0 };
                (of.length_m, of.width_m, of.height_m) = (0.3, 0.4, size_m);
            }
        }
        let of = versus(&[vec![samples]], &Protocol::default(), Mode::Id).unwrap();
        for (name, n_truths, is_found) in [
            ("nearer than 10", 4, false),
            ("from 10 to 30 m", 1, true),
            ("30 m or more", 3, false),
            ("fewer than 10 points", 2, true),
            ("below 1 m", 2, true),
            ("night", 2, true),
            ("rain", 2, true),
            ("more than 16 rings", 2, true),
            ("16 rings or fewer", 6, false),
        ] {
            let line = line(&of.mean, name);
            assert_eq!(line.n_truths, n_truths, "{name}");
            assert_eq!(line.figures[0].value.unwrap() > 0.999, is_found, "{name}");
        }
    }

    #[test]
    fn one_episode_has_no_intervals_and_an_absent_class_counts_where_the_config_says_so() {
        let mut one = samples(1, |_| true);
        one[0].objects.truncate(1);
        let of = versus(&[vec![one.clone()]], &Protocol::default(), Mode::Id).unwrap();
        let total = line(&of.mean, "total").figures[0].clone();
        assert_eq!((of.n_resamples, total.interval), (0, None));
        assert!(total.value.unwrap() > 0.999);
        let config = EvalConfig { missing_class: MissingClass::Zero, ..EvalConfig::default() };
        let protocol = Protocol::try_from(config).unwrap();
        let zero =
            line(&versus(&[vec![one.clone()]], &protocol, Mode::Id).unwrap().mean, "total").figures[0].value;
        assert_eq!(zero, evaluate(&one, &protocol, Mode::Id).unwrap().metrics.columns.total.mean);
    }

    #[test]
    fn the_detector_that_does_not_fit_is_named() {
        let all = || samples(3, |_| true);
        let given = [vec![all()], vec![all(), samples(4, |_| true)]];
        let wrong = versus(&given, &Protocol::default(), Mode::Id).unwrap_err();
        assert!(
            (wrong.detector, wrong.run) == (1, 1) && wrong.to_string().contains("other samples"),
            "{wrong}"
        );
        let mut bad = all();
        bad[0].detections[0].score = f64::NAN;
        let wrong =
            versus(&[vec![all()], vec![all()], vec![bad]], &Protocol::default(), Mode::Id).unwrap_err();
        assert!(wrong.detector == 2 && wrong.to_string().contains("score"), "{wrong}");
    }

    #[test]
    fn runs_of_one_training_count_as_their_mean() {
        let (a, b, c) = (samples(20, |i| i < 8), samples(20, |i| i < 10), samples(20, |i| i < 16));
        let alone = |of: &Vec<EvalSample>| {
            let of = versus(&[vec![of.clone()]], &Protocol::default(), Mode::Id).unwrap();
            line(&of.mean, "total").figures[0].value
        };
        let runs = vec![b.clone(), c.clone()];
        let of = versus(&[vec![a.clone()], runs], &Protocol::default(), Mode::Id).unwrap();
        let [first, second] = &line(&of.mean, "total").figures[..] else { panic!() };
        assert_eq!((first.value, first.runs.len()), (alone(&a), 0));
        assert_eq!(second.runs, [alone(&b), alone(&c)]);
        let expected = f64::midpoint(alone(&b).unwrap(), alone(&c).unwrap());
        assert!((second.value.unwrap() - expected).abs() < 1e-12);
        assert_eq!(second.over_first, Some(second.value.unwrap() - first.value.unwrap()));
        let [low, high] = second.over_first_interval.unwrap();
        assert!(low < second.over_first.unwrap() && second.over_first.unwrap() < high, "{low} {high}");
        assert_eq!(versus(&[vec![a], vec![]], &Protocol::default(), Mode::Id).unwrap_err().detector, 1);
    }
}
