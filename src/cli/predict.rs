//! `harmzone predict`: a detector's boxes for a dataset, as MCAP and as nuScenes-style JSON.

use std::path::{Path, PathBuf};

use anyhow::bail;
use burn::tensor::Device;
use clap::Args;
use fs_err as fs;

use super::{Bar, DeviceArg, ExitStatus, SamplesArgs, print};
use crate::config;
use crate::dataset::Dataset;
use crate::episode::{DetectionWriter, SampleDetections, SourceMeta};
use crate::eval::{eval_samples, json};
use crate::infer::{self, Trained};
use crate::object::Detection;

#[derive(Debug, Args)]
pub struct PredictArgs {
    /// Run folder of `harmzone train`, a checkpoint, or `small`, the trained network inside the program
    run: PathBuf,
    #[command(flatten)]
    samples: SamplesArgs,
    /// Folder for one MCAP an episode and predictions.json; default `<run>/predictions/<dataset>`, and
    /// `<dataset>/predictions/small` for `small`
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArg,
    /// Replace predictions that are there
    #[arg(long)]
    force: bool,
}

const JSON_FILE: &str = "predictions.json";

pub fn run(args: PredictArgs) -> anyhow::Result<ExitStatus> {
    let trained = Trained::find(&args.run)?;
    let out = match &args.out {
        Some(out) => out.clone(),
        None => trained.predictions_folder(&args.samples.data)?,
    };
    refuse_to_overwrite(&out, args.force)?;
    let device = args.device.open()?;
    let dataset = args.samples.open()?;
    let found = detect(&trained, &dataset, &device)?;
    let source =
        Source { set: args.run.display().to_string(), config_toml: config::to_toml(&trained.config()?) };
    write(&out, &dataset, &found, &source)?;
    Ok(ExitStatus::Done)
}

/// Where boxes come from, as their files tell it.
pub struct Source {
    /// The detector.
    pub set: String,
    pub config_toml: String,
}

/// Writes boxes, one MCAP an episode and the JSON, and tells how many.
pub fn write(out: &Path, dataset: &Dataset, found: &[Vec<Detection>], source: &Source) -> anyhow::Result<()> {
    fs::create_dir_all(out)?;
    let mut rest = found;
    let mut samples = dataset.samples();
    for entry in dataset.episodes() {
        let meta = SourceMeta {
            episode: entry.name.clone(),
            episode_sha256: entry.sha256.clone(),
            set: source.set.clone(),
            config_toml: source.config_toml.clone(),
            generator_version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        let (of_episode, later) = rest.split_at(entry.n_samples);
        let (measured, later_samples) = samples.split_at(entry.n_samples);
        (rest, samples) = (later, later_samples);
        let mut writer = DetectionWriter::create(&out.join(format!("{}.mcap", entry.name)), &meta)?;
        for (sample, detections) in measured.iter().zip(of_episode) {
            writer.write(&SampleDetections {
                time_ns: sample.measured.time_ns,
                detections: detections.clone(),
            })?;
        }
        writer.finish()?;
    }
    json::write_predictions(&out.join(JSON_FILE), &eval_samples(dataset.samples(), found))?;
    let n_boxes: usize = found.iter().map(Vec::len).sum();
    print(format!("{n_boxes} boxes for {} samples: {}", found.len(), out.display()))
}

/// Refuses to write over predictions.
pub fn refuse_to_overwrite(out: &Path, force: bool) -> anyhow::Result<()> {
    if out.join(JSON_FILE).exists() && !force {
        bail!("predictions exist already; give --force to replace them: {}", out.display());
    }
    Ok(())
}

/// Runs a detector over all samples of a dataset.
pub fn detect(trained: &Trained, dataset: &Dataset, device: &Device) -> anyhow::Result<Vec<Vec<Detection>>> {
    Ok(infer::detect(&trained.load(device)?, dataset, device, &Bar::default())?)
}
