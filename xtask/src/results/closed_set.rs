//! A closed set as a rival: its network tells kinds, and harm is decided by the kind, or by strangeness.
//!
//! Or by the zone's rules over its boxes, whatever kind they are called. The network sees neither speed nor steering angle unless its
//! row says so, and the kind does not either: errors of the two sensors change the zone's verdicts alone.

use fs_err as fs;

use super::experiment::{Experiment, Row};
use super::score::{
    RowScores, SPEED_FACTORS, STEERING_OFFSETS_DEG, median, read_or_make_by, time_it, time_judge,
    time_network, timed_samples,
};
use harmzone::cli::judge_all_at;
use harmzone::dataset::Dataset;
use harmzone::eval::judge::Judge;
use harmzone::eval::sweep::Change;
use harmzone::eval::{Mode, Protocol, SCORING, eval_samples, evaluate};
use harmzone::files::sha256_hex;
use harmzone::infer::{self, ClosedSet, Strangeness, Trained};
use harmzone::model::KindBox;
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::object::Detection;
use harmzone::progress::Silent;
use harmzone::report::results::{JudgeScores, MissedHarm, SetConfidence, SetScores};

/// The zone's rules that judge its boxes.
const ZONES: [Judge; 3] = [Judge::Zone, Judge::ZoneSoft, Judge::ZoneExpected];

/// The closed set by each score of strangeness and by the zone; none where it is not done and not wanted now.
pub fn read_or_make(experiment: &Experiment<'_>, row: &Row) -> anyhow::Result<Option<RowScores>> {
    let names = [Strangeness::ALL.map(Strangeness::name), ZONES.map(Judge::name)].concat();
    read_or_make_by(experiment, row, &names, || make(experiment, row))
}

/// What a line of the table is called.
pub fn label(judge: &str) -> String {
    match judge.strip_prefix("closed-") {
        Some(strangeness) => format!("closed set, {strangeness}"),
        None => format!("{judge} over the closed set's boxes"),
    }
}

fn make(experiment: &Experiment<'_>, row: &Row) -> anyhow::Result<RowScores> {
    let (device, progress) = (experiment.device, experiment.progress);
    let detector = Trained::find(&row.folder)?.load(device)?;
    let boxes = |data: &Dataset| infer::detect_kinds(&detector, data, &row.name, device, progress);
    let set = ClosedSet::fit_to(&detector, experiment.training_split()?, device, progress)?;
    let (validation, test) = (experiment.scored_split(Mode::Id)?, experiment.scored_split(Mode::Ood)?);
    let (in_validation, in_test) = (boxes(validation)?, boxes(test)?);
    let scores = |data: &Dataset, found: &[Vec<KindBox>], by: Strangeness, mode| {
        let judged: Vec<Vec<Detection>> = found.iter().map(|found| set.judge(by, found)).collect();
        evaluate(&eval_samples(data.samples(), &judged), &Protocol::default(), mode)
    };
    let judges = Strangeness::ALL.map(|by| {
        let id = scores(validation, &in_validation, by, Mode::Id)?;
        let ood = scores(test, &in_test, by, Mode::Ood)?;
        let right = SetScores { id: id.metrics.columns.total, ood: ood.metrics.columns };
        let times = timed_samples(test).map(|(i, _)| time_it(|| set.judge(by, &in_test[i])).1);
        anyhow::Ok(JudgeScores {
            judge: by.name().to_owned(),
            judge_ms: median(times.collect()),
            speed_off: [right.clone(), right.clone()],
            steering_off: [right.clone(), right.clone()],
            right,
            missed: MissedHarm { id: id.safety.alarms, ood: ood.safety.alarms },
            confidence: SetConfidence { id: id.confidence, ood: ood.confidence },
        })
    });
    let boxes_of = |found: &[Vec<KindBox>]| -> Vec<Vec<Detection>> {
        found.iter().map(|found| found.iter().map(KindBox::to_detection).collect()).collect()
    };
    let [id_boxes, ood_boxes] = [&in_validation, &in_test].map(|found| boxes_of(found));
    let sets = [(validation, &id_boxes, Mode::Id), (test, &ood_boxes, Mode::Ood)];
    let zones = ZONES.map(|judge| {
        let at = |change: Change, value: f64| {
            let [id, ood] = sets.map(|(data, found, mode)| {
                let judged = judge_all_at(judge, found, data, |state| change.apply(state, value))?;
                anyhow::Ok(evaluate(&eval_samples(data.samples(), &judged), &Protocol::default(), mode)?)
            });
            let (id, ood) = (id?, ood?);
            let scores = SetScores { id: id.metrics.columns.total, ood: ood.metrics.columns };
            let missed = MissedHarm { id: id.safety.alarms, ood: ood.safety.alarms };
            anyhow::Ok((scores, missed, SetConfidence { id: id.confidence, ood: ood.confidence }))
        };
        let off = |change, [low, high]: [f64; 2]| anyhow::Ok([at(change, low)?.0, at(change, high)?.0]);
        let (right, missed, confidence) = at(Change::SpeedFactor, 1.0)?;
        anyhow::Ok(JudgeScores {
            judge: judge.name().to_owned(),
            judge_ms: time_judge(test, &ood_boxes, judge)?,
            right,
            missed,
            confidence,
            speed_off: off(Change::SpeedFactor, SPEED_FACTORS)?,
            steering_off: off(Change::SteeringOffsetDeg, STEERING_OFFSETS_DEG)?,
        })
    });
    let network_ms =
        time_network(test, |named| infer::predict_kinds(&detector, named, device, &Silent).map(|_| ()))?;
    Ok(RowScores {
        scoring: SCORING,
        checkpoint_sha256: sha256_hex(&fs::read(row.folder.join(CHECKPOINT))?),
        trained_on: experiment.id.clone(),
        tested_on: experiment.ood.clone(),
        record: None,
        judges: judges.into_iter().chain(zones).collect::<anyhow::Result<_>>()?,
        network_ms: Some(network_ms),
    })
}
