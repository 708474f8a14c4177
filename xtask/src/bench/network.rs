//! Training and inference against PyTorch, and how long the training of `small` takes.
//!
//! The race is `scripts/race_pytorch.py`, the steps' times are those of `xtask bench-model`: processes of their own.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, ensure};
use burn::tensor::Device;
use fs_err as fs;
use serde::Deserialize;

use super::table::{Goal, Line, Outcome, Value};
use harmzone::config::{self, Checked};
use harmzone::dataset::Dataset;
use harmzone::episode::Split;
use harmzone::episode::manifest::LabelManifest;
use harmzone::generate::{self, GenerateConfig, Preset, RunOptions, preset};
use harmzone::label;
use harmzone::progress::Progress;
use harmzone::train::{self, TrainConfig, TrainingData};
use harmzone::zone::ZoneConfig;

const TRAINING: Goal = Goal::new(0.8, 0.95);
const INFERENCE: Goal = Goal::new(0.8, 1.0);
const MINUTES: Goal = Goal::new(30.0, 40.0);

/// Threads of each side, as `scripts/race_pytorch.py` has them.
const N_THREADS: &str = "2";
/// The label set that the programs use where none is named.
const LABELS: &str = "rect";
/// The data that is raced on where it must be made first: 120 samples to train on and 120 to infer on.
const RACE_DATA: [&str; 4] = ["towns=[\"downtown\"]", "samples=30", "seed=7", "val_every=2"];
const N_RACE_EPISODES: u32 = 8;
/// Steps of each stage, and samples of inference, from which the time of a training is computed.
const N_STEPS: u32 = 20;
const N_SAMPLES: u32 = 100;

/// Makes and labels the data to race on, unless it is there.
///
/// # Errors
/// Nothing can be generated here.
pub fn prepare(data: &Path, progress: &dyn Progress) -> anyhow::Result<()> {
    if is_labelled(data) {
        return Ok(());
    }
    let overrides = RACE_DATA.map(str::to_owned);
    let config = config::load_over(&GenerateConfig::default(), None, &overrides)?;
    make(&config, N_RACE_EPISODES, data, progress)
}

fn is_labelled(data: &Path) -> bool {
    LabelManifest::folder(data, LABELS).join(LabelManifest::FILE).is_file()
}

fn make(config: &GenerateConfig, n: u32, data: &Path, progress: &dyn Progress) -> anyhow::Result<()> {
    let jobs = std::thread::available_parallelism().map_or(1, usize::from);
    let options = RunOptions {
        program: std::env::current_exe()?.into(),
        engine: harmzone::worker::Engine::Local { jobs },
        force: false,
        silence: harmzone::worker::SILENCE,
        own_models: None,
    };
    generate::run(config, n, data, &options, progress)?;
    label::run(data, &ZoneConfig::default(), LABELS, false, progress)?;
    Ok(())
}

/// One contest as the race tells it.
#[derive(Deserialize)]
struct Contest {
    variant: String,
    harmzone: Vec<f64>,
    pytorch: Vec<f64>,
}

/// Races against PyTorch; `root` is the source tree.
///
/// # Errors
/// The two programs disagree, or one fails.
pub fn race(
    root: &Path,
    data: &Path,
    with_training: bool,
    with_inference: bool,
) -> anyhow::Result<Vec<Line>> {
    let training = [
        ("training step, LiDAR, against PyTorch", "lidar_step", TRAINING, with_training),
        ("training step, fused, against PyTorch", "fused_step", TRAINING, with_training),
    ];
    let inference = ("inference, norms folded, against PyTorch", "inference", INFERENCE, with_inference);
    let python = root.join(".venv-golden/bin/python");
    let mut told = if python.is_file() { Some(run_race(root, &python, data)?) } else { None };
    let wanted = training.into_iter().chain([inference]).filter(|(.., is_wanted)| *is_wanted);
    let line = |(what, contest, goal, _): (&str, &str, Goal, bool)| {
        let (outcome, note) = match &mut told {
            None => {
                let needed = "`make setup-golden` installs PyTorch";
                (Outcome::Absent(needed.to_owned()), String::new())
            }
            Some(told) => {
                let Contest { variant, harmzone, pytorch } =
                    told.remove(contest).with_context(|| format!("the race told nothing of `{contest}`"))?;
                let [ours, theirs] = [&harmzone, &pytorch].map(|ms| Value::of(ms).map(|of| of.median));
                let value = Value::ratio(&harmzone, &pytorch).context("the race told no times")?;
                let note = format!(
                    "{:.1} ms against {:.1}, medians of {} turns; PyTorch's fastest: {variant}",
                    ours.unwrap_or_default(),
                    theirs.unwrap_or_default(),
                    harmzone.len()
                );
                (Outcome::Measured(value), note)
            }
        };
        let unit = "times the time";
        Ok(Line { what: what.to_owned(), unit, goal: Some(goal), outcome, note })
    };
    wanted.map(line).collect()
}

fn run_race(root: &Path, python: &Path, data: &Path) -> anyhow::Result<BTreeMap<String, Contest>> {
    let folder = tempfile::tempdir()?;
    let times = folder.path().join("times.json");
    let status = Command::new(python)
        .arg(root.join("scripts/race_pytorch.py"))
        .arg(std::env::current_exe()?)
        .arg(data)
        .arg("--json")
        .arg(&times)
        .stdout(Stdio::null())
        .status()?;
    ensure!(status.success(), "scripts/race_pytorch.py ended with {status}");
    Ok(serde_json::from_slice(&fs::read(times)?)?)
}

