//! From one sample's cloud and packed picture to its boxes, stage by stage: the functions that [`Input::prepare`],
//! [`Detector::forward`] and [`detections`] string together, called one by one, so that each can be measured.

use burn::tensor::Device;
use serde::Serialize;

use super::batch::Batch;
use super::cnn_input::{CnnInput, resized};
use super::config::CameraBackbone;
use super::detector::{Detector, detections};
use super::input::{CameraInput, Input, InputError, LidarInput, points_in_ego};
use crate::object::Detection;
use crate::sample::Measured;

/// A stage of inference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum InferenceStage {
    ImageDecode,
    ImageResize,
    Points,
    /// Pillars or voxels.
    Voxelization,
    /// LiDAR depths in the image, and cells of the frustum; with Swin also the picture's resizing.
    CameraInput,
    Tensors,
    LidarBranch,
    /// With Swin also its lift.
    ImageNet,
    LiftSplat,
    FuserAndBackbone,
    Head,
    BoxDecode,
}

impl InferenceStage {
    /// In the order of work.
    pub const ALL: [Self; 12] = [
        Self::ImageDecode,
        Self::ImageResize,
        Self::Points,
        Self::Voxelization,
        Self::CameraInput,
        Self::Tensors,
        Self::ImageNet,
        Self::LiftSplat,
        Self::LidarBranch,
        Self::FuserAndBackbone,
        Self::Head,
        Self::BoxDecode,
    ];

    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ImageDecode => "image decode",
            Self::ImageResize => "image resize",
            Self::Points => "points to ego frame",
            Self::Voxelization => "voxelization",
            Self::CameraInput => "depths and frustum",
            Self::Tensors => "tensors",
            Self::LidarBranch => "LiDAR branch",
            Self::ImageNet => "camera branch",
            Self::LiftSplat => "lift and splat",
            Self::FuserAndBackbone => "fuser and backbone",
            Self::Head => "head",
            Self::BoxDecode => "box decode",
        }
    }
}

/// Boxes of one sample, best first, as by the whole functions; `watch` is told each stage and must call what it
/// is given. The detector must be in inference mode.
///
/// # Errors
/// The image is broken, or speed or steering is not finite.
pub fn detect_by_stage(
    detector: &Detector,
    measured: &Measured,
    min_score: f32,
    device: &Device,
    watch: &mut dyn FnMut(InferenceStage, &mut dyn FnMut()),
) -> Result<Vec<Detection>, InputError> {
    use InferenceStage as Stage;
    let config = detector.config();
    let watch = &mut Watch(watch);
    let image = watch.run(Stage::ImageDecode, || config.use_camera.then(|| measured.image.decode()));
    let image = image.transpose()?;
    let with_cnn = config.use_camera && config.camera.backbone == CameraBackbone::Cnn;
    let small = watch
        .run(Stage::ImageResize, || image.as_ref().filter(|_| with_cnn).map(|full| resized(full, config)));
    let points = watch.run(Stage::Points, || points_in_ego(measured, false));
    let lidar = watch.run(Stage::Voxelization, || LidarInput::prepare(&points, config));
    let camera = watch.run(Stage::CameraInput, || {
        let seen = if config.use_lidar { points.as_slice() } else { &[] };
        let pose = &measured.ego_from_camera;
        Ok::<_, InputError>(match (&image, &small) {
            (Some(full), Some(small)) => Some(CameraInput::Cnn(CnnInput::of_resized(
                small,
                full.width(),
                seen,
                &measured.intrinsics,
                pose,
                config,
            ))),
            (Some(_), None) => Some(CameraInput::prepare(measured, seen, config, false)?),
            (None, _) => None,
        })
    })?;
    let batch = watch.run(Stage::Tensors, || {
        let states = std::slice::from_ref(&measured.ego_state);
        let input = Input { lidar, camera, numeric: Vec::new() }.with_states(states, false)?;
        Ok::<_, InputError>(Batch::stack(&[&input], config, config.use_camera, device))
    })?;
    let features = watch.run(Stage::ImageNet, || detector.image_features(&batch));
    let camera = watch.run(Stage::LiftSplat, || detector.camera_map(&batch, features));
    let lidar = watch.run(Stage::LidarBranch, || detector.lidar_map(&batch));
    let fused = watch.run(Stage::FuserAndBackbone, || detector.fuse(camera, lidar));
    let output = watch.run(Stage::Head, || detector.head(&batch, fused));
    let found = watch.run(Stage::BoxDecode, || detections(&output, config, min_score));
    Ok(found.into_iter().flatten().collect())
}

/// Hands a stage's result past the watcher.
struct Watch<'a>(&'a mut dyn FnMut(InferenceStage, &mut dyn FnMut()));

impl Watch<'_> {
    fn run<T>(&mut self, stage: InferenceStage, work: impl FnOnce() -> T) -> T {
        let (mut work, mut result) = (Some(work), None);
        (self.0)(stage, &mut || result = work.take().map(|work| work()));
        result.expect("the watcher calls what it is given, once")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::model::ModelConfig;

    #[test]
    fn boxes_by_stages_are_those_of_the_whole_functions() {
        let device = Device::flex();
        let mut small = ModelConfig::default();
        (small.grid.cell_size_m, small.camera.cnn.image_width_px, small.head.n_queries) = (3.2, 64, 20);
        let paper = toml::from_str(include_str!("../../tests/data/paper_scaled_down.toml")).unwrap();
        let data = test_data::dataset(1);
        let measured = &data.samples()[0].measured;
        for config in [small, paper] {
            let detector = Detector::init(&config, 0, &device);
            let mut stages = Vec::new();
            let found = detect_by_stage(&detector, measured, 0.0, &device, &mut |stage, work| {
                stages.push(stage);
                work();
            });
            let input = Input::prepare(measured, &config, false, true).unwrap();
            let batch = Batch::stack(&[&input], &config, true, &device);
            let whole = detections(&detector.forward(&batch), &config, 0.0).concat();
            assert!(!whole.is_empty());
            assert_eq!((found.unwrap(), stages), (whole, InferenceStage::ALL.to_vec()));
        }
    }
}
