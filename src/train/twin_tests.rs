//! The whole `small` detector and its training loss against the twin in PyTorch, `tests/golden/torch_small.py`:
//! from points and picture to boxes, and from the loss back to every weight.
//!
//! Both sides make the same weights and inputs from names (`formula`); the golden file holds the outputs.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData};
use nalgebra::Vector3;

use super::augment::ObjectsByState;
use super::config::LossConfig;
use super::losses::losses;
use super::picture::picture_loss;
use super::targets::car;
use crate::device::{test_device, test_slack};
use crate::geometry::{Box3, Pinhole, Point, Transform};
use crate::kernels::has_matrix_unit;
use crate::model::golden::formula::{self, uniform};
use crate::model::golden::{Golden, assert_close, assert_within};
use crate::model::{Batch, Detector, DropsLeftOut, Input, ModelConfig, Output};
use crate::object::{Harm, LabelledObject};
use crate::sample::{EgoState, EncodedImage, ImageFormat, LidarPoint, Measured};

const N_SAMPLES: usize = 2;
const N_STATES: usize = 2;
const N_CROWDED: usize = 600;
const N_OBJECTS: usize = 5;
const HEATMAP_BIAS: f32 = -2.2;
/// Number of values of a gradient in the golden file, evenly over the tensor.
const N_SAMPLED: usize = 48;
/// Of f32, which every machine is held to.
const TOLERANCE: f64 = 1e-4;

/// Of this process: the matrix unit multiplies halves of bf16, right to 2^-16, whose errors sum up through the layers to
/// 1.2e-4 of spreads and gradients.
fn tolerance() -> f64 {
    if has_matrix_unit() { 2e-4 } else { TOLERANCE }
}

/// Of scores; the matrix unit's products make it 4e-5.
fn score_tolerance() -> f64 {
    if has_matrix_unit() { 1e-4 } else { 1e-5 }
}

/// Runs a test of this file once more without the matrix unit, where there is one: it hides no fault of the network then.
fn again_in_f32(test: &str) {
    if !has_matrix_unit() {
        return;
    }
    let name = format!("{}::{test}", module_path!().split_once("::").expect("a module of the crate").1);
    let program = std::env::current_exe().expect("this test's program");
    let done = std::process::Command::new(program)
        .args(["--exact", &name])
        .env("HARMZONE_MATRIX_UNIT", "off")
        .output()
        .expect("it starts once more");
    let told = String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success() && told.contains("1 passed"), "in f32: {told}");
}

/// A config and its inputs, as in the script.
struct Case {
    name: &'static str,
    config: ModelConfig,
    height_px: u32,
    n_points: usize,
    seed: usize,
}

/// The profile as it ships.
fn whole() -> Case {
    Case {
        name: "whole",
        config: ModelConfig::default(),
        height_px: 225,
        n_points: 8000,
        seed: seed_of("whole"),
    }
}

/// A narrower network on a coarse map with a little picture.
fn coarse() -> Case {
    let mut config = ModelConfig::default();
    (config.grid.cell_size_m, config.camera.cnn.image_width_px, config.head.n_queries) = (6.4, 64, 20);
    (config.head.channels, config.fuser_channels, config.lidar.pillars.channels) = (64, 64, 32);
    config.lidar.pillars.bev_channels = [64, 96];
    Case { name: "coarse", config, height_px: 36, n_points: 1200, seed: seed_of("coarse") }
}

/// The seed of a case's inputs, which the script chose.
fn seed_of(case: &str) -> usize {
    Golden::read("small").numbers(&format!("{case}.seed"))[0] as usize
}

fn points(case: &Case, sample_idx: usize) -> Vec<LidarPoint> {
    let numbers = uniform(&format!("points{sample_idx}.{}", case.seed), case.n_points * 4);
    let point = |(i, u): (usize, &[f64])| {
        let ([x, y], [middle_x, middle_y]) =
            if i < N_CROWDED { ([1.2, 1.2], [12.0, 3.0]) } else { ([26.0, 33.0], [25.0, 0.0]) };
        LidarPoint {
            x_m: (middle_x + x * u[0]) as f32,
            y_m: (middle_y + y * u[1]) as f32,
            z_m: (-0.6 + 2.6 * u[2]) as f32,
            intensity: (127.5 + 127.5 * u[3]) as f32,
            ring: 0,
        }
    };
    numbers.chunks(4).enumerate().map(point).collect()
}

