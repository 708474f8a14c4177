//! The experiment's page: the headline's network scored on both sets, with its faults and sweeps, and `report.html` of
//! these and the tables.

use std::path::{Path, PathBuf};

use burn::module::Module;

use super::data::LABELS;
use super::experiment::{Experiment, Row};
use super::record::{Record, Results};
use super::run::{ResultsError, TEXT_FILE};
use harmzone::config::to_toml;
use harmzone::dataset::Fingerprint;
use harmzone::eval::eval_samples;
use harmzone::eval::sweep::SweepConfig;
use harmzone::eval::{Mode, Protocol, evaluate, worst_faults};
use harmzone::infer::{self, SweepRunError};
use harmzone::model::checkpoint;
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::report::page::scores::{self, Scores, Source, quote};
use harmzone::report::page::{self, DEFAULT_CARDS, PAGE_FILE, ReportRequest, ScoresRequest};
use harmzone::report::sweeps::{self, SweepReportError, SweepRequest};
use harmzone::train::CONFIG_FILE;

/// Where the headline's scores of a kind are, in the experiment's folder.
fn folder(out: &Path, mode: Mode) -> PathBuf {
    out.join("report").join(match mode {
        Mode::Id => "id",
        Mode::Ood => "ood",
    })
}

/// Scores the headline with all that the page shows, where that was not done yet.
///
/// # Errors
/// The network cannot be read, run or scored.
pub fn score(experiment: &mut Experiment<'_>, row: &Row, record: &Record) -> Result<(), ResultsError> {
    for mode in [Mode::Id, Mode::Ood] {
        if !is_kept(&experiment.request.out, record, mode) {
            score_side(experiment, row, record, mode)?;
        }
    }
    Ok(())
}

/// Whether all scores of a kind are there, of this network and its data.
fn is_kept(out: &Path, record: &Record, mode: Mode) -> bool {
    // What cannot be read is made anew.
    let Ok(kept) = Scores::read(&folder(out, mode)) else { return false };
    let is_of_these = kept.source.is_some_and(|source| {
        source.checkpoint_sha256.as_ref() == Some(&record.checkpoint_sha256)
            && source.fingerprint.as_ref() == Some(data_of(record, mode))
    });
    is_of_these && kept.faults.is_some() && kept.sweeps.is_some()
}

fn data_of(record: &Record, mode: Mode) -> &Fingerprint {
    match mode {
        Mode::Id => &record.trained_on,
        Mode::Ood => &record.tested_on,
    }
}

fn score_side(
    experiment: &mut Experiment<'_>,
    row: &Row,
    record: &Record,
    mode: Mode,
) -> Result<(), ResultsError> {
    let (device, progress, request) = (experiment.device, experiment.progress, experiment.request);
    let folder = folder(&request.out, mode);
    let name = || row.name.clone();
    let detector = checkpoint::load(&row.folder.join(CHECKPOINT), device)
        .map_err(|source| ResultsError::Checkpoint { row: name(), source })?
        .valid();
    let (data, found) = experiment.found(row, &detector, mode)?;
    let samples = eval_samples(data, &found);
    let protocol = Protocol::default();
    let fail = |source| ResultsError::Score { row: name(), source };
    let evaluation = evaluate(&samples, &protocol, mode).map_err(fail)?;
    let faults = worst_faults(&samples, &protocol).map_err(fail)?;
    let sweep_fail =
        |source: SweepReportError| ResultsError::SweepReport { row: name(), source: Box::new(source) };
    let run_fail = |source: SweepRunError| ResultsError::Sweep { row: name(), source: Box::new(source) };
    let (swept, series) =
        infer::sweep(&detector, data, &SweepConfig::default(), device, progress).map_err(run_fail)?;
    let sweep = SweepRequest {
        swept: &swept,
        series: &series,
        dataset: data,
        config: &SweepConfig::default(),
        protocol: &protocol,
        out: &folder,
    };
    sweeps::run(&sweep).map_err(sweep_fail)?;
    let source = Source {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        command: request.command.clone(),
        data: Some(data.path().to_owned()),
        labels: Some(LABELS.to_owned()),
        fingerprint: Some(data_of(record, mode).clone()),
        checkpoint_sha256: Some(record.checkpoint_sha256.clone()),
        model_toml: Some(to_toml(detector.config())),
        train_toml: Some(fs_err::read_to_string(row.folder.join(CONFIG_FILE))?),
    };
    Ok(scores::write(&folder, &protocol, &evaluation, &faults, &source)?)
}

/// Writes the page from what is kept, where the headline is scored for it; its name, if it was written.
///
/// # Errors
/// A picture or chart cannot be drawn, or the file cannot be written.
pub fn write(results: &Results, out: &Path) -> Result<Option<PathBuf>, ResultsError> {
    let is_scored = |record: &Record| [Mode::Id, Mode::Ood].iter().all(|&mode| is_kept(out, record, mode));
    if !results.headline.as_ref().is_some_and(is_scored) {
        return Ok(None);
    }
    let scores = |mode| Some(ScoresRequest { folder: folder(out, mode), data: None });
    let (page, tables) = (out.join(PAGE_FILE), out.join(TEXT_FILE));
    let text = |path: &Path| path.display().to_string();
    let (id, ood) = (text(&folder(out, Mode::Id)), text(&folder(out, Mode::Ood)));
    let words = ["harmzone", "report", &text(&page), "--id", &id, "--ood", &ood, "--results", &text(&tables)]
        .map(str::to_owned);
    let request = ReportRequest {
        out: page,
        id: scores(Mode::Id),
        ood: scores(Mode::Ood),
        results: Some(tables),
        n_cards: DEFAULT_CARDS,
        command: quote(&words),
        force: true,
    };
    Ok(Some(page::run(&request)?.out))
}
