//! Rows side by side on the OOD set, and what each gains over the first: made when all of its rows are trained, and then kept.

use std::path::PathBuf;

use fs_err as fs;
use serde::{Deserialize, Serialize};

use super::config::{SeenRowConfig, SideBySideConfig};
use super::experiment::{Experiment, Row};
use harmzone::cli::judge_all;
use harmzone::dataset::Fingerprint;
use harmzone::dataset::blind::Sensor;
use harmzone::eval::judge::Judge;
use harmzone::eval::versus::{Versus, versus};
use harmzone::eval::{EvalSample, Mode, Protocol, eval_samples};
use harmzone::files::{sha256_hex, write_atomic};
use harmzone::infer::{self, Trained};
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::report::results::SideBySide;

/// Each run's row by its place, its network by its hash, the sensor that saw nothing, and who judged.
type Networks = Vec<(usize, String, Option<Sensor>, Judge)>;

/// What `scores/side-by-side-<number>.json` keeps.
#[derive(Serialize, Deserialize)]
struct Kept {
    rows: Networks,
    tested_on: Fingerprint,
    of: Versus,
}

/// The rows side by side as kept, if they are of these networks and data; none where they are not, or a row is not trained.
///
/// # Errors
/// A file cannot be read.
pub fn read(
    experiment: &Experiment<'_>,
    number: usize,
    config: &SideBySideConfig,
    rows: &[Row],
) -> anyhow::Result<Option<SideBySide>> {
    let (file, networks) = (path(experiment, number), networks(experiment, config, rows)?);
    // What an older version kept is made anew.
    let kept =
        if file.is_file() { serde_json::from_str::<Kept>(&fs::read_to_string(&file)?).ok() } else { None };
    let kept = kept.filter(|kept| networks.as_ref() == Some(&kept.rows) && kept.tested_on == experiment.ood);
    Ok(kept.map(|kept| record(config, kept.of)))
}

/// As [`read`]; else made and kept. None where a row is not trained.
///
/// # Errors
/// A row cannot be read or scored.
pub fn read_or_make(
    experiment: &Experiment<'_>,
    number: usize,
    config: &SideBySideConfig,
    rows: &[Row],
) -> anyhow::Result<Option<SideBySide>> {
    if let Some(kept) = read(experiment, number, config, rows)? {
        return Ok(Some(kept));
    }
    let Some(networks) = networks(experiment, config, rows)? else { return Ok(None) };
    let detectors = config.rows.iter().map(|seen| {
        let runs = runs_of(rows, &seen.row).into_iter();
        runs.map(|row| look(experiment, row, seen)).collect::<anyhow::Result<_>>()
    });
    let detectors: Vec<Vec<Vec<EvalSample>>> = detectors.collect::<anyhow::Result<_>>()?;
    let of = versus(&detectors, &Protocol::default(), Mode::Ood)?;
    let kept = Kept { rows: networks, tested_on: experiment.ood.clone(), of };
    write_atomic(&path(experiment, number), serde_json::to_string_pretty(&kept)?.as_bytes())?;
    Ok(Some(record(config, kept.of)))
}

fn path(experiment: &Experiment<'_>, number: usize) -> PathBuf {
    experiment.request.out.join("scores").join(format!("side-by-side-{number}.json"))
}

/// A row and its repeats.
fn runs_of<'a>(rows: &'a [Row], name: &str) -> Vec<&'a Row> {
    let runs: Vec<&Row> =
        rows.iter().filter(|row| row.name == name || row.repeats.as_deref() == Some(name)).collect();
    assert!(!runs.is_empty(), "the config was checked");
    runs
}

/// The rows' networks; none where a row is not trained.
fn networks(
    experiment: &Experiment<'_>,
    config: &SideBySideConfig,
    rows: &[Row],
) -> anyhow::Result<Option<Networks>> {
    let mut networks = Vec::new();
    for (i, seen) in config.rows.iter().enumerate() {
        for row in runs_of(rows, &seen.row) {
            if !experiment.is_trained(row)? {
                return Ok(None);
            }
            let sha256 = sha256_hex(&fs::read(row.folder.join(CHECKPOINT))?);
            networks.push((i, sha256, seen.blind, seen.judge));
        }
    }
    Ok(Some(networks))
}

fn record(config: &SideBySideConfig, of: Versus) -> SideBySide {
    let labels = config.rows.iter().map(|seen| seen.label.clone()).collect();
    SideBySide { title: config.title.clone(), note: config.note.clone(), labels, of }
}

/// The OOD set's samples with what a row finds.
fn look(experiment: &Experiment<'_>, row: &Row, seen: &SeenRowConfig) -> anyhow::Result<Vec<EvalSample>> {
    let data = experiment.scored_split(Mode::Ood)?;
    let detector = Trained::find(&row.folder)?.load(experiment.device)?;
    let &SeenRowConfig { blind, judge, .. } = seen;
    let (device, progress) = (experiment.device, experiment.progress);
    let found = infer::detect_for(judge, &detector, data.samples(), blind, device, progress)?;
    Ok(eval_samples(data.samples(), &judge_all(judge, &found, data)?))
}
