//! Runs an experiment: each row is trained where it is not, then scored, then all of it written down.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use fs_err as fs;
use serde::de::DeserializeOwned;
use thiserror::Error;

use super::closed_set;
use super::config::{ResultsConfig, ResultsConfigError};
use super::data;
use super::experiment::Experiment;
use super::page;
use super::record::{DataRecord, Results};
use super::text::{NoMarks, card, markdown};
use harmzone::config::ConfigError;
use harmzone::dataset::DatasetError;
use harmzone::episode::ManifestError;
use harmzone::eval::ScoreError;
use harmzone::files::{sha256_hex, write_atomic};
use harmzone::generate::GenerateError;
use harmzone::infer::ClosedSetError;
use harmzone::infer::{PredictError, SweepRunError};
use harmzone::label::LabelError;
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::model::checkpoint::CheckpointError;
use harmzone::progress::Progress;
use harmzone::report::page::ReportError;
use harmzone::report::sweeps::SweepReportError;
use harmzone::train::TrainError;

/// Names of the files in the experiment's folder.
const JSON_FILE: &str = "results.json";
const CSV_FILE: &str = "results.csv";
pub const TEXT_FILE: &str = "RESULTS.md";

/// What to run, and where.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    pub config: &'a ResultsConfig,
    /// The experiment's folder.
    pub out: PathBuf,
    /// Data sets to use in place of those made in `out`.
    pub data: Option<PathBuf>,
    pub ood: Option<PathBuf>,
    /// A finished run to be the headline, in place of training one.
    pub headline: Option<PathBuf>,
    /// The one row to train and score.
    pub only: Option<String>,
    /// A network's card to write the headline's figures into; the network lies beside it.
    pub card: Option<PathBuf>,
    /// This program, started to generate, and how many of it.
    pub program: PathBuf,
    pub jobs: usize,
    /// The command, as it was typed.
    pub command: String,
}

/// Why an experiment stopped.
#[derive(Debug, Error)]
pub enum ResultsError {
    #[error(transparent)]
    Config(#[from] ResultsConfigError),
    #[error(transparent)]
    Preset(#[from] ConfigError),
    #[error(transparent)]
    Generate(#[from] GenerateError),
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Label(#[from] LabelError),
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("row `{row}`: {source}")]
    Train { row: String, source: Box<TrainError> },
    #[error(
        "row `{row}` was trained with another config or on other data; delete this folder to train it anew, \
         or give another --out: {}", path.display()
    )]
    OtherRun { row: String, path: PathBuf },
    #[error("the headline's run is not finished, no {what}; `harmzone train DATA --out RUN` finishes it: {}", path.display())]
    Unfinished { what: &'static str, path: PathBuf },
    #[error("the headline's run was trained on other data; give its data by --data: {}", path.display())]
    OtherData { path: PathBuf },
    #[error("row `{row}`: {source}")]
    Checkpoint { row: String, source: CheckpointError },
    #[error("row `{row}`: {source}")]
    Predict { row: String, source: PredictError },
    #[error("row `{row}`: {source}")]
    Score { row: String, source: ScoreError },
    #[error("row `{row}`: {source}")]
    ClosedSet { row: String, source: ClosedSetError },
    #[error("row `{row}`, rivals: {source}")]
    Sweep { row: String, source: Box<SweepRunError> },
    #[error("row `{row}`, sweeps: {source}")]
    SweepReport { row: String, source: Box<SweepReportError> },
    #[error(transparent)]
    Report(#[from] ReportError),
    #[error(
        "the data set was made {} unfamiliar objects; --data needs one without and --ood one with: {}",
        if *is_ood { "with" } else { "without" }, path.display()
    )]
    OtherKind { is_ood: bool, path: PathBuf },
    #[error("not a file of `make results`: {message}: {}", path.display())]
    Broken { message: String, path: PathBuf },
    #[error("{source}: {}", path.display())]
    Marks { source: NoMarks, path: PathBuf },
    #[error(
        "the card's network is not the headline's; copy {CHECKPOINT} of the headline's run there first: {}",
        path.display()
    )]
    OtherNetwork { path: PathBuf },
}

