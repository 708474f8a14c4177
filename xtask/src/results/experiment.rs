//! What the rows of an experiment share, and the work on one row: its training, its scores, its record.

use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::tensor::Device;
use fs_err as fs;

use super::config::RivalConfig;
use super::data::LABELS;
use super::record::{Record, Results, RivalRecord};
use super::rivals;
use super::run::{Request, ResultsError, read};
use harmzone::config::differences;
use harmzone::dataset::{Dataset, DatasetError, Fingerprint};
use harmzone::episode::Split;
use harmzone::eval::eval_samples;
use harmzone::eval::{Metrics, Mode, Protocol, score};
use harmzone::files::{sha256_hex, write_atomic};
use harmzone::infer::predict;
use harmzone::model::checkpoint;
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::model::{Detector, ModelConfig};
use harmzone::object::Detection;
use harmzone::progress::Progress;
use harmzone::report::curves;
use harmzone::train::{self, CONFIG_FILE, DATA_FILE, TrainConfig, TrainError, TrainingTime};

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

impl<'a> Experiment<'a> {
    /// An experiment on two data sets, ID and OOD.
    pub fn new(
        request: &'a Request<'a>,
        [id, ood]: [Fingerprint; 2],
        [id_path, ood_path]: [&'a Path; 2],
        device: &'a Device,
        progress: &'a dyn Progress,
    ) -> Self {
        Self {
            request,
            id,
            ood,
            train: Lazy::new(id_path, Split::Train),
            val: Lazy::new(id_path, Split::Val),
            test: Lazy::new(ood_path, Split::Test),
            device,
            progress,
        }
    }
}

/// A row to train and score.
pub struct Row {
    pub name: String,
    config: TrainConfig,
    /// Its run's folder.
    pub folder: PathBuf,
    /// Whether the run was given, finished.
    is_given: bool,
    /// Its record.
    file: PathBuf,
}

impl Row {
    /// Whether its run was trained with its config on the data.
    ///
    /// # Errors
    /// What the run tells of itself cannot be read.
    pub fn is_trained_so(&self, data: &Fingerprint) -> Result<bool, ResultsError> {
        let is_of_data = read::<Fingerprint>(&self.folder.join(DATA_FILE))? == *data;
        Ok(is_of_data && read_training(&self.folder)? == self.config)
    }

    /// The row's record, if it is still that of its run and of the data.
    ///
    /// # Errors
    /// The record or the run cannot be read.
    pub fn kept(&self, experiment: &Experiment<'_>) -> Result<Option<Record>, ResultsError> {
        let checkpoint = self.folder.join(CHECKPOINT);
        if !self.file.is_file() || !checkpoint.is_file() {
            return Ok(None);
        }
        let record: Record = read(&self.file)?;
        let is_same = self.is_trained_so(&experiment.id)?
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
    ///
    /// # Errors
    /// A row's network cannot be read or judged.
    pub fn rivals(
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
            let is_it = |of: &RivalConfig| of.row == rival.row && of.judge.name() == rival.scores.judge;
            self.request.config.rivals.iter().position(is_it)
        };
        told.sort_by_key(place);
        Ok(told)
    }

    /// The split that is trained on.
    ///
    /// # Errors
    /// It cannot be loaded.
    pub fn training_split(&mut self) -> Result<&Dataset, DatasetError> {
        self.train.get()
    }

    /// A row's place in the experiment's folder; the headline's may be a given run.
    ///
    /// # Errors
    /// The given run is not finished, or was trained on other data.
    pub fn row(&self, name: &str, config: &TrainConfig, is_headline: bool) -> Result<Row, ResultsError> {
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
    ///
    /// # Errors
    /// It cannot be trained or scored.
    pub fn make(&mut self, row: &Row) -> Result<Record, ResultsError> {
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
            spent: TrainingTime::read(&row.folder),
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

    /// Trains a row, or what is left of its training.
    ///
    /// # Errors
    /// The training fails, or the folder holds another one.
    pub fn train(&mut self, row: &Row) -> Result<(), ResultsError> {
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

    /// What a detector finds in the validation split in distribution, else in the OOD set.
    ///
    /// # Errors
    /// The set cannot be loaded, or a sample is broken.
    pub fn found(
        &mut self,
        row: &Row,
        detector: &Detector,
        mode: Mode,
    ) -> Result<(&Dataset, Vec<Vec<Detection>>), ResultsError> {
        let (device, progress) = (self.device, self.progress);
        let data = match mode {
            Mode::Id => self.val.get()?,
            Mode::Ood => self.test.get()?,
        };
        let measured: Vec<_> =
            data.samples().iter().map(|sample| (sample.id.as_str(), &sample.measured)).collect();
        progress.start(&format!("{} {}", row.name, kind(mode)), measured.len() as u64);
        let with_camera = detector.config().use_camera;
        let found = predict(detector, &measured, with_camera, device, progress)
            .map_err(|source| ResultsError::Predict { row: row.name.clone(), source })?;
        progress.finish();
        Ok((data, found))
    }

    /// Scores a detector; all figures are kept.
    fn score(&mut self, row: &Row, detector: &Detector, mode: Mode) -> Result<Metrics, ResultsError> {
        let (data, found) = self.found(row, detector, mode)?;
        let metrics = score(&eval_samples(data, &found), &Protocol::default(), mode)
            .map_err(|source| ResultsError::Score { row: row.name.clone(), source })?;
        let path = row.file.with_file_name(format!("{}-{}.json", row.name, kind(mode)));
        write_atomic(&path, metrics.to_json().as_bytes())?;
        Ok(metrics)
    }
}

fn kind(mode: Mode) -> &'static str {
    match mode {
        Mode::Id => "id",
        Mode::Ood => "ood",
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
