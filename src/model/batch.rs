//! Several samples' inputs as tensors.

use burn::tensor::{Device, Tensor, TensorData};

use super::camera::{CameraBatch, CameraInput};
use super::config::ModelConfig;
use super::input::Input;
use super::lidar::{LidarBatch, LidarInput};

/// Inputs of `batch` samples.
#[derive(Debug, Clone)]
pub struct Batch {
    pub n_samples: usize,
    /// `None` without a LiDAR branch.
    pub lidar: Option<LidarBatch>,
    /// The camera's inputs; `None` in the LiDAR stage.
    pub camera: Option<CameraBatch>,
    /// `[batch * state, 2]`: scaled speed and steering; all samples have the same number of states.
    pub numeric: Tensor<2>,
}

impl Batch {
    /// Stacks inputs prepared with `config`; all images must have one size.
    ///
    /// # Panics
    /// If `inputs` is empty, if their numbers of states differ, or if they were prepared with another config.
    #[must_use]
    pub fn stack(inputs: &[&Input], config: &ModelConfig, with_camera: bool, device: &Device) -> Self {
        assert!(!inputs.is_empty(), "a batch holds at least one sample");
        let n_samples = inputs.len();
        let n_states = inputs[0].numeric.len();
        assert!(inputs.iter().all(|input| input.numeric.len() == n_states), "samples differ in states");
        let numeric: Vec<f32> =
            inputs.iter().flat_map(|input| input.numeric.iter().flatten().copied()).collect();
        let lidar =
            || -> Option<Vec<&LidarInput>> { inputs.iter().map(|input| input.lidar.as_ref()).collect() };
        let camera =
            || -> Option<Vec<&CameraInput>> { inputs.iter().map(|input| input.camera.as_ref()).collect() };
        let prepared = "the inputs were prepared with this config";
        Self {
            n_samples,
            lidar: config.use_lidar.then(|| LidarBatch::stack(&lidar().expect(prepared), config, device)),
            camera: (with_camera && config.use_camera)
                .then(|| CameraBatch::stack(&camera().expect(prepared), config, device)),
            numeric: Tensor::from_data(TensorData::new(numeric, [n_samples * n_states, 2]), device),
        }
    }
}
