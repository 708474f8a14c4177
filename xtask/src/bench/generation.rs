//! `gen` against bare MuJoCo, its samples a second, and its LiDAR; each from `xtask bench-gen`, a process of its own.

use std::collections::BTreeMap;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use serde::Deserialize;

use super::table::{Goal, Line, Outcome, Value};

const CLEAR_NOON: Goal = Goal::new(1.0, 1.1);
const ALL_WEATHERS: Goal = Goal::new(1.1, 1.2);
const TWO_JOBS: Goal = Goal::new(20.0, 15.0);
const RAYS: Goal = Goal::new(5.0, 3.0);

/// Episodes in ClearNoon: each of the five towns twice.
const N_CLEAR_EPISODES: u32 = 10;
/// Each of the 18 weathers twice.
const N_WEATHER_EPISODES: u32 = 36;
/// Samples of an episode that is measured against the bare calls.
const N_SAMPLES: u32 = 16;
/// Samples that one process and two make, whose time counts.
const N_RUN_SAMPLES: u32 = 320;

/// What `bench-gen --json` tells.
#[derive(Deserialize)]
pub struct Told {
    /// The OpenGL that draws.
    pub renderer: String,
    pub episodes: Vec<Episode>,
    runs: Option<Runs>,
}

/// One episode's times, milliseconds a sample.
#[derive(Deserialize)]
pub struct Episode {
    weather: String,
    gen_ms: f64,
    bare_ms: f64,
    pub pictures_ms: f64,
    n_rays: u32,
    rays_ms: f64,
    bare_rays_ms: f64,
}

#[derive(Deserialize)]
struct Runs {
    one_job_samples_per_s: f64,
    jobs_samples_per_s: f64,
}

/// Measures all towns, in ClearNoon unless the flags name weathers.
///
/// # Errors
/// Nothing can be generated here.
pub fn bench_gen(flags: &[String]) -> anyhow::Result<Told> {
    let output = Command::new(std::env::current_exe()?)
        .args(["bench-gen", "--town", "all", "--json"])
        .args(flags)
        .stderr(Stdio::inherit())
        .output()?;
    ensure!(output.status.success(), "`xtask bench-gen` ended with {}", output.status);
    serde_json::from_slice(&output.stdout).context("`xtask bench-gen` told something else than its figures")
}

/// The default weather against bare calls, and its LiDAR; each where it is wanted.
///
/// # Errors
/// Nothing can be generated here.
pub fn clear_noon(with_ratio: bool, with_rays: bool) -> anyhow::Result<Vec<Line>> {
    if !with_ratio && !with_rays {
        return Ok(Vec::new());
    }
    let flags =
        format!("--episodes {N_CLEAR_EPISODES} --run-samples 0 --set val_every=0 --set samples={N_SAMPLES}");
    let episodes = bench_gen(&split(&flags))?.episodes;
    let lines = [with_ratio.then(|| against_bare(&episodes)), with_rays.then(|| rays(&episodes))];
    Ok(lines.into_iter().flatten().collect())
}

/// What two processes make in a second.
///
/// # Errors
/// Nothing can be generated here.
pub fn two_jobs() -> anyhow::Result<Line> {
    let told = bench_gen(&split(&format!("--episodes 0 --run-samples {N_RUN_SAMPLES}")))?;
    let runs = told.runs.context("`xtask bench-gen` told no rate")?;
    Ok(Line {
        what: "`gen --jobs 2`, ClearNoon".to_owned(),
        unit: "samples a second",
        goal: Some(TWO_JOBS),
        outcome: Outcome::Measured(Value::single(runs.jobs_samples_per_s)),
        note: format!(
            "{N_RUN_SAMPLES} samples, starting included; one job makes {:.1} a second",
            runs.one_job_samples_per_s
        ),
    })
}

fn split(flags: &str) -> Vec<String> {
    flags.split(' ').map(str::to_owned).collect()
}

fn against_bare(episodes: &[Episode]) -> Line {
    let gen_ms: Vec<f64> = episodes.iter().map(|of| of.gen_ms).collect();
    let bare_ms: Vec<f64> = episodes.iter().map(|of| of.bare_ms).collect();
    let ratios: Vec<f64> = episodes.iter().map(|of| of.gen_ms / of.bare_ms).collect();
    let value = Value::of(&ratios).expect("episodes were asked for");
    let [gen_ms, bare_ms] = [gen_ms, bare_ms].map(|ms| ms.iter().sum::<f64>() / episodes.len() as f64);
    Line {
        what: "`gen` against bare MuJoCo calls, ClearNoon".to_owned(),
        unit: "times the time",
        goal: Some(CLEAR_NOON),
        outcome: Outcome::Measured(value),
        note: format!(
            "a sample takes {gen_ms:.1} ms, its bare calls {bare_ms:.1}; the median of {} episodes, each made and issued again in turn",
            episodes.len()
        ),
    }
}

