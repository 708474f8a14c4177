//! The whole detector: LiDAR and camera branches, fuser, head.

use std::sync::{Mutex, PoisonError};

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor};

use super::batch::Batch;
use super::camera::CameraBranch;
use super::coder::{CODE_SIZE, decode};
use super::config::ModelConfig;
use super::head::{Head, Output};
use super::layers::ConvBlock;
use super::lidar::LidarBranch;
use crate::object::{Detection, Harm};

/// A fused LiDAR-camera detector of harmful and harmless objects.
#[derive(Module, Debug)]
pub struct Detector {
    lidar: LidarBranch,
    camera: CameraBranch,
    fuser: ConvBlock,
    head: Head,
    #[module(skip)]
    config: ModelConfig,
}

impl Detector {
    /// A detector with random weights from `seed`: same seed, same weights.
    #[must_use]
    pub fn init(config: &ModelConfig, seed: u64, device: &Device) -> Self {
        // The device's generator is one for the whole process and parameters draw when first looked at:
        // hold it for as long as the drawing lasts.
        static GENERATOR: Mutex<()> = Mutex::new(());
        let _held = GENERATOR.lock().unwrap_or_else(PoisonError::into_inner);
        device.seed(seed);
        let detector = Self::undrawn(config, device);
        detector.visit(&mut Draw);
        detector
    }

    fn undrawn(config: &ModelConfig, device: &Device) -> Self {
        let channels_in = LidarBranch::channels_out(config) + config.camera.lift_channels;
        Self {
            lidar: LidarBranch::init(config, device),
            camera: CameraBranch::init(config, device),
            fuser: ConvBlock::init(channels_in, config.hidden_channels, 1, device),
            head: Head::init(config.hidden_channels, config, device),
            config: config.clone(),
        }
    }

    #[must_use]
    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// Without camera inputs in the batch (the LiDAR stage) the camera's channels are zero.
    pub fn forward(&self, batch: &Batch) -> Output {
        let lidar = self.lidar.forward(batch);
        let camera = match &batch.camera {
            Some(camera) => self.camera.forward(camera),
            None => {
                let [n_batch, _, n_y, n_x] = lidar.dims();
                Tensor::zeros([n_batch, self.config.camera.lift_channels, n_y, n_x], &lidar.device())
            }
        };
        self.head.forward(self.fuser.forward(Tensor::cat(vec![camera, lidar], 1)), batch.numeric.clone())
    }
}

/// Looks at each parameter, which draws it.
struct Draw;

impl ModuleVisitor for Draw {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let _drawn = param.val();
    }
}

/// Boxes of each sample of a batch, best first: every query reports each class whose score, the
/// product of heatmap and class probability, reaches `min_score`.
#[must_use]
pub fn detections(output: &Output, config: &ModelConfig, min_score: f32) -> Vec<Vec<Detection>> {
    let codes: Vec<f32> = output.boxes.clone().into_data().try_to_vec().expect("codes are f32");
    let logits: Vec<f32> = output.harm.clone().into_data().try_to_vec().expect("class scores are f32");
    let mut query_idx = 0;
    output
        .queries
        .iter()
        .map(|queries| {
            let mut found = Vec::new();
            for query in queries {
                let code = &codes[query_idx * CODE_SIZE..(query_idx + 1) * CODE_SIZE];
                let (box_in_ego, velocity_in_ego_mps) = decode(code, query.center_m, config.grid.cell_size_m());
                for harm in Harm::ALL {
                    let probability = 1.0 / (1.0 + (-logits[2 * query_idx + harm.index()]).exp());
                    let score = query.score * probability;
                    if score >= min_score {
                        found.push(Detection { box_in_ego, velocity_in_ego_mps, harm, score });
                    }
                }
                query_idx += 1;
            }
            found.sort_by(|a, b| b.score.total_cmp(&a.score));
            found
        })
        .collect()
}
