//! Who decides on harm over one network's boxes, with both sensors right and with each of them off.

use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::module::Module;
use serde::{Deserialize, Serialize};

use super::experiment::Experiment;
use super::record::{JudgeScores, Record, RivalRecord, SetScores};
use super::run::{ResultsError, read};
use harmzone::dataset::{Dataset, Fingerprint, LabelledSample};
use harmzone::eval::Protocol;
use harmzone::eval::judge::Judge;
use harmzone::eval::sweep::{Change, SweepConfig, SweepError, SweepPoint, Sweeps};
use harmzone::files::write_atomic;
use harmzone::infer::{self, SweepRunError, predict};
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::model::{Detector, checkpoint};
use harmzone::progress::Silent;

/// Factors of a speed sensor that errs, and the one of a right one first.
const SPEED_FACTORS: [f64; 3] = [1.0, 0.9, 1.1];
/// Offsets of a steering sensor that errs, degrees.
const STEERING_OFFSETS_DEG: [f64; 2] = [-2.0, 2.0];
/// Samples whose times are taken.
const N_TIMED: usize = 30;

/// A row's judges, as kept beside its scores.
#[derive(Debug, Serialize, Deserialize)]
struct Kept {
    checkpoint_sha256: String,
    id: Fingerprint,
    ood: Fingerprint,
    judges: Vec<JudgeScores>,
}

/// The rivals over a row's boxes: kept ones if they are still of its checkpoint and of the data.
///
/// # Errors
/// The data or the checkpoint cannot be read or scored.
pub fn of_row(
    experiment: &mut Experiment<'_>,
    record: &Record,
    run: &Path,
) -> Result<Vec<RivalRecord>, ResultsError> {
    let config = experiment.request.config;
    let wanted: Vec<_> = config.rivals.iter().filter(|rival| rival.row == record.name).collect();
    if wanted.is_empty() {
        return Ok(Vec::new());
    }
    let judges: Vec<Judge> = wanted.iter().map(|rival| rival.judge).collect();
    let names: Vec<&str> = judges.iter().map(|judge| judge.name()).collect();
    let scores = kept_or(experiment, &record.name, &record.checkpoint_sha256, &names, |experiment| {
        make(experiment, record, run, &judges)
    })?;
    let of = |judge: Judge| scores.iter().find(|of| of.judge == judge.name());
    let rival = |wanted: &super::config::RivalConfig| RivalRecord {
        label: wanted.label.clone(),
        row: record.name.clone(),
        scores: of(wanted.judge).expect("all that are wanted were judged").clone(),
    };
    Ok(wanted.into_iter().map(rival).collect())
}

/// Where the judges of a row's boxes are kept.
pub fn kept_file(experiment: &Experiment<'_>, row: &str) -> PathBuf {
    experiment.request.out.join("scores").join(format!("{row}-rivals.json"))
}

/// The judges of a row's boxes as kept, if they are of its checkpoint and of the data and none is missing; else made and
/// kept.
///
/// # Errors
/// Those of `make`, or the record cannot be read or written.
pub fn kept_or<'a>(
    experiment: &mut Experiment<'a>,
    row: &str,
    checkpoint_sha256: &str,
    names: &[&str],
    make: impl FnOnce(&mut Experiment<'a>) -> Result<Vec<JudgeScores>, ResultsError>,
) -> Result<Vec<JudgeScores>, ResultsError> {
    let file = kept_file(experiment, row);
    if file.is_file() {
        let kept: Kept = read(&file)?;
        let is_of_these = kept.checkpoint_sha256 == checkpoint_sha256
            && (&kept.id, &kept.ood) == (&experiment.id, &experiment.ood)
            && names.iter().all(|name| kept.judges.iter().any(|of| of.judge == *name));
        if is_of_these {
            return Ok(kept.judges);
        }
    }
    let kept = Kept {
        checkpoint_sha256: checkpoint_sha256.to_owned(),
        id: experiment.id.clone(),
        ood: experiment.ood.clone(),
        judges: make(experiment)?,
    };
    let text = serde_json::to_string_pretty(&kept).expect("names and numbers have a JSON form");
    write_atomic(&file, text.as_bytes())?;
    Ok(kept.judges)
}

