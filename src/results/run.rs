//! Runs an experiment: each row is trained where it is not, then scored, then all of it written down.

use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::tensor::Device;
use fs_err as fs;
use serde::de::DeserializeOwned;
use thiserror::Error;

use super::config::{ResultsConfig, ResultsConfigError, RivalConfig};
use super::data::{self, LABELS};
use super::record::{DataRecord, Record, Results, RivalRecord};
use super::rivals;
use super::text::{NoMarks, card, markdown};
use crate::config::{ConfigError, differences};
use crate::dataset::{Dataset, DatasetError, Fingerprint};
use crate::episode::{ManifestError, Split};
use crate::eval::predict::{PredictError, eval_samples, predict};
use crate::eval::sweep::SweepError;
use crate::eval::{Metrics, Mode, Protocol, ScoreError, score};
use crate::files::{sha256_hex, write_atomic};
use crate::generate::GenerateError;
use crate::label::LabelError;
use crate::model::checkpoint::{self, CheckpointError};
use crate::model::{Detector, ModelConfig};
use crate::progress::Progress;
use crate::report::curves;
use crate::train::{self, CHECKPOINT, CONFIG_FILE, DATA_FILE, Spent, TrainConfig, TrainError};

/// Names of the files in the experiment's folder.
const JSON_FILE: &str = "results.json";
const CSV_FILE: &str = "results.csv";
const TEXT_FILE: &str = "RESULTS.md";

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
    /// The `harmzone` program, started to generate, and how many of it.
    pub program: PathBuf,
    pub jobs: usize,
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
    #[error("row `{row}`, rivals: {source}")]
    Sweep { row: String, source: Box<SweepError> },
    #[error(
        "the data set was made {} unfamiliar objects; --data needs one without and --ood one with: {}",
        if *is_ood { "with" } else { "without" }, path.display()
    )]
    OtherKind { is_ood: bool, path: PathBuf },
    #[error("not a file of `harmzone results`: {message}: {}", path.display())]
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
    if let Some(only) = request.only.as_ref().filter(|only| !trainings.iter().any(|(name, _)| name == *only))
    {
        let valid = trainings.into_iter().map(|(name, _)| name).collect();
        return Err(ResultsConfigError::Only { found: only.clone(), valid }.into());
    }
    let scores = request.out.join("scores");
    fs::create_dir_all(&scores)?;
    let (id_path, id) = data::prepare(request, false, progress)?;
    let (ood_path, ood) = data::prepare(request, true, progress)?;
    let mut experiment = Experiment {
        request,
        id: id.fingerprint.clone(),
        ood: ood.fingerprint.clone(),
        train: Lazy::new(&id_path, Split::Train),
        val: Lazy::new(&id_path, Split::Val),
        test: Lazy::new(&ood_path, Split::Test),
        device,
        progress,
    };
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
            results.headline = record;
        } else {
            results.rows.extend(record);
        }
        // What is done is told even if a later row fails.
        write(&results, &request.out, None)?;
    }
    results.rivals = experiment.rivals(&trainings, &results)?;
    write(&results, &request.out, request.card.as_deref())?;
    Ok(results)
}

/// Writes everything again from `results.json`.
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

/// A split that is loaded when it is first needed.
pub struct Lazy<'a> {
    path: &'a Path,
    split: Split,
    loaded: Option<Dataset>,
}

impl<'a> Lazy<'a> {
    fn new(path: &'a Path, split: Split) -> Self {
        Self { path, split, loaded: None }
    }

    /// The split.
    ///
    /// # Errors
    /// It cannot be loaded.
    pub fn get(&mut self) -> Result<&Dataset, DatasetError> {
        if self.loaded.is_none() {
            self.loaded = Some(Dataset::open(self.path, LABELS, self.split)?);
        }
        Ok(self.loaded.as_ref().expect("it was loaded just now"))
    }
}

/// What all rows share.
pub struct Experiment<'a> {
    pub request: &'a Request<'a>,
    pub id: Fingerprint,
    pub ood: Fingerprint,
    train: Lazy<'a>,
    pub val: Lazy<'a>,
    pub test: Lazy<'a>,
    pub device: &'a Device,
    pub progress: &'a dyn Progress,
}

/// A row to train and score.
struct Row {
    name: String,
    config: TrainConfig,
    /// Its run's folder.
    folder: PathBuf,
    /// Whether the run was given, finished.
    is_given: bool,
    /// Its record.
    file: PathBuf,
}

impl Row {
    /// The row's record, if it is still that of its run and of the data.
    fn kept(&self, experiment: &Experiment<'_>) -> Result<Option<Record>, ResultsError> {
        let checkpoint = self.folder.join(CHECKPOINT);
        if !self.file.is_file() || !checkpoint.is_file() {
            return Ok(None);
        }
        let record: Record = read(&self.file)?;
        let is_same = read_training(&self.folder)? == self.config
            && record.checkpoint_sha256 == sha256_hex(&fs::read(checkpoint)?)
            && (&record.trained_on, &record.tested_on) == (&experiment.id, &experiment.ood);
        Ok(is_same.then_some(record))
    }
}

/// The config that a run was trained with.
fn read_training(run: &Path) -> Result<TrainConfig, ResultsError> {
    let path = run.join(CONFIG_FILE);
    toml::from_str(&fs::read_to_string(&path)?)
        .map_err(|error| ResultsError::Broken { message: error.to_string(), path })
}

