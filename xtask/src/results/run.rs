//! Runs an experiment: each row is trained where it is not, then scored, then all of it written down.

use burn::tensor::Device;
use fs_err as fs;

use super::config::RivalConfig;
use super::experiment::{Experiment, Row};
use super::found::Found;
use super::request::Request;
use super::score::RowScores;
use super::side_by_side::Asked;
use super::split_test::SplitTest;
use super::{closed_set, data, reported, score, write};
use harmzone::model::Classes;
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::progress::Progress;
use harmzone::report::results::{
    DataRecord, JudgeScores, Record, Repeat, ReportedRecord, Results, RivalRecord, SeedMeans,
};
use harmzone::train::{DATA_FILE, TrainConfig};

/// Runs an experiment, or what is left of it; a row that is done is not done again, a training that was broken off
/// goes on.
///
/// # Errors
/// The config does not fit, or a row cannot be trained or scored; rows that are done stay.
pub fn run(request: &Request<'_>, device: &Device, progress: &dyn Progress) -> anyhow::Result<Results> {
    let trainings = request.config.trainings()?;
    let (repeats, closed_set) = (request.config.repeats()?, request.config.closed_set_training()?);
    if let Some(only) = &request.only {
        let again = repeats.iter().map(|(_, training)| training);
        let names = trainings.iter().chain(&closed_set).chain(again).map(|(name, _)| name.as_str());
        let names: Vec<&str> = names.collect();
        anyhow::ensure!(names.contains(&only.as_str()), "no row `{only}`; there are: {}", names.join(", "));
    }
    if request.reported.is_some() {
        check_given(request)?;
    }
    fs::create_dir_all(request.out.join("scores"))?;
    let (id_path, id) = data::prepare(request, false, progress)?;
    let (ood_path, ood) = data::prepare(request, true, progress)?;
    let fingerprints = [id.fingerprint.clone(), ood.fingerprint.clone()];
    let experiment = Experiment::new(request, fingerprints, [&id_path, &ood_path], device, progress);
    let mut results = Results {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        made_by: request.config.made_by.clone(),
        data: DataRecord { preset: request.config.preset.clone(), id, ood },
        reported: None,
        reported_repeats: Vec::new(),
        seed_means: None,
        common: request.config.common.clone(),
        headline: None,
        rows: Vec::new(),
        repeats: Vec::new(),
        tables: request.config.tables.clone(),
        side_by_side: Vec::new(),
        rivals: Vec::new(),
        network_ms: [].into(),
    };
    let rows = trainings.iter().enumerate().map(|(i, (name, config))| experiment.row(name, config, i == 0));
    let mut rows: Vec<Row> = rows.collect::<anyhow::Result<_>>()?;
    rows.extend(experiment.repeats(&rows[0], &request.headline_repeats)?);
    for (of, (name, config)) in &repeats {
        rows.push(experiment.row(name, config, false)?.repeating(of));
    }
    if let Some((name, config)) = &closed_set {
        rows.push(experiment.row(name, config, false)?);
    }
    // What is given stands side by side with others alone, and is scored there.
    let n_scored = rows.len();
    for of in &request.config.given {
        if let Some(absent) = of.runs.iter().find(|run| !run.join(CHECKPOINT).is_file()) {
            tracing::warn!(
                "this run is not there or not finished, and what is to stand beside `{}` is left out: {}",
                of.name,
                absent.display()
            );
            continue;
        }
        rows.extend(experiment.given_rows(of)?);
    }
    let known: Vec<(&str, &TrainConfig)> = rows.iter().map(|row| (row.name.as_str(), &row.config)).collect();
    request.config.check_side_by_side(&known)?;
    let found = Found::default();
    let test = SplitTest::new(&experiment, &found);
    for (number, config) in request.config.side_by_side.iter().enumerate() {
        let asked =
            Asked { experiment: &experiment, number, config, rows: &rows, found: &found, test: &test };
        results.side_by_side.extend(asked.read()?);
    }
    for row in &rows[..n_scored] {
        let is_closed_set = row.config.model.head.classes == Classes::Kind;
        let scores = if is_closed_set && row.repeats.is_some() {
            // It stands side by side with others alone.
            if request.wants(&row.name) && !experiment.is_trained(row)? {
                experiment.train(row)?;
            }
            None
        } else if is_closed_set {
            closed_set::read_or_make(&experiment, row)?
        } else {
            score::read_or_make(&experiment, row)?
        };
        if let Some(scores) = scores {
            results.network_ms.extend(scores.network_ms.map(|ms| (row.name.clone(), ms)));
            if is_closed_set {
                results.rivals.extend(closed_set_lines(row, scores));
            } else {
                results.rivals.extend(rivals(&request.config.rivals, &row.name, &scores));
                add_record(&experiment, &test, row, scores.record, &mut results)?;
            }
        }
        // What is done is told even if a later row fails.
        write::write(&results, &request.out, None)?;
    }
    results.seed_means = seed_means(&experiment, &test, &found, &rows, &results)?;
    results.side_by_side.clear();
    for (number, config) in request.config.side_by_side.iter().enumerate() {
        let asked =
            Asked { experiment: &experiment, number, config, rows: &rows, found: &found, test: &test };
        results.side_by_side.extend(asked.read_or_make()?);
    }
    // In the config's order; the closed set's are last.
    let place = |row: &str, judge: &str| {
        let rivals = &request.config.rivals;
        rivals.iter().position(|of| of.row == row && of.judge.name() == judge).unwrap_or(rivals.len())
    };
    results.rivals.sort_by_key(|rival| place(&rival.row, &rival.scores.judge));
    write::write(&results, &request.out, request.card.as_deref())?;
    Ok(results)
}

