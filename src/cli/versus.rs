//! `harmzone versus`: detectors side by side on the same samples, and what each gains over the first.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use burn::tensor::Device;
use clap::Args;
use fs_err as fs;

use super::eval::{command_line, tell_seen};
use super::{Bar, DeviceArg, ExitStatus, SamplesArgs, print};
use crate::config;
use crate::dataset::Dataset;
use crate::dataset::blind::Sensor;
use crate::episode::Manifest;
use crate::eval::versus::versus;
use crate::eval::{EvalConfig, EvalSample, Mode, Protocol, eval_samples, json, score};
use crate::files::{sha256_hex, write_atomic};
use crate::infer::{self, Trained};
use crate::object::Detection;
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
    /// Thresholds and filters, for all of them; the operating score plays no part (TOML)
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
///
/// # Errors
/// Nothing stands after the name, or boxes of a file are to be blinded.
fn parse(text: &str) -> anyhow::Result<(String, Whose)> {
    let (name, whose) = match text.split_once('=') {
        Some((name, whose)) if !name.is_empty() && !name.contains(['/', ':']) => (name, whose),
        _ => (text, text),
    };
    let blinded = Sensor::ALL
        .into_iter()
        .find_map(|sensor| Some((sensor, whose.strip_prefix(sensor.name())?.strip_prefix("-blind:")?)));
    let is_boxes = Path::new(whose).extension().is_some_and(|of| of.eq_ignore_ascii_case("json"));
    if whose.is_empty() || blinded.is_some_and(|(_, run)| run.is_empty()) {
        bail!(
            "no detector is named in `{text}`; a run's folder, a checkpoint, `small` or a JSON of boxes is needed"
        );
    }
    if is_boxes && blinded.is_some() {
        bail!("`{text}`: boxes in a file cannot be blinded, only a network can");
    }
    let whose = match blinded {
        Some((sensor, run)) => Whose::Run { path: run.into(), blind: Some(sensor) },
        None if is_boxes => Whose::Boxes(whose.into()),
        None => Whose::Run { path: whose.into(), blind: None },
    };
    Ok((name.to_owned(), whose))
}

/// A detector's boxes as they lie in a file, or the network that makes them.
enum Opened {
    Boxes { found: json::Boxes<Detection>, sha256: String },
    Run { trained: Trained, blind: Option<Sensor>, sha256: String },
}

impl Opened {
    fn of(whose: &Whose) -> anyhow::Result<Self> {
        match whose {
            Whose::Boxes(path) => {
                Ok(Self::Boxes { found: json::read_predictions(path)?, sha256: sha256_hex(&fs::read(path)?) })
            }
            Whose::Run { path, blind } => {
                let trained = Trained::find(path)?;
                let model = trained.config()?;
                let lacks = match blind {
                    Some(Sensor::Camera) => !model.use_camera,
                    Some(Sensor::Lidar) => !model.use_lidar,
                    None => false,
                };
                if let Some(sensor) = blind.filter(|_| lacks) {
                    bail!(
                        "the network has no {}, so it cannot be blinded: {}",
                        sensor.name(),
                        path.display()
                    );
                }
                let sha256 = sha256_hex(&trained.bytes()?.1);
                Ok(Self::Run { trained, blind: *blind, sha256 })
            }
        }
    }

    fn sha256(&self) -> &str {
        match self {
            Self::Boxes { sha256, .. } | Self::Run { sha256, .. } => sha256,
        }
    }

    /// Refuses a network that learned from the samples.
    fn check(&self, dataset: &Dataset, on_training_data: bool) -> anyhow::Result<()> {
        let Self::Run { trained, .. } = self else { return Ok(()) };
        let learned = tell_seen(trained, dataset.episodes())?;
        if on_training_data { Ok(()) } else { Ok(learned?) }
    }

    /// The data set's samples with the boxes, in the data set's order.
    fn samples(self, dataset: &Dataset, device: &Device) -> anyhow::Result<Vec<EvalSample>> {
        match self {
            Self::Boxes { found, .. } => {
                let mut samples = json::join_dataset(found, dataset)?;
                let place: HashMap<&str, usize> =
                    dataset.samples().iter().enumerate().map(|(i, sample)| (sample.id.as_str(), i)).collect();
                samples.sort_by_key(|sample| place[sample.id.as_str()]);
                Ok(samples)
            }
            Self::Run { trained, blind, .. } => {
                let detector = trained.load(device)?;
                let found = infer::detect_with(&detector, dataset.samples(), blind, device, &Bar::default())?;
                Ok(eval_samples(dataset.samples(), &found))
            }
        }
    }
}