impl Experiment<'_> {
    /// The table of rivals, of the rows that are done.
    fn rivals(
        &mut self,
        trainings: &[(String, TrainConfig)],
        results: &Results,
    ) -> Result<Vec<RivalRecord>, ResultsError> {
        let mut told = Vec::new();
        for (i, (name, config)) in trainings.iter().enumerate() {
            let row = self.row(name, config, i == 0)?;
            if let Some(record) = results.row(name) {
                told.extend(rivals::of_row(self, record, &row.folder)?);
            }
        }
        // In the config's order.
        let place = |rival: &RivalRecord| {
            let is_it = |of: &RivalConfig| (&of.row, of.judge) == (&rival.row, rival.scores.judge);
            self.request.config.rivals.iter().position(is_it)
        };
        told.sort_by_key(place);
        Ok(told)
    }

    fn row(&self, name: &str, config: &TrainConfig, is_headline: bool) -> Result<Row, ResultsError> {
        let given = self.request.headline.as_ref().filter(|_| is_headline);
        let row = |config, folder| Row {
            name: name.to_owned(),
            config,
            folder,
            is_given: given.is_some(),
            file: self.request.out.join("scores").join(format!("{name}.json")),
        };
        let Some(folder) = given else {
            return Ok(row(config.clone(), self.request.out.join("runs").join(name)));
        };
        for what in [CHECKPOINT, CONFIG_FILE, DATA_FILE] {
            if !folder.join(what).is_file() {
                return Err(ResultsError::Unfinished { what, path: folder.clone() });
            }
        }
        if read::<Fingerprint>(&folder.join(DATA_FILE))? != self.id {
            return Err(ResultsError::OtherData { path: folder.clone() });
        }
        Ok(row(read_training(folder)?, folder.clone()))
    }

    /// Trains a row where it is not trained, scores it, and keeps its record.
    fn make(&mut self, row: &Row) -> Result<Record, ResultsError> {
        if !row.is_given {
            self.train(row)?;
        }
        let path = row.folder.join(CHECKPOINT);
        let name = || row.name.clone();
        let detector = checkpoint::load(&path, self.device)
            .map_err(|source| ResultsError::Checkpoint { row: name(), source })?
            .valid();
        let id = self.score(row, &detector, Mode::Id)?;
        let ood = self.score(row, &detector, Mode::Ood)?;
        let bytes = fs::read(&path)?;
        let (profile, set) = as_flags(&row.config);
        let record = Record {
            name: name(),
            profile: profile.to_owned(),
            set,
            seed: row.config.seed,
            epochs: [row.config.lidar_stage.epochs, row.config.fused_stage.epochs],
            n_parameters: n_parameters(detector.config()),
            spent: Spent::read(&row.folder),
            checkpoint_sha256: sha256_hex(&bytes),
            checkpoint_bytes: bytes.len(),
            trained_on: self.id.clone(),
            tested_on: self.ood.clone(),
            id: id.columns.total,
            ood: ood.columns,
        };
        let text = serde_json::to_string_pretty(&record).expect("names and numbers have a JSON form");
        write_atomic(&row.file, text.as_bytes())?;
        Ok(record)
    }

    fn train(&mut self, row: &Row) -> Result<(), ResultsError> {
        let draw = |run: &Path| {
            // A picture that fails is no reason to stop a training.
            if let Err(error) = curves::run(run) {
                tracing::warn!("{error}");
            }
        };
        let options = train::RunOptions { after_validation: Some(&draw), ..train::RunOptions::default() };
        let validation = if row.config.validate_every_epochs > 0 { Some(self.val.get()?) } else { None };
        let data = self.train.get()?;
        train::run(data, validation, &row.config, &row.folder, options, self.device, self.progress).map_err(
            |source| match source {
                TrainError::OtherRun { path } => ResultsError::OtherRun { row: row.name.clone(), path },
                source => ResultsError::Train { row: row.name.clone(), source: Box::new(source) },
            },
        )?;
        draw(&row.folder);
        Ok(())
    }

    /// Scores a detector, in distribution on the validation split, else on the OOD set; all figures are kept.
    fn score(&mut self, row: &Row, detector: &Detector, mode: Mode) -> Result<Metrics, ResultsError> {
        let (data, kind) = match mode {
            Mode::Id => (self.val.get()?, "id"),
            Mode::Ood => (self.test.get()?, "ood"),
        };
        let measured: Vec<_> =
            data.samples().iter().map(|sample| (sample.id.as_str(), &sample.measured)).collect();
        self.progress.start(&format!("{} {kind}", row.name), measured.len() as u64);
        let with_camera = detector.config().use_camera;
        let found = predict(detector, &measured, with_camera, self.device, self.progress)
            .map_err(|source| ResultsError::Predict { row: row.name.clone(), source })?;
        self.progress.finish();
        let metrics = score(&eval_samples(data, &found), &Protocol::default(), mode)
            .map_err(|source| ResultsError::Score { row: row.name.clone(), source })?;
        let path = row.file.with_file_name(format!("{}-{kind}.json", row.name));
        write_atomic(&path, metrics.to_json().as_bytes())?;
        Ok(metrics)
    }
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
