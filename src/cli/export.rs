//! `harmzone export`: data sets in the formats of other tools, one subcommand a format, and predictions.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::exchange::{self, ExportPredictionsArgs};
use super::{Bar, ExitStatus, one_of, print_summary, tell};
use crate::export::kitti::{self, KittiRequest};
use crate::export::nuscenes::{self, Naming, NuScenesRequest, Release};

#[derive(Debug, Args)]
pub struct ExportArgs {
    #[command(subcommand)]
    format: Format,
}

#[derive(Debug, Subcommand)]
enum Format {
    /// A folder of nuScenes: for nuscenes-devkit, mmdetection3d and what else reads it
    Nuscenes(NuScenesArgs),
    /// A folder of KITTI's object set: for mmdetection3d, OpenPCDet and what else reads it
    Kitti(KittiArgs),
    /// A detector's boxes, for the evaluation of another tool
    Predictions(ExportPredictionsArgs),
}

#[derive(Debug, Args)]
struct NuScenesArgs {
    /// Data set to export
    data: PathBuf,
    /// Folder to make; it appears when it is whole
    out: PathBuf,
    /// What categories tell: `harm`, harmful or harmless; `harm-as-car-truck`, the same under names that the devkit's evaluation
    /// and mmdetection3d know; `kinds`, as car, pedestrian and barrier; `source`, nuScenes' nearest to the objects' own
    #[arg(long, default_value = "harm", value_parser = one_of(Naming::ALL, Naming::name))]
    categories: Naming,
    /// Label set, for categories that tell harm
    #[arg(long, value_name = "SET", default_value = "rect")]
    labels: String,
    /// `v1.0` makes v1.0-trainval and v1.0-test; `v1.0-mini` takes up to 8 episodes to train and 2 others
    #[arg(long, default_value = "v1.0", value_parser = one_of(Release::ALL, Release::name))]
    version: Release,
    /// Replace an export that is there
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: ExportArgs) -> anyhow::Result<ExitStatus> {
    match args.format {
        Format::Nuscenes(args) => export_nuscenes(&args),
        Format::Kitti(args) => export_kitti(&args),
        Format::Predictions(args) => exchange::export(&args),
    }
}

fn export_nuscenes(args: &NuScenesArgs) -> anyhow::Result<ExitStatus> {
    let request = NuScenesRequest {
        dataset: &args.data,
        out: &args.out,
        labels: &args.labels,
        naming: args.categories,
        release: args.version,
        force: args.force,
    };
    let summary = nuscenes::run(&request, &Bar::default())?;
    print_summary(&summary, args.json)?;
    if summary.left_out.is_empty() {
        return Ok(ExitStatus::Done);
    }
    tell(format!(
        "left out, since the version has no section for their split: {}",
        summary.left_out.join(", ")
    ));
    Ok(ExitStatus::DoneWithLosses)
}

#[derive(Debug, Args)]
struct KittiArgs {
    /// Data set to export
    data: PathBuf,
    /// Folder to make; it appears when it is whole
    out: PathBuf,
    /// What types tell: `harm`, Harmful or Harmless; `harm-as-car-truck`, the same as Car and Truck; `kinds`, as Car, Pedestrian and Misc;
    /// `source`, the objects' own categories
    #[arg(long, default_value = "harm", value_parser = one_of(Naming::ALL, Naming::name))]
    categories: Naming,
    /// Label set, for categories that tell harm
    #[arg(long, value_name = "SET", default_value = "rect")]
    labels: String,
    /// Replace an export that is there
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

fn export_kitti(args: &KittiArgs) -> anyhow::Result<ExitStatus> {
    let request = KittiRequest {
        dataset: &args.data,
        out: &args.out,
        labels: &args.labels,
        naming: args.categories,
        force: args.force,
    };
    let summary = kitti::run(&request, &Bar::default())?;
    print_summary(&summary, args.json)?;
    if summary.n_pictures_left_out > 0 {
        tell(format!(
            "left out, since KITTI's object set has the front camera alone: {} pictures of further cameras",
            summary.n_pictures_left_out
        ));
    }
    Ok(ExitStatus::Done)
}