fn make(
    experiment: &mut Experiment<'_>,
    record: &Record,
    run: &Path,
    judges: &[Judge],
) -> Result<Vec<JudgeScores>, ResultsError> {
    let device = experiment.device;
    let detector = checkpoint::load(&run.join(CHECKPOINT), device)
        .map_err(|source| ResultsError::Checkpoint { row: record.name.clone(), source })?
        .valid();
    let config = SweepConfig {
        speed_mps: Vec::new(),
        steering_deg: Vec::new(),
        speed_factor: SPEED_FACTORS.to_vec(),
        steering_offset_deg: STEERING_OFFSETS_DEG.to_vec(),
        ..SweepConfig::default()
    };
    let fail = |source: SweepRunError| {
        let row = record.name.clone();
        ResultsError::Sweep { row, source: Box::new(source) }
    };
    let progress = experiment.progress;
    let sweep = |data: &Dataset| -> Result<Sweeps, SweepRunError> {
        let (swept, _) = infer::sweep(&detector, data, &config, device, progress)?;
        Ok(swept.measure(judges, &Protocol::default())?)
    };
    let id = sweep(experiment.val.get()?).map_err(fail)?;
    let ood = sweep(experiment.test.get()?).map_err(fail)?;
    let data = experiment.test.get()?;
    let of_judge = |&judge: &Judge| {
        let (network_ms, judge_ms) = times(&detector, data, judge, device).map_err(fail)?;
        let scores = |change, i: usize| set_scores(&id, &ood, change, judge, i);
        Ok(JudgeScores {
            judge: judge.name().to_owned(),
            network_ms,
            judge_ms,
            right: scores(Change::SpeedFactor, 0),
            speed_off: [1, 2].map(|i| scores(Change::SpeedFactor, i)),
            steering_off: [0, 1].map(|i| scores(Change::SteeringOffsetDeg, i)),
        })
    };
    judges.iter().map(of_judge).collect()
}

fn set_scores(id: &Sweeps, ood: &Sweeps, change: Change, judge: Judge, i: usize) -> SetScores {
    let at = |sweeps: &Sweeps| -> SweepPoint { sweeps.points(change, judge)[i].clone() };
    SetScores { id: at(id).scores.total, ood: at(ood).scores }
}

/// Median times of a sample through the network and through a judge, milliseconds.
fn times(
    detector: &Detector,
    data: &Dataset,
    judge: Judge,
    device: &burn::tensor::Device,
) -> Result<(f64, f64), SweepRunError> {
    let (mut network, mut rule) = (Vec::new(), Vec::new());
    for sample in timed(data) {
        let named = [(sample.id.as_str(), &sample.measured)];
        let (found, ms) =
            watched(|| predict(detector, &named, detector.config().use_camera, device, &Silent));
        network.push(ms);
        let found = found?;
        let (judged, ms) = watched(|| judge.judged(&found[0], &sample.measured.ego_state, data.zone()));
        rule.push(ms);
        judged.map_err(|source| SweepError::Zone {
            sample: sample.id.clone(),
            change: Change::SpeedFactor,
            value: 1.0,
            source,
        })?;
    }
    Ok((median(network), median(rule)))
}

/// The samples whose times are taken, evenly over the set.
pub fn timed(data: &Dataset) -> impl Iterator<Item = &LabelledSample> {
    data.samples().iter().step_by(data.samples().len().div_ceil(N_TIMED).max(1))
}

/// What some work gives, and its time in milliseconds.
pub fn watched<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let started = Instant::now();
    let given = work();
    (given, started.elapsed().as_secs_f64() * 1e3)
}

/// The middle value; 0 of none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;
    use harmzone::dataset::test_data;
    use harmzone::model::ModelConfig;

    #[test]
    fn times_are_medians_over_the_set_and_the_rule_costs_less_than_the_network() {
        assert_eq!(median(vec![9.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(vec![]), 0.0);
        let mut config = ModelConfig::default();
        (config.grid.cell_size_m, config.camera.cnn.image_width_px, config.head.n_queries) = (3.2, 64, 20);
        let (data, device) = (test_data::dataset(3), Device::flex());
        let detector = Detector::init(&config, 0, &device).valid();
        let (network_ms, judge_ms) = times(&detector, &data, Judge::ZoneSoft, &device).unwrap();
        assert!(network_ms > judge_ms && judge_ms > 0.0, "{network_ms} {judge_ms}");
    }
}
