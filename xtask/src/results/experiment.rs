//! What the rows of an experiment share: the data, and the training of one row.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use burn::tensor::Device;
use fs_err as fs;
use serde::de::DeserializeOwned;

use super::config::{GivenConfig, repeat_name};
use super::data::LABELS;
use super::request::Request;
use harmzone::config::{Checked, differences};
use harmzone::dataset::{Dataset, Fingerprint, SampleSource};
use harmzone::episode::Split;
use harmzone::eval::Mode;
use harmzone::model::checkpoint::{self, CHECKPOINT};
use harmzone::progress::Progress;
use harmzone::report::curves;
use harmzone::train::{self, CONFIG_FILE, DATA_FILE, TrainConfig, TrainError, TrainingData};

/// A split that is loaded when it is first needed.
struct Lazy<'a> {
    path: &'a Path,
    split: Split,
    loaded: OnceCell<Dataset>,
}

impl<'a> Lazy<'a> {
    fn new(path: &'a Path, split: Split) -> Self {
        Self { path, split, loaded: OnceCell::new() }
    }

    fn get(&self) -> anyhow::Result<&Dataset> {
        if self.loaded.get().is_none() {
            let dataset = Dataset::open(self.path, LABELS, self.split)?;
            return Ok(self.loaded.get_or_init(|| dataset));
        }
        Ok(self.loaded.get().expect("it was loaded before"))
    }
}

/// What all rows share.
pub struct Experiment<'a> {
    pub request: &'a Request<'a>,
    pub id: Fingerprint,
    pub ood: Fingerprint,
    train: Lazy<'a>,
    val: Lazy<'a>,
    test: Lazy<'a>,
    pub device: &'a Device,
    pub progress: &'a dyn Progress,
}

/// A row to train and score.
pub struct Row {
    pub name: String,
    /// Name of the row that it trains once more, from another seed.
    pub repeats: Option<String>,
    pub config: TrainConfig,
    /// Its run's folder.
    pub folder: PathBuf,
    pub is_headline: bool,
    /// Whether the run was given, finished.
    is_given: bool,
    /// What a run that was given was trained on, where that is other data than the experiment's.
    pub learned_from: Option<Fingerprint>,
}

