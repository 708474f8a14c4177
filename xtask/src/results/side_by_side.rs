//! Rows side by side on the OOD set, and what each gains over the first: made when all of its rows are trained, and then kept.

use fs_err as fs;
use serde::{Deserialize, Serialize};

use super::config::SideBySideConfig;
use super::experiment::{Experiment, Row, read_json};
use harmzone::dataset::Fingerprint;
use harmzone::dataset::blind::Sensor;
use harmzone::eval::versus::{Versus, versus};
use harmzone::eval::{EvalSample, Mode, Protocol, eval_samples};
use harmzone::files::{sha256_hex, write_atomic};
use harmzone::infer::{self, Trained};
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::report::results::SideBySide;

/// What `scores/side-by-side-<number>.json` keeps.
#[derive(Serialize, Deserialize)]
struct Kept {
    /// Each row's network and the sensor that saw nothing.
    rows: Vec<(String, Option<Sensor>)>,
    tested_on: Fingerprint,
    of: Versus,
}

/// The rows side by side as kept, if they are of these networks and data; else made. None where a row is not trained.
///
/// # Errors
/// A row cannot be read or scored.
pub fn read_or_make(
    experiment: &Experiment<'_>,
    number: usize,
    config: &SideBySideConfig,
    rows: &[Row],
) -> anyhow::Result<Option<SideBySide>> {
    let row = |name: &str| rows.iter().find(|row| row.name == name).expect("the config was checked");
    let mut networks = Vec::new();
    for seen in &config.rows {
        let row = row(&seen.row);
        if !experiment.is_trained(row)? {
            return Ok(None);
        }
        networks.push((sha256_hex(&fs::read(row.folder.join(CHECKPOINT))?), seen.blind));
    }
    let file = experiment.request.out.join("scores").join(format!("side-by-side-{number}.json"));
    let kept = if file.is_file() { Some(read_json::<Kept>(&file)?) } else { None };
    let kept = kept.filter(|kept| kept.rows == networks && kept.tested_on == experiment.ood);
    let of = if let Some(kept) = kept {
        kept.of
    } else {
        let detectors = config.rows.iter().map(|seen| look(experiment, row(&seen.row), seen.blind));
        let detectors: Vec<Vec<EvalSample>> = detectors.collect::<anyhow::Result<_>>()?;
        let of = versus(&detectors, &Protocol::default(), Mode::Ood)?;
        let kept = Kept { rows: networks, tested_on: experiment.ood.clone(), of };
        write_atomic(&file, serde_json::to_string_pretty(&kept)?.as_bytes())?;
        kept.of
    };
    let labels = config.rows.iter().map(|seen| seen.label.clone()).collect();
    Ok(Some(SideBySide { title: config.title.clone(), note: config.note.clone(), labels, of }))
}

fn look(experiment: &Experiment<'_>, row: &Row, blind: Option<Sensor>) -> anyhow::Result<Vec<EvalSample>> {
    let data = experiment.scored_split(Mode::Ood)?;
    let detector = Trained::find(&row.folder)?.load(experiment.device)?;
    let blinded = blind.map(|sensor| data.clone().blind(sensor));
    let shown = blinded.as_ref().unwrap_or(data);
    let found = infer::detect(&detector, &shown.named(), experiment.device, experiment.progress)?;
    Ok(eval_samples(data.samples(), &found))
}
