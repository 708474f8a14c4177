//! `harmzone export predictions` and `harmzone import predictions`: boxes to and from other tools.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;

use super::predict::tell_boxes;
use super::zones::ZoneArgs;
use super::{Bar, ExitStatus, one_of, split, tell};
use crate::episode::Split;
use crate::episode::manifest::{LabelManifest, label_sets};
use crate::exchange::kitti::{KittiReader, KittiWriter};
use crate::exchange::nuscenes::{ResultsReader, ResultsWriter};
use crate::exchange::{
    ExportPredictions, HarmRule, ImportPredictions, ReadBoxes, WriteBoxes, export_predictions,
    import_predictions,
};
use crate::export::nuscenes::Naming;
use crate::zone::{Zone, ZoneConfig};

/// A format of predictions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BoxFormat {
    Nuscenes,
    Kitti,
}

impl BoxFormat {
    const ALL: [Self; 2] = [Self::Nuscenes, Self::Kitti];

    fn name(self) -> &'static str {
        match self {
            Self::Nuscenes => "nuscenes",
            Self::Kitti => "kitti",
        }
    }
}

#[derive(Debug, Args)]
pub struct ExportPredictionsArgs {
    /// Folder of predictions, or a predictions.json
    predictions: PathBuf,
    /// File to make, a folder for `kitti`
    out: PathBuf,
    /// Data set that the predictions are of
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// `nuscenes`: one results JSON in the global frame, by sample tokens; `kitti`: one NNNNNN.txt a frame, boxes in the rectified
    /// camera's frame, without velocities
    #[arg(long, value_parser = one_of(BoxFormat::ALL, BoxFormat::name))]
    format: BoxFormat,
    /// Names of the classes: `harm`, harmful and harmless; `harm-as-car-truck`, car and truck, which the devkit's own evaluation takes
    #[arg(long, default_value = "harm", value_parser = one_of([Naming::Harm, Naming::HarmAsCarTruck], Naming::name))]
    names: Naming,
    /// Split; without it, the first of val, dev and test that the data set has
    #[arg(long, value_parser = split())]
    split: Option<Split>,
    /// Replace what is there
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn export(args: &ExportPredictionsArgs) -> anyhow::Result<ExitStatus> {
    let (out, data) = (&args.out, &args.data);
    let writer: Box<dyn WriteBoxes> = match args.format {
        BoxFormat::Nuscenes => Box::new(ResultsWriter::create(out, data, args.names, args.force)?),
        BoxFormat::Kitti => Box::new(KittiWriter::create(out, data, args.names, args.force)?),
    };
    let request = ExportPredictions { predictions: &args.predictions, data: &args.data, split: args.split };
    let (n_samples, n_boxes) = export_predictions(&request, writer, &Bar::default())?;
    tell_boxes(n_boxes, n_samples, &args.out, args.json)
}

/// How names become harm, as the flag has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HarmFlag {
    Names,
    CarTruck,
    Zone,
}

impl HarmFlag {
    const ALL: [Self; 3] = [Self::Names, Self::CarTruck, Self::Zone];

    fn name(self) -> &'static str {
        match self {
            Self::Names => "names",
            Self::CarTruck => "car-truck",
            Self::Zone => "zone",
        }
    }
}

#[derive(Debug, Args)]
pub struct ImportPredictionsArgs {
    /// Predictions of another tool
    predictions: PathBuf,
    /// Data set that the predictions are of
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// `nuscenes`: one results JSON in the global frame, by sample tokens; `kitti`: one NNNNNN.txt a frame, boxes in the rectified
    /// camera's frame, without velocities
    #[arg(long, value_parser = one_of(BoxFormat::ALL, BoxFormat::name))]
    format: BoxFormat,
    /// Folder for one MCAP an episode and predictions.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Where a box's harm comes from: `names`, harmful or harmless; `car-truck`, car is harmful and truck harmless; `zone`, the danger
    /// zone decides, whatever the names: for detectors of cars, pedestrians and so on
    #[arg(long, default_value = "names", value_parser = one_of(HarmFlag::ALL, HarmFlag::name))]
    harm: HarmFlag,
    /// With `--harm zone`: label set whose zone decides; without it, the zone of --zone and --set, else that of `rect` where it is there
    #[arg(long, value_name = "SET")]
    labels: Option<String>,
    #[command(flatten)]
    zone: ZoneArgs,
    /// Split; without it, the first of val, dev and test that the data set has
    #[arg(long, value_parser = split())]
    split: Option<Split>,
    /// Replace predictions that are there
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn import(args: &ImportPredictionsArgs) -> anyhow::Result<ExitStatus> {
    if args.harm != HarmFlag::Zone && (args.labels.is_some() || args.zone.is_given()) {
        bail!(
            "--labels, --zone and --set say which zone decides on harm; that is with --harm zone alone (found --harm {})",
            args.harm.name()
        );
    }
    if args.labels.is_some() && args.zone.is_given() {
        bail!("--labels takes the zone of a label set; --zone and --set give another: leave one of them out");
    }
    let harm = match args.harm {
        HarmFlag::Names => HarmRule::Names,
        HarmFlag::CarTruck => HarmRule::CarTruck,
        HarmFlag::Zone => HarmRule::Zone(Box::new(zone_of(args)?)),
    };
    let mut reader: Box<dyn ReadBoxes> = match args.format {
        BoxFormat::Nuscenes => Box::new(ResultsReader::open(&args.predictions, &args.data)?),
        BoxFormat::Kitti => Box::new(KittiReader::open(&args.predictions, &args.data)?),
    };
    let request =
        ImportPredictions { data: &args.data, split: args.split, harm, out: &args.out, force: args.force };
    let imported = import_predictions(&request, reader.as_mut(), &Bar::default())?;
    let (n_boxes, n_samples) = (imported.n_boxes, imported.n_samples);
    tell_boxes(n_boxes, n_samples, &imported.folder, args.json)?;
    if imported.n_unknown == 0 {
        return Ok(ExitStatus::Done);
    }
    tell(format!(
        "{} lists of boxes are of no sample of the split, and were left out: {}",
        imported.n_unknown,
        args.predictions.display()
    ));
    Ok(ExitStatus::DoneWithLosses)
}

/// The zone that decides on harm.
fn zone_of(args: &ImportPredictionsArgs) -> anyhow::Result<Zone> {
    const DEFAULT_SET: &str = "rect";
    let is_there = || Ok::<_, anyhow::Error>(label_sets(&args.data)?.iter().any(|set| set == DEFAULT_SET));
    let set = match args.labels.as_deref() {
        Some(set) => Some(set),
        None if args.zone.is_given() => None,
        None => is_there()?.then_some(DEFAULT_SET),
    };
    let config: ZoneConfig = match set {
        Some(set) => toml::from_str(&LabelManifest::read(&args.data, set)?.zone_toml).with_context(|| {
            format!("the zone of label set `{set}` is not valid: {}", args.data.display())
        })?,
        None => args.zone.load()?,
    };
    Ok(Zone::try_from(config)?)
}
