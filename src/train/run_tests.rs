//! Whole runs: stopped and resumed, streamed, on several devices, and what makes them fail.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicI64, Ordering};

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor};
use fs_err as fs;

use super::memory::MemoryBound;
use super::plan::Position;
use super::{
    AugmentConfig, DryRun, Learner, Pace, Plan, Schedule, StageConfig, Steps, StreamConfig, Summary,
    TrainConfig, TrainError, TrainOptions, TrainingData, TrainingTime, run,
};
use crate::config::Checked;
use crate::dataset::{LabelledSplit, SampleSource, test_data};
use crate::device::DeviceName;
use crate::episode::Split;
use crate::history::{History, SCORES_FILE, STEPS_FILE};
use crate::model::checkpoint::CHECKPOINT;
use crate::model::{CameraConfig, CnnConfig, GridConfig, HeadConfig, LidarConfig, ModelConfig, PillarConfig};
use crate::progress::{Progress, Silent};

fn tiny() -> TrainConfig {
    let stage = |epochs, schedule| StageConfig { epochs, max_learning_rate: 2e-3, schedule };
    TrainConfig {
        batch_size: 1,
        accumulate: 2,
        // The two that change beta1 from step to step.
        lidar_stage: stage(2, Schedule::Cyclic),
        fused_stage: stage(1, Schedule::WarmupCosine),
        save_every_steps: 1,
        model: ModelConfig {
            grid: GridConfig { cell_size_m: 3.2, ..GridConfig::default() },
            fuser_channels: 16,
            lidar: LidarConfig {
                pillars: PillarConfig { channels: 8, bev_channels: [16, 16], ..PillarConfig::default() },
                ..LidarConfig::default()
            },
            camera: CameraConfig {
                cnn: CnnConfig { image_width_px: 64, n_depth_bins: 12, ..CnnConfig::default() },
                ..CameraConfig::default()
            },
            head: HeadConfig { channels: 16, n_queries: 8, ffn_channels: 32, ..HeadConfig::default() },
            ..ModelConfig::default()
        },
        ..TrainConfig::default()
    }
}

fn checked(config: &TrainConfig) -> Checked<TrainConfig> {
    Checked::new(config.clone()).unwrap()
}

fn train<'a>(
    data: impl Into<SampleSource<'a>>,
    config: &TrainConfig,
    out: &Path,
) -> Result<Summary, TrainError> {
    let data = TrainingData::new(data, None);
    let config = Checked::new(config.clone())?;
    run(data, &config, out, TrainOptions::default(), &[Device::flex()], &Silent)
}

/// Stops a run after some steps, as a kill would, by a watcher that panics.
struct Stop {
    after: AtomicI64,
}

impl Progress for Stop {
    fn start(&self, _stage: &str, _total: u64) {}
    fn advance(&self, n: u64) {
        let left = self.after.fetch_sub(n as i64, Ordering::SeqCst) - n as i64;
        assert!(left > 0, "stopped on purpose");
    }
    fn note(&self, _text: &str) {}
    fn finish(&self) {}
}

/// Trains in one go and, in another folder, with stops after so many steps; both end with the same bytes.
fn assert_stops_change_nothing(
    data: TrainingData<'_>,
    config: &TrainConfig,
    folder: &Path,
    telling: TrainOptions<'_>,
) {
    let (config, device) = (Checked::new(config.clone()).unwrap(), [Device::flex()]);
    let (path, broken) = (folder.join("whole"), folder.join("broken"));
    let whole = run(data, &config, &path, telling, &device, &Silent).unwrap();
    for after in [2, 5, 2] {
        let watcher = Stop { after: after.into() };
        let stopped = catch_unwind(AssertUnwindSafe(|| {
            run(data, &config, &broken, TrainOptions::default(), &device, &watcher)
        }));
        assert!(stopped.is_err() && !broken.join(CHECKPOINT).exists());
    }
    let resumed = run(data, &config, &broken, TrainOptions::default(), &device, &Silent).unwrap();
    assert!(resumed.n_steps_now < whole.n_steps_now);
    assert_eq!(TrainingTime::read(&broken).unwrap().n_calls, 3);
    assert!(fs::read(&whole.checkpoint).unwrap() == fs::read(&resumed.checkpoint).unwrap());
    for name in [STEPS_FILE, SCORES_FILE] {
        assert_eq!(fs::read(path.join(name)).unwrap(), fs::read(broken.join(name)).unwrap(), "{name}");
    }
}

