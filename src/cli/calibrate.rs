//! `harmzone calibrate`: the score from which on a network warns.

use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use clap::Args;
use serde_json::json;

use super::{
    Bar, DeviceArg, ExitStatus, SamplesArgs, judge_all, number, one_of, path_text, print_either, tell_seen,
};
use crate::dataset::LearnedError;
use crate::episode::Split;
use crate::eval::judge::Judge;
use crate::eval::{self, EvalConfig, Mode, Protocol, eval_samples};
use crate::files;
use crate::infer::{self, Trained};
use crate::model::{OperatingScore, checkpoint};

#[derive(Debug, Args)]
pub struct CalibrateArgs {
    /// Folder of a trained detector, or a checkpoint; the score is written into it. With --judge also `small`
    run: PathBuf,
    /// Who decides on harm: another than the network itself has a score of its own, which is told and written nowhere: for
    /// `drive JUDGE:RUN@SCORE`
    #[arg(long, value_parser = one_of(Judge::ALL, Judge::name), default_value = "network")]
    judge: Judge,
    #[command(flatten)]
    samples: SamplesArgs,
    /// Most false alarms that a warning may cost, per kilometre driven
    #[arg(long, value_name = "N", default_value_t = 10.0, value_parser = number(1e-3..=1e6_f64))]
    false_alarms_per_km: f64,
    #[command(flatten)]
    device: DeviceArg,
    /// Print the score and what it costs as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: CalibrateArgs) -> anyhow::Result<ExitStatus> {
    let trained = Trained::find(&args.run)?;
    // Where the score goes.
    let path = match (&trained, args.judge) {
        (Trained::File(path), Judge::Network) => Some(path),
        (Trained::Shipped(_), Judge::Network) => bail!(
            "`{}` is inside the program and stays as it is; give a run's folder or a checkpoint",
            args.run.display()
        ),
        _ => None,
    };
    let dataset = args.samples.open()?;
    let data = args.samples.data.display();
    let episodes = dataset.episodes();
    ensure!(
        episodes.iter().all(|entry| entry.split != Split::Test),
        "a score is chosen on val or dev; split test only reports: {data}"
    );
    if let Err(LearnedError { n_learned, n_episodes, first }) = tell_seen(&trained, episodes)? {
        bail!(
            "the network learned from {n_learned} of the {n_episodes} episodes, the first is `{first}`, and is surer of them than \
             of a drive that is new to it; choose on another split (val or dev): {data}"
        );
    }
    let mut config = EvalConfig { n_resamples: 0, ..EvalConfig::default() };
    config.safety.false_alarms_per_km = vec![args.false_alarms_per_km];
    let device = args.device.open()?;
    let found = infer::detect_for(
        args.judge,
        &trained.load(&device)?,
        dataset.samples(),
        None,
        &device,
        &Bar::default(),
    )?;
    let samples = eval_samples(dataset.samples(), &judge_all(args.judge, &found, &dataset)?);
    let evaluation = eval::evaluate(&samples, &Protocol::try_from(config)?, Mode::Id)?;
    let alarms = evaluation.safety.alarms.with_context(|| {
        format!("the car does not move in these samples, so that false alarms a kilometre cannot be counted: {data}")
    })?;
    let point = &alarms.points[0];
    let score = point.score.with_context(|| {
        format!(
            "no score spends as few as {} false alarms a kilometre on the {:.3} km driven here; allow more, or give more \
             data: {data}",
            args.false_alarms_per_km, alarms.driven_km
        )
    })?;
    let chosen = OperatingScore {
        score,
        max_false_alarms_per_km: args.false_alarms_per_km,
        false_alarms_per_km: point.false_alarms_per_km,
        missed_per_event: point.missed_per_event,
        driven_km: alarms.driven_km,
        n_samples: samples.len(),
    };
    let kept = match path {
        Some(path) => {
            let seen = trained.seen()?.map(|seen| seen.with_watched(episodes));
            let (_, bytes) = trained.bytes()?;
            let bytes = checkpoint::with_operating_score(&bytes, &chosen, seen.as_ref(), path)?;
            files::write_atomic(path, &bytes).with_context(|| format!("cannot write {}", path.display()))?;
            format!("kept in {}", path.display())
        }
        None => format!("for `drive {}:{}@{score:.3}`", args.judge.name(), args.run.display()),
    };
    let missed = chosen.missed_per_event.map_or_else(
        || "no harmful event is told apart".to_owned(),
        |share| format!("{:.1} % of the harmful events are missed", 100.0 * share),
    );
    let words = format!(
        "warns from a score of {score:.3}: {:.1} false alarms a kilometre over {:.3} km, {missed}; {kept}",
        chosen.false_alarms_per_km, chosen.driven_km,
    );
    let network = path.map_or_else(|| args.run.display().to_string(), |path| path_text(path));
    let json = json!({"network": network, "judge": args.judge.name(), "operating_score": chosen});
    print_either(words, &json, args.json)?;
    Ok(ExitStatus::Done)
}
