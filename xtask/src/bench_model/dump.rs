//! Inputs and outputs of the race as a safetensors file, for the twin: `docs/detector.md` tells its tensors.

use std::collections::BTreeMap;
use std::path::Path;

use burn::module::Module;
use burn::optim::GradientsParams;
use fs_err as fs;
use safetensors::tensor::{Dtype, TensorView};

use super::training::{batch, learner};
use super::{Bench, BenchError, PACE};
use harmzone::files;
use harmzone::model::{Batch, CameraInput, Input, LidarInput, Output, Query, checkpoint, n_paint_pixels};
use harmzone::train::{LossParts, ObjectsByState, STAGES, losses};

/// The weights, and inputs with what the network makes of them.
const CHECKPOINT: &str = "model.safetensors";
const TENSORS: &str = "race.safetensors";

/// Writes both files into a folder: one sample's inference, and a step of both stages in training.
///
/// # Errors
/// [`BenchError`]; among them a network that has no twin.
pub fn dump(bench: &Bench, folder: &Path) -> Result<(), BenchError> {
    bench.check()?;
    fs::create_dir_all(folder)?;
    let (detector, model) = (bench.detector(bench.device)?.valid(), &bench.config.model);
    checkpoint::save(&detector, None, &folder.join(CHECKPOINT))?;
    let mut file = Tensors::default();

    let first = &bench.dataset.samples()[0];
    let input = Input::prepare(&first.measured, model, false, true)
        .map_err(|source| BenchError::Input { sample: first.id.clone(), source })?;
    let output = detector.forward(&Batch::stack(&[&input], model, true, bench.device));
    file.inputs("inference", &[input])?;
    file.output("inference", &output, model.head.heatmap_scale);

    let device = bench.device.clone().autodiff();
    for (stage, name) in STAGES.into_iter().enumerate() {
        let (inputs, batch, objects) = batch(bench, stage, bench.samples_per_step(), &device)?;
        let mut learner = learner(bench)?;
        let output = learner.detector().forward(&batch);
        let loss = losses(&output, &objects, &[], model, &bench.config.loss);
        let gradients = GradientsParams::from_grads(loss.total.backward(), learner.detector());
        file.output(name, &output, model.head.heatmap_scale);
        file.losses(name, loss.parts, learner.apply(gradients, PACE));
        if stage == 1 {
            file.inputs("training", &inputs)?;
            file.objects("training", &objects);
        }
    }
    file.write(&folder.join(TENSORS))
}

/// Named tensors as bytes.
#[derive(Default)]
struct Tensors(BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>);

impl Tensors {
    fn floats(&mut self, name: String, shape: &[usize], values: &[f32]) {
        let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.0.insert(name, (Dtype::F32, shape.to_vec(), bytes));
    }

    fn doubles(&mut self, name: String, shape: &[usize], values: &[f64]) {
        let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.0.insert(name, (Dtype::F64, shape.to_vec(), bytes));
    }

    fn integers(&mut self, name: String, shape: &[usize], values: &[i64]) {
        let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.0.insert(name, (Dtype::I64, shape.to_vec(), bytes));
    }

    /// `<prefix>.<sample>.<part>` of each sample as the program prepares it, `<prefix>.numeric` of all.
    fn inputs(&mut self, prefix: &str, inputs: &[Input]) -> Result<(), BenchError> {
        let integers = |values: &[u32]| values.iter().map(|&value| i64::from(value)).collect::<Vec<_>>();
        for (i, input) in inputs.iter().enumerate() {
            let name = |part: &str| format!("{prefix}.{i}.{part}");
            let Some(LidarInput::Pillars(pillars)) = &input.lidar else {
                return Err(BenchError::NoTwin { found: "another LiDAR branch than pillars" });
            };
            let Some(CameraInput::Cnn(camera)) = &input.camera else {
                return Err(BenchError::NoTwin { found: "another camera branch than the small CNN" });
            };
            let n_pillars = pillars.cells.len();
            let n_points = pillars.points.iter().max().map_or(0, |&last| last as usize + 1);
            let n_features = pillars.point_features.len() / n_points.max(1);
            self.floats(name("point_features"), &[n_points, n_features], &pillars.point_features);
            let per_pillar = pillars.points.len() / n_pillars.max(1);
            self.integers(name("points"), &[n_pillars, per_pillar], &integers(&pillars.points));
            self.integers(name("pillars"), &[n_pillars], &integers(&pillars.cells));
            let height_px = camera.image_height_px;
            let shape = vec![3, height_px, camera.image.len() / 3 / height_px];
            self.0.insert(name("image"), (Dtype::U8, shape, camera.image.clone()));
            self.floats(name("depth"), &[camera.depth.len()], &camera.depth);
            let (plan, n_pixels) = (&camera.plan, camera.plan.n_pixels() as i64);
            let (points, cells): (Vec<i64>, Vec<i64>) = plan
                .points()
                .iter()
                .map(|&point| {
                    let (pixel, bin) = (point as usize / plan.n_bins(), point as usize % plan.n_bins());
                    (bin as i64 * n_pixels + pixel as i64, i64::from(plan.cell_of_point()[point as usize]))
                })
                .unzip();
            let n_px = [height_px, camera.image.len() / 3 / height_px].map(n_paint_pixels);
            let n_pixels_painted = (n_px[0] * n_px[1]) as u32;
            let pixels: Vec<u32> = camera.pixel_of_point.iter().map(|&of| of.min(n_pixels_painted)).collect();
            self.integers(name("pixels"), &[pixels.len()], &integers(&pixels));
            self.integers(name("frustum_points"), &[points.len()], &points);
            self.integers(name("frustum_cells"), &[cells.len()], &cells);
        }
        let numeric: Vec<f32> =
            inputs.iter().flat_map(|input| input.numeric.as_flattened().to_vec()).collect();
        self.floats(format!("{prefix}.numeric"), &[numeric.len() / 2, 2], &numeric);
        Ok(())
    }

