//! Small camera branch: a convolutional net, a depth distribution for each feature helped by the
//! LiDAR's sparse depth, and the lift to bird's-eye view (lift-splat, Philion and Fidler 2020;
//! depth input as in BEVFusion, Liu et al. 2023).

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::{Device, Tensor};

use super::ImageFeatures;
use super::cnn_input::CnnBatch;
use super::lift::lift_and_pool;
use super::paint::Paint;
use crate::model::config::ModelConfig;
use crate::model::layers::{ConvBlock, convolve_pointwise, pointwise};

/// Convolutions up to a quarter of the image's size.
const N_BLOCKS_TO_QUARTER: usize = 3;
/// Channels of the encoded LiDAR depth.
const DEPTH_CHANNELS: usize = 16;

/// From an image to features on the bird's-eye grid.
#[derive(Module, Debug)]
pub struct CnnBranch {
    image: Vec<ConvBlock>,
    depth: ConvBlock,
    joint: ConvBlock,
    lift: Conv2d,
    smooth: ConvBlock,
    paint: Option<Paint>,
    #[module(skip)]
    n_depth_bins: usize,
    #[module(skip)]
    n_cells: [usize; 2],
}

impl CnnBranch {
    pub fn init(config: &ModelConfig, device: &Device) -> Self {
        let (grid, is_painted) = (&config.grid, config.paint_channels() > 0);
        let config = &config.camera.cnn;
        let [a, b, c] = config.channels;
        let lift = config.lift_channels;
        Self {
            image: vec![
                ConvBlock::init(3, a, 2, device),
                ConvBlock::init(a, b, 2, device),
                ConvBlock::init(b, b, 1, device),
                ConvBlock::init(b, c, 2, device),
                ConvBlock::init(c, c, 1, device),
            ],
            depth: ConvBlock::init(2, DEPTH_CHANNELS, 1, device),
            joint: ConvBlock::init(c + DEPTH_CHANNELS, c, 1, device),
            lift: pointwise(c, config.n_depth_bins + lift, device),
            smooth: ConvBlock::init(lift, lift, 1, device),
            paint: is_painted.then(|| Paint::init(config, device)),
            n_depth_bins: config.n_depth_bins,
            n_cells: [grid.n_cells_y(), grid.n_cells_x()],
        }
    }

    /// Features of the image and of the LiDAR's depths in it.
    pub fn image_features(&self, batch: &CnnBatch) -> ImageFeatures {
        let (to_quarter, to_eighth) = self.image.split_at(N_BLOCKS_TO_QUARTER);
        let quarter = to_quarter.iter().fold(batch.image.clone(), |x, block| block.forward(x));
        let eighth = to_eighth.iter().fold(quarter.clone(), |x, block| block.forward(x));
        let depth = self.depth.forward(batch.depth.clone());
        let joint = self.joint.forward(Tensor::cat(vec![eighth, depth], 1));
        let paint = self.paint.as_ref().map(|paint| paint.forward(quarter, joint.clone()));
        ImageFeatures { joint, paint }
    }

    /// Whether each pixel of the painting's map shows an object.
    pub fn objects(&self, features: &ImageFeatures) -> Option<Tensor<4>> {
        let (paint, map) = self.paint.as_ref().zip(features.paint.clone())?;
        Some(paint.objects(map))
    }

    /// Lifts these features to the bird's-eye grid.
    ///
    /// # Shapes
    /// - joint: `[batch, channel, feature_y, feature_x]`
    /// - output: `[batch, lift_channel, cell_y, cell_x]`; each cell the sum of the frustum points in it
    pub fn lift_and_splat(&self, joint: Tensor<4>, batch: &CnnBatch) -> Tensor<4> {
        let lifted = convolve_pointwise(&self.lift, joint);
        self.smooth.forward(lift_and_pool(lifted, self.n_depth_bins, self.n_cells, &batch.plans))
    }
}
