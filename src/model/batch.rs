//! Several samples' inputs as tensors.

use burn::tensor::{Device, Tensor, TensorData};

use super::cnn_input::{CnnBatch, CnnInput};
use super::config::{CameraBackbone, LidarEncoder, ModelConfig};
use super::input::{CameraInput, Input, LidarInput};
use super::lidar_voxel::VoxelBatch;
use super::pillars::{PillarBatch, Pillars};
use super::swin_camera::{SwinCameraBatch, SwinCameraInput};
use super::voxel::Voxels;

/// Inputs of `batch` samples.
#[derive(Debug, Clone)]
pub struct Batch {
    pub n_samples: usize,
    /// `None` without a LiDAR branch.
    pub lidar: Option<LidarBatch>,
    /// The camera's inputs; `None` in the LiDAR stage.
    pub camera: Option<CameraBatch>,
    /// `[batch * state, 2]`: scaled speed and steering; every sample has as many states.
    pub numeric: Tensor<2>,
}

/// The LiDAR's inputs of a batch.
#[derive(Debug, Clone)]
pub enum LidarBatch {
    /// `None` when no sample has a point in the grid.
    Pillars(Option<PillarBatch>),
    Voxels(VoxelBatch),
}

/// The camera's inputs of a batch.
#[derive(Debug, Clone)]
pub enum CameraBatch {
    Cnn(CnnBatch),
    Swin(SwinCameraBatch),
}

impl Batch {
    /// Stacks inputs prepared with `config`; all images must have one size.
    ///
    /// # Panics
    /// If `inputs` is empty, or their numbers of states differ.
    #[must_use]
    pub fn stack(inputs: &[&Input], config: &ModelConfig, with_camera: bool, device: &Device) -> Self {
        assert!(!inputs.is_empty(), "a batch holds at least one sample");
        let n_samples = inputs.len();
        let n_states = inputs[0].numeric.len();
        assert!(inputs.iter().all(|input| input.numeric.len() == n_states), "as many states everywhere");
        let numeric: Vec<f32> =
            inputs.iter().flat_map(|input| input.numeric.iter().flatten().copied()).collect();
        Self {
            n_samples,
            lidar: config.use_lidar.then(|| LidarBatch::stack(inputs, config, device)),
            camera: (with_camera && config.use_camera).then(|| CameraBatch::stack(inputs, config, device)),
            numeric: Tensor::from_data(TensorData::new(numeric, [n_samples * n_states, 2]), device),
        }
    }
}

/// Why the inputs' kinds cannot differ from the config's.
const PREPARED: &str = "inputs were prepared with this config";

impl LidarBatch {
    fn stack(inputs: &[&Input], config: &ModelConfig, device: &Device) -> Self {
        let of = inputs.iter().map(|input| input.lidar.as_ref().expect(PREPARED));
        match config.lidar.encoder {
            LidarEncoder::Pillars => {
                let pillars: Vec<&Pillars> = of
                    .map(|input| match input {
                        LidarInput::Pillars(pillars) => pillars,
                        LidarInput::Voxels(_) => unreachable!("{PREPARED}"),
                    })
                    .collect();
                Self::Pillars(PillarBatch::stack(&pillars, config, device))
            }
            LidarEncoder::Voxels => {
                let voxels: Vec<&Voxels> = of
                    .map(|input| match input {
                        LidarInput::Voxels(voxels) => voxels,
                        LidarInput::Pillars(_) => unreachable!("{PREPARED}"),
                    })
                    .collect();
                Self::Voxels(VoxelBatch::stack(&voxels, &config.lidar.voxel, device))
            }
        }
    }
}

impl CameraBatch {
    fn stack(inputs: &[&Input], config: &ModelConfig, device: &Device) -> Self {
        let of = inputs.iter().map(|input| input.camera.as_ref().expect(PREPARED));
        match config.camera.backbone {
            CameraBackbone::Cnn => {
                let inputs: Vec<&CnnInput> = of
                    .map(|input| match input {
                        CameraInput::Cnn(input) => input,
                        CameraInput::Swin(_) => unreachable!("{PREPARED}"),
                    })
                    .collect();
                Self::Cnn(CnnBatch::stack(&inputs, config, device))
            }
            CameraBackbone::Swin => {
                let inputs: Vec<&SwinCameraInput> = of
                    .map(|input| match input {
                        CameraInput::Swin(input) => input,
                        CameraInput::Cnn(_) => unreachable!("{PREPARED}"),
                    })
                    .collect();
                Self::Swin(SwinCameraBatch::stack(&inputs, &config.camera.swin, device))
            }
        }
    }
}
