//! `harmzone train`: trains a detector on a labelled data set, resumable.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use serde_json::json;

use super::{Bar, DevicesArg, ExitStatus, path_text, print, print_summary, tell};
use crate::config::{self, Checked};
use crate::dataset::{Dataset, DatasetError, LabelledSplit, SampleSource};
use crate::episode::Split;
use crate::infer::Trained;
use crate::model::HeadJudge;
use crate::report::curves;
use crate::store::{Access, Location};
use crate::train::memory::MemoryBound;
use crate::train::{self, DryRun, TrainConfig, TrainOptions, TrainingData};
use crate::zone::{Zone, ZoneConfig};

#[derive(Debug, Args)]
pub struct TrainArgs {
    /// Folder or URL of a labelled data set
    data: Location,
    /// Folder or URL of the run: config, logs, curves, states, and at the end `model.safetensors`. The same
    /// command again goes on where it stopped
    #[arg(long, value_name = "DIR", required_unless_present = "dry_run")]
    out: Option<Location>,
    /// Label set
    #[arg(long, value_name = "SET", default_value = "rect")]
    labels: String,
    /// Training config (TOML); `configs/train.toml` holds the defaults
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Network: `small`, `paper` (which brings `configs/train-paper.toml`), or a TOML file as those of
    /// `configs/model/`. `--config` and `--set` go over it
    #[arg(long, value_name = "PROFILE", default_value = "small")]
    model: String,
    /// Weights of the image backbone to start from: a Swin Transformer of torchvision, timm, Microsoft or
    /// mmdet (.pth, .pt, .safetensors)
    #[arg(long, value_name = "FILE")]
    image_weights: Option<PathBuf>,
    /// Override one key of the config, e.g. lidar_stage.epochs=4
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    #[command(flatten)]
    devices: DevicesArg,
    /// Take at most so much memory: less of it for pictures, and an end with the state saved where that is not enough
    #[arg(long, value_name = "GIB", value_parser = parse_gib)]
    max_memory: Option<f64>,
    /// Print parameters, shapes, memory and steps, and stop
    #[arg(long)]
    dry_run: bool,
    /// Print the summary, or the dry run, as JSON
    #[arg(long)]
    json: bool,
    /// Fail unless the folder holds a run to go on with
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Discard what another run left in the folder
    #[arg(long)]
    force: bool,
}

/// A number of GiB that a process can have.
fn parse_gib(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(gib) if (0.1..=1e6).contains(&gib) => Ok(gib),
        _ => Err("GiB from 0.1 to 1000000 are wanted".to_owned()),
    }
}

/// What `--config` and `--set` lie over: a profile's training, or the default's with a network from a file.
fn base_config(model: &str) -> anyhow::Result<TrainConfig> {
    match model {
        "small" => Ok(TrainConfig::default()),
        "paper" => Ok(TrainConfig::paper()),
        path => {
            let model = config::load(Some(Path::new(path)), &[]).with_context(|| {
                format!("--model {path} is no shipped profile (small, paper), so a TOML file")
            })?;
            Ok(TrainConfig { model, ..TrainConfig::default() })
        }
    }
}

/// A split in memory, or one that is read window by window.
enum Opened {
    Whole(Dataset),
    Stream(LabelledSplit),
}

impl Opened {
    fn open(data: &Path, labels: &str, config: &TrainConfig, split: Split) -> Result<Self, DatasetError> {
        if config.stream.is_off() {
            Dataset::open(data, labels, split).map(Self::Whole)
        } else {
            LabelledSplit::open(data, labels, split).map(Self::Stream)
        }
    }

    fn source(&self) -> SampleSource<'_> {
        match self {
            Self::Whole(dataset) => dataset.into(),
            Self::Stream(split) => split.into(),
        }
    }

    fn zone(&self) -> &Zone {
        match self {
            Self::Whole(dataset) => dataset.zone(),
            Self::Stream(split) => split.zone(),
        }
    }

    /// As [`Dataset::to_learn_from`]; a stream tells it when it comes to the episode.
    fn annotated(self) -> Result<Self, DatasetError> {
        match self {
            Self::Whole(dataset) => dataset.to_learn_from().map(Self::Whole),
            stream @ Self::Stream(_) => Ok(stream),
        }
    }
}

/// Whether who decides together with the default zone decides about labels of another one.
fn judges_by_another_zone(judge: HeadJudge, zone: &Zone) -> anyhow::Result<bool> {
    Ok(judge == HeadJudge::Both && *zone != Zone::try_from(ZoneConfig::default())?)
}

/// Warns where a network's own judge goes by another zone than the labels that it is held against.
///
/// # Errors
/// The checkpoint is broken.
pub fn tell_other_zone(trained: &Trained, zone: &Zone) -> anyhow::Result<()> {
    if judges_by_another_zone(trained.config()?.head.judge, zone)? {
        tell(
            "the labels are of another zone than the default one, by which the network judges together with its class branch \
             (model.head.judge = both): its figures are of another rule than the labels'",
        );
    }
    Ok(())
}