impl Row {
    /// As the training of another row from another seed.
    pub fn repeating(self, row: &str) -> Self {
        Self { repeats: Some(row.to_owned()), ..self }
    }
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
            test: Lazy::new(ood_path, Split::Dev),
            device,
            progress,
        }
    }

    /// The split that is trained on.
    pub fn training_split(&self) -> anyhow::Result<&Dataset> {
        self.train.get()
    }

    /// What is scored: the validation split in distribution, else the OOD set.
    pub fn scored_split(&self, mode: Mode) -> anyhow::Result<&Dataset> {
        match mode {
            Mode::Id => self.val.get(),
            Mode::Ood => self.test.get(),
        }
    }

    /// A row's place in the experiment's folder; the headline's may be a given run.
    ///
    /// # Errors
    /// As [`Self::given`].
    pub fn row(&self, name: &str, config: &TrainConfig, is_headline: bool) -> anyhow::Result<Row> {
        if let Some(run) = self.request.headline.as_ref().filter(|_| is_headline) {
            return Ok(Row { is_headline, ..self.given(name, run)? });
        }
        Ok(Row {
            name: name.to_owned(),
            repeats: None,
            config: config.clone(),
            folder: self.request.out.join("runs").join(name),
            is_headline,
            is_given: false,
            learned_from: None,
        })
    }

    /// Finished runs, the first as a row, the others as its repeats.
    ///
    /// # Errors
    /// As [`Self::repeats`], of the first run, too.
    pub fn given_rows(&self, of: &GivenConfig) -> anyhow::Result<Vec<Row>> {
        let (first, again) = of.runs.split_first().expect("the config was checked");
        let row = self.given(&of.name, first)?;
        let again = self.repeats(&row, again)?;
        Ok(std::iter::once(row).chain(again).collect())
    }

    /// Finished runs of a row's training from other seeds.
    ///
    /// # Errors
    /// A run is not finished, or differs from the row in more than its seed or not even in that.
    pub fn repeats(&self, of: &Row, runs: &[PathBuf]) -> anyhow::Result<Vec<Row>> {
        let mut repeats: Vec<Row> = Vec::new();
        for run in runs {
            let row = self.given("", run)?;
            let expected = TrainConfig { seed: row.config.seed, ..of.config.clone() };
            ensure!(
                row.config == expected,
                "this run is not the training of `{}` from another seed, it has {} where `{0}` has {}: {}",
                of.name,
                differences(&expected, &row.config).join(", "),
                differences(&row.config, &expected).join(", "),
                run.display()
            );
            ensure!(
                row.learned_from == of.learned_from,
                "this run is not the training of `{}` from another seed, it learned from other data: {}",
                of.name,
                run.display()
            );
            let seed = row.config.seed;
            let is_taken = seed == of.config.seed || repeats.iter().any(|other| other.config.seed == seed);
            ensure!(
                !is_taken,
                "two runs of `{}` are from seed {seed}; one is enough: {}",
                of.name,
                run.display()
            );
            let name = repeat_name(&of.name, seed);
            repeats.push(Row { name, ..row.repeating(&of.name) });
        }
        Ok(repeats)
    }

    /// A run that is given as a row, which must be finished.
    fn given(&self, name: &str, run: &Path) -> anyhow::Result<Row> {
        for what in [CHECKPOINT, CONFIG_FILE, DATA_FILE] {
            ensure!(
                run.join(what).is_file(),
                "this run is not finished, it has no {what}; `harmzone train DATA --out RUN` finishes it: {}",
                run.display()
            );
        }
        let data: Fingerprint = read_json(&run.join(DATA_FILE))?;
        Ok(Row {
            name: name.to_owned(),
            repeats: None,
            config: read_training(run)?,
            folder: run.to_owned(),
            is_headline: false,
            is_given: true,
            learned_from: (data != self.id).then_some(data),
        })
    }

    /// Whether a row's run is finished, and was trained with the row's config on the experiment's data, or on its own.
    pub fn is_trained(&self, row: &Row) -> anyhow::Result<bool> {
        Ok(row.folder.join(CHECKPOINT).is_file()
            && read_json::<Fingerprint>(&row.folder.join(DATA_FILE))?
                == *row.learned_from.as_ref().unwrap_or(&self.id)
            && read_training(&row.folder)? == row.config)
    }

    /// Trains a row, or what is left of its training; a run that was given stays as it is.
    pub fn train(&self, row: &Row) -> anyhow::Result<()> {
        if row.is_given {
            return Ok(());
        }
        let draw = |run: &Path| {
            // A picture that fails is no reason to stop a training.
            if let Err(error) = curves::run(run) {
                tracing::warn!("{error}");
            }
        };
        let options = train::TrainOptions { after_validation: Some(&draw), ..train::TrainOptions::default() };
        let validation = if row.config.validate_every_epochs > 0 { Some(self.val.get()?) } else { None };
        let data = self.train.get()?;
        let config = Checked::try_from(row.config.clone())?;
        let data = TrainingData::new(data, validation.map(SampleSource::from));
        let devices = std::slice::from_ref(self.device);
        match train::run(data, &config, &row.folder, options, devices, self.progress) {
            Err(TrainError::OtherRun { path }) => bail!(
                "row `{}` was trained with another config or on other data; delete this folder to train it anew, \
                 or give another --out: {}",
                row.name,
                path.display()
            ),
            done => done.with_context(|| format!("row `{}`", row.name))?,
        };
        draw(&row.folder);
        Ok(())
    }
}

/// The config that a finished run was trained with; its network's as the checkpoint holds it, which knows what older ones lack.
fn read_training(run: &Path) -> anyhow::Result<TrainConfig> {
    let path = run.join(CONFIG_FILE);
    let mut config: TrainConfig = toml::from_str(&fs::read_to_string(&path)?)
        .with_context(|| format!("this is not the config of a training: {}", path.display()))?;
    config.model = checkpoint::read_config(&run.join(CHECKPOINT))?;
    Ok(config)
}

/// Reads a file of an experiment.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> anyhow::Result<T> {
    serde_json::from_str(&fs::read_to_string(path)?)
        .with_context(|| format!("this is not a file of `make results`; delete it: {}", path.display()))
}
