//! `harmzone versus`: detectors side by side on the same samples, and what each gains over the first.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;

use super::detectors::{NamedDetector, OpenedDetector};
use super::eval::command_line;
use super::{DeviceArg, ExitStatus, SamplesArgs, print};
use crate::config;
use crate::episode::Manifest;
use crate::eval::versus::versus;
use crate::eval::{EvalConfig, EvalSample, Mode, Protocol, eval_samples, score};
use crate::files::{self, FolderLock, seal_result, write_atomic};
use crate::report::standing::Standing;
use crate::report::table::Table;
use crate::report::versus::tables;

/// Names of the files, the one that says that all are there last.
const FILES: [&str; 2] = ["versus.txt", "versus.json"];

#[derive(Debug, Args)]
pub struct VersusArgs {
    /// Two or more detectors, the first one to measure by: a run's folder, a checkpoint, `small`, or a JSON of boxes as
    /// `eval --predictions` takes it; `camera-blind:RUN` and `lidar-blind:RUN`, a run with black pictures or empty clouds;
    /// `truth`, all true boxes, whose harm is told from measured speed and steering: about the best there can be; `JUDGE:`
    /// before any of them, such as `zone:small`, a rule of `baseline` over its boxes; NAME=DETECTOR for a name of its own; the same
    /// NAME= again for another run of the same training: their mean counts
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

pub fn run(args: VersusArgs) -> anyhow::Result<ExitStatus> {
    let named = args.detectors.iter().map(|text| NamedDetector::parse(text));
    let named = named.collect::<anyhow::Result<Vec<_>>>()?;
    let rows = rows(&named)?;
    let _lock = args.out.as_deref().map(FolderLock::take).transpose()?;
    if let Some(out) = args.out.as_ref().filter(|_| !args.force) {
        let taken = files::first_there(FILES.map(|name| out.join(name)))?;
        if let Some(path) = taken {
            bail!("the file exists; --force replaces it: {}", path.display());
        }
    }
    let config = config::load_over(&EvalConfig::default(), args.config.as_deref(), &args.overrides)?;
    let protocol = Protocol::try_from(config)?;
    let mode = if args.ood { Mode::Ood } else { Mode::Id };
    let of_detector = |i: usize| format!("cannot score `{}`", args.detectors[i]);
    // All that can be wrong is told before the first network runs.
    let opened = named.iter().enumerate();
    let opened = opened.map(|(i, detector)| detector.open().with_context(|| of_detector(i)));
    let opened: Vec<OpenedDetector> = opened.collect::<anyhow::Result<_>>()?;
    let device = args.device.open()?;
    let dataset = args.samples.open()?;
    let nothing = vec![Vec::new(); dataset.samples().len()];
    score(&eval_samples(dataset.samples(), &nothing), &protocol, mode)?;
    for (i, detector) in opened.iter().enumerate() {
        detector.check(&dataset, args.on_training_data).with_context(|| of_detector(i))?;
    }
    let hashes: Vec<Option<String>> =
        opened.iter().map(|detector| detector.sha256().map(str::to_owned)).collect();
    for (name, runs) in &rows {
        let again = runs
            .iter()
            .enumerate()
            .find(|(k, i)| runs[..*k].iter().any(|other| hashes[*other] == hashes[**i]));
        if let Some((_, &i)) = again {
            bail!("`{name}` has one run twice, `{}`; each of its runs counts once", args.detectors[i]);
        }
    }
    let detectors = opened.into_iter().enumerate().map(|(i, detector)| {
        let samples = detector.samples(&dataset, &device);
        samples.with_context(|| of_detector(i))
    });
    let mut detectors: Vec<Option<Vec<EvalSample>>> =
        detectors.map(|of| of.map(Some)).collect::<anyhow::Result<_>>()?;
    let of_rows = rows.iter().map(|(_, runs)| runs.iter().filter_map(|&i| detectors[i].take()).collect());
    let of_rows: Vec<Vec<Vec<EvalSample>>> = of_rows.collect();
    let found = versus(&of_rows, &protocol, mode).map_err(|error| {
        let place = rows[error.detector].1[error.run];
        anyhow::Error::from(error.source).context(of_detector(place))
    })?;
    let names: Vec<String> = rows.into_iter().map(|(name, _)| name).collect();
    let split = dataset.episodes().first().map(|entry| entry.split);
    let standing = Standing { split, data_version: Manifest::read(dataset.path())?.format_version };
    let described = named.iter().zip(&args.detectors).zip(&hashes).map(|((detector, given), sha256)| {
        serde_json::json!({ "name": detector.name, "detector": given, "sha256": sha256 })
    });
    let record = serde_json::json!({
        "version": env!("CARGO_PKG_VERSION"),
        "command": command_line("harmzone"),
        "data": dataset.path(),
        "labels": args.samples.labels,
        "split": split,
        "fingerprint": dataset.fingerprint(),
        "config": protocol.config(),
        "detectors": described.collect::<Vec<_>>(),
        "columns": names,
        "of": found,
    });
    let json = serde_json::to_string_pretty(&record)? + "\n";
    let tables = tables(&found, &names).iter().map(Table::to_string).collect::<Vec<_>>().join("\n");
    let text = format!("{standing}\n\n{tables}");
    if let Some(out) = &args.out {
        for (name, content) in FILES.iter().zip([&text, &seal_result(&json)]) {
            write_atomic(&out.join(name), content.as_bytes())?;
        }
    }
    print(if args.json { json } else { text })?;
    Ok(ExitStatus::Done)
}

/// The detectors' names in their first order, each with the places of its runs.
fn rows(named: &[NamedDetector]) -> anyhow::Result<Vec<(String, Vec<usize>)>> {
    let mut rows: Vec<(String, Vec<usize>)> = Vec::new();
    for (i, detector) in named.iter().enumerate() {
        let Some((name, runs)) = rows.iter_mut().find(|(name, _)| *name == detector.name) else {
            rows.push((detector.name.clone(), vec![i]));
            continue;
        };
        if !detector.has_own_name || !named[runs[0]].has_own_name {
            bail!(
                "two detectors are called `{name}`; NAME=DETECTOR gives one another name, and the same NAME= before both makes \
                 them runs of one training"
            );
        }
        runs.push(i);
    }
    if rows.len() < 2 {
        bail!("all detectors are called `{}`; there is nothing to set them beside", rows[0].0);
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_is_given_again_makes_runs_of_one_detector() {
        let of = |texts: &[&str]| {
            let named = texts.iter().map(|text| NamedDetector::parse(text)).collect::<Result<Vec<_>, _>>();
            rows(&named.unwrap()).map_err(|error| error.to_string())
        };
        let both = of(&["a=runs/1", "b=runs/2", "a=runs/3"]).unwrap();
        assert_eq!(both, [("a".to_owned(), vec![0, 2]), ("b".to_owned(), vec![1])]);
        for (wrong, told) in [
            (&["small", "small"][..], "two detectors are called `small`"),
            (&["small", "small=runs/1"], "two detectors are called `small`"),
            (&["a=runs/1", "a=runs/2"], "nothing to set them beside"),
        ] {
            let message = of(wrong).unwrap_err();
            assert!(message.contains(told), "{message}");
        }
    }
}
