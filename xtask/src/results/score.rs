//! The scores of one row, by one pass of its network over each data set: AP, rivals under errors of the sensors, and for
//! the headline all that the page shows.

use std::time::Instant;

use anyhow::Context;
use burn::tensor::Device;
use fs_err as fs;
use serde::{Deserialize, Serialize};

use super::data::LABELS;
use super::experiment::{Experiment, Row, read_json};
use super::page;
use harmzone::cli::{ScoredData, judge_all, provenance};
use harmzone::config::{Checked, differences};
use harmzone::dataset::{Dataset, Fingerprint, LabelledSample};
use harmzone::episode::{Manifest, Split};
use harmzone::eval::judge::Judge;
use harmzone::eval::safety::Alarms;
use harmzone::eval::sweep::{Change, SweepConfig, Sweeps};
use harmzone::eval::{
    ClassScores, Columns, Confidence, Evaluation, Mode, Protocol, SCORING, eval_samples, evaluate,
};
use harmzone::files::{sha256_hex, write_atomic};
use harmzone::infer::{self, PredictError, Trained};
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::model::{Detector, ModelConfig};
use harmzone::object::Detection;
use harmzone::progress::Silent;
use harmzone::report::results::{JudgeScores, MissedHarm, Record, SetConfidence, SetScores};
use harmzone::report::scores;
use harmzone::report::sweeps::{self, SweepRequest};
use harmzone::train::{TrainConfig, TrainingTime};

/// Factors of a speed sensor that errs.
pub const SPEED_FACTORS: [f64; 2] = [0.9, 1.1];
/// Offsets of a steering sensor that errs, degrees.
pub const STEERING_OFFSETS_DEG: [f64; 2] = [-2.0, 2.0];
/// Samples whose times are taken.
const N_TIMED: usize = 30;

/// What a row came to, as `scores/<row>.json` keeps it.
#[derive(Debug, Serialize, Deserialize)]
pub struct RowScores {
    /// Number of the rules that made them.
    #[serde(default)]
    pub scoring: u32,
    pub checkpoint_sha256: String,
    pub trained_on: Fingerprint,
    pub tested_on: Fingerprint,
    /// None for a closed set, whose network tells no harm.
    pub record: Option<Record>,
    /// Those that the config asks for.
    pub judges: Vec<JudgeScores>,
    /// Median time of a sample through the network, milliseconds; taken where judges are asked for.
    pub network_ms: Option<f64>,
}

/// The scores of a row that tells harm; none where it is not done and not wanted now.
pub fn read_or_make(experiment: &Experiment<'_>, row: &Row) -> anyhow::Result<Option<RowScores>> {
    let rivals = experiment.request.config.rivals.iter();
    let judges: Vec<Judge> = rivals.filter(|of| of.row == row.name).map(|of| of.judge).collect();
    let names: Vec<&str> = judges.iter().map(|judge| judge.name()).collect();
    read_or_make_by(experiment, row, &names, || make(experiment, row, &judges))
}

/// The scores of a row as kept, if they are of its run and of the data and no judge and no missed harm is missing; else trained, made and
/// kept, where the row is wanted.
pub fn read_or_make_by(
    experiment: &Experiment<'_>,
    row: &Row,
    judges: &[&str],
    make: impl FnOnce() -> anyhow::Result<RowScores>,
) -> anyhow::Result<Option<RowScores>> {
    let file = experiment.request.out.join("scores").join(format!("{}.json", row.name));
    let is_trained = experiment.is_trained(row)?;
    if is_trained && file.is_file() {
        let kept: RowScores = read_json(&file)?;
        let is_shown = |record: &Record| page::is_complete(&experiment.request.out, record);
        let is_whole = kept.scoring == SCORING
            && kept.checkpoint_sha256 == sha256_hex(&fs::read(row.folder.join(CHECKPOINT))?)
            && (&kept.trained_on, &kept.tested_on) == (&experiment.id, &experiment.ood)
            && judges.iter().all(|name| kept.judges.iter().any(|of| of.judge == *name))
            && kept.record.iter().all(|of| of.missed != MissedHarm::default())
            && kept.judges.iter().all(|of| of.missed != MissedHarm::default())
            && (!row.is_headline || kept.record.as_ref().is_some_and(is_shown));
        if is_whole {
            return Ok(Some(kept));
        }
    }
    if !experiment.request.wants(&row.name) {
        return Ok(None);
    }
    if !is_trained {
        experiment.train(row)?;
    }
    let made = make().with_context(|| format!("row `{}`", row.name))?;
    write_atomic(&file, serde_json::to_string_pretty(&made)?.as_bytes())?;
    Ok(Some(made))
}