    /// `<prefix>.<sample>.boxes`, `[object, 9]`: centre, length, width, height, yaw, velocity; and
    /// `<prefix>.<sample>.harm`, `[state, object]`.
    fn objects(&mut self, prefix: &str, objects: &[ObjectsByState]) {
        for (i, states) in objects.iter().enumerate() {
            let boxes: Vec<f64> = states[0]
                .iter()
                .flat_map(|object| {
                    let (of, velocity) = (&object.truth.box_in_ego, object.truth.velocity_in_ego_mps);
                    let center = [of.center.x(), of.center.y(), of.center.z()];
                    let shape = [of.length_m, of.width_m, of.height_m, of.yaw_rad];
                    center.into_iter().chain(shape).chain(velocity)
                })
                .collect();
            let harm: Vec<i64> = states.iter().flatten().map(|object| object.harm.index() as i64).collect();
            let n_objects = states[0].len();
            self.doubles(format!("{prefix}.{i}.boxes"), &[n_objects, 9], &boxes);
            self.integers(format!("{prefix}.{i}.harm"), &[states.len(), n_objects], &harm);
        }
    }

    /// `cells` are of the heatmap.
    fn output(&mut self, prefix: &str, output: &Output, scale: usize) {
        let name = |part: &str| format!("{prefix}.output.{part}");
        let [n_batch, n_channels, n_y, n_x] = output.heatmap.dims();
        let values = |data: burn::tensor::TensorData| data.try_to_vec::<f32>().expect("outputs are f32");
        let heatmap = values(output.heatmap.clone().into_data());
        self.floats(name("heatmap"), &[n_batch, n_channels, n_y, n_x], &heatmap);
        let spread = output.spread.as_ref().map(|spread| ("spread", spread));
        for (part, tensor) in [("boxes", &output.boxes), ("harm", &output.harm)].into_iter().chain(spread) {
            self.floats(name(part), &tensor.dims(), &values(tensor.clone().into_data()));
        }
        let queries = output.queries.iter().flatten();
        let cell = |query: &Query| query.heatmap_cell(n_x / scale, scale) as i64;
        let cells: Vec<i64> = queries.clone().map(cell).collect();
        let scores: Vec<f32> = queries.map(|query| query.score).collect();
        let shape = [n_batch, cells.len() / n_batch];
        self.integers(name("cells"), &shape, &cells);
        self.floats(name("scores"), &shape, &scores);
    }

    fn losses(&mut self, prefix: &str, parts: LossParts, gradient_norm: f32) {
        let named = [
            ("heatmap", parts.heatmap),
            ("harm", parts.harm),
            ("boxes", parts.boxes),
            ("norm", gradient_norm),
        ];
        for (part, value) in named {
            self.floats(format!("{prefix}.loss.{part}"), &[1], &[value]);
        }
    }

    fn write(&self, path: &Path) -> Result<(), BenchError> {
        let fail = |message: String| BenchError::Pack { message, path: path.to_owned() };
        let views = self.0.iter().map(|(name, (dtype, shape, bytes))| {
            Ok((
                name,
                TensorView::new(*dtype, shape.clone(), bytes).map_err(|error| fail(error.to_string()))?,
            ))
        });
        let views = views.collect::<Result<Vec<_>, BenchError>>()?;
        let bytes = safetensors::serialize(views, None).map_err(|error| fail(error.to_string()))?;
        Ok(files::write_atomic(path, &bytes)?)
    }
}
