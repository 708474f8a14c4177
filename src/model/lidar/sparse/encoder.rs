//! Sparse encoder: from voxel features to a dense bird's-eye map (SECOND, Yan et al. 2018; sizes of
//! BEVFusion).
//!
//! A submanifold convolution comes first, then stages of residual blocks with a convolution of stride 2 between
//! them, then a convolution along z, whose heights become channels of the map. No convolution has a bias; each is
//! followed by batch norm over the active sites and, outside the short cuts, ReLU.

use burn::module::Module;
use burn::tensor::activation::relu;
use burn::tensor::{Device, IndexingUpdateOp, Int, Tensor, TensorData};

use super::conv::{SparseBlock, SparseConvNorm};
use super::rulebooks::EncoderRulebooks;
use crate::model::config::{SparseEncoderConfig, SparseKernel};

/// The encoder.
#[derive(Module, Debug)]
pub struct SparseEncoder {
    first: SparseConvNorm,
    /// Residual blocks of each stage.
    stages: Vec<Vec<SparseBlock>>,
    downs: Vec<SparseConvNorm>,
    last: SparseConvNorm,
    #[module(skip)]
    channels_out: usize,
}

impl SparseEncoder {
    pub fn init(channels_in: usize, config: &SparseEncoderConfig, device: &Device) -> Self {
        let n_offsets = SparseKernel::SUBMANIFOLD.n_offsets();
        let stage = |(&n_channels, &n_blocks): (&usize, &usize)| {
            (0..n_blocks).map(|_| SparseBlock::init(n_channels, n_offsets, device)).collect()
        };
        let (&widest, strided) =
            (config.channels.last().expect("there is a stage"), config.strided_kernels());
        let down = |(channels, geometry): (&[usize], &SparseKernel)| {
            SparseConvNorm::init(channels[0], channels[1], geometry.n_offsets(), device)
        };
        let last = &strided[strided.len() - 1];
        Self {
            first: SparseConvNorm::init(channels_in, config.channels[0], n_offsets, device),
            stages: config.channels.iter().zip(&config.n_blocks).map(stage).collect(),
            downs: config.channels.windows(2).zip(&strided).map(down).collect(),
            last: SparseConvNorm::init(widest, config.channels_out, last.n_offsets(), device),
            channels_out: config.channels_out,
        }
    }

    /// # Shapes
    /// - x: `[voxel, channel_in]`, rows in the order of the sites that the rulebooks were built from
    /// - output: `[batch, channel_out * z, y, x]`, channel outermost; zero where no site is
    pub fn forward(&self, x: Tensor<2>, rulebooks: &EncoderRulebooks, n_samples: usize) -> Tensor<4> {
        if rulebooks.sites.is_empty() {
            return self.lay_out(None, rulebooks, n_samples, &x.device());
        }
        let mut x = relu(self.first.forward(x, &rulebooks.stages[0]));
        for (level, blocks) in self.stages.iter().enumerate() {
            x = blocks.iter().fold(x, |x, block| block.forward(x, &rulebooks.stages[level]));
            if let Some(down) = self.downs.get(level) {
                x = relu(down.forward(x, &rulebooks.downs[level]));
            }
        }
        let x = relu(self.last.forward(x, &rulebooks.last));
        let device = x.device();
        self.lay_out(Some(x), rulebooks, n_samples, &device)
    }

    /// Lays the rows of the last sites onto the map.
    fn lay_out(
        &self,
        rows: Option<Tensor<2>>,
        rulebooks: &EncoderRulebooks,
        n_samples: usize,
        device: &Device,
    ) -> Tensor<4> {
        let [n_z, n_y, n_x] = rulebooks.sites.shape();
        let map = Tensor::<2>::zeros([n_samples * n_z * n_y * n_x, self.channels_out], device);
        let map = match rows {
            Some(rows) => {
                let cell = |(sample_idx, [z, y, x]): (usize, [usize; 3])| {
                    (((sample_idx * n_z + z) * n_y + y) * n_x + x) as i64
                };
                let cells: Vec<i64> = rulebooks.sites.iter().map(cell).collect();
                let n_cells = cells.len();
                let cells = Tensor::<1, Int>::from_data(TensorData::new(cells, [n_cells]), device);
                map.select_assign(0, cells, rows, IndexingUpdateOp::Add)
            }
            None => map,
        };
        map.reshape([n_samples, n_z, n_y, n_x, self.channels_out]).permute([0, 4, 1, 2, 3]).reshape([
            n_samples,
            self.channels_out * n_z,
            n_y,
            n_x,
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::super::sites::Sites;
    use super::*;
    use crate::device::test_device;
    use crate::model::golden::{Golden, relative_error};
    use crate::model::parameters::n_trained;

    fn small() -> SparseEncoderConfig {
        SparseEncoderConfig {
            channels: vec![3, 4, 5],
            n_blocks: vec![1, 2, 1],
            z_padding: vec![1, 0],
            channels_out: 6,
        }
    }

    #[test]
    fn the_published_encoder_has_2_694_million_parameters_and_a_256_channel_map() {
        let config = SparseEncoderConfig::default();
        let encoder = SparseEncoder::init(4, &config, &Device::flex().autodiff());
        // The published net has one channel more at its input.
        assert_eq!(n_trained(&encoder) + 27 * 16, 2_694_352);
        assert_eq!(config.check_with([41, 1440, 720]), Ok(()));
        assert_eq!(config.out_shape([41, 1440, 720]), Some([2, 180, 90]));
    }

    #[test]
    fn equals_dense_convolutions_read_at_the_active_sites() {
        let golden = Golden::read("sparse");
        let device = test_device().autodiff();
        let sites = golden.sites("encoder.shape", "encoder.cells");
        let rulebooks = EncoderRulebooks::build(sites, &small());
        let encoder = golden.load_torch("encoder.net", SparseEncoder::init(4, &small(), &device));
        let inner = test_device();

        let x = golden.tensor::<2>("encoder.x", &inner);
        golden.check("encoder.y_eval", &encoder.valid().forward(x, &rulebooks, 2));

        let x = golden.tensor::<2>("encoder.x", &device).require_grad();
        let y = encoder.forward(x.clone(), &rulebooks, 2);
        let dy = golden.tensor::<4>("encoder.dy", &device);
        let gradients = (y.clone() * dy).sum().backward();
        golden.check("encoder.y_train", &y);
        golden.check("encoder.dx", &x.grad(&gradients).unwrap());
        golden.check("encoder.d_first", &encoder.first.weight_gradient(&gradients));
        golden.check("encoder.d_last", &encoder.last.weight_gradient(&gradients));
        let [mean, variance] = encoder.last.running_statistics();
        golden.check("encoder.running_mean", &mean);
        // PyTorch's running variance is the unbiased one, n / (n - 1) times burn's, of which 1 % enters.
        assert!(relative_error(variance, golden.tensor("encoder.running_var", &inner)) < 1e-3);
    }

    #[test]
    fn without_voxels_the_map_is_zero() {
        let device = Device::flex().autodiff();
        let rulebooks = EncoderRulebooks::build(Sites::new([21, 16, 12], &[&[], &[]]), &small());
        let encoder = SparseEncoder::init(4, &small(), &device);
        let map = encoder.forward(Tensor::zeros([0, 4], &device), &rulebooks, 2);
        assert_eq!(map.dims(), [2, 12, 4, 3]);
        assert_eq!(map.abs().max().into_scalar::<f32>(), 0.0);
    }
}