fn picture(case: &Case, sample_idx: usize) -> EncodedImage {
    let (width_px, height_px) = (case.config.camera.cnn.image_width_px as u32, case.height_px);
    let name = format!("picture{sample_idx}.{}", case.seed);
    let values = uniform(&name, (3 * width_px * height_px) as usize).into_iter();
    let values = values.map(|u| ((u + 1.0) * 128.0).floor() as u8).collect();
    let picture = image::RgbImage::from_raw(width_px, height_px, values).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    EncodedImage { format: ImageFormat::Png, bytes: bytes.into_inner() }
}

fn states() -> Vec<EgoState> {
    let state = |u: &[f64]| EgoState {
        speed_mps: u[0] * 9.0 + 9.0,
        steering_angle_rad: u[1] * 0.3,
        yaw_rate_rps: 0.0,
        acceleration_mps2: 0.0,
        wheelbase_m: 2.6,
        front_bumper_x_m: 3.3,
    };
    uniform("states", N_SAMPLES * N_STATES * 2).chunks(2).map(state).collect()
}

fn inputs(case: &Case) -> Vec<Input> {
    let (width_px, height_px) = (case.config.camera.cnn.image_width_px as u32, case.height_px);
    // The twin gets the points of every brightness, anywhere.
    let mut config = case.config.clone();
    config.lidar.drops.left_out = DropsLeftOut::Never;
    let input = |(sample_idx, states): (usize, &[EgoState])| {
        let measured = Measured {
            time_ns: 0,
            ego_state: states[0],
            world_from_ego: Transform::from_xyz_yaw(0.0, 0.0, 0.0, 0.0),
            ego_from_lidar: Transform::from_xyz_yaw(0.9, 0.0, 1.8, 0.0),
            ego_from_camera: Transform::looking_forward(Vector3::new(1.7, 0.2, 1.5), 0.02),
            intrinsics: Pinhole::from_horizontal_fov(width_px, height_px, 70f64.to_radians()),
            image: picture(case, sample_idx),
            points: points(case, sample_idx),
        };
        Input::prepare(&measured, &config, false, true).unwrap().with_states(states, false).unwrap()
    };
    states().chunks(N_STATES).enumerate().map(input).collect()
}

fn objects(sample_idx: usize) -> ObjectsByState {
    let boxes = uniform(&format!("objects{sample_idx}"), N_OBJECTS * 9);
    let harm = uniform(&format!("harm{sample_idx}"), N_STATES * N_OBJECTS);
    let object = |(u, &harm): (&[f64], &f64)| -> LabelledObject {
        let mut object = car(0.0, 0.0, if harm >= 0.0 { Harm::Harmless } else { Harm::Harmful });
        object.truth.box_in_ego = Box3 {
            center: Point::new(20.0 * u[0] + 26.0, 20.0 * u[1], 0.3 * u[2] + 0.8),
            length_m: 1.6 * u[3] + 2.6,
            width_m: 0.6 * u[4] + 1.4,
            height_m: 0.4 * u[5] + 1.2,
            yaw_rad: 3.0 * u[6],
        };
        object.truth.velocity_in_ego_mps = [5.0 * u[7], 5.0 * u[8]];
        object
    };
    let of_state = |harm: &[f64]| boxes.chunks(9).zip(harm).map(object).collect();
    harm.chunks(N_OBJECTS).map(of_state).collect()
}

