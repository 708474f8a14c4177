//! `harmzone baseline`: the boxes of a rival of the network's class branch, to be scored as any detector's.

use std::path::PathBuf;

use anyhow::{anyhow, bail};
use clap::Args;

use super::detectors::judge_all;
use super::eval::tell_learned;
use super::predict::tell_boxes;
use super::{Bar, DeviceArg, ExitStatus, SamplesArgs};
use crate::config;
use crate::dataset::Dataset;
use crate::episode::Split;
use crate::eval::judge::Judge;
use crate::infer::{self, ClosedSet, Predictions, Strangeness, Trained};

#[derive(Debug, Args)]
pub struct BaselineArgs {
    /// Who decides on harm: `zone`, the zone's rule over the network's boxes; `zone-soft`, with a probability by the
    /// distance to the zone's edge; `zone-expected`, by the spreads of boxes and state; `both`, that and the network;
    /// `speed-zone`, `speed-zone-soft`, the zone straight ahead whatever the steering angle; `closed-msp`,
    /// `closed-energy`, `closed-mahalanobis`, by the kind of object and harmful where the kind is in doubt
    name: String,
    /// Whose boxes: a run's folder, a checkpoint, or `small`, the network inside the program
    run: PathBuf,
    #[command(flatten)]
    samples: SamplesArgs,
    /// Labelled data set that a closed set's network was trained on; its train split fits the closed-* baselines
    #[arg(long, value_name = "DIR")]
    fit: Option<PathBuf>,
    /// Folder for one MCAP an episode and predictions.json; default as of `predict`, with `-<name>` at its end
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArg,
    /// Replace predictions that are there
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

/// A rival by its name.
enum Rival {
    Zone(Judge),
    ClosedSet(Strangeness),
}

impl Rival {
    fn named(name: &str) -> anyhow::Result<Self> {
        let judges = || Judge::ALL.into_iter().filter(|&judge| judge != Judge::Network);
        let closed = Strangeness::ALL.into_iter().find(|score| score.name() == name).map(Self::ClosedSet);
        judges().find(|judge| judge.name() == name).map(Self::Zone).or(closed).ok_or_else(|| {
            let names = judges().map(Judge::name).chain(Strangeness::ALL.map(Strangeness::name));
            anyhow!("no baseline `{name}`; there are: {}", names.collect::<Vec<_>>().join(", "))
        })
    }
}

pub fn run(args: BaselineArgs) -> anyhow::Result<ExitStatus> {
    let rival = Rival::named(&args.name)?;
    let trained = Trained::find(&args.run)?;
    let folder = if let Some(out) = &args.out {
        out.clone()
    } else {
        let mut folder = trained.predictions_folder(&args.samples.data)?.into_os_string();
        folder.push(format!("-{}", args.name));
        folder.into()
    };
    let _lock = Predictions::take_folder(&folder, args.force)?;
    let device = args.device.open()?;
    let dataset = args.samples.open()?;
    tell_learned(&trained, dataset.episodes())?;
    let judged = match rival {
        Rival::Zone(judge) => {
            if !judge.fits(dataset.zone()) {
                bail!(
                    "`{}` cannot judge by zone `{}` of the labels, which has no edge to measure a distance to; the hard rules take every zone",
                    judge.name(),
                    dataset.zone().config().kind.name()
                );
            }
            let detector = trained.load(&device)?;
            let found =
                infer::detect_for(judge, &detector, dataset.samples(), None, &device, &Bar::default())?;
            judge_all(judge, &found, &dataset)?
        }
        Rival::ClosedSet(score) => {
            let Some(fit) = &args.fit else {
                bail!("`{}` is fitted on what its network was trained on; give that by --fit DIR", args.name)
            };
            let bar = Bar::default();
            let detector = trained.load(&device)?;
            let training = Dataset::open(fit, &args.samples.labels, Split::Train)?;
            let set = ClosedSet::fit_to(&detector, &training, &device, &bar)?;
            let found = infer::detect_kinds(&detector, &dataset, "predict", &device, &bar)?;
            found.iter().map(|found| set.judge(score, found)).collect()
        }
    };
    let set = format!("{} of {}", args.name, args.run.display());
    let predictions = Predictions { folder, set, config_toml: config::to_toml(&trained.config()?) };
    let samples = dataset.samples().iter().map(|sample| (sample.id.clone(), sample.measured.time_ns));
    predictions.write(dataset.episodes(), &samples.collect::<Vec<_>>(), &judged, &|_| Ok(()))?;
    tell_boxes(judged.iter().map(Vec::len).sum(), judged.len(), &predictions.folder, args.json)
}
