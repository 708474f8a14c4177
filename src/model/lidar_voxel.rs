//! LiDAR branch on voxels: sparse encoder, then the bird's-eye backbone.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};

use super::bev_backbone::BevBackbone;
use super::config::LidarVoxelConfig;
use super::sparse::{EncoderRulebooks, Sites, SparseEncoder};
use super::voxel::{N_VOXEL_FEATURES, Voxels};

/// The voxels of `n_samples` samples and what is built from their cells once for all layers.
#[derive(Debug, Clone)]
pub struct VoxelBatch {
    pub n_samples: usize,
    /// `[voxel, N_VOXEL_FEATURES]`, all samples in one list.
    pub features: Tensor<2>,
    pub rulebooks: EncoderRulebooks,
}

impl VoxelBatch {
    /// Stacks the voxels of several samples; a sample may have none. The config has passed its check.
    ///
    /// # Panics
    /// If voxels come from another grid.
    #[must_use]
    pub fn stack(samples: &[&Voxels], config: &LidarVoxelConfig, device: &Device) -> Self {
        let cells: Vec<&[[u16; 3]]> = samples.iter().map(|voxels| voxels.cells.as_slice()).collect();
        let sites = Sites::new(config.sparse_shape(), &cells);
        let features: Vec<f32> = samples.iter().flat_map(|voxels| &voxels.features).copied().collect();
        let dims = [sites.len(), N_VOXEL_FEATURES];
        Self {
            n_samples: samples.len(),
            features: Tensor::from_data(TensorData::new(features, dims), device),
            rulebooks: EncoderRulebooks::build(sites, &config.encoder),
        }
    }
}

/// From voxels to features on the bird's-eye grid.
#[derive(Module, Debug)]
pub struct LidarVoxelBranch {
    encoder: SparseEncoder,
    backbone: BevBackbone,
}

impl LidarVoxelBranch {
    /// The config has passed its check.
    pub fn init(config: &LidarVoxelConfig, device: &Device) -> Self {
        let [channels, ..] = config.encoded_shape();
        Self {
            encoder: SparseEncoder::init(N_VOXEL_FEATURES, &config.encoder, device),
            backbone: BevBackbone::init(channels, &config.backbone, device),
        }
    }

    /// # Shapes
    /// - output: `[batch, channel, cell_y, cell_x]`, as [`LidarVoxelConfig::out_shape`]
    pub fn forward(&self, batch: &VoxelBatch) -> Tensor<4> {
        self.backbone.forward(self.encode(batch))
    }

    /// The encoder's map alone.
    ///
    /// # Shapes
    /// - output: `[batch, channel, y, x]`, as [`LidarVoxelConfig::encoded_shape`]
    pub fn encode(&self, batch: &VoxelBatch) -> Tensor<4> {
        self.encoder.forward(batch.features.clone(), &batch.rulebooks, batch.n_samples)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::config::{BevBackboneConfig, SparseEncoderConfig, VoxelConfig};
    use crate::model::n_trained;
    use crate::model::voxelize;

    fn small() -> LidarVoxelConfig {
        LidarVoxelConfig {
            voxels: VoxelConfig {
                x_max_m: 3.2,
                y_min_m: -1.6,
                y_max_m: 1.6,
                size_xy_m: 0.1,
                ..VoxelConfig::default()
            },
            encoder: SparseEncoderConfig {
                channels: vec![4, 6, 8, 8],
                n_blocks: vec![1, 1, 0, 1],
                channels_out: 5,
                ..SparseEncoderConfig::default()
            },
            backbone: BevBackboneConfig {
                channels: vec![8, 12],
                n_layers: vec![1, 1],
                channels_out: vec![6, 7],
                ..BevBackboneConfig::default()
            },
        }
    }

    fn points(seed: u64) -> Vec<[f64; 4]> {
        use rand::RngExt;
        let mut rng = crate::random::stream(seed, "voxel-test", 0);
        (0..200)
            .map(|_| {
                [
                    rng.random::<f64>() * 3.2,
                    rng.random::<f64>() * 3.2 - 1.6,
                    rng.random::<f64>() * 8.0 - 3.0,
                    100.0 * rng.random::<f64>(),
                ]
            })
            .collect()
    }

    #[test]
    fn the_published_branch_ends_in_512_channels_on_180_by_90_cells_of_60_cm() {
        let config = LidarVoxelConfig::default();
        assert_eq!(config.check(), Ok(()));
        assert_eq!(config.sparse_shape(), [41, 1440, 720]);
        assert_eq!((config.encoded_shape(), config.out_shape()), ([256, 180, 90], [512, 180, 90]));
        assert!((config.cell_size_m() - 0.6).abs() < 1e-12);
        let branch = LidarVoxelBranch::init(&config, &Device::flex().autodiff());
        assert_eq!(n_trained(&branch), 2_693_920 + 4_280_832 + 295_936);
    }

    #[test]
    fn samples_of_a_batch_do_not_see_each_other() {
        let (config, device) = (small(), Device::flex());
        assert_eq!(config.check(), Ok(()));
        let branch = LidarVoxelBranch::init(&config, &device);
        let clouds = [points(1), vec![], points(2)].map(|points| voxelize(&points, &config.voxels));
        let together = VoxelBatch::stack(&clouds.each_ref(), &config, &device);
        let together = branch.forward(&together);
        for (sample_idx, cloud) in clouds.iter().enumerate() {
            let alone = branch.forward(&VoxelBatch::stack(&[cloud], &config, &device));
            let [channels, n_y, n_x] = config.out_shape();
            assert_eq!(alone.dims(), [1, channels, n_y, n_x]);
            let difference = alone - together.clone().narrow(0, sample_idx, 1);
            assert!(difference.abs().max().into_scalar::<f32>() < 1e-5);
        }
    }

    #[test]
    fn a_point_shows_in_the_cell_that_holds_it() {
        let (config, device) = (small(), Device::flex());
        let branch = LidarVoxelBranch::init(&config, &device);
        // One voxel in the last column and the first row of cells.
        let cloud = voxelize(&[[3.1, -1.5, 0.0, 50.0]], &config.voxels);
        let map = branch.encode(&VoxelBatch::stack(&[&cloud], &config, &device));
        let [_, n_y, n_x] = config.encoded_shape();
        let per_cell: Vec<f32> = map.abs().sum_dim(1).into_data().try_to_vec().unwrap();
        let lit: Vec<usize> = (0..n_y * n_x).filter(|&cell| per_cell[cell] > 0.0).collect();
        assert!(lit.contains(&(n_x - 1)), "{lit:?}");
        assert!(lit.iter().all(|&cell| cell / n_x <= 1 && cell % n_x >= n_x - 2), "{lit:?}");
    }
}