/// Compares heatmap, scores, and what is predicted for each cell that became a query: scores that differ by less
/// than rounding may stand in either order.
fn assert_output(output: &Output, golden: &Golden, prefix: &str) {
    let device = test_device();
    let name = |part: &str| format!("{prefix}.{part}");
    let heatmap = output.heatmap.clone().detach().into_data();
    assert_close(
        &Tensor::from_data(heatmap, &device),
        &golden.tensor::<4>(&name("heatmap"), &device),
        prefix,
    );
    let queries: Vec<_> = output.queries.iter().flatten().collect();
    let scores = golden.numbers(&name("scores"));
    assert_eq!(queries.len(), scores.len());
    for (query, score) in queries.iter().zip(scores) {
        assert!(
            (f64::from(query.score) - score).abs() < score_tolerance() * test_slack(),
            "{prefix}: {query:?}, expected {score}"
        );
    }
    let (cells, n_queries) = (golden.numbers(&name("cells")), output.queries[0].len());
    let scale = ModelConfig::default().head.heatmap_scale;
    let n_cells_x = output.heatmap.dims()[3] / scale;
    let row_of = |expected: usize| {
        let sample_idx = expected / n_queries;
        let mut of_sample = output.queries[sample_idx].iter();
        let found =
            of_sample.position(|query| query.heatmap_cell(n_cells_x, scale) as f64 == cells[expected]);
        found.unwrap_or_else(|| panic!("{prefix}: no query {}", cells[expected]))
    };
    let order: Vec<usize> = (0..cells.len()).map(row_of).collect();
    let spread = output.spread.as_ref().expect("the profile tells spreads");
    for (found, part) in [(&output.boxes, "boxes"), (spread, "spread"), (&output.harm, "harm")] {
        let [n_rows, _, n_numbers] = found.dims();
        let values: Vec<f32> = found.clone().detach().into_data().try_to_vec().unwrap();
        let sorted: Vec<f32> = (0..n_rows * n_queries)
            .flat_map(|i| {
                let (row, place) = (i / n_queries, i % n_queries);
                let query = order[row / N_STATES * n_queries + place];
                values[(row * n_queries + query) * n_numbers..][..n_numbers].to_vec()
            })
            .collect();
        let sorted = Tensor::<3>::from_data(TensorData::new(sorted, found.dims()), &device);
        assert_within(tolerance() as f32, &sorted, &golden.tensor::<3>(&name(part), &device), &name(part));
    }
}

/// Whether a weight is idle without the picture: those of the camera, and of what points take along from it.
fn is_of_the_camera(name: &str) -> bool {
    name.starts_with("camera.") || name.contains(".painted.")
}

/// Which pixels are to show an object, `[batch][y * x]`.
fn shown(logits: &Tensor<4>) -> Vec<Vec<f32>> {
    let [n_batch, _, n_y, n_x] = logits.dims();
    let shown: Vec<f32> =
        uniform("shown", n_batch * n_y * n_x).iter().map(|&u| f32::from(u8::from(u >= 0.5))).collect();
    shown.chunks(n_y * n_x).map(<[f32]>::to_vec).collect()
}

/// Compares some values of each weight's gradient on the scale of its largest one; returns the number of weights.
fn assert_gradients(detector: &Detector, loss: Tensor<1>, golden: &Golden, prefix: &str) -> usize {
    let mut n_compared = 0;
    for (name, found) in formula::gradients(detector.clone(), &loss.backward()) {
        let what = format!("{prefix} {name}");
        if prefix.ends_with("lidar") && is_of_the_camera(&name) {
            assert!(found.iter().all(|&value| value == 0.0), "{what}: the camera takes no part");
            continue;
        }
        let largest_of = |name: &str| golden.numbers(&format!("{prefix}.largest.{name}"))[0];
        // A key's bias shifts all of a query's scores equally, which the softmax cancels: its gradient is
        // rounding, and is compared on the scale of the weight beside it.
        let scale = largest_of(&name.replace("key.bias", "key.weight"));
        let expected = golden.numbers(&format!("{prefix}.gradient.{name}"));
        let sampled: Vec<f32> = found.iter().copied().step_by(found.len().div_ceil(N_SAMPLED)).collect();
        assert!(scale > 0.0 && sampled.len() == expected.len(), "{what}");
        let largest = found.iter().fold(0f32, |largest, value| largest.max(value.abs()));
        let pairs = sampled.into_iter().zip(expected).chain([(largest, largest_of(&name))]);
        for (i, (a, b)) in pairs.enumerate() {
            let error = (f64::from(a) - b).abs() / scale;
            assert!(
                error <= tolerance() * test_slack(),
                "{what}: value {i} is {a}, expected {b}; off by {error:.1e}"
            );
        }
        n_compared += 1;
    }
    n_compared
}

