//! `harmzone predict`: a detector's boxes for a dataset, as MCAP and as nuScenes-style JSON.

use std::path::Path;

use clap::Args;
use serde_json::json;

use super::engine::EngineArgs;
use super::{Bar, DeviceArg, ExitStatus, path_text, print_either, split, tell_learned};
use crate::config;
use crate::dataset::MeasuredSplit;
use crate::episode::{Manifest, PartOf, Shard, Split};
use crate::files::sha256_of;
use crate::infer::worker::NetworkWorkers;
use crate::infer::{self, PredictionPart, Predictions, Trained};
use crate::object::Detection;
use crate::store::{self, Access, Location};
use crate::worker::Program;

#[derive(Debug, Args)]
pub struct PredictArgs {
    /// Run folder or URL of `harmzone train`, a checkpoint, or `small`, the trained network inside the program
    run: Location,
    /// Folder or URL of a data set; it needs neither labels nor truth
    #[arg(long, value_name = "DIR")]
    data: Location,
    /// Split; without it, the first of val, dev and test that the data set has
    #[arg(long, value_parser = split())]
    split: Option<Split>,
    /// From when labels were needed; a detector sees none
    #[arg(long, value_name = "SET", hide = true)]
    labels: Option<String>,
    /// Folder or URL for one MCAP an episode and predictions.json; default `<run>/predictions/<dataset>`, and
    /// `<dataset>/predictions/small` for `small`
    #[arg(long, value_name = "DIR")]
    out: Option<Location>,
    /// Predict one of N parts of the split, I from 0: every N-th episode, in a folder of its own, which `harmzone merge` joins with
    /// the others
    #[arg(long, value_name = "I/N", requires = "out")]
    shard: Option<Shard>,
    #[command(flatten)]
    device: DeviceArg,
    #[command(flatten)]
    engine: EngineArgs,
    /// Replace predictions that are there
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: PredictArgs) -> anyhow::Result<ExitStatus> {
    // Without --out the boxes lie in the run, or in the data set those of the network inside the program.
    let is_shipped = matches!(args.run.local().map(Trained::find), Some(Ok(Trained::Shipped(_))));
    let access = |is_out: bool| if args.out.is_none() && is_out { Access::Write } else { Access::Read };
    let run = args.run.open(access(!is_shipped))?;
    let data = args.data.open(access(is_shipped))?;
    let out = args.out.as_ref().map(|out| out.open(Access::Write)).transpose()?;
    let trained = Trained::find(run.path())?;
    let folder = match &out {
        Some(out) => out.path().to_owned(),
        None => trained.predictions_folder(data.path())?,
    };
    let _lock = Predictions::take_folder(&folder, args.force)?;
    let cluster = args.engine.cluster_alone()?;
    let whole = MeasuredSplit::open(data.path(), args.split)?;
    let recording = match args.shard {
        Some(shard) => whole.part(shard),
        None => whole.clone(),
    };
    // Boxes on training data serve to find faults; only figures on them are refused, by `eval`.
    tell_learned(&trained, recording.episodes())?;
    let config_toml = config::to_toml(&trained.config()?);
    let predictions = Predictions { folder, set: args.run.to_string(), config_toml };
    let part = match args.shard {
        Some(shard) => Some(part_of(&args, data.path(), shard, &whole, &trained)?),
        None => None,
    };
    let of_episodes: Vec<(&str, usize)> =
        recording.episodes().iter().map(|entry| (entry.name.as_str(), entry.n_samples)).collect();
    let beside = |folder: &Path| match &part {
        Some(part) => part.clone().write(folder, &of_episodes),
        None => Ok(()),
    };
    let n_boxes = if let Some(engine) = &cluster {
        let program = Program::this()?;
        let (device, trained, silence) = (args.device.name(), &trained, args.engine.silence());
        let workers = NetworkWorkers { engine, program: &program, trained, device, blind: None, silence };
        let found = workers.predict(data.path(), recording.episodes(), &Bar::default())?;
        let samples = recording.episodes().iter().zip(&found).flat_map(|(entry, found)| {
            found.times_ns.iter().enumerate().map(|(i, &time_ns)| (format!("{}/{i}", entry.name), time_ns))
        });
        let samples: Vec<(String, u64)> = samples.collect();
        let boxes: Vec<Vec<Detection>> = found.into_iter().flat_map(|found| found.found).collect();
        predictions.write(recording.episodes(), &samples, &boxes, &beside)?;
        boxes.iter().map(Vec::len).sum()
    } else {
        let device = args.device.open()?;
        let detector = trained.load(&device)?;
        infer::predict_recording(&detector, &recording, &predictions, &beside, &device, &Bar::default())?
    };
    store::push(&predictions.folder)?;
    tell_boxes(n_boxes, recording.n_samples(), &predictions.folder, args.json)
}

/// What the boxes of a shard are a part of.
fn part_of(
    args: &PredictArgs,
    data: &Path,
    shard: Shard,
    whole: &MeasuredSplit,
    trained: &Trained,
) -> anyhow::Result<PredictionPart> {
    let n_episodes = u32::try_from(whole.episodes().len())?;
    Ok(PredictionPart {
        part: PartOf { shard, n_episodes },
        generator_version: env!("CARGO_PKG_VERSION").to_owned(),
        data: args.data.to_string().into(),
        data_sha256: sha256_of(&data.join(Manifest::FILE))?,
        split: whole.episodes()[0].split.name().to_owned(),
        network: args.run.to_string(),
        network_sha256: trained.sha256()?,
        episodes: Vec::new(),
    })
}

/// Says how many boxes were written.
pub fn tell_boxes(n_boxes: usize, n_samples: usize, to: &Path, as_json: bool) -> anyhow::Result<ExitStatus> {
    let words = format!("{n_boxes} boxes for {n_samples} samples: {}", to.display());
    let json = json!({"n_boxes": n_boxes, "n_samples": n_samples, "predictions": path_text(to)});
    print_either(words, &json, as_json)?;
    Ok(ExitStatus::Done)
}