/// The config for labels of a zone. Who judges together with the default zone would be wrong about labels of another one.
fn judged_by_their_zone(config: &Checked<TrainConfig>, zone: &Zone) -> anyhow::Result<Checked<TrainConfig>> {
    let mut config = TrainConfig::clone(config);
    if judges_by_another_zone(config.model.head.judge, zone)? {
        tell(
            "the labels are of another zone than the default one, by which model.head.judge = both judges: the network's class branch \
             decides alone (model.head.judge = network)",
        );
        config.model.head.judge = HeadJudge::Network;
    }
    Ok(Checked::try_from(config)?)
}

fn print_json(summary: &train::Summary, run: &Path) -> anyhow::Result<()> {
    let loss = summary.last_loss;
    print(serde_json::to_string_pretty(&json!({
        "checkpoint": path_text(&summary.checkpoint),
        "curves": path_text(&run.join(curves::FILES[1])),
        "n_samples": summary.n_samples,
        "n_steps": summary.n_steps,
        "n_steps_now": summary.n_steps_now,
        "seconds": summary.elapsed.as_secs_f64(),
        "seconds_of_inputs": summary.loading.as_secs_f64(),
        "last_loss": {
            "total": loss.total(),
            "heatmap": loss.heatmap,
            "harm": loss.harm,
            "boxes": loss.boxes,
            "picture": loss.picture,
        },
    }))?)
}

pub fn run(args: TrainArgs) -> anyhow::Result<ExitStatus> {
    let mut config: TrainConfig =
        config::load_over(&base_config(&args.model)?, args.config.as_deref(), &args.overrides)?;
    if args.image_weights.is_some() {
        config.image_weights = args.image_weights;
    }
    let config = Checked::try_from(config)?;
    let devices = args.devices.open()?;
    let data = args.data.open(Access::Read)?;
    let opened = |split| Opened::open(data.path(), &args.labels, &config, split);
    let learned = opened(Split::Train)?.annotated()?;
    let config = judged_by_their_zone(&config, learned.zone())?;
    let Some(out) = args.out.filter(|_| !args.dry_run) else {
        let dry_run = DryRun::of(learned.source(), &config)?;
        print_summary(&dry_run, args.json)?;
        return Ok(ExitStatus::Done);
    };
    let place = out.open(Access::Write)?;
    let out = place.path();
    // A picture that fails is no reason to stop a training.
    let draw = |run: &Path| match curves::run(run) {
        Ok(_) => ExitStatus::Done,
        Err(error) => {
            tell(format!("left out: the curves: {error}"));
            ExitStatus::DoneWithLosses
        }
    };
    let after_validation = |run: &Path| {
        draw(run);
    };
    let options = TrainOptions {
        force: args.force,
        resume: args.resume,
        bound: args.max_memory.map(|gib| MemoryBound::new(gib * 1024.0)),
        after_validation: Some(&after_validation),
    };
    // A split that is not scored is not read either.
    let validation = match (config.validate_every_epochs > 0).then(|| opened(Split::Val)) {
        Some(Ok(split)) => Some(split),
        None | Some(Err(DatasetError::EmptySplit { .. })) => None,
        Some(Err(error)) => return Err(error.into()),
    };
    let data = TrainingData::new(learned.source(), validation.as_ref().map(Opened::source));
    let summary = train::run(data, &config, out, options, &devices, &Bar::default())?;
    let status = draw(out);
    place.push()?;
    if let Some(report) = summary.image_weights.as_ref().filter(|_| !args.json) {
        print(report)?;
    }
    if args.json {
        print_json(&summary, out)?;
        return Ok(status);
    }
    if summary.n_steps_now == 0 {
        print(format!("already trained: {}", summary.checkpoint.display()))?;
        return Ok(status);
    }
    let (loss, wall_s) = (summary.last_loss, summary.elapsed.as_secs_f64());
    print(format!(
        "trained on {} samples: {} of {} steps in {wall_s:.0} s, {:.1} % of it spent on inputs; \
         last epoch's loss {:.3} (heatmap {:.3}, harm {:.3}, boxes {:.3}, picture {:.3})\n\
         checkpoint: {}; curves: {}",
        summary.n_samples,
        summary.n_steps_now,
        summary.n_steps,
        100.0 * summary.loading.as_secs_f64() / wall_s,
        loss.total(),
        loss.heatmap,
        loss.harm,
        loss.boxes,
        loss.picture,
        summary.checkpoint.display(),
        out.join(curves::FILES[1]).display()
    ))?;
    Ok(status)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::zone::ZoneKind;

    #[test]
    fn labels_of_another_zone_leave_harm_to_the_class_branch() {
        let config = Checked::new(TrainConfig::default()).unwrap();
        let judge_for = |zone: ZoneConfig| {
            let zone = Zone::try_from(zone).unwrap();
            judged_by_their_zone(&config, &zone).unwrap().model.head.judge
        };
        assert_eq!(judge_for(ZoneConfig::default()), HeadJudge::Both);
        for kind in ZoneKind::ALL.into_iter().filter(|&kind| kind != ZoneConfig::default().kind) {
            assert_eq!(
                judge_for(ZoneConfig { kind, ..ZoneConfig::default() }),
                HeadJudge::Network,
                "{kind:?}"
            );
        }
    }
}
