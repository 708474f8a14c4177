//! `harmzone versus`: detectors side by side on the same samples, and what each gains over the first.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use burn::tensor::Device;
use clap::Args;
use fs_err as fs;

use super::eval::tell_seen;
use super::{Bar, DeviceArg, ExitStatus, SamplesArgs, print};
use crate::config;
use crate::dataset::Dataset;
use crate::dataset::blind::Sensor;
use crate::episode::Manifest;
use crate::eval::versus::versus;
use crate::eval::{EvalConfig, EvalSample, Mode, Protocol, eval_samples, json};
use crate::files::write_atomic;
use crate::infer::{self, Trained};
use crate::report::standing::Standing;
use crate::report::table::Table;
use crate::report::versus::tables;

/// Names of the files, the one that says that all are there last.
const FILES: [&str; 2] = ["versus.txt", "versus.json"];

#[derive(Debug, Args)]
pub struct VersusArgs {
    /// Two or more detectors, the first one to measure by: a run's folder, a checkpoint, `small`, or a JSON of boxes as
    /// `eval --predictions` takes it; `camera-blind:RUN` and `lidar-blind:RUN`, a run with black pictures or empty clouds;
    /// NAME=DETECTOR for a name of its own
    #[arg(required = true, num_args = 2.., value_name = "DETECTOR")]
    detectors: Vec<String>,
    #[command(flatten)]
    samples: SamplesArgs,
    #[command(flatten)]
    device: DeviceArg,
    /// Also the ID and OOD columns of Table III
    #[arg(long)]
    ood: bool,
    /// Score also on episodes that a network learned from, which is refused otherwise
    #[arg(long)]
    on_training_data: bool,
    /// Thresholds and filters, for all of them (TOML)
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key of the config, e.g. max_range_m=30
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Also write versus.txt and versus.json
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
    /// Print versus.json in place of the tables
    #[arg(long)]
    json: bool,
}

/// Whose boxes.
#[derive(Debug, PartialEq)]
enum Whose {
    Boxes(PathBuf),
    Run { path: PathBuf, blind: Option<Sensor> },
}

/// A detector and its name in the tables.
fn parse(text: &str) -> (String, Whose) {
    let (name, whose) = match text.split_once('=') {
        Some((name, whose)) if !name.is_empty() && !name.contains(['/', ':']) => (name, whose),
        _ => (text, text),
    };
    let blinded = Sensor::ALL
        .into_iter()
        .find_map(|sensor| Some((sensor, whose.strip_prefix(sensor.name())?.strip_prefix("-blind:")?)));
    let is_boxes = Path::new(whose).extension().is_some_and(|of| of.eq_ignore_ascii_case("json"));
    let whose = match blinded {
        Some((sensor, run)) => Whose::Run { path: run.into(), blind: Some(sensor) },
        None if is_boxes => Whose::Boxes(whose.into()),
        None => Whose::Run { path: whose.into(), blind: None },
    };
    (name.to_owned(), whose)
}

pub fn run(args: VersusArgs) -> anyhow::Result<ExitStatus> {
    let (names, whose): (Vec<String>, Vec<Whose>) = args.detectors.iter().map(|text| parse(text)).unzip();
    if let Some(name) =
        names.iter().enumerate().find_map(|(i, name)| names[..i].contains(name).then_some(name))
    {
        bail!("two detectors are called `{name}`; NAME=DETECTOR gives one another name");
    }
    if let Some(out) = args.out.as_ref().filter(|_| !args.force) {
        let taken = FILES.map(|name| out.join(name)).into_iter().find(|path| path.exists());
        if let Some(path) = taken {
            bail!("the file exists; --force replaces it: {}", path.display());
        }
    }
    let config = config::load_over(&EvalConfig::default(), args.config.as_deref(), &args.overrides)?;
    let protocol = Protocol::try_from(config)?;
    let device = args.device.open()?;
    let dataset = args.samples.open()?;
    let detectors: Vec<Vec<EvalSample>> = names
        .iter()
        .zip(&whose)
        .map(|(name, whose)| {
            samples(whose, &dataset, args.on_training_data, &device)
                .with_context(|| format!("cannot score `{name}`"))
        })
        .collect::<anyhow::Result<_>>()?;
    let mode = if args.ood { Mode::Ood } else { Mode::Id };
    let found = versus(&detectors, &protocol, mode)?;
    let record = serde_json::json!({ "detectors": names, "of": found });
    let json = serde_json::to_string_pretty(&record)? + "\n";
    let standing = Standing {
        split: dataset.episodes().first().map(|entry| entry.split),
        data_version: Manifest::read(dataset.path())?.format_version,
    };
    let tables = tables(&found, &names).iter().map(Table::to_string).collect::<Vec<_>>().join("\n");
    let text = format!("{standing}\n\n{tables}");
    if let Some(out) = &args.out {
        fs::create_dir_all(out)?;
        for (name, content) in FILES.iter().zip([&text, &json]) {
            write_atomic(&out.join(name), content.as_bytes())?;
        }
    }
    print(if args.json { json } else { text })?;
    Ok(ExitStatus::Done)
}

/// The data set's samples with a detector's boxes.
fn samples(
    whose: &Whose,
    dataset: &Dataset,
    on_training_data: bool,
    device: &Device,
) -> anyhow::Result<Vec<EvalSample>> {
    let (path, blind) = match whose {
        Whose::Boxes(path) => return boxes(path, dataset),
        Whose::Run { path, blind } => (path, *blind),
    };
    let trained = Trained::find(path)?;
    let learned = tell_seen(&trained, dataset.episodes())?;
    if !on_training_data {
        learned?;
    }
    let detector = trained.load(device)?;
    let sees = [(Sensor::Camera, detector.config().use_camera), (Sensor::Lidar, detector.config().use_lidar)];
    if let Some((sensor, _)) = sees.into_iter().find(|&(sensor, sees)| Some(sensor) == blind && !sees) {
        bail!("the network has no {}, so it cannot be blinded: {}", sensor.name(), path.display());
    }
    let blinded = blind.map(|sensor| dataset.clone().blind(sensor));
    let shown = blinded.as_ref().unwrap_or(dataset);
    let found = infer::detect(&detector, &shown.named(), device, &Bar::default())?;
    Ok(eval_samples(dataset.samples(), &found))
}

/// The same with the boxes of a file, in the data set's order.
fn boxes(path: &Path, dataset: &Dataset) -> anyhow::Result<Vec<EvalSample>> {
    let mut samples = json::join_dataset(json::read_predictions(path)?, dataset)?;
    let place: HashMap<&str, usize> =
        dataset.samples().iter().enumerate().map(|(i, sample)| (sample.id.as_str(), i)).collect();
    samples.sort_by_key(|sample| place[sample.id.as_str()]);
    Ok(samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_detector_has_a_name_and_may_be_blind() {
        let run = |path: &str, blind| Whose::Run { path: path.into(), blind };
        assert_eq!(parse("small"), ("small".into(), run("small", None)));
        assert_eq!(parse("mine=runs/a"), ("mine".into(), run("runs/a", None)));
        assert_eq!(parse("runs/lr=3"), ("runs/lr=3".into(), run("runs/lr=3", None)));
        let blind = run("runs/lr=3", Some(Sensor::Camera));
        assert_eq!(parse("dark=camera-blind:runs/lr=3"), ("dark".into(), blind));
        assert_eq!(parse("lidar-blind:small").1, run("small", Some(Sensor::Lidar)));
        assert_eq!(parse("boxes.json"), ("boxes.json".into(), Whose::Boxes("boxes.json".into())));
    }
}