/// Runs an experiment, or what is left of it; a row that is done is not done again, a training that was broken off
/// goes on.
///
/// # Errors
/// [`ResultsError`]; rows that were done stay.
pub fn run(request: &Request<'_>, device: &Device, progress: &dyn Progress) -> Result<Results, ResultsError> {
    let trainings = request.config.trainings()?;
    let closed_set = request.config.closed_set.iter().map(|row| row.name.clone());
    let names: Vec<String> = trainings.iter().map(|(name, _)| name.clone()).chain(closed_set).collect();
    if let Some(only) = request.only.as_ref().filter(|only| !names.contains(only)) {
        let valid = names;
        return Err(ResultsConfigError::Only { found: only.clone(), valid }.into());
    }
    let scores = request.out.join("scores");
    fs::create_dir_all(&scores)?;
    let (id_path, id) = data::prepare(request, false, progress)?;
    let (ood_path, ood) = data::prepare(request, true, progress)?;
    let fingerprints = [id.fingerprint.clone(), ood.fingerprint.clone()];
    let mut experiment = Experiment::new(request, fingerprints, [&id_path, &ood_path], device, progress);
    let mut results = Results {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        data: DataRecord { preset: request.config.preset.clone(), id, ood },
        common: request.config.common.clone(),
        headline: None,
        rows: Vec::new(),
        tables: request.config.tables.clone(),
        rivals: Vec::new(),
    };
    for (i, (name, config)) in trainings.iter().enumerate() {
        let row = experiment.row(name, config, i == 0)?;
        let is_wanted = request.only.as_ref().is_none_or(|only| only == name);
        let record = match row.kept(&experiment)? {
            None if is_wanted => Some(experiment.make(&row)?),
            kept => kept,
        };
        if i == 0 {
            if let Some(record) = record.as_ref().filter(|_| is_wanted) {
                page::score(&mut experiment, &row, record)?;
            }
            results.headline = record;
        } else {
            results.rows.extend(record);
        }
        // What is done is told even if a later row fails.
        write(&results, &request.out, None)?;
    }
    results.rivals = experiment.rivals(&trainings, &results)?;
    if let Some((name, config)) = request.config.closed_set_training()? {
        let is_wanted = request.only.as_ref().is_none_or(|only| *only == name);
        write(&results, &request.out, None)?;
        let row = experiment.row(&name, &config, false)?;
        results.rivals.extend(closed_set::rivals(&mut experiment, &row, is_wanted)?);
    }
    write(&results, &request.out, request.card.as_deref())?;
    Ok(results)
}

/// Writes everything again from `results.json`, the page also from the scores kept for it.
///
/// # Errors
/// There is no such file in the folder, or it is of something else.
pub fn rewrite(out: &Path, card: Option<&Path>) -> Result<Results, ResultsError> {
    let results = read(&out.join(JSON_FILE))?;
    write(&results, out, card)?;
    Ok(results)
}

fn write(results: &Results, out: &Path, card_path: Option<&Path>) -> Result<(), ResultsError> {
    write_atomic(&out.join(JSON_FILE), results.to_json().as_bytes())?;
    write_atomic(&out.join(CSV_FILE), results.to_csv().as_bytes())?;
    write_atomic(&out.join(TEXT_FILE), markdown(results).as_bytes())?;
    page::write(results, out)?;
    let (Some(path), Some(headline)) = (card_path, &results.headline) else { return Ok(()) };
    let network = path.with_extension("safetensors");
    if sha256_hex(&fs::read(&network)?) != headline.checkpoint_sha256 {
        return Err(ResultsError::OtherNetwork { path: network });
    }
    let text = card(&fs::read_to_string(path)?, results, headline)
        .map_err(|source| ResultsError::Marks { source, path: path.to_owned() })?;
    Ok(write_atomic(path, text.as_bytes())?)
}

/// Reads a file of an experiment.
///
/// # Errors
/// It is not there, or of something else.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, ResultsError> {
    serde_json::from_str(&fs::read_to_string(path)?)
        .map_err(|error| ResultsError::Broken { message: error.to_string(), path: path.to_owned() })
}
