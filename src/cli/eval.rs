//! `harmzone eval`: scores a trained run, or any detector's JSON against a truth JSON.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{ArgGroup, Args};
use fs_err as fs;

use super::engine::EngineArgs;
use super::train::tell_other_zone;
use super::{Bar, DeviceArg, ExitStatus, print, sensor, split, tell};
use crate::dataset::blind::Sensor;
use crate::dataset::{
    Dataset, DatasetError, Fingerprint, LabelledSample, LabelledSplit, LearnedError, named,
};
use crate::episode::{EpisodeEntry, Manifest, Split};
use crate::eval::{self, EvalSample, Mode, Protocol, eval_samples, json};
use crate::files::{self, FolderLock};
use crate::infer::worker::NetworkWorkers;
use crate::infer::{self, PredictError, Trained};
use crate::object::Detection;
use crate::progress::Progress;
use crate::report::provenance::{Provenance, quote};
use crate::report::score_tables;
use crate::report::scores::{self, METRICS_FILE};
use crate::report::standing::Standing;
use crate::store::{self, Access, Location, OpenedLocation};
use crate::worker::Program;
use crate::{config, interrupt, train};

#[derive(Debug, Args)]
#[command(group = ArgGroup::new("detector").args(["run", "predictions"]).required(true))]
#[command(group = ArgGroup::new("against").args(["data", "truth"]).required(true))]
pub struct EvalArgs {
    /// Folder or URL of a trained detector, a checkpoint, or `small`, the network inside the program; needs --data
    #[arg(requires = "data")]
    run: Option<Location>,
    /// Folder or URL of a labelled data set: what a run sees, and the truth
    #[arg(long, value_name = "DIR")]
    data: Option<Location>,
    /// Label set of the data set
    #[arg(long, value_name = "SET", default_value = "rect", requires = "data")]
    labels: String,
    /// Split; without it, the first of val, dev and test that the data set has
    #[arg(long, requires = "data", value_parser = split())]
    split: Option<Split>,
    #[command(flatten)]
    device: DeviceArg,
    #[command(flatten)]
    engine: EngineArgs,
    /// Also attribute false positives and score the ID and OOD columns of Table III
    #[arg(long)]
    ood: bool,
    /// Score also on episodes that the network learned from, which is refused otherwise
    #[arg(long, requires = "run")]
    on_training_data: bool,
    /// Score the network with black pictures, or with empty clouds
    #[arg(long, requires = "run", value_name = "SENSOR", value_parser = sensor())]
    blind: Option<Sensor>,
    /// Any detector's boxes, nuScenes-style JSON in the ego frame; needs --truth or --data
    #[arg(long, value_name = "JSON", conflicts_with = "run")]
    predictions: Option<PathBuf>,
    /// The true boxes, in the same form
    #[arg(long, value_name = "JSON", requires = "predictions")]
    truth: Option<PathBuf>,
    /// Also print scores by group and the safety metrics; metrics.json always has both
    #[arg(long, conflicts_with = "json")]
    breakdown: bool,
    /// Folder or URL for metrics.json, table.txt, breakdown.txt, the resolved eval.toml, and what `harmzone report` shows:
    /// faults.json, source.json
    #[arg(long, value_name = "DIR")]
    out: Option<Location>,
    /// Print metrics.json instead of the table
    #[arg(long)]
    json: bool,
    /// Thresholds and filters (TOML)
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key of the config, e.g. max_range_m=30
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Overwrite the metrics of an existing output folder
    #[arg(long)]
    force: bool,
}