/// Compares both stages in training, then inference or the gradients, with the golden file.
fn check(case: &Case, with_gradients: bool) {
    let golden = Golden::read("small");
    let device = test_device().autodiff();
    let mut detector = Detector::init(&case.config, 0, &device);
    formula::fill(&mut detector);
    formula::set_all(&mut detector, "head.heatmap_out.bias", HEATMAP_BIAS);
    let inputs = inputs(case);
    let inputs: Vec<&Input> = inputs.iter().collect();
    let objects: Vec<ObjectsByState> = (0..N_SAMPLES).map(objects).collect();

    let mut totals = Vec::new();
    // Each pass in training also moves the running statistics.
    for (stage, with_camera) in [("lidar", false), ("fused", true)] {
        let prefix = format!("{}.{stage}", case.name);
        let output = detector.forward(&Batch::stack(&inputs, &case.config, with_camera, &device));
        assert_output(&output, &golden, &format!("{prefix}.train"));
        // The twin's queries may be matched at any distance.
        let config = LossConfig { match_reach_m: 1e6, ..LossConfig::default() };
        let found = losses(&output, &objects, &[], &case.config, &config);
        let mut parts =
            vec![("heatmap", found.parts.heatmap), ("harm", found.parts.harm), ("boxes", found.parts.boxes)];
        let mut total = found.total;
        if let Some(logits) = output.picture_objects {
            let targets = shown(&logits);
            let of_picture = picture_loss(logits, &targets);
            parts.push(("picture", of_picture.clone().detach().into_scalar()));
            total = total + of_picture;
        }
        parts.push(("total", parts.iter().map(|(_, value)| value).sum()));
        for (part, value) in parts {
            let expected = golden.numbers(&format!("{prefix}.loss.{part}"))[0];
            let error = (f64::from(value) - expected).abs() / expected.abs();
            assert!(error <= tolerance() * test_slack(), "{prefix} {part}: {value}, expected {expected}");
        }
        totals.push((prefix, with_camera, total));
    }

    if !with_gradients {
        let at_inference = detector.valid();
        let output = at_inference.forward(&Batch::stack(&inputs, &case.config, true, &test_device()));
        assert_output(&output, &golden, &format!("{}.eval", case.name));
        let mut statistics =
            Statistics { path: Vec::new(), prefix: case.name, golden: &golden, n_compared: 0 };
        at_inference.visit(&mut statistics);
        assert_eq!(statistics.n_compared, 8);
        return;
    }
    // Copies of a module share their running statistics, which this overwrites.
    for (prefix, with_camera, total) in totals {
        let n_compared = assert_gradients(&detector, total, &golden, &prefix);
        let names = formula::named_weights(&detector);
        let n_trained = names.iter().filter(|(name, _)| with_camera || !is_of_the_camera(name)).count();
        assert!(n_compared == n_trained && n_compared > 60, "{prefix}: {n_compared} of {n_trained}");
    }
}

#[test]
fn outputs_and_losses_equal_pytorchs() {
    check(&whole(), false);
    again_in_f32("outputs_and_losses_equal_pytorchs");
}

/// A gradient jumps where an activation crosses the kink of its ReLU; this case's inputs keep clear of all kinks.
#[test]
fn gradients_of_the_loss_for_every_weight_equal_pytorchs() {
    check(&coarse(), true);
    again_in_f32("gradients_of_the_loss_for_every_weight_equal_pytorchs");
}

/// Compares the running statistics that the golden file has.
struct Statistics<'a> {
    path: Vec<String>,
    prefix: &'a str,
    golden: &'a Golden,
    n_compared: usize,
}

impl ModuleVisitor for Statistics<'_> {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        const COMPARED: [&str; 4] =
            ["lidar.Pillars.point_norm", "camera.Cnn.smooth.norm", "fuser.norm", "head.heatmap_hidden.norm"];
        let name = self.path.join(".");
        if COMPARED.iter().any(|norm| name.starts_with(norm)) && name.contains(".running_") {
            assert_close(
                &param.val(),
                &self.golden.tensor(&format!("{}.{name}", self.prefix), &test_device()),
                &name,
            );
            self.n_compared += 1;
        }
    }
}