#[test]
fn a_run_stopped_in_either_stage_and_called_again_ends_with_the_same_bytes() {
    let data = test_data::dataset(6);
    let folder = tempfile::tempdir().unwrap();
    let told = std::cell::RefCell::new(Vec::new());
    let tell = |run: &Path| {
        let history = History::read(run).unwrap();
        told.borrow_mut().push((history.steps.len(), history.scores.len()));
    };
    let telling = TrainOptions { after_validation: Some(&tell), ..TrainOptions::default() };
    let of_run = TrainingData::new(&data, Some((&data).into()));
    assert_stops_change_nothing(of_run, &tiny(), folder.path(), telling);
    assert_eq!(told.into_inner(), [(3, 1), (6, 2), (9, 3)], "logs are up to date at each validation");
}

#[test]
fn a_streamed_run_stopped_and_called_again_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    fs::create_dir(&data).unwrap();
    test_data::write(&data, &[1, 2, 1, 2]);
    let split = LabelledSplit::open(&data, "rect", Split::Train).unwrap();
    let config = TrainConfig { stream: StreamConfig { window_episodes: 2 }, harmful_share: 0.3, ..tiny() };
    let of_run = TrainingData::new(&split, Some((&split).into()));
    assert_stops_change_nothing(of_run, &config, folder.path(), TrainOptions::default());
}

#[test]
fn a_stream_whose_window_is_larger_than_the_data_trains_as_in_memory_to_the_byte() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    fs::create_dir(&data).unwrap();
    test_data::write(&data, &[1, 2, 1]);
    let split = LabelledSplit::open(&data, "rect", Split::Train).unwrap();
    let whole = split.read_all().unwrap();
    let checkpoint_of = |name: &str, window_episodes, data: SampleSource<'_>| {
        let config = TrainConfig { stream: StreamConfig { window_episodes }, ..tiny() };
        let data = TrainingData::new(data, Some(data));
        let out = folder.path().join(name);
        let config = Checked::new(config).unwrap();
        run(data, &config, &out, TrainOptions::default(), &[Device::flex()], &Silent).unwrap();
        (fs::read(out.join(CHECKPOINT)).unwrap(), fs::read(out.join(SCORES_FILE)).unwrap())
    };
    let in_memory = checkpoint_of("in-memory", 0, (&whole).into());
    assert!(checkpoint_of("streamed", 1000, (&split).into()) == in_memory);
    assert!(checkpoint_of("windows", 1, (&split).into()) != in_memory);
}

#[test]
fn a_bound_on_memory_changes_no_byte_and_refuses_what_it_cannot_hold_before_the_folder_is_touched() {
    let data = test_data::dataset(2);
    let folder = tempfile::tempdir().unwrap();
    let of_bound = |name: &str, bound: Option<f64>| {
        let options = TrainOptions { bound: bound.map(MemoryBound::new), ..TrainOptions::default() };
        let (out, of_run) = (folder.path().join(name), TrainingData::new(&data, None));
        run(of_run, &checked(&tiny()), &out, options, &[Device::flex()], &Silent)
    };
    let [free, bound] = [of_bound("free", None), of_bound("bound", Some(1e6))].map(Result::unwrap);
    assert!(fs::read(free.checkpoint).unwrap() == fs::read(bound.checkpoint).unwrap());
    let told = of_bound("refused", Some(1.0)).unwrap_err().to_string();
    assert!(told.contains("--max-memory") && told.contains("batch_size"), "{told}");
    assert!(!folder.path().join("refused").exists());
}

#[test]
fn a_folder_with_another_run_is_left_alone_without_force() {
    let data = test_data::dataset(2);
    let folder = tempfile::tempdir().unwrap();
    train(&data, &tiny(), folder.path()).unwrap();
    let before = fs::read(folder.path().join(CHECKPOINT)).unwrap();
    let other = TrainConfig { seed: 1, ..tiny() };
    assert!(matches!(train(&data, &other, folder.path()), Err(TrainError::OtherRun { .. })));
    assert_eq!(fs::read(folder.path().join(CHECKPOINT)).unwrap(), before);
    let forced = TrainOptions { force: true, ..TrainOptions::default() };
    let of_run = TrainingData::new(&data, None);
    run(of_run, &checked(&other), folder.path(), forced, &[Device::flex()], &Silent).unwrap();
    assert_ne!(fs::read(folder.path().join(CHECKPOINT)).unwrap(), before);
}

