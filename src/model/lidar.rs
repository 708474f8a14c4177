//! LiDAR branch: pillar encoder (PointPillars, Lang et al. 2019) and a two-scale bird's-eye net.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::nn::{BatchNorm, BatchNormConfig, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, IndexingUpdateOp, Tensor};

use super::batch::Batch;
use super::config::ModelConfig;
use super::input::N_POINT_FEATURES;
use super::layers::{ConvBlock, pointwise, upsample_nearest};

/// From points to features on the bird's-eye grid at one cell (two pillars).
#[derive(Module, Debug)]
pub struct LidarBranch {
    point: Linear,
    point_norm: BatchNorm,
    fine: Vec<ConvBlock>,
    coarse: Vec<ConvBlock>,
    fine_out: Conv2d,
    coarse_out: Conv2d,
    #[module(skip)]
    n_pillars: [usize; 2],
    #[module(skip)]
    max_points: usize,
    #[module(skip)]
    n_pillar_channels: usize,
}

impl LidarBranch {
    pub fn init(config: &ModelConfig, device: &Device) -> Self {
        let [fine, coarse] = config.bev_channels;
        let out = Self::channels_out_of_scale(config);
        Self {
            point: LinearConfig::new(N_POINT_FEATURES, config.pillar_channels).with_bias(false).init(device),
            point_norm: BatchNormConfig::new(config.pillar_channels).with_epsilon(1e-3).init(device),
            fine: vec![
                ConvBlock::init(config.pillar_channels, fine, 2, device),
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
            n_pillars: [config.grid.n_pillars_y(), config.grid.n_pillars_x()],
            max_points: config.max_points_per_pillar,
            n_pillar_channels: config.pillar_channels,
        }
    }

    fn channels_out_of_scale(config: &ModelConfig) -> usize {
        config.bev_channels[0] * 3 / 4
    }

    /// Channels of the output.
    pub fn channels_out(config: &ModelConfig) -> usize {
        2 * Self::channels_out_of_scale(config)
    }

    /// # Shapes
    /// - output: `[batch, channel, cell_y, cell_x]`
    pub fn forward(&self, batch: &Batch) -> Tensor<4> {
        let fine = self.fine.iter().fold(self.scatter(batch), |x, block| block.forward(x));
        let coarse = self.coarse.iter().fold(fine.clone(), |x, block| block.forward(x));
        let fine = self.fine_out.forward(fine);
        let coarse = upsample_nearest(self.coarse_out.forward(coarse));
        Tensor::cat(vec![fine, coarse], 1)
    }

    /// Encodes points, takes the maximum of each pillar and lays it on the grid.
    ///
    /// # Shapes
    /// - output: `[batch, channel, pillar_y, pillar_x]`, zero where no point falls
    fn scatter(&self, batch: &Batch) -> Tensor<4> {
        let [n_y, n_x] = self.n_pillars;
        let device = batch.numeric.device();
        let map = Tensor::<2>::zeros([batch.n_samples * n_y * n_x, self.n_pillar_channels], &device);
        let map = match (&batch.point_features, &batch.pillar_points, &batch.pillar_cells) {
            (Some(features), Some(rows), Some(cells)) => {
                let points = relu(self.point_norm.forward(self.point.forward(features.clone())));
                let [n_pillars] = cells.dims();
                let pillars = points
                    .select(0, rows.clone())
                    .reshape([n_pillars, self.max_points, self.n_pillar_channels])
                    .max_dim(1)
                    .reshape([n_pillars, self.n_pillar_channels]);
                map.select_assign(0, cells.clone(), pillars, IndexingUpdateOp::Add)
            }
            _ => map,
        };
        map.reshape([batch.n_samples, n_y, n_x, self.n_pillar_channels]).permute([0, 3, 1, 2])
    }
}
