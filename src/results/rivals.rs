//! Who decides on harm over one network's boxes, with both sensors right and with each of them off.

use std::path::Path;
use std::time::Instant;

use burn::module::Module;
use serde::{Deserialize, Serialize};

use super::record::{JudgeScores, Record, RivalRecord, SetScores};
use super::run::{Experiment, ResultsError, read};
use crate::dataset::{Dataset, Fingerprint};
use crate::eval::Protocol;
use crate::eval::judge::Judge;
use crate::eval::predict::predict;
use crate::eval::sweep::{Change, SweepConfig, SweepError, SweepPoint, Sweeps, Swept};
use crate::files::write_atomic;
use crate::model::{Detector, checkpoint};
use crate::progress::Silent;
use crate::train::CHECKPOINT;

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
    let file = experiment.request.out.join("scores").join(format!("{}-rivals.json", record.name));
    let kept = if file.is_file() { Some(read::<Kept>(&file)?) } else { None };
    let is_of_these = |kept: &Kept| {
        kept.checkpoint_sha256 == record.checkpoint_sha256
            && (&kept.id, &kept.ood) == (&experiment.id, &experiment.ood)
            && judges.iter().all(|judge| kept.judges.iter().any(|of| of.judge == *judge))
    };
    let kept = match kept.filter(is_of_these) {
        Some(kept) => kept,
        None => {
            let kept = Kept {
                checkpoint_sha256: record.checkpoint_sha256.clone(),
                id: experiment.id.clone(),
                ood: experiment.ood.clone(),
                judges: make(experiment, record, run, &judges)?,
            };
            let text = serde_json::to_string_pretty(&kept).expect("names and numbers have a JSON form");
            write_atomic(&file, text.as_bytes())?;
            kept
        }
    };
    let of = |judge| kept.judges.iter().find(|of| of.judge == judge);
    let rival = |wanted: &super::RivalConfig| RivalRecord {
        label: wanted.label.clone(),
        row: record.name.clone(),
        scores: of(wanted.judge).expect("all that are wanted were judged").clone(),
    };
    Ok(wanted.into_iter().map(rival).collect())
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
    let fail = |source: SweepError| {
        let row = record.name.clone();
        ResultsError::Sweep { row, source: Box::new(source) }
    };
    let progress = experiment.progress;
    let sweep = |data: &Dataset| -> Result<Sweeps, SweepError> {
        Swept::run(&detector, data, &config, device, progress)?.measure(judges, &Protocol::default())
    };
    let id = sweep(experiment.val.get()?).map_err(fail)?;
    let ood = sweep(experiment.test.get()?).map_err(fail)?;
    let data = experiment.test.get()?;
    let of_judge = |&judge: &Judge| {
        let (network_ms, judge_ms) = times(&detector, data, judge, device).map_err(fail)?;
        let scores = |change, i: usize| set_scores(&id, &ood, change, judge, i);
        Ok(JudgeScores {
            judge,
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

/// Median times of a sample through the network and through a judge, milliseconds; samples evenly over the set.
fn times(
    detector: &Detector,
    data: &Dataset,
    judge: Judge,
    device: &burn::tensor::Device,
) -> Result<(f64, f64), SweepError> {
    let every = data.samples().len().div_ceil(N_TIMED).max(1);
    let (mut network, mut rule) = (Vec::new(), Vec::new());
    for sample in data.samples().iter().step_by(every) {
        let started = Instant::now();
        let named = [(sample.id.as_str(), &sample.measured)];
        let found = predict(detector, &named, detector.config().use_camera, device, &Silent)?;
        network.push(started.elapsed().as_secs_f64() * 1e3);
        let started = Instant::now();
        let judged = judge.judged(&found[0], &sample.measured.ego_state, data.zone());
        rule.push(started.elapsed().as_secs_f64() * 1e3);
        judged.map_err(|source| SweepError::Zone {
            sample: sample.id.clone(),
            change: Change::SpeedFactor,
            value: 1.0,
            source,
        })?;
    }
    Ok((median(network), median(rule)))
}

/// The middle value; 0 of none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::model::ModelConfig;
    use burn::tensor::Device;

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