#[test]
fn what_does_not_belong_to_a_run_is_told_and_its_state_stays() {
    let data = test_data::dataset(6);
    let home = tempfile::tempdir().unwrap();
    let stop = |config: &TrainConfig, name: &str| {
        let (out, watcher) = (home.path().join(name), Stop { after: 3.into() });
        let stopped = catch_unwind(AssertUnwindSafe(|| {
            let data = TrainingData::new(&data, None);
            run(data, &checked(config), &out, TrainOptions::default(), &[Device::flex()], &watcher)
        }));
        assert!(stopped.is_err());
        out
    };
    let mut wider = tiny();
    wider.model.head.n_queries = 9;
    let (ours, theirs) = (stop(&tiny(), "ours"), stop(&TrainConfig { seed: 1, ..tiny() }, "theirs"));
    let told = || train(&data, &tiny(), &ours).unwrap_err().to_string();
    let swap = |file: &str, other: &Path| {
        let (path, kept) = (ours.join(file), ours.join("kept"));
        fs::rename(&path, &kept).unwrap();
        if other.exists() {
            fs::copy(other, &path).unwrap();
        }
        let told = told();
        fs::rename(kept, path).unwrap();
        told
    };
    let state = "state/step-00000002/";
    for name in ["model.safetensors", "average.safetensors"] {
        let file = format!("{state}{name}");
        let told = swap(&file, &theirs.join(&file));
        assert!(told.contains("not those it was written with") && told.contains("step-00000002"), "{told}");
    }
    let told_log = swap(STEPS_FILE, Path::new("absent"));
    assert!(told_log.contains("no row of step 1"), "{told_log}");
    let changed = home.path().join("log.csv");
    let log = fs::read_to_string(ours.join(STEPS_FILE)).unwrap();
    fs::write(&changed, log.replacen("lidar,0", "lidar,1", 1)).unwrap();
    let told_log = swap(STEPS_FILE, &changed);
    assert!(told_log.contains("was changed") && told_log.contains(STEPS_FILE), "{told_log}");
    fs::rename(ours.join(state), ours.join("state/step-00000004")).unwrap();
    assert!(told().contains("it stands at"), "{}", told());
    fs::rename(ours.join("state/step-00000004"), ours.join(state)).unwrap();
    // A network that is not the run's is no end of it.
    let last = ours.join(CHECKPOINT);
    fs::write(&last, "").unwrap();
    assert!(told().contains("not a harmzone checkpoint"), "{}", told());
    fs::copy(stop(&wider, "wider").join(state).join("model.safetensors"), &last).unwrap();
    assert!(told().contains("goes on from its state"), "{}", told());
    fs::remove_file(&last).unwrap();
    assert!(train(&data, &tiny(), &ours).unwrap().n_steps_now < 9);
}

#[test]
fn what_is_in_a_folder_of_others_stays() {
    let out = tempfile::tempdir().unwrap();
    let files = ["film.partial", "notes.txt"].map(|name| out.path().join(name));
    files.iter().for_each(|file| fs::write(file, "mine").unwrap());
    let refused = train(&test_data::dataset(2), &tiny(), out.path());
    assert!(matches!(refused, Err(TrainError::NotARun { .. })));
    assert!(files.iter().all(|file| file.exists()));
    fs::remove_file(&files[1]).unwrap();
    train(&test_data::dataset(2), &tiny(), out.path()).unwrap();
    assert!(files[0].exists());
}

#[test]
fn a_broken_sample_is_named() {
    let mut data = test_data::dataset(2);
    data.sample_mut(1).measured.ego_state.steering_angle_rad = f64::NAN;
    let config =
        TrainConfig { augment: AugmentConfig { n_redrawn_states: 0, ..Default::default() }, ..tiny() };
    let folder = tempfile::tempdir().unwrap();
    let message = train(&data, &config, folder.path()).unwrap_err().to_string();
    assert!(message.contains("made/1") && message.contains("steering_angle_rad"), "{message}");
}

#[test]
fn image_weights_that_cannot_be_read_leave_no_folder_and_end_a_dry_run_too() {
    let (folder, data) = (tempfile::tempdir().unwrap(), test_data::dataset(2));
    let out = folder.path().join("run");
    let [_, model] = ModelConfig::in_little();
    let config = TrainConfig { model, image_weights: Some("absent.pth".into()), ..tiny() };
    let told = [train(&data, &config, &out).unwrap_err(), DryRun::of(&data, &config).unwrap_err()];
    assert!(told.iter().all(|error| matches!(error, TrainError::ImageWeights(_))), "{told:?}");
    assert!(!out.exists());
}

