//! `harmzone calibrate`: the scores from which on a network warns and a car brakes for what it says.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use clap::Args;
use serde_json::json;

use super::train::tell_other_zone;
use super::{
    Bar, DeviceArg, ExitStatus, SamplesArgs, judge_all, number, one_of, path_text, print_either, tell,
    tell_seen,
};
use crate::dataset::LearnedError;
use crate::episode::Split;
use crate::eval::judge::Judge;
use crate::eval::safety::{Alarms, OperatingPoint};
use crate::eval::{self, EvalConfig, Mode, Protocol, eval_samples};
use crate::files::{self, FolderLock};
use crate::infer::{self, Trained};
use crate::model::{OperatingScore, OperatingScores, checkpoint};

/// A car brakes for fewer false alarms than it warns of: so many of them, where nothing else is said.
const BRAKING_SHARE: f64 = 0.2;
/// Shortest way of the car by which false alarms a kilometre are counted, metres: below it are cars that stand, whose place trembles.
const LEAST_DRIVEN_M: f64 = 1.0;
/// False alarms a kilometre among which is every alarm: the most that may be asked for.
const ALL_PER_KM: f64 = 1e6;

#[derive(Debug, Args)]
pub struct CalibrateArgs {
    /// Folder of a trained detector, or a checkpoint; the scores are written into it. With --judge also `small`
    run: PathBuf,
    /// Who decides on harm: another than the network itself has scores of its own, which are told and written nowhere: for
    /// `drive JUDGE:RUN@BRAKE,WARN`
    #[arg(long, value_parser = one_of(Judge::ALL, Judge::name), default_value = "network")]
    judge: Judge,
    #[command(flatten)]
    samples: SamplesArgs,
    /// Most false alarms that a warning may cost, per kilometre driven
    #[arg(long, value_name = "N", default_value_t = 10.0, value_parser = number(1e-3..=1e6_f64))]
    false_alarms_per_km: f64,
    /// Most false alarms that a car may brake hard for, per kilometre driven; a fifth of those that it may warn of where not given
    #[arg(long, value_name = "N", value_parser = number(1e-3..=1e6_f64))]
    braking_false_alarms_per_km: Option<f64>,
    #[command(flatten)]
    device: DeviceArg,
    /// Print the scores and what they cost as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: CalibrateArgs) -> anyhow::Result<ExitStatus> {
    let trained = Trained::find(&args.run)?;
    // Where the score goes.
    let path = match (&trained, args.judge) {
        (Trained::File(file), Judge::Network) => Some(file.path()),
        (Trained::Shipped(_), Judge::Network) => bail!(
            "`{}` is inside the program and stays as it is; give a run's folder or a checkpoint",
            args.run.display()
        ),
        _ => None,
    };
    // No training writes another network there meanwhile.
    let _lock = path.and_then(Path::parent).map(FolderLock::take).transpose()?;
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
    if !args.judge.fits(dataset.zone()) {
        bail!(
            "`{}` cannot judge by zone `{}` of the labels, which has no edge to measure a distance to; the hard rules take every zone: \
             {data}",
            args.judge.name(),
            dataset.zone().config().kind.name()
        );
    }
    if args.judge == Judge::Network {
        tell_other_zone(&trained, dataset.zone())?;
    }
    let allowed = [
        args.false_alarms_per_km,
        args.braking_false_alarms_per_km.unwrap_or(BRAKING_SHARE * args.false_alarms_per_km),
    ];
    ensure!(
        allowed[1] <= allowed[0],
        "a car may not brake hard for more false alarms than it warns of: --braking-false-alarms-per-km {} is more than \
         --false-alarms-per-km {}",
        allowed[1],
        allowed[0]
    );
    let mut config = EvalConfig { n_resamples: 0, ..EvalConfig::default() };
    config.safety.false_alarms_per_km = vec![allowed[0], allowed[1], ALL_PER_KM];
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
    check_driven(alarms.driven_km).with_context(|| format!("cannot choose a score: {data}"))?;
    let chosen = |point: &OperatingPoint| {
        let score = score_of(point, &alarms).with_context(|| format!("cannot choose a score: {data}"))?;
        tell_scant(point.max_false_alarms_per_km, alarms.driven_km).into_iter().for_each(tell);
        anyhow::Ok(OperatingScore {
            score,
            max_false_alarms_per_km: point.max_false_alarms_per_km,
            false_alarms_per_km: point.false_alarms_per_km,
            missed_per_event: point.missed_per_event,
            driven_km: alarms.driven_km,
            n_samples: samples.len(),
            sample_period_s: eval::mean_period_s(&samples),
        })
    };
    let chosen = OperatingScores { warning: chosen(&alarms.points[0])?, braking: chosen(&alarms.points[1])? };
    let kept = if let Some(path) = path {
        let seen = trained.seen()?.map(|seen| seen.with_watched(episodes));
        let (_, bytes) = trained.bytes()?;
        let bytes = checkpoint::with_operating_scores(bytes, &chosen, seen.as_ref(), path)?;
        // Scores of one network are not put into another.
        Trained::find(path)?.check_sha256(&trained.sha256()?)?;
        files::write_atomic(path, &bytes).with_context(|| format!("cannot write {}", path.display()))?;
        format!("kept in {}", path.display())
    } else {
        // Every digit: what is surer than nearly all lies close to one.
        let (judge, run) = (args.judge.name(), args.run.display());
        format!("for `drive {judge}:{run}@{},{}`", chosen.braking.score, chosen.warning.score)
    };
    let words =
        format!("warns from {}\nbrakes from {}; {kept}", told(&chosen.warning), told(&chosen.braking));
    let network = path.map_or_else(|| args.run.display().to_string(), path_text);
    let (operating_score, braking_score) = (&chosen.warning, &chosen.braking);
    let json = json!({
        "network": network,
        "judge": args.judge.name(),
        "operating_score": operating_score,
        "braking_score": braking_score,
    });
    print_either(words, &json, args.json)?;
    Ok(ExitStatus::Done)
}

