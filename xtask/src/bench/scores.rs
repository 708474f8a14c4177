//! `eval` against nuscenes-devkit's `accumulate`, and `label` against shapely: the same boxes on one thread, in turns.
//!
//! The rivals run in `scripts/bench_eval.py`, which does once what each line names. Both sides must come to the same APs
//! and to the same number of harmful objects.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;

use anyhow::{Context, ensure};
use serde::Deserialize;
use serde_json::{Value as Json, json};

use super::boxes::{self, N_SAMPLES};
use super::table::{Goal, Line, Outcome, Value};
use harmzone::eval::{self, EvalConfig, EvalSample, Mode, Protocol, json as box_files};
use harmzone::object::Harm;
use harmzone::progress::Progress;
use harmzone::sample::EgoState;
use harmzone::zone::{Zone, ZoneConfig};

/// How often both sides take turns; the devkit takes half a minute for its own.
const N_SCORINGS: usize = 3;
const N_LABELLINGS: usize = 9;
/// Ours in a turn of labelling, which takes milliseconds: the first finds what Python left of the cache.
const N_A_TURN: usize = 5;
/// Ours before the first that counts: memory is not there yet.
const N_WARM_UPS: usize = 2;

pub const SCORE: Goal = Goal::new(150.0, 100.0);
pub const EVALUATE: Goal = Goal::new(100.0, 60.0);
pub const LABEL: Goal = Goal::new(200.0, 100.0);

/// The Python side.
struct Rival {
    process: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
}

/// What it tells of one repetition.
#[derive(Deserialize)]
struct Told {
    seconds: f64,
    result: Json,
}

impl Rival {
    fn start(python: &Path, script: &Path, folder: &Path) -> anyhow::Result<Self> {
        let mut process = Command::new(python)
            .arg(script)
            .arg(folder)
            .env("OMP_NUM_THREADS", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let to = process.stdin.take().expect("it is piped");
        let from = BufReader::new(process.stdout.take().expect("it is piped"));
        Ok(Self { process, to, from })
    }

    /// Seconds of one repetition, and its result.
    fn once(&mut self, what: &str) -> anyhow::Result<(f64, Json)> {
        writeln!(self.to, "{what}")?;
        let mut line = String::new();
        self.from.read_line(&mut line)?;
        let told: Told = serde_json::from_str(&line)
            .with_context(|| format!("scripts/bench_eval.py ended without telling of `{what}`"))?;
        Ok((told.seconds, told.result))
    }

    fn stop(self) -> anyhow::Result<()> {
        let Self { mut process, to, .. } = self;
        drop(to);
        ensure!(process.wait()?.success(), "scripts/bench_eval.py failed");
        Ok(())
    }
}

/// What is scored and labelled.
struct Work {
    samples: Vec<EvalSample>,
    states: Vec<EgoState>,
    protocol: Protocol,
    zone: Zone,
}

impl Work {
    fn new() -> anyhow::Result<Self> {
        // The devkit's accumulate filters nothing.
        let config = EvalConfig { max_range_m: f64::INFINITY, n_resamples: 0, ..EvalConfig::default() };
        Ok(Self {
            samples: boxes::samples(),
            states: boxes::states(),
            protocol: Protocol::try_from(config)?,
            zone: Zone::try_from(ZoneConfig::default())?,
        })
    }

    fn write(&self, folder: &Path) -> anyhow::Result<()> {
        let found = self.samples.iter().map(|sample| (sample.id.as_str(), sample.detections.as_slice()));
        box_files::write_predictions(&folder.join("predictions.json"), found)?;
        box_files::write_truth(&folder.join("truth.json"), &self.samples)?;
        let of_state = |state: &EgoState| [state.speed_mps, state.steering_angle_rad, state.front_bumper_x_m];
        let states: Vec<[f64; 3]> = self.states.iter().map(of_state).collect();
        fs_err::write(folder.join("states.json"), json!(states).to_string())?;
        Ok(())
    }

    /// How many objects are harmful.
    fn label(&self) -> anyhow::Result<u64> {
        let mut n_harmful = 0;
        for (sample, state) in self.samples.iter().zip(&self.states) {
            let here = self.zone.at(state)?;
            for object in &sample.objects {
                let harm = here.harm_of_object(&object.truth)?.harm;
                n_harmful += u64::from(harm == Harm::Harmful);
            }
        }
        Ok(n_harmful)
    }

    /// APs of both classes at each threshold.
    fn score(&self) -> anyhow::Result<[Vec<f64>; 2]> {
        let metrics = eval::score(&self.samples, &self.protocol, Mode::Id)?;
        let of_class = |class| metrics.per_threshold.total.get(class).iter().copied().flatten().collect();
        Ok(Harm::ALL.map(of_class))
    }