#[test]
fn resuming_where_there_is_nothing_is_an_error() {
    let (folder, data) = (tempfile::tempdir().unwrap(), test_data::dataset(2));
    let options = TrainOptions { resume: true, ..TrainOptions::default() };
    let of_run = TrainingData::new(&data, None);
    let ended = run(of_run, &checked(&tiny()), folder.path(), options, &[Device::flex()], &Silent);
    assert!(matches!(ended, Err(TrainError::NothingToResume { .. })));
}

#[test]
fn training_lowers_the_loss() {
    let data = test_data::dataset(4);
    let stage = StageConfig { epochs: 30, max_learning_rate: 4e-3, schedule: Schedule::OneCycle };
    let config = TrainConfig { lidar_stage: stage, ..tiny() };
    let folder = tempfile::tempdir().unwrap();
    train(&data, &config, folder.path()).unwrap();
    let steps = History::read(folder.path()).unwrap().steps;
    let losses: Vec<f64> = steps.iter().map(|row| row.heatmap + row.harm + row.boxes).collect();
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    assert!(mean(&losses[50..60]) < 0.5 * mean(&losses[..4]), "{losses:?}");
}

/// Every number of a detector, trained or not, in the module's order.
struct Numbers(Vec<f32>);

impl ModuleVisitor for Numbers {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.0.extend(param.val().into_data().try_to_vec::<f32>().unwrap());
    }
}

/// The weights and running statistics after some steps on devices, and the norm of each step's gradients.
fn after_steps(config: &TrainConfig, devices: &[Device]) -> (Vec<f32>, Vec<f32>) {
    let data = test_data::dataset(8);
    let plan = Plan::new(config, &data);
    let mut steps = Steps::new(&plan, &data, config, devices);
    let detector = crate::model::Detector::init(&config.model, 3, &devices[0].clone().autodiff());
    let mut learner = Learner::start(detector, config);
    let mut norms = Vec::new();
    for step in 0..3 {
        let pace = Pace { learning_rate: 1e-3, beta_1: 0.9 };
        norms.push(learner.step(&mut steps, Position { stage: 1, step }, pace).unwrap().1);
    }
    let mut numbers = Numbers(Vec::new());
    learner.detector().valid().visit(&mut numbers);
    (numbers.0, norms)
}

/// Five batches a step, so that devices have unequally many; the last one is short.
fn of_five_batches() -> TrainConfig {
    TrainConfig { accumulate: 5, ..tiny() }
}

#[test]
fn several_devices_give_one_devices_weights_to_the_bit() {
    let cpu = Device::flex();
    let mut dropping = of_five_batches();
    dropping.model.head.dropout = 0.2;
    assert!(dropping.model.draws_in_training());
    for config in [of_five_batches(), dropping] {
        let one = after_steps(&config, std::slice::from_ref(&cpu));
        for n in [2, 3, 7] {
            assert!(after_steps(&config, &vec![cpu.clone(); n]) == one, "{n} devices");
        }
    }
}

/// By hand on two GPUs, or on `vulkan:0,cpu`: `HARMZONE_TEST_DEVICES` names devices of one run as `--device` does. The first
/// is compared with itself alone.
#[test]
fn devices_of_the_environment_give_the_first_ones_gradients() {
    let names = std::env::var("HARMZONE_TEST_DEVICES").unwrap_or_else(|_| "cpu,cpu".into());
    let open = |name: &str| name.parse::<DeviceName>().and_then(DeviceName::open).unwrap();
    let devices: Vec<Device> = names.split(',').map(open).collect();
    let (one, several) =
        (after_steps(&of_five_batches(), &devices[..1]), after_steps(&of_five_batches(), &devices));
    // Kernels of two kinds of device round otherwise; a missing or a doubled batch would change norms by tens of per cent.
    for (a, b) in one.1.iter().zip(&several.1) {
        assert!((a / b - 1.0).abs() < 2e-3, "norms of gradients {:?} and {:?}", one.1, several.1);
    }
    let apart = one.0.iter().zip(&several.0).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    // Three steps of AdamW move a weight by at most 3e-3.
    assert!(apart < 1e-3, "weights are {apart} apart");
}