fn rays(episodes: &[Episode]) -> Line {
    // Millions of rays in a second.
    let rates = |ms_of: fn(&Episode) -> f64| -> Vec<f64> {
        episodes.iter().map(|of| f64::from(of.n_rays) / ms_of(of) / 1e3).collect()
    };
    let value = Value::of(&rates(|of| of.rays_ms)).expect("episodes were asked for");
    let bare = Value::of(&rates(|of| of.bare_rays_ms)).expect("episodes were asked for");
    Line {
        what: "LiDAR".to_owned(),
        unit: "Mray/s/core",
        goal: Some(RAYS),
        outcome: Outcome::Measured(value),
        note: format!(
            "{} rays a sample; mj_multiRay casts {:.2} Mray/s/core",
            episodes[0].n_rays, bare.median
        ),
    }
}

/// All weathers against bare calls, the worst of them beside.
///
/// # Errors
/// Nothing can be generated here.
pub fn all_weathers() -> anyhow::Result<Line> {
    let flags = format!(
        "--weather all --episodes {N_WEATHER_EPISODES} --run-samples 0 --set val_every=0 --set samples={N_SAMPLES}"
    );
    over_weathers(&bench_gen(&split(&flags))?.episodes)
}

fn over_weathers(episodes: &[Episode]) -> anyhow::Result<Line> {
    let mut weathers: BTreeMap<&str, Vec<&Episode>> = BTreeMap::new();
    episodes.iter().for_each(|of| weathers.entry(&of.weather).or_default().push(of));
    let mean = |of: &[&Episode], ms: fn(&Episode) -> f64| {
        of.iter().map(|episode| ms(episode)).sum::<f64>() / of.len() as f64
    };
    let times = weathers.iter().map(|(name, of)| (*name, mean(of, |e| e.gen_ms), mean(of, |e| e.bare_ms)));
    let (gen_ms, bare_ms) = times.clone().fold((0.0, 0.0), |sums, of| (sums.0 + of.1, sums.1 + of.2));
    let ratios: Vec<(&str, f64)> = times.map(|(name, gen_ms, bare_ms)| (name, gen_ms / bare_ms)).collect();
    let by_ratio = |a: &&(&str, f64), b: &&(&str, f64)| a.1.total_cmp(&b.1);
    let worst = ratios.iter().max_by(by_ratio).context("`xtask bench-gen` told no episode")?;
    let best = ratios.iter().min_by(by_ratio).context("`xtask bench-gen` told no episode")?;
    Ok(Line {
        what: format!("the same over {} weathers", ratios.len()),
        unit: "times the time",
        goal: Some(ALL_WEATHERS),
        outcome: Outcome::Measured(Value { median: gen_ms / bare_ms, least: Some(best.1) }),
        note: format!(
            "all samples' time over that of all bare calls; {:.2} in the worst, {}, {:.2} in the best, {}",
            worst.1, worst.0, best.1, best.0
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench_gen::{BenchReport, EpisodeReport, Runs as ReportedRuns};

    #[test]
    fn what_bench_gen_tells_is_understood() {
        let episode = |weather, gen_ms| EpisodeReport {
            town: "downtown".to_owned(),
            weather,
            gen_ms,
            bare_ms: 50.0,
            pictures_ms: 40.0,
            n_rays: 6000,
            rays_ms: 2.0,
            bare_rays_ms: 30.0,
        };
        let report = BenchReport {
            towns: Vec::new(),
            weathers: Vec::new(),
            n_episodes: 3,
            samples_per_episode: 16,
            renderer: "llvmpipe".to_owned(),
            stages: Vec::new(),
            gen_ms: 0.0,
            bare_ms: 0.0,
            over_bare: 0.0,
            over_bare_least: 0.0,
            over_bare_most: 0.0,
            set_up_ms_per_episode: 0.0,
            warm_up_ms_per_episode: 0.0,
            finishing_ms_per_episode: 0.0,
            episodes: vec![episode("ClearNoon", 45.0), episode("ClearNoon", 60.0), episode("FogNight", 55.0)],
            runs: Some(ReportedRuns {
                n_episodes: 2,
                n_samples: 80,
                jobs: 2,
                one_job_samples_per_s: 5.0,
                jobs_samples_per_s: 10.0,
                speed_up: 2.0,
                bytes_per_sample: 0.0,
                memory: None,
            }),
        };
        let told: Told = serde_json::from_value(serde_json::to_value(&report).unwrap()).unwrap();
        assert_eq!((told.renderer.as_str(), told.runs.unwrap().jobs_samples_per_s), ("llvmpipe", 10.0));
        let value = |line: Line| match line.outcome {
            Outcome::Measured(value) => (value.median, value.least.unwrap()),
            other => panic!("{other:?}"),
        };
        assert_eq!(value(against_bare(&told.episodes)), (1.1, 0.9));
        assert_eq!(value(rays(&told.episodes)), (3.0, 3.0));
        let line = over_weathers(&told.episodes).unwrap();
        assert!(
            line.what.contains("2 weathers") && line.note.contains("1.10 in the worst, FogNight"),
            "{line:?}"
        );
        // ClearNoon takes 52.5 ms on average.
        assert_eq!(value(line), (107.5 / 100.0, 1.05));
    }
}