fn make(experiment: &Experiment<'_>, row: &Row, judges: &[Judge]) -> anyhow::Result<RowScores> {
    let trained = Trained::find(&row.folder)?;
    let detector = trained.load(experiment.device)?;
    if let (Some(seen), Some(_)) = (trained.seen()?, &row.learned_from) {
        for mode in [Mode::Id, Mode::Ood] {
            seen.check_unlearned(experiment.scored_split(mode)?.episodes())?;
        }
    }
    let id = look(experiment, row, &trained, &detector, judges, Mode::Id)?;
    let ood = look(experiment, row, &trained, &detector, judges, Mode::Ood)?;
    let network_ms = if judges.is_empty() {
        None
    } else {
        Some(time_network(ood.data, |named| {
            infer::predict(&detector, named, detector.config().use_camera, experiment.device, &Silent)
                .map(|_| ())
        })?)
    };
    let scores = |judge: Judge, change, value: f64| {
        let at = |sweeps: &Sweeps| {
            let points = sweeps.points(change, judge);
            points.iter().find(|point| point.value == value).expect("all values are swept").scores.clone()
        };
        SetScores { id: at(&id.sweeps).total, ood: at(&ood.sweeps) }
    };
    let judged = judges.iter().map(|&judge| {
        let (of_id, of_ood) =
            (evaluate_judged(&id, judge, Mode::Id)?, evaluate_judged(&ood, judge, Mode::Ood)?);
        anyhow::Ok(JudgeScores {
            judge: judge.name().to_owned(),
            judge_ms: time_judge(ood.data, &ood.found, judge)?,
            right: scores(judge, Change::SpeedFactor, 1.0),
            missed: MissedHarm { id: of_id.safety.alarms, ood: of_ood.safety.alarms },
            confidence: SetConfidence { id: of_id.confidence, ood: of_ood.confidence },
            speed_off: SPEED_FACTORS.map(|factor| scores(judge, Change::SpeedFactor, factor)),
            steering_off: STEERING_OFFSETS_DEG.map(|off| scores(judge, Change::SteeringOffsetDeg, off)),
        })
    });
    let judges = judged.collect::<anyhow::Result<_>>()?;
    let bytes = trained.bytes()?.1;
    let (profile, set) = as_flags(&row.config);
    let record = Record {
        name: row.name.clone(),
        profile: profile.to_owned(),
        set,
        seed: row.config.seed,
        epochs: [row.config.lidar_stage.epochs, row.config.fused_stage.epochs],
        n_parameters: n_parameters(detector.config()),
        wall_and_cpu_s: TrainingTime::read(&row.folder).map(|spent| [spent.wall_s, spent.cpu_s]),
        checkpoint_sha256: sha256_hex(bytes),
        checkpoint_bytes: bytes.len(),
        trained_on: experiment.id.clone(),
        tested_on: experiment.ood.clone(),
        learned_from: row.learned_from.clone(),
        strict: strict_of(&id, &ood),
        id: id.scores.total,
        ood: ood.scores,
        missed: MissedHarm { id: id.missed, ood: ood.missed },
        confidence: SetConfidence { id: id.confidence, ood: ood.confidence },
    };
    Ok(RowScores {
        scoring: SCORING,
        checkpoint_sha256: record.checkpoint_sha256.clone(),
        trained_on: experiment.id.clone(),
        tested_on: experiment.ood.clone(),
        record: Some(record),
        judges,
        network_ms,
    })
}

/// What one pass over a data set gave.
struct Looked<'a> {
    data: &'a Dataset,
    found: Vec<Vec<Detection>>,
    scores: Columns<ClassScores>,
    strict: Option<Columns<ClassScores>>,
    missed: Option<Alarms>,
    confidence: Option<Confidence>,
    /// Empty where neither judges nor the page ask for them.
    sweeps: Sweeps,
}