pub fn run(args: EvalArgs) -> anyhow::Result<ExitStatus> {
    let opened = Opened::of(&args)?;
    let trained = opened.trained()?;
    let base = trained.map(|trained| trained.eval_config()).transpose()?.unwrap_or_default();
    let config = config::load_over(&base, args.config.as_deref(), &args.overrides)?;
    let protocol = Protocol::try_from(config)?;
    let _lock = opened.out.as_ref().map(|out| FolderLock::take(out.path())).transpose()?;
    if let Some(out) = opened.out.as_ref().filter(|_| !args.force) {
        refuse_to_overwrite(out.path())?;
    }
    let mode = if args.ood { Mode::Ood } else { Mode::Id };
    let scored = opened.data.as_ref().map(|data| ScoredData::find(data.path(), &args)).transpose()?;
    if args.run.is_none() && args.engine.cluster()?.is_some() {
        bail!("--engine ray runs a network on the cluster: give a RUN in place of --predictions");
    }
    let samples = samples(&args, &opened, scored.as_ref())?;
    let chosen = opened.trained()?.map(|trained| trained.operating_score()).transpose()?.flatten();
    let other_period = chosen.zip(eval::mean_period_s(&samples)).and_then(|(of, s)| of.tell_other_period(s));
    other_period.into_iter().for_each(tell);
    let evaluation = eval::evaluate(&samples, &protocol, mode).with_context(|| match &args.predictions {
        Some(found) => {
            let truth = args.truth.as_ref().map(|path| path.display().to_string());
            let truth = truth.or_else(|| args.data.as_ref().map(Location::to_string));
            format!("cannot score {} against {}", found.display(), truth.unwrap_or_default())
        }
        None => "cannot score the run".to_owned(),
    })?;
    if let Some(out) = &opened.out {
        let trained = opened.trained()?;
        let source = provenance(trained.as_ref(), scored.as_ref(), command_line("harmzone"))?;
        scores::write(out.path(), &protocol, &evaluation, &source)?;
        out.push()?;
    }
    let standing = scored.as_ref().map(ScoredData::standing);
    print(if args.json { evaluation.to_json() } else { score_tables::with_standing(&evaluation, standing) })?;
    if args.breakdown {
        print(format!("\n{}", score_tables::breakdown(&evaluation)))?;
    }
    Ok(ExitStatus::Done)
}

/// What the flags name, opened.
struct Opened {
    run: Option<OpenedLocation>,
    data: Option<OpenedLocation>,
    out: Option<OpenedLocation>,
}

impl Opened {
    fn of(args: &EvalArgs) -> anyhow::Result<Self> {
        let open =
            |location: &Option<Location>, access| location.as_ref().map(|of| of.open(access)).transpose();
        let (run, data) = (open(&args.run, Access::Read)?, open(&args.data, Access::Read)?);
        Ok(Self { run, data, out: open(&args.out, Access::Write)? })
    }

    fn trained(&self) -> anyhow::Result<Option<Trained>> {
        Ok(self.run.as_ref().map(|run| Trained::find(run.path())).transpose()?)
    }
}

/// The part of a data set that is scored.
pub struct ScoredData<'a> {
    pub path: &'a Path,
    pub labels: &'a str,
    pub split: Split,
    /// The data set's version.
    pub data_version: u32,
}

impl<'a> ScoredData<'a> {
    fn find(path: &'a Path, args: &'a EvalArgs) -> anyhow::Result<Self> {
        let manifest = Manifest::read(path)?;
        let split = args.split.unwrap_or_else(|| Split::to_score(&manifest));
        Ok(Self { path, labels: &args.labels, split, data_version: manifest.format_version })
    }

    fn open(&self) -> Result<Dataset, DatasetError> {
        self.split()?.read_all()
    }

    fn split(&self) -> Result<LabelledSplit, DatasetError> {
        LabelledSplit::open(self.path, self.labels, self.split)
    }

    fn standing(&self) -> Standing {
        Standing { split: Some(self.split), data_version: self.data_version }
    }
}

/// The samples to score, from files of boxes or from a trained detector.
fn samples(
    args: &EvalArgs,
    opened: &Opened,
    scored: Option<&ScoredData<'_>>,
) -> anyhow::Result<Vec<EvalSample>> {
    match (&opened.run, &args.predictions, &args.truth, scored) {
        (_, Some(predictions), Some(truth), _) => {
            Ok(json::join(json::read_predictions(predictions)?, json::read_truth(truth)?)?)
        }
        (_, Some(predictions), _, Some(data)) => {
            Ok(json::join_dataset(json::read_predictions(predictions)?, &data.open()?)?)
        }
        (Some(run), _, _, Some(data)) => samples_of_run(run.path(), data, args),
        _ => bail!("give a RUN with --data, or --predictions with --truth or --data"),
    }
}