/// What `bench-model --json` tells.
#[derive(Deserialize)]
pub struct Told {
    inference: Inference,
    pub training: Vec<Stage>,
}

#[derive(Deserialize)]
struct Inference {
    stages: Vec<Times>,
    total: Times,
}

#[derive(Deserialize)]
pub struct Stage {
    pub stage: String,
    pub step: Times,
}

#[derive(Deserialize)]
pub struct Times {
    name: String,
    pub mean_ms: f64,
}

/// The first stage of `bench-model`'s inference that prepares no inputs, which training does once for each sample.
const AFTER_PREPARING: &str = "tensors";

/// Measures steps and inference of `small` on a device.
///
/// # Errors
/// The device or the data is missing.
pub fn bench_model(data: &Path, device: &str) -> anyhow::Result<Told> {
    let output = Command::new(std::env::current_exe()?)
        .args(["bench-model", "--model", "small", "--json", "--device", device])
        .args(["--steps", &N_STEPS.to_string(), "--samples", &N_SAMPLES.to_string()])
        .arg("--data")
        .arg(data)
        .env("RAYON_NUM_THREADS", N_THREADS)
        .stderr(Stdio::inherit())
        .output()?;
    ensure!(output.status.success(), "`xtask bench-model --device {device}` ended with {}", output.status);
    serde_json::from_slice(&output.stdout).context("`xtask bench-model` told something else than its figures")
}

/// The line of the training of `small`.
fn minutes(minutes: f64, note: String) -> Line {
    Line {
        what: "the training of `small`, 10 epochs".to_owned(),
        unit: "minutes",
        goal: Some(MINUTES),
        outcome: Outcome::Measured(Value::single(minutes)),
        note,
    }
}

/// Computes how long the training of `small` takes, from the times of steps and of inference.
///
/// # Errors
/// The model cannot be measured.
pub fn compute_training(data: &Path) -> anyhow::Result<Line> {
    let told = bench_model(data, "cpu")?;
    let (generated, n_episodes) = preset::load(Some(Preset::Small), None, false, None, &[])?;
    let n_val = (f64::from(n_episodes) / generated.val_every).floor() * f64::from(generated.samples);
    let n_train = f64::from(n_episodes * generated.samples) - n_val;
    let config = training_config();
    let steps_an_epoch = (n_train / (config.batch_size * config.accumulate) as f64).ceil();
    let mut ms = 0.0;
    let mut n_validations = 0;
    for (stage, of) in [config.lidar_stage, config.fused_stage].iter().zip(&told.training) {
        ms += stage.epochs as f64 * steps_an_epoch * of.step.mean_ms;
        n_validations += stage.epochs / config.validate_every_epochs;
    }
    let mut stages = told.inference.stages.iter();
    let n_preparing = stages.position(|times| times.name == AFTER_PREPARING);
    let n_preparing = n_preparing.context("`xtask bench-model` names the stages of inference otherwise")?;
    let preparing_ms: f64 = told.inference.stages[..n_preparing].iter().map(|times| times.mean_ms).sum();
    ms += n_train * preparing_ms + n_validations as f64 * n_val * told.inference.total.mean_ms;
    let [lidar_ms, fused_ms] = [0, 1].map(|stage| told.training[stage].step.mean_ms);
    Ok(minutes(
        ms / 60e3,
        format!(
            "computed from {lidar_ms:.0} ms a step of the LiDAR stage and {fused_ms:.0} of the fused one, {steps_an_epoch:.0} steps \
             an epoch, {n_validations} validations of {n_val:.0} samples at {:.1} ms; --train-in trains",
            told.inference.total.mean_ms
        ),
    ))
}

/// The default training, with every second validation.
fn training_config() -> TrainConfig {
    TrainConfig { validate_every_epochs: 2, ..TrainConfig::default() }
}

/// Makes the data of the preset `small` in a folder, unless it is there, and trains `small` on it.
///
/// # Errors
/// Nothing can be generated or trained here.
pub fn train_small(work: &Path, device: &Device, progress: &dyn Progress) -> anyhow::Result<Line> {
    let (data, run) = (work.join("id"), work.join("small"));
    if !is_labelled(&data) {
        let (config, n_episodes) = preset::load(Some(Preset::Small), None, false, None, &[])?;
        make(&config, n_episodes, &data, progress)?;
    }
    let [train, val] = [Split::Train, Split::Val].map(|split| Dataset::open(&data, LABELS, split));
    let (train, val) = (train?, val?);
    // A finished run would be left as it is.
    if run.is_dir() {
        fs::remove_dir_all(&run)?;
    }
    let (config, options) = (Checked::try_from(training_config())?, train::TrainOptions::default());
    let begin = Instant::now();
    let data = TrainingData::new(&train, Some((&val).into()));
    train::run(data, &config, &run, options, std::slice::from_ref(device), progress)?;
    let note = format!("trained for real: {}", run.display());
    Ok(minutes(begin.elapsed().as_secs_f64() / 60.0, note))
}