/// Split test reports once: what stands there without its rivals is not made good later.
fn check_given(request: &Request<'_>) -> anyhow::Result<()> {
    for of in &request.config.given {
        let absent = of.runs.iter().find(|run| !run.join(CHECKPOINT).is_file());
        if let Some(absent) = absent {
            anyhow::bail!(
                "cannot report on split test (--final): `{}` is to stand beside the others, and this run is not there or not finished: \
                 {}; train it first (`make network-rivals`), or take its [[given]] and rows out of the config",
                of.name,
                absent.display()
            );
        }
    }
    // Equal training is training on the same drives.
    let Some(headline) = &request.headline else { return Ok(()) };
    let data = fs::read_to_string(headline.join(DATA_FILE))?;
    for run in request.config.given.iter().flat_map(|of| &of.runs).chain(&request.headline_repeats) {
        let path = run.join(DATA_FILE);
        let found = fs::read_to_string(&path)?;
        anyhow::ensure!(
            found == data,
            "cannot report on split test (--final): what stands beside the headline was trained on other data; found {found} and, in \
             {}, {data}: {}",
            headline.join(DATA_FILE).display(),
            path.display()
        );
    }
    Ok(())
}

/// Puts a row's figures into their place; the headline's on split test, too, and its repeats', where they are asked for.
fn add_record(
    experiment: &Experiment<'_>,
    test: &SplitTest<'_>,
    row: &Row,
    record: Option<Record>,
    results: &mut Results,
) -> anyhow::Result<()> {
    let Some(record) = record else { return Ok(()) };
    let headline = &experiment.request.config.headline.name;
    if row.is_headline || row.repeats.as_ref() == Some(headline) {
        let reported = reported::read_or_make(experiment, test, row, &record)?;
        if row.is_headline {
            results.reported = reported;
        } else {
            results.reported_repeats.extend(reported);
        }
    }
    match &row.repeats {
        _ if row.is_headline => results.headline = Some(record),
        Some(of) => results.repeats.push(Repeat { row: of.clone(), record }),
        None => results.rows.push(record),
    }
    Ok(())
}

/// The means of the headline and of its repeats that are scored on split test.
fn seed_means(
    experiment: &Experiment<'_>,
    test: &SplitTest<'_>,
    found: &Found,
    rows: &[Row],
    results: &Results,
) -> anyhow::Result<Option<SeedMeans>> {
    let headline = &experiment.request.config.headline.name;
    let runs = rows.iter().filter(|row| row.is_headline || row.repeats.as_ref() == Some(headline));
    let runs: Vec<&Row> = runs.collect();
    let records: Vec<ReportedRecord> =
        results.reported.iter().chain(&results.reported_repeats).cloned().collect();
    if records.len() < runs.len() {
        return Ok(None);
    }
    reported::read_or_make_means(experiment, test, found, &runs, &records)
}

/// The lines of a closed set in the table of rivals.
fn closed_set_lines(row: &Row, scores: RowScores) -> Vec<RivalRecord> {
    let line = |scores: JudgeScores| {
        let label = closed_set::label(&scores.judge);
        RivalRecord { label, row: row.name.clone(), scores }
    };
    scores.judges.into_iter().map(line).collect()
}

/// The lines of a row's judges in the table of rivals.
fn rivals(wanted: &[RivalConfig], row: &str, of_row: &RowScores) -> Vec<RivalRecord> {
    let record = |of: &RivalConfig| {
        let scores = of_row.judges.iter().find(|scores| scores.judge == of.judge.name())?.clone();
        Some(RivalRecord { label: of.label.clone(), row: row.to_owned(), scores })
    };
    wanted.iter().filter(|of| of.row == row).filter_map(record).collect()
}