/// Runs a trained detector over a split of a dataset.
fn samples_of_run(run: &Path, data: &ScoredData<'_>, args: &EvalArgs) -> anyhow::Result<Vec<EvalSample>> {
    let trained = Trained::find(run)?;
    let episodes = Manifest::read(data.path)?.of_split(data.split).cloned().collect::<Vec<_>>();
    let learned = tell_seen(&trained, &episodes)?;
    if !args.on_training_data {
        learned.with_context(|| format!("cannot score {} on {}", run.display(), data.path.display()))?;
    }
    let split = data.split()?;
    tell_other_zone(&trained, split.zone())?;
    if let Some(engine) = &args.engine.cluster_alone()? {
        let (program, device) = (Program::this()?, args.device.name());
        let (trained, blind, silence) = (&trained, args.blind, args.engine.silence());
        let workers = NetworkWorkers { engine, program: &program, trained, device, blind, silence };
        let found = workers.predict(data.path, split.episodes(), &Bar::default())?;
        let mut found = found.into_iter().flat_map(|found| found.found);
        return join(&split, blind, |samples| Ok(found.by_ref().take(samples.len()).collect()));
    }
    let device = args.device.open()?;
    let (detector, progress) = (trained.load(&device)?, Bar::default());
    progress.start("predict", split.n_samples() as u64);
    let with_camera = detector.config().use_camera;
    let joined = join(&split, args.blind, |samples| {
        infer::predict(&detector, &named(samples), with_camera, &device, &progress)
    })?;
    progress.finish();
    Ok(joined)
}

/// The samples of a split with the boxes that `detect` finds. Points and pictures are in memory a part at a time.
fn join(
    split: &LabelledSplit,
    blind: Option<Sensor>,
    mut detect: impl FnMut(&[LabelledSample]) -> Result<Vec<Vec<Detection>>, PredictError>,
) -> anyhow::Result<Vec<EvalSample>> {
    let mut joined = Vec::new();
    split.for_each_part(|mut samples| -> anyhow::Result<()> {
        interrupt::check()?;
        if let Some(sensor) = blind {
            samples.iter_mut().for_each(|sample| sensor.blind(&mut sample.measured));
        }
        joined.extend(eval_samples(&samples, &detect(&samples)?));
        Ok(())
    })?;
    Ok(joined)
}

/// Tells whether choices for the network were made by any of the episodes, and whether that can be known; the result
/// tells whether it learned from any.
///
/// # Errors
/// The checkpoint cannot be read.
pub fn tell_seen(trained: &Trained, episodes: &[EpisodeEntry]) -> anyhow::Result<Result<(), LearnedError>> {
    let Some(seen) = trained.seen()? else {
        tell(
            "the network does not say which episodes it learned from: whether these are among them cannot be checked",
        );
        return Ok(Ok(()));
    };
    let n_watched = seen.n_watched(episodes);
    if n_watched > 0 {
        tell(format!(
            "choices for the network (validation, the score it warns from) were made by {n_watched} of the {} episodes",
            episodes.len()
        ));
    }
    Ok(seen.check_unlearned(episodes))
}

/// Says which episodes a network learned from, and goes on.
///
/// # Errors
/// The checkpoint cannot be read.
pub fn tell_learned(trained: &Trained, episodes: &[EpisodeEntry]) -> anyhow::Result<()> {
    if let Err(learned) = tell_seen(trained, episodes)? {
        tell(format!(
            "the network learned from {} of the {} episodes",
            learned.n_learned, learned.n_episodes
        ));
    }
    Ok(())
}

/// Where scores come from: the network, the data set with its labels, and the command.
///
/// # Errors
/// The network or the data set cannot be read.
pub fn provenance(
    trained: Option<&Trained>,
    data: Option<&ScoredData<'_>>,
    command: String,
) -> anyhow::Result<Provenance> {
    let train_toml = match trained {
        Some(Trained::File(file)) => fs::read_to_string(file.path().with_file_name(train::CONFIG_FILE)).ok(),
        _ => None,
    };
    Ok(Provenance {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        command,
        data: data.map(|of| store::name_of(of.path)),
        labels: data.map(|of| of.labels.to_owned()),
        split: data.map(|of| of.split),
        data_version: data.map(|of| of.data_version),
        fingerprint: data.map(|of| Fingerprint::of(of.path, of.labels)).transpose()?,
        checkpoint_sha256: trained.map(Trained::sha256).transpose()?,
        model_toml: trained.map(Trained::config).transpose()?.as_ref().map(config::to_toml),
        train_toml,
    })
}

/// This command as a shell takes it; `program` is how the program is called.
pub fn command_line(program: &str) -> String {
    let words = super::words().into_iter().map(|word| word.to_string_lossy().into_owned());
    quote(program.split(' ').map(str::to_owned).chain(words))
}

fn refuse_to_overwrite(out: &Path) -> anyhow::Result<()> {
    let metrics = out.join(METRICS_FILE);
    if files::is_there(&metrics)? {
        bail!("metrics exist already; give --force to overwrite them: {}", metrics.display());
    }
    Ok(())
}
