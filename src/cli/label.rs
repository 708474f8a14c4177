//! `harmzone label`.

use clap::Args;

use super::engine::EngineArgs;
use super::zones::ZoneArgs;
use super::{Bar, ExitStatus, print_summary};
use crate::episode::Shard;
use crate::label::{self, LabelOptions, LabelWorkers};
use crate::store::{Access, Location};
use crate::worker::Program;

#[derive(Debug, Args)]
pub struct LabelArgs {
    /// The data set's folder or URL
    dataset: Location,
    #[command(flatten)]
    zone: ZoneArgs,
    /// Name of the label set [default: the zone's kind]
    #[arg(long, value_name = "NAME")]
    labels: Option<String>,
    /// Label one of N parts, I from 0: every N-th episode; `harmzone label` without it then joins the parts and labels what
    /// they lack
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Replace a label set made with another zone
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    engine: EngineArgs,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: LabelArgs) -> anyhow::Result<ExitStatus> {
    let zone = args.zone.load()?;
    let set = args.labels.unwrap_or_else(|| zone.kind.name().to_owned());
    let cluster = args.engine.cluster_alone()?;
    let dataset = args.dataset.open(Access::Write)?;
    let program = Program::this()?;
    let silence = args.engine.silence();
    let workers = cluster.as_ref().map(|engine| LabelWorkers { engine, program: &program, silence });
    let options = LabelOptions { force: args.force, shard: args.shard, workers };
    let done = label::run_with(dataset.path(), &zone, &set, &options, &Bar::default());
    // Also what is whole of a set that broke off, with which the same command goes on.
    let pushed = dataset.push();
    let summary = done?;
    pushed?;
    print_summary(&summary, args.json)?;
    Ok(if summary.lost.is_empty() { ExitStatus::Done } else { ExitStatus::DoneWithLosses })
}
