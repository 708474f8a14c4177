//! Small LiDAR branch: pillar encoder (PointPillars, Lang et al. 2019) and a two-scale bird's-eye net.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::nn::{BatchNorm, BatchNormConfig, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::LidarMaps;
use super::pillars::PillarBatch;
use crate::kernels::pillar_map;
use crate::model::config::ModelConfig;
use crate::model::layers::{ConvBlock, batch_norm, convolve_pointwise, pointwise, upsample_nearest};

/// From points to features on the bird's-eye grid at one cell (two pillars).
#[derive(Module, Debug)]
pub struct PillarBranch {
    point: Linear,
    /// From the picture's features of a point.
    painted: Option<Linear>,
    point_norm: BatchNorm,
    fine: Vec<ConvBlock>,
    coarse: Vec<ConvBlock>,
    fine_out: Conv2d,
    coarse_out: Conv2d,
    #[module(skip)]
    n_pillars: [usize; 2],
    #[module(skip)]
    n_pillar_channels: usize,
}

impl PillarBranch {
    pub fn init(config: &ModelConfig, device: &Device) -> Self {
        let (grid, n_painted) = (&config.grid, config.paint_channels());
        let config = &config.lidar.pillars;
        let linear = |n_in| LinearConfig::new(n_in, config.channels).with_bias(false).init(device);
        let [fine, coarse] = config.bev_channels;
        let out = config.channels_out_of_scale();
        Self {
            point: linear(config.n_point_features()),
            painted: (n_painted > 0).then(|| linear(n_painted)),
            point_norm: BatchNormConfig::new(config.channels).with_epsilon(1e-3).init(device),
            fine: vec![
                ConvBlock::init(config.channels, fine, 2, device),
                ConvBlock::init(fine, fine, 1, device),
                ConvBlock::init(fine, fine, 1, device),
            ],
            coarse: vec![
                ConvBlock::init(fine, coarse, 2, device),
                ConvBlock::init(coarse, coarse, 1, device),
                ConvBlock::init(coarse, coarse, 1, device),
            ],
            fine_out: pointwise(fine, out, device),
            coarse_out: pointwise(coarse, out, device),
            n_pillars: [2 * grid.n_cells_y(), 2 * grid.n_cells_x()],
            n_pillar_channels: config.channels,
        }
    }

    /// # Shapes
    /// - painted: `[point, paint_channel]`
    /// - output: as [`super::LidarMaps`]
    pub fn forward(
        &self,
        pillars: Option<&PillarBatch>,
        painted: Option<Tensor<2>>,
        n_samples: usize,
        device: &Device,
    ) -> LidarMaps {
        let pillars_map = self.scatter(pillars, painted, n_samples, device);
        let fine = self.fine.iter().fold(pillars_map.clone(), |x, block| block.forward(x));
        let coarse = self.coarse.iter().fold(fine.clone(), |x, block| block.forward(x));
        let fine = convolve_pointwise(&self.fine_out, fine);
        let coarse = upsample_nearest(convolve_pointwise(&self.coarse_out, coarse));
        LidarMaps { map: Tensor::cat(vec![fine, coarse], 1), pillars: Some(pillars_map) }
    }

    /// Encodes points, takes the maximum of each pillar and lays it on the grid.
    ///
    /// # Shapes
    /// - output: `[batch, channel, pillar_y, pillar_x]`, zero where no point falls
    fn scatter(
        &self,
        pillars: Option<&PillarBatch>,
        painted: Option<Tensor<2>>,
        n_samples: usize,
        device: &Device,
    ) -> Tensor<4> {
        let [n_y, n_x] = self.n_pillars;
        let Some(batch) = pillars else {
            return Tensor::zeros([n_samples, self.n_pillar_channels, n_y, n_x], device);
        };
        let mut points = self.point.forward(batch.point_features.clone());
        if let (Some(linear), Some(painted)) = (&self.painted, painted) {
            points = points + linear.forward(painted);
        }
        let points = relu(batch_norm(&self.point_norm, points));
        pillar_map(points, &batch.plan).reshape([n_samples, self.n_pillar_channels, n_y, n_x])
    }
}