pub fn run(args: VersusArgs) -> anyhow::Result<ExitStatus> {
    let parsed = args.detectors.iter().map(|text| parse(text)).collect::<anyhow::Result<Vec<_>>>()?;
    let (names, whose): (Vec<String>, Vec<Whose>) = parsed.into_iter().unzip();
    let again = names.iter().enumerate().find_map(|(i, name)| names[..i].contains(name).then_some(name));
    if let Some(name) = again {
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
    let mode = if args.ood { Mode::Ood } else { Mode::Id };
    let of_detector = |i: usize| format!("cannot score `{}`", names[i]);
    // All that can be wrong is told before the first network runs.
    let opened = whose.iter().enumerate();
    let opened = opened.map(|(i, whose)| Opened::of(whose).with_context(|| of_detector(i)));
    let opened: Vec<Opened> = opened.collect::<anyhow::Result<_>>()?;
    let device = args.device.open()?;
    let dataset = args.samples.open()?;
    let nothing = vec![Vec::new(); dataset.samples().len()];
    score(&eval_samples(dataset.samples(), &nothing), &protocol, mode)?;
    for (i, detector) in opened.iter().enumerate() {
        detector.check(&dataset, args.on_training_data).with_context(|| of_detector(i))?;
    }
    let hashes: Vec<String> = opened.iter().map(|detector| detector.sha256().to_owned()).collect();
    let detectors = opened.into_iter().enumerate().map(|(i, detector)| {
        let samples = detector.samples(&dataset, &device);
        samples.with_context(|| of_detector(i))
    });
    let detectors: Vec<Vec<EvalSample>> = detectors.collect::<anyhow::Result<_>>()?;
    let found = versus(&detectors, &protocol, mode)
        .map_err(|error| anyhow::Error::from(error.source).context(of_detector(error.detector)))?;
    let split = dataset.episodes().first().map(|entry| entry.split);
    let standing = Standing { split, data_version: Manifest::read(dataset.path())?.format_version };
    let described = names.iter().zip(&args.detectors).zip(&hashes).map(
        |((name, given), sha256)| serde_json::json!({ "name": name, "detector": given, "sha256": sha256 }),
    );
    let record = serde_json::json!({
        "version": env!("CARGO_PKG_VERSION"),
        "command": command_line("harmzone"),
        "data": dataset.path(),
        "labels": args.samples.labels,
        "split": split,
        "fingerprint": dataset.fingerprint(),
        "config": protocol.config(),
        "detectors": described.collect::<Vec<_>>(),
        "of": found,
    });
    let json = serde_json::to_string_pretty(&record)? + "\n";
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_detector_has_a_name_and_may_be_blind() {
        let run = |path: &str, blind| Whose::Run { path: path.into(), blind };
        let parse = |text: &str| super::parse(text).unwrap();
        assert_eq!(parse("small"), ("small".into(), run("small", None)));
        assert_eq!(parse("mine=runs/a"), ("mine".into(), run("runs/a", None)));
        assert_eq!(parse("runs/lr=3"), ("runs/lr=3".into(), run("runs/lr=3", None)));
        let blind = run("runs/lr=3", Some(Sensor::Camera));
        assert_eq!(parse("dark=camera-blind:runs/lr=3"), ("dark".into(), blind));
        assert_eq!(parse("lidar-blind:small").1, run("small", Some(Sensor::Lidar)));
        assert_eq!(parse("boxes.json"), ("boxes.json".into(), Whose::Boxes("boxes.json".into())));
    }
    #[test]
    fn what_is_no_detector_is_refused() {
        for (wrong, told) in [
            ("a=", "`a=`"),
            ("a=camera-blind:", "no detector"),
            ("camera-blind:boxes.json", "cannot be blinded"),
        ] {
            let message = parse(wrong).unwrap_err().to_string();
            assert!(message.contains(told), "{message}");
        }
    }
}
