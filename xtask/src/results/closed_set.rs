//! A closed set as a rival: its network tells kinds, and harm is decided by the kind, or by strangeness.
//!
//! The network sees neither speed nor steering angle unless its row says so, and no rule here does: errors of the two
//! sensors change nothing, so that each line has the same scores in all of its columns.

use fs_err as fs;

use super::experiment::{Experiment, Row};
use super::score::{RowScores, median, read_or_make_by, time_it, time_network, timed_samples};
use harmzone::dataset::Dataset;
use harmzone::eval::{Mode, Protocol, eval_samples, evaluate};
use harmzone::files::sha256_hex;
use harmzone::infer::{self, ClosedSet, Strangeness, Trained};
use harmzone::model::KindBox;
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::object::Detection;
use harmzone::progress::Silent;
use harmzone::report::results::{JudgeScores, MissedHarm, SetScores};

/// The closed set by each score of strangeness; none where it is not done and not wanted now.
pub fn read_or_make(experiment: &Experiment<'_>, row: &Row) -> anyhow::Result<Option<RowScores>> {
    let names = Strangeness::ALL.map(Strangeness::name);
    read_or_make_by(experiment, row, &names, || make(experiment, row))
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
        })
    });
    let network_ms =
        time_network(test, |named| infer::predict_kinds(&detector, named, device, &Silent).map(|_| ()))?;
    Ok(RowScores {
        checkpoint_sha256: sha256_hex(&fs::read(row.folder.join(CHECKPOINT))?),
        trained_on: experiment.id.clone(),
        tested_on: experiment.ood.clone(),
        record: None,
        judges: judges.into_iter().collect::<anyhow::Result<_>>()?,
        network_ms: Some(network_ms),
    })
}
