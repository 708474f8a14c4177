//! Speed of `eval` and `label` against nuscenes-devkit's `accumulate` and shapely, over the same boxes in one run.
//!
//! Makes 6,000 samples with 60,000 truths and 300,000 detections, scores and labels them on one thread, writes them to a
//! folder and lets `scripts/bench_eval.py` do the same with the devkit and shapely, each a run of its own. Both must
//! come to the same APs and to the same number of harmful objects.

#![allow(clippy::unwrap_used, reason = "a bench fails by panicking")]

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use harmzone::dataset::SampleFacts;
use harmzone::eval::{self, EvalConfig, EvalSample, Mode, Protocol, json};
use harmzone::geometry::{Box3, Ego, Point};
use harmzone::object::{Detection, Distribution, Harm, LabelledObject, Object};
use harmzone::random;
use harmzone::sample::EgoState;
use harmzone::zone::{Zone, ZoneConfig};
use rand::RngExt;
use serde_json::{Value, json};

const N_SAMPLES: usize = 6000;
const TRUTHS_A_SAMPLE: usize = 10;
const DETECTIONS_A_TRUTH: usize = 5;
/// Ours are timed this often; the median counts.
const N_RUNS: usize = 5;

/// Boxes about as dense as on a street, detections near their truths.
fn samples() -> Vec<EvalSample> {
    let mut rng = random::stream(5, "bench-eval", 0);
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    (0..N_SAMPLES)
        .map(|i| {
            let (mut objects, mut detections) = (Vec::new(), Vec::new());
            for _ in 0..TRUTHS_A_SAMPLE {
                let (x_m, y_m) = (between(4.0, 45.0), between(-15.0, 15.0));
                let harm = Harm::ALL[usize::from(between(0.0, 1.0) > 0.1)];
                let mut a_box = |spread_m: f64| Box3::<Ego> {
                    center: Point::new(
                        x_m + between(-spread_m, spread_m),
                        y_m + between(-spread_m, spread_m),
                        0.8,
                    ),
                    length_m: between(0.5, 5.0),
                    width_m: between(0.5, 2.0),
                    height_m: 1.6,
                    yaw_rad: between(-3.1, 3.1),
                };
                objects.push(LabelledObject {
                    harm,
                    truth: Object {
                        distribution: Some(Distribution::Id),
                        n_lidar_points: Some(5),
                        ..Object::new(a_box(0.0))
                    },
                });
                let found: Vec<Box3<Ego>> = (0..DETECTIONS_A_TRUTH).map(|k| a_box(0.4 + k as f64)).collect();
                for (k, box_in_ego) in found.into_iter().enumerate() {
                    let score = between(0.0, 1.0) / (1.0 + k as f64);
                    detections.push(Detection { box_in_ego, velocity_in_ego_mps: [0.0; 2], harm, score });
                }
            }
            EvalSample::new(format!("s{i}"), SampleFacts::default(), objects, detections)
        })
        .collect()
}

fn states() -> Vec<EgoState> {
    let mut rng = random::stream(5, "bench-states", 0);
    (0..N_SAMPLES)
        .map(|_| EgoState {
            speed_mps: 14.0 * rng.random::<f64>(),
            steering_angle_rad: 0.4 * (rng.random::<f64>() - 0.5),
            yaw_rate_rps: 0.0,
            acceleration_mps2: 0.0,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        })
        .collect()
}

/// The result, and the median seconds of some runs.
fn timed<T>(mut run: impl FnMut() -> T) -> (T, f64) {
    let mut seconds = Vec::new();
    let mut last = None;
    for _ in 0..N_RUNS {
        let start = Instant::now();
        last = Some(run());
        seconds.push(start.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    (last.unwrap(), seconds[N_RUNS / 2])
}

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join(".venv-test/bin/python");
    assert!(python.is_file(), "no {}: run `make setup-test` first", python.display());
    let (samples, states) = (samples(), states());
    // The devkit's accumulate filters nothing.
    let unfiltered = || EvalConfig { max_range_m: f64::INFINITY, n_resamples: 0, ..EvalConfig::default() };
    let protocol = Protocol::try_from(unfiltered()).unwrap();
    let (metrics, score_s) = timed(|| eval::score(&samples, &protocol, Mode::Id).unwrap());
    let (_, evaluate_s) = timed(|| eval::evaluate(&samples, &protocol, Mode::Id).unwrap());

    let zone = Zone::try_from(ZoneConfig::default()).unwrap();
    let label = || -> usize {
        let of_sample = |(sample, state): (&EvalSample, &EgoState)| {
            let here = zone.at(state).unwrap();
            let is_harmful = |object: &&LabelledObject| {
                let Object { box_in_ego, velocity_in_ego_mps, .. } = &object.truth;
                here.harm_of(box_in_ego, *velocity_in_ego_mps).unwrap().harm == Harm::Harmful
            };
            sample.objects.iter().filter(is_harmful).count()
        };
        samples.iter().zip(&states).map(of_sample).sum()
    };
    let (n_harmful, label_s) = timed(label);

    let folder = tempfile::tempdir().unwrap();
    let boxes = samples.iter().map(|sample| (sample.id.as_str(), sample.detections.as_slice()));
    json::write_predictions(&folder.path().join("predictions.json"), boxes).unwrap();
    json::write_truth(&folder.path().join("truth.json"), &samples).unwrap();
    let of_state = |state: &EgoState| [state.speed_mps, state.steering_angle_rad, state.front_bumper_x_m];
    let states: Vec<[f64; 3]> = states.iter().map(of_state).collect();
    fs_err::write(folder.path().join("states.json"), json!(states).to_string()).unwrap();
    let output = Command::new(python)
        .arg(root.join("scripts/bench_eval.py"))
        .arg(folder.path())
        .env("OMP_NUM_THREADS", "1")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let theirs: Value = serde_json::from_slice(&output.stdout).unwrap();
    let seconds = |key: &str| theirs[key].as_f64().unwrap();

    for class in Harm::ALL {
        for (i, ap) in metrics.per_threshold.total.get(class).iter().enumerate() {
            let devkit = theirs["per_threshold"][class.name()][i].as_f64().unwrap();
            let ap = ap.expect("both classes are there");
            assert!((ap - devkit).abs() < 1e-9, "{class:?} {i}: ours {ap}, the devkit's {devkit}");
        }
    }
    assert_eq!(theirs["n_harmful"].as_u64(), Some(n_harmful as u64));

    let n_truths = N_SAMPLES * TRUTHS_A_SAMPLE;
    println!(
        "{N_SAMPLES} samples, {n_truths} truths, {} detections; same APs",
        n_truths * DETECTIONS_A_TRUTH
    );
    let devkit_s = seconds("accumulate_s");
    let row = |what: &str, ours_s: f64, against: &str, theirs_s: f64| {
        println!("{what:<44}{ours_s:>9.4} s   {against:<34}{theirs_s:>9.3} s{:>9.0} x", theirs_s / ours_s);
    };
    row("eval::score", score_s, "nuscenes-devkit accumulate", devkit_s);
    row("eval::evaluate, breakdowns and safety too", evaluate_s, "the same", devkit_s);
    println!("{n_truths} objects, {n_harmful} harmful in both");
    row("label, one thread", label_s, "shapely, object by object", seconds("shapely_s"));
    row("label, one thread", label_s, "shapely, arrays", seconds("shapely_arrays_s"));
}
