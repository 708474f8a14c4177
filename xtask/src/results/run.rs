//! Runs an experiment: each row is trained where it is not, then scored, then all of it written down.

use burn::tensor::Device;
use fs_err as fs;

use super::config::RivalConfig;
use super::experiment::{Experiment, Row};
use super::request::Request;
use super::score::RowScores;
use super::{closed_set, data, reported, score, side_by_side, write};
use harmzone::progress::Progress;
use harmzone::report::results::{DataRecord, Results, RivalRecord};

/// Runs an experiment, or what is left of it; a row that is done is not done again, a training that was broken off
/// goes on.
///
/// # Errors
/// The config does not fit, or a row cannot be trained or scored; rows that are done stay.
pub fn run(request: &Request<'_>, device: &Device, progress: &dyn Progress) -> anyhow::Result<Results> {
    let trainings = request.config.trainings()?;
    let closed_set = request.config.closed_set_training()?;
    if let Some(only) = &request.only {
        let names: Vec<&str> = trainings.iter().chain(&closed_set).map(|(name, _)| name.as_str()).collect();
        anyhow::ensure!(names.contains(&only.as_str()), "no row `{only}`; there are: {}", names.join(", "));
    }
    fs::create_dir_all(request.out.join("scores"))?;
    let (id_path, id) = data::prepare(request, false, progress)?;
    let (ood_path, ood) = data::prepare(request, true, progress)?;
    let fingerprints = [id.fingerprint.clone(), ood.fingerprint.clone()];
    let experiment = Experiment::new(request, fingerprints, [&id_path, &ood_path], device, progress);
    let mut results = Results {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        data: DataRecord { preset: request.config.preset.clone(), id, ood },
        reported: None,
        common: request.config.common.clone(),
        headline: None,
        rows: Vec::new(),
        tables: request.config.tables.clone(),
        side_by_side: Vec::new(),
        rivals: Vec::new(),
        network_ms: [].into(),
    };
    let rows = trainings.iter().enumerate().map(|(i, (name, config))| experiment.row(name, config, i == 0));
    let rows: Vec<Row> = rows.collect::<anyhow::Result<_>>()?;
    for (number, config) in request.config.side_by_side.iter().enumerate() {
        results.side_by_side.extend(side_by_side::read(&experiment, number, config, &rows)?);
    }
    for (i, row) in rows.iter().enumerate() {
        let name = &row.name;
        if let Some(scores) = score::read_or_make(&experiment, row)? {
            results.rivals.extend(rivals(&request.config.rivals, name, &scores));
            results.network_ms.extend(scores.network_ms.map(|ms| (name.clone(), ms)));
            if i == 0 {
                results.headline = scores.record;
                if let Some(record) = &results.headline {
                    results.reported = reported::read_or_make(&experiment, row, record)?;
                }
            } else {
                results.rows.extend(scores.record);
            }
        }
        // What is done is told even if a later row fails.
        write::write(&results, &request.out, None)?;
    }
    results.side_by_side.clear();
    for (number, config) in request.config.side_by_side.iter().enumerate() {
        results.side_by_side.extend(side_by_side::read_or_make(&experiment, number, config, &rows)?);
    }
    // In the config's order.
    let place = |row: &str, judge: &str| {
        request.config.rivals.iter().position(|of| of.row == row && of.judge.name() == judge)
    };
    results.rivals.sort_by_key(|rival| place(&rival.row, &rival.scores.judge));
    if let Some((name, config)) = closed_set {
        let row = experiment.row(&name, &config, false)?;
        if let Some(scores) = closed_set::read_or_make(&experiment, &row)? {
            results.network_ms.extend(scores.network_ms.map(|ms| (name.clone(), ms)));
            results.rivals.extend(scores.judges.into_iter().map(|scores| RivalRecord {
                label: format!("closed set, {}", scores.judge.trim_start_matches("closed-")),
                row: name.clone(),
                scores,
            }));
        }
    }
    write::write(&results, &request.out, request.card.as_deref())?;
    Ok(results)
}

/// The lines of a row's judges in the table of rivals.
fn rivals(wanted: &[RivalConfig], row: &str, of_row: &RowScores) -> Vec<RivalRecord> {
    let record = |of: &RivalConfig| {
        let scores = of_row.judges.iter().find(|scores| scores.judge == of.judge.name())?.clone();
        Some(RivalRecord { label: of.label.clone(), row: row.to_owned(), scores })
    };
    wanted.iter().filter(|of| of.row == row).filter_map(record).collect()
}
