//! `harmzone sweep`: a dataset's frames at other speeds and steering angles.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;

use super::eval::tell_learned;
use super::{Bar, DeviceArg, ExitStatus, SamplesArgs, print_summary, tell};
use crate::config::{self, Checked};
use crate::eval::Protocol;
use crate::eval::judge::Judge;
use crate::eval::sweep::SweepConfig;
use crate::files::FolderLock;
use crate::infer::{self, Trained};
use crate::report::sweeps::{self, SweepRequest};
use crate::zone::Zone;

#[derive(Debug, Args)]
pub struct SweepArgs {
    /// Folder of a trained detector, a checkpoint, or `small`, the network inside the program
    run: PathBuf,
    #[command(flatten)]
    samples: SamplesArgs,
    /// Folder for sweeps.json, sweeps.csv, sweep.toml, plots (SVG and PNG) and pictures
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What is swept (TOML); `configs/sweep.toml` holds the defaults
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key of the config, e.g. n_episodes=4
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    #[command(flatten)]
    device: DeviceArg,
    /// Replace the sweeps of an existing output folder
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: SweepArgs) -> anyhow::Result<ExitStatus> {
    let trained = Trained::find(&args.run)?;
    let mut base = SweepConfig::default();
    if let Some(own) = trained.operating_score()? {
        base.picture_min_score = own.score as f32;
    }
    let mut config = config::load_over(&base, args.config.as_deref(), &args.overrides)?;
    let _lock = FolderLock::take(&args.out)?;
    sweeps::refuse_to_overwrite(&args.out, args.force)?;
    let device = args.device.open()?;
    let dataset = args.samples.open()?;
    config.judges = judges_for(&config.judges, dataset.zone())?;
    tell_learned(&trained, dataset.episodes())?;
    let config = Checked::try_from(config)?;
    let detector = trained.load(&device)?;
    let (swept, series) = infer::sweep(&detector, &dataset, &config, &device, &Bar::default())?;
    let request = SweepRequest {
        swept: &swept,
        series: &series,
        dataset: &dataset,
        config: &config,
        protocol: &Protocol::try_from(trained.eval_config()?)?,
        out: &args.out,
    };
    print_summary(&sweeps::run(&request)?, args.json)?;
    Ok(ExitStatus::Done)
}

/// The judges of a sweep that can judge by the labels' zone; one that was asked for and cannot is refused.
fn judges_for(judges: &[Judge], zone: &Zone) -> anyhow::Result<Vec<Judge>> {
    let (fitting, others): (Vec<Judge>, Vec<Judge>) = judges.iter().partition(|judge| judge.fits(zone));
    let names = |judges: &[Judge]| judges.iter().map(|judge| judge.name()).collect::<Vec<_>>().join(", ");
    let kind = zone.config().kind.name();
    if others.is_empty() {
        return Ok(fitting);
    }
    if judges != Judge::ALL {
        bail!(
            "judges: {} cannot judge by zone `{kind}`, which has no edge to measure a distance to; valid there are {}",
            names(&others),
            names(&fitting)
        );
    }
    tell(format!("{} are left out: zone `{kind}` has no edge to measure a distance to", names(&others)));
    Ok(fitting)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::zone::{ZoneConfig, ZoneKind};

    #[test]
    fn judges_that_a_zone_has_no_edge_for_are_left_out_or_refused_where_they_were_asked_for() {
        let zone = |kind| Zone::try_from(ZoneConfig { kind, ..ZoneConfig::default() }).unwrap();
        assert_eq!(judges_for(&Judge::ALL, &zone(ZoneKind::Rect)).unwrap(), Judge::ALL);
        let arc = zone(ZoneKind::Arc);
        let left = judges_for(&Judge::ALL, &arc).unwrap();
        assert_eq!(left, [Judge::Network, Judge::Zone, Judge::ZoneExpected, Judge::Both, Judge::SpeedZone]);
        let error = judges_for(&[Judge::Zone, Judge::ZoneSoft], &arc).unwrap_err().to_string();
        assert!(error.contains("zone-soft") && error.contains("`arc`"), "{error}");
    }
}