/// Passes once over a data set, at the recorded state and at those that judges and page ask for, and scores what is
/// found.
fn look<'a>(
    experiment: &'a Experiment<'_>,
    row: &Row,
    trained: &Trained,
    detector: &Detector,
    judges: &[Judge],
    mode: Mode,
) -> anyhow::Result<Looked<'a>> {
    let (data, protocol) = (experiment.scored_split(mode)?, Protocol::try_from(trained.eval_config()?)?);
    let shipped = SweepConfig::default();
    let config = if row.is_headline {
        shipped
    } else {
        let is_judged = !judges.is_empty();
        let values = |values: &[f64]| if is_judged { values.to_vec() } else { Vec::new() };
        SweepConfig {
            speed_mps: Vec::new(),
            steering_deg: Vec::new(),
            speed_factor: values(&[1.0, SPEED_FACTORS[0], SPEED_FACTORS[1]]),
            steering_offset_deg: values(&STEERING_OFFSETS_DEG),
            picture_speed_mps: Vec::new(),
            picture_steering_deg: Vec::new(),
            judges: judges.to_vec(),
            ..shipped
        }
    };
    let config = Checked::try_from(config)?;
    let (swept, series) = infer::sweep(detector, data, &config, experiment.device, experiment.progress)?;
    let found: Vec<Vec<Detection>> = swept.found().iter().map(|of_frame| of_frame[0].clone()).collect();
    let samples = eval_samples(data.samples(), &found);
    let evaluation = evaluate(&samples, &protocol, mode)?;
    let sweeps = if row.is_headline {
        let out = &page::folder(&experiment.request.out, mode);
        let request = SweepRequest {
            swept: &swept,
            series: &series,
            dataset: data,
            config: &config,
            protocol: &protocol,
            out,
        };
        let sweeps = sweeps::run(&request)?.sweeps;
        let command = experiment.request.command.clone();
        let of_mode = ScoredData {
            path: data.path(),
            labels: LABELS,
            split: if mode == Mode::Id { Split::Val } else { Split::Dev },
            data_version: Manifest::read(data.path())?.format_version,
        };
        let source = provenance(Some(trained), Some(&of_mode), command)?;
        scores::write(out, &protocol, &evaluation, &source)?;
        sweeps
    } else {
        swept.measure(&config.judges, &protocol)?
    };
    let kind = if mode == Mode::Id { "id" } else { "ood" };
    let file = experiment.request.out.join("scores").join(format!("{}-{kind}.json", row.name));
    write_atomic(&file, evaluation.metrics.to_json().as_bytes())?;
    let (scores, strict) = (evaluation.metrics.columns, evaluation.metrics.strict);
    let missed = evaluation.safety.alarms;
    Ok(Looked { data, found, scores, strict, missed, confidence: evaluation.confidence, sweeps })
}

/// The strict scores of both sets; of one that has no neutral detection they are its scores.
fn strict_of(id: &Looked<'_>, ood: &Looked<'_>) -> Option<SetScores> {
    if id.strict.is_none() && ood.strict.is_none() {
        return None;
    }
    let of = |looked: &Looked<'_>| looked.strict.clone().unwrap_or_else(|| looked.scores.clone());
    Some(SetScores { id: of(id).total, ood: of(ood) })
}

/// What the boxes come to where a judge decides on them.
fn evaluate_judged(looked: &Looked<'_>, judge: Judge, mode: Mode) -> anyhow::Result<Evaluation> {
    let samples = eval_samples(looked.data.samples(), &judge_all(judge, &looked.found, looked.data)?);
    Ok(evaluate(&samples, &Protocol::default(), mode)?)
}

/// Median time of a sample through a network, milliseconds.
pub fn time_network(
    data: &Dataset,
    mut predict: impl FnMut(&[(&str, &harmzone::sample::Measured)]) -> Result<(), PredictError>,
) -> Result<f64, PredictError> {
    let mut times = Vec::new();
    for (_, sample) in timed_samples(data) {
        let (done, ms) = time_it(|| predict(&[(sample.id.as_str(), &sample.measured)]));
        done?;
        times.push(ms);
    }
    Ok(median(times))
}

pub fn time_judge(data: &Dataset, found: &[Vec<Detection>], judge: Judge) -> anyhow::Result<f64> {
    let mut times = Vec::new();
    for (i, sample) in timed_samples(data) {
        let (judged, ms) = time_it(|| judge.judge(&found[i], &sample.measured.ego_state, data.zone()));
        judged?;
        times.push(ms);
    }
    Ok(median(times))
}

/// The samples whose times are taken, evenly over the set.
pub fn timed_samples(data: &Dataset) -> impl Iterator<Item = (usize, &LabelledSample)> {
    let step = data.samples().len().div_ceil(N_TIMED).max(1);
    data.samples().iter().enumerate().step_by(step)
}

/// What some work gives, and its time in milliseconds.
pub fn time_it<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let started = Instant::now();
    let given = work();
    (given, started.elapsed().as_secs_f64() * 1e3)
}

/// The middle value; 0 of none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Profile and overrides by which `harmzone train` makes a config.
fn as_flags(config: &TrainConfig) -> (&'static str, Vec<String>) {
    let small = differences(&TrainConfig::default(), config);
    let paper = differences(&TrainConfig::paper(), config);
    if paper.len() < small.len() { ("paper", paper) } else { ("small", small) }
}

fn n_parameters(config: &ModelConfig) -> usize {
    let detector = Detector::init(config, 0, &Device::flex().autodiff());
    detector.n_parameters().into_iter().map(|(_, n)| n).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_value_is_the_median() {
        assert_eq!([median(vec![9.0, 1.0, 2.0]), median(vec![])], [2.0, 0.0]);
    }
}