    fn evaluate(&self) -> anyhow::Result<()> {
        eval::evaluate(&self.samples, &self.protocol, Mode::Id)?;
        Ok(())
    }
}

/// Seconds of one call, and its result.
fn timed<T>(work: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<(f64, T)> {
    let begin = Instant::now();
    let result = work()?;
    Ok((begin.elapsed().as_secs_f64(), result))
}

/// Races what is asked for; `root` is the source tree.
///
/// # Errors
/// Both sides come to other results; files cannot be written.
pub fn race(
    root: &Path,
    with_labels: bool,
    with_scores: bool,
    progress: &dyn Progress,
) -> anyhow::Result<Vec<Line>> {
    let names = [("`label` against shapely, one thread", LABEL, with_labels)];
    let of_scores = [
        ("`eval` against nuscenes-devkit, scores alone", SCORE, with_scores),
        ("`eval` against nuscenes-devkit, with everything", EVALUATE, with_scores),
    ];
    let wanted = names.into_iter().chain(of_scores).filter(|(_, _, is_wanted)| *is_wanted);
    let wanted: Vec<(&str, Goal)> = wanted.map(|(what, goal, _)| (what, goal)).collect();
    let python = root.join(".venv-test/bin/python");
    let outcomes: Vec<(Outcome, String)> = if python.is_file() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
        pool.install(|| measure(root, &python, with_labels, with_scores, progress))?
    } else {
        let absent = Outcome::Absent("`make setup-test` installs nuscenes-devkit and shapely".to_owned());
        vec![(absent, String::new()); wanted.len()]
    };
    let line = |((what, goal), (outcome, note)): ((&str, Goal), (Outcome, String))| Line {
        what: what.to_owned(),
        unit: "times as fast",
        goal: Some(goal),
        outcome,
        note,
    };
    Ok(wanted.into_iter().zip(outcomes).map(line).collect())
}

fn measure(
    root: &Path,
    python: &Path,
    with_labels: bool,
    with_scores: bool,
    progress: &dyn Progress,
) -> anyhow::Result<Vec<(Outcome, String)>> {
    let work = Work::new()?;
    let folder = tempfile::tempdir()?;
    work.write(folder.path())?;
    let mut rival = Rival::start(python, &root.join("scripts/bench_eval.py"), folder.path())?;
    let mut found = Vec::new();
    if with_labels {
        progress.start("label", N_LABELLINGS as u64);
        found.push(race_labels(&work, &mut rival, progress)?);
    }
    if with_scores {
        progress.start("eval", N_SCORINGS as u64);
        found.extend(race_scores(&work, &mut rival, progress)?);
    }
    progress.finish();
    rival.stop()?;
    Ok(found)
}

fn outcome(theirs: &[f64], ours: &[f64]) -> Outcome {
    Outcome::Measured(Value::ratio(theirs, ours).expect("each was done at least once"))
}

fn race_labels(work: &Work, rival: &mut Rival, progress: &dyn Progress) -> anyhow::Result<(Outcome, String)> {
    let (mut ours, mut theirs, mut arrays) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..N_WARM_UPS {
        work.label()?;
    }
    for _ in 0..N_LABELLINGS {
        let mut n_harmful = 0;
        for _ in 0..N_A_TURN {
            let (seconds, found) = timed(|| work.label())?;
            ours.push(seconds);
            n_harmful = found;
        }
        for (what, times) in [("shapely", &mut theirs), ("shapely_arrays", &mut arrays)] {
            let (seconds, found) = rival.once(what)?;
            ensure!(found == json!(n_harmful), "{n_harmful} objects are harmful, by {what} {found}");
            times.push(seconds);
        }
        progress.advance(1);
    }
    let by_arrays = Value::ratio(&arrays, &ours).expect("it was done").median;
    let ms = 1e3 * Value::of(&ours).expect("it was done").median;
    let n_objects: usize = work.samples.iter().map(|sample| sample.objects.len()).sum();
    let note = format!(
        "{n_objects} objects in {ms:.1} ms, shapely object by object; {by_arrays:.1} times shapely's array functions"
    );
    Ok((outcome(&theirs, &ours), note))
}

fn race_scores(
    work: &Work,
    rival: &mut Rival,
    progress: &dyn Progress,
) -> anyhow::Result<[(Outcome, String); 2]> {
    let (mut scores, mut everything, mut theirs) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..N_WARM_UPS {
        work.evaluate()?;
    }
    for _ in 0..N_SCORINGS {
        let (seconds, aps) = timed(|| work.score())?;
        scores.push(seconds);
        everything.push(timed(|| work.evaluate())?.0);
        let (seconds, found) = rival.once("accumulate")?;
        theirs.push(seconds);
        for (class, aps) in Harm::ALL.into_iter().zip(&aps) {
            for (i, ap) in aps.iter().enumerate() {
                let devkit = found[class.name()][i].as_f64();
                let is_same = devkit.is_some_and(|devkit| (ap - devkit).abs() < 1e-9);
                ensure!(
                    is_same,
                    "{} at threshold {i}: our AP is {ap}, the devkit's {devkit:?}",
                    class.name()
                );
            }
        }
        progress.advance(1);
    }
    let note = |ours: &[f64]| {
        let ms = 1e3 * Value::of(ours).expect("it was done").median;
        let devkit_s = Value::of(&theirs).expect("it was done").median;
        format!("{N_SAMPLES} samples in {ms:.0} ms on one thread, the devkit in {devkit_s:.1} s; same APs")
    };
    Ok([(outcome(&theirs, &scores), note(&scores)), (outcome(&theirs, &everything), note(&everything))])
}
