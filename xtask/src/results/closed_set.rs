//! A closed set as a rival: its network tells kinds, and harm is decided by the kind, or by strangeness.
//!
//! The network sees neither speed nor steering angle unless its row says so, and no rule here does: errors of the two
//! sensors change nothing, so that each line has the same scores in all of its columns.

use burn::module::Module;

use super::experiment::{Experiment, Row};
use super::record::{JudgeScores, RivalRecord, SetScores};
use super::rivals::{kept_file, kept_or, median, timed, watched};
use super::run::ResultsError;
use harmzone::dataset::Dataset;
use harmzone::eval::eval_samples;
use harmzone::eval::{ClassScores, Columns, Mode, Protocol, score};
use harmzone::files::sha256_hex;
use harmzone::infer::{ClosedSet, Strangeness};
use harmzone::infer::{PredictError, predict_kinds};
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::model::{KindBox, checkpoint};
use harmzone::object::Detection;
use harmzone::progress::Silent;

/// Trains the closed set where it is not trained, and scores it by each score of strangeness; where it is not wanted,
/// only what was kept is told.
///
/// # Errors
/// It cannot be trained, fitted or scored.
pub fn rivals(
    experiment: &mut Experiment<'_>,
    row: &Row,
    is_wanted: bool,
) -> Result<Vec<RivalRecord>, ResultsError> {
    let path = row.folder.join(CHECKPOINT);
    if !is_wanted && (!path.is_file() || !kept_file(experiment, &row.name).is_file()) {
        return Ok(Vec::new());
    }
    if !path.is_file() || !row.is_trained_so(&experiment.id)? {
        experiment.train(row)?;
    }
    let checkpoint_sha256 = sha256_hex(&fs_err::read(&path)?);
    let names = Strangeness::ALL.map(Strangeness::name);
    let scores =
        kept_or(experiment, &row.name, &checkpoint_sha256, &names, |experiment| make(experiment, row))?;
    let rival = |scores: JudgeScores| RivalRecord {
        label: format!("closed set, {}", scores.judge.trim_start_matches("closed-")),
        row: row.name.clone(),
        scores,
    };
    Ok(scores.into_iter().map(rival).collect())
}

fn make(experiment: &mut Experiment<'_>, row: &Row) -> Result<Vec<JudgeScores>, ResultsError> {
    let (device, progress) = (experiment.device, experiment.progress);
    let detector = checkpoint::load(&row.folder.join(CHECKPOINT), device)
        .map_err(|source| ResultsError::Checkpoint { row: row.name.clone(), source })?
        .valid();
    let fail = |source: PredictError| ResultsError::Predict { row: row.name.clone(), source };
    let boxes = |data: &Dataset| -> Result<Vec<Vec<KindBox>>, ResultsError> {
        let samples = data.samples().iter();
        let named: Vec<_> = samples.map(|sample| (sample.id.as_str(), &sample.measured)).collect();
        progress.start(&row.name, named.len() as u64);
        let found = predict_kinds(&detector, &named, device, progress).map_err(fail)?;
        progress.finish();
        Ok(found)
    };
    let training = experiment.training_split()?;
    let found = boxes(training)?;
    let objects = training.samples().iter().map(|sample| sample.objects.as_slice());
    let frames: Vec<_> = objects.zip(found.iter().map(Vec::as_slice)).collect();
    let set = ClosedSet::fit(&frames)
        .map_err(|source| ResultsError::ClosedSet { row: row.name.clone(), source })?;

    let columns = |data: &Dataset, found: &[Vec<KindBox>], by: Strangeness, mode| {
        let judged: Vec<Vec<Detection>> = found.iter().map(|found| set.judged(by, found)).collect();
        score(&eval_samples(data, &judged), &Protocol::default(), mode)
            .map(|metrics| metrics.columns)
            .map_err(|source| ResultsError::Score { row: row.name.clone(), source })
    };
    let validation = experiment.val.get()?;
    let found = boxes(validation)?;
    let id = Strangeness::ALL.map(|by| columns(validation, &found, by, Mode::Id));
    let test = experiment.test.get()?;
    let found = boxes(test)?;
    let mut network = Vec::new();
    let mut rule = Strangeness::ALL.map(|_| Vec::new());
    for sample in timed(test) {
        let named = [(sample.id.as_str(), &sample.measured)];
        let (alone, ms) = watched(|| predict_kinds(&detector, &named, device, &Silent));
        network.push(ms);
        let alone = alone.map_err(fail)?;
        for (i, by) in Strangeness::ALL.into_iter().enumerate() {
            rule[i].push(watched(|| set.judged(by, &alone[0])).1);
        }
    }
    let network_ms = median(network);
    let scores = Strangeness::ALL.into_iter().zip(id).zip(rule).map(|((by, id), rule)| {
        let id: Columns<ClassScores> = id?;
        let right = SetScores { id: id.total, ood: columns(test, &found, by, Mode::Ood)? };
        Ok(JudgeScores {
            judge: by.name().to_owned(),
            network_ms,
            judge_ms: median(rule),
            speed_off: [right.clone(), right.clone()],
            steering_off: [right.clone(), right.clone()],
            right,
        })
    });
    scores.collect()
}