/// Refuses a way that is too short to count alarms by.
fn check_driven(driven_km: f64) -> anyhow::Result<()> {
    let driven_m = 1000.0 * driven_km;
    ensure!(
        driven_m >= LEAST_DRIVEN_M,
        "the car drives {driven_m:.3} m in these samples, and false alarms a kilometre are counted from {LEAST_DRIVEN_M} m on; give \
         data of a car that drives"
    );
    Ok(())
}

/// The score of a point; `alarms` has one more in which every alarm counts.
fn score_of(point: &OperatingPoint, alarms: &Alarms) -> anyhow::Result<f64> {
    if alarms.points.iter().all(|point| point.score.is_none()) {
        bail!(
            "no box that counts is called harmful in these samples, so that there is nothing to choose from; train the network longer, or \
             give data with something harmful ahead"
        );
    }
    point.score.with_context(|| {
        format!(
            "no score spends as few as {} false alarms a kilometre on the {:.3} km driven here; allow more, or give more data",
            point.max_false_alarms_per_km, alarms.driven_km
        )
    })
}

/// A warning where less than one false alarm may come on all the way.
fn tell_scant(allowed_per_km: f64, driven_km: f64) -> Option<String> {
    (allowed_per_km * driven_km < 1.0).then(|| {
        format!(
            "{allowed_per_km} false alarms a kilometre are less than one on the {driven_km:.3} km driven here: the score only lies above the \
             highest false alarm, and more data may show that it is too low"
        )
    })
}

fn told(chosen: &OperatingScore) -> String {
    let missed = chosen.missed_per_event.map_or_else(
        || "no harmful event is told apart".to_owned(),
        |share| format!("{:.1} % of the harmful events are missed", 100.0 * share),
    );
    let OperatingScore { score, false_alarms_per_km, driven_km, .. } = chosen;
    let period =
        chosen.sample_period_s.map_or_else(String::new, |of| format!(" at a sample every {of:.1} s"));
    format!(
        "a score of {score:.3}: {false_alarms_per_km:.1} false alarms a kilometre over {driven_km:.3} km{period}, {missed}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a kilometre with points of these scores, the last of which lets every alarm count.
    fn with_scores(scores: [Option<f64>; 3]) -> Alarms {
        let points: Vec<serde_json::Value> = scores
            .map(|score| {
                json!({
                    "max_false_alarms_per_km": 2.0,
                    "score": score,
                    "n_false_alarms": 0,
                    "false_alarms_per_km": 0.0,
                    "n_harmful": 1,
                    "n_events": 1,
                    "warned": [],
                })
            })
            .into();
        serde_json::from_value(json!({ "driven_km": 0.5, "driven_h": 0.1, "points": points })).unwrap()
    }

    #[test]
    fn a_way_of_less_than_a_metre_bears_out_no_score() {
        let told = check_driven(0.0009).unwrap_err().to_string();
        assert!(told.contains("drives 0.900 m") && told.contains("from 1 m on"), "{told}");
        check_driven(0.002).unwrap();
    }

    #[test]
    fn no_alarm_at_all_is_told_from_too_many() {
        let told = |scores| {
            let alarms = with_scores(scores);
            score_of(&alarms.points[0], &alarms).map_err(|error| error.to_string())
        };
        assert_eq!(told([Some(0.5), None, Some(0.1)]), Ok(0.5));
        assert!(told([None, None, None]).unwrap_err().contains("nothing to choose from"));
        let too_many = told([None, None, Some(0.1)]).unwrap_err();
        assert!(
            too_many.contains("no score spends as few as 2") && too_many.contains("0.500 km"),
            "{too_many}"
        );
    }

    #[test]
    fn less_than_one_false_alarm_on_all_the_way_is_told() {
        assert!(tell_scant(10.0, 0.05).unwrap().contains("less than one on the 0.050 km"));
        assert_eq!(tell_scant(10.0, 0.2), None);
    }
}
