//! The LiDAR branch: from points in the ego frame to a bird's-eye map, by pillars or by voxels.

mod drops;
mod ground;
mod pillar_branch;
mod pillars;
pub mod sparse;
mod voxels;

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::config::{LidarEncoder, ModelConfig};
use pillar_branch::PillarBranch;
pub use pillars::{PillarBatch, Pillars};
use sparse::SparseEncoder;
pub use voxels::{N_VOXEL_FEATURES, VoxelBatch, Voxels, voxelize};

/// The reason that a branch never gets the input of another encoder.
const SAME_CONFIG: &str = "input, batch and branch were made with one config";

/// One sample's points, grouped as the config's encoder needs them.
#[derive(Debug, Clone, PartialEq)]
pub enum LidarInput {
    Pillars(Pillars),
    Voxels(Voxels),
}

impl LidarInput {
    /// Groups points: x, y, z in the ego frame, and intensity.
    #[must_use]
    pub fn prepare(points: &[[f64; 4]], config: &ModelConfig) -> Self {
        match config.lidar.encoder {
            LidarEncoder::Pillars => Self::Pillars(Pillars::group(points, config)),
            LidarEncoder::Voxels => Self::Voxels(voxelize(points, &config.lidar.voxel.voxels)),
        }
    }

    /// Memory that the arrays take.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        match self {
            Self::Pillars(of) => {
                let n_ids = of.sources.len() + of.points.len() + of.cells.len();
                size_of_val(&*of.point_features) + n_ids * size_of::<u32>()
            }
            Self::Voxels(of) => size_of_val(&*of.features) + size_of_val(&*of.cells),
        }
    }

    /// The pillars, if the encoder has some.
    #[must_use]
    pub fn pillars(&self) -> Option<&Pillars> {
        if let Self::Pillars(pillars) = self { Some(pillars) } else { None }
    }

    fn voxels(&self) -> Option<&Voxels> {
        if let Self::Voxels(voxels) = self { Some(voxels) } else { None }
    }
}

/// The LiDAR's inputs of a batch.
#[derive(Debug, Clone)]
pub enum LidarBatch {
    /// `None` when no sample has a point in the grid.
    Pillars(Option<PillarBatch>),
    Voxels(VoxelBatch),
}

impl LidarBatch {
    /// Stacks inputs prepared with `config`.
    #[must_use]
    pub fn stack(inputs: &[&LidarInput], config: &ModelConfig, device: &Device) -> Self {
        match config.lidar.encoder {
            LidarEncoder::Pillars => {
                let pillars = inputs.iter().map(|input| input.pillars().expect(SAME_CONFIG));
                Self::Pillars(PillarBatch::stack(&pillars.collect::<Vec<_>>(), config, device))
            }
            LidarEncoder::Voxels => {
                let voxels = inputs.iter().map(|input| input.voxels().expect(SAME_CONFIG));
                Self::Voxels(VoxelBatch::stack(&voxels.collect::<Vec<_>>(), &config.lidar.voxel, device))
            }
        }
    }
}

/// What the network over the points makes of them.
#[derive(Debug, Clone)]
pub struct LidarMaps {
    /// `[batch, channel, cell_y, cell_x]`
    pub map: Tensor<4>,
    /// `[batch, pillar_channel, 2 cell_y, 2 cell_x]`: the pillars before the first convolution, if there are some.
    pub pillars: Option<Tensor<4>>,
}

/// The network over the points.
#[derive(Module, Debug)]
pub enum LidarBranch {
    Pillars(PillarBranch),
    Voxels(SparseEncoder),
}

impl LidarBranch {
    pub fn init(config: &ModelConfig, device: &Device) -> Self {
        match config.lidar.encoder {
            LidarEncoder::Pillars => Self::Pillars(PillarBranch::init(config, device)),
            LidarEncoder::Voxels => {
                Self::Voxels(SparseEncoder::init(N_VOXEL_FEATURES, &config.lidar.voxel.encoder, device))
            }
        }
    }

    /// # Shapes
    /// - painted: `[point, paint_channel]`, what pillars' points take along from the picture
    pub fn forward(
        &self,
        batch: &LidarBatch,
        painted: Option<Tensor<2>>,
        n_samples: usize,
        device: &Device,
    ) -> LidarMaps {
        match (self, batch) {
            (Self::Pillars(branch), LidarBatch::Pillars(batch)) => {
                branch.forward(batch.as_ref(), painted, n_samples, device)
            }
            (Self::Voxels(encoder), LidarBatch::Voxels(batch)) => {
                let map = encoder.forward(batch.features.clone(), &batch.rulebooks, n_samples);
                LidarMaps { map, pillars: None }
            }
            _ => panic!("{SAME_CONFIG}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::config::LidarVoxelConfig;

    fn little() -> LidarVoxelConfig {
        let [_, paper] = ModelConfig::in_little();
        paper.lidar.voxel
    }

    fn points(seed: u64) -> Vec<[f64; 4]> {
        use rand::RngExt;
        let mut rng = crate::random::stream(seed, "voxel-test", 0);
        (0..200)
            .map(|_| {
                let scale = [(0.0, 32.0), (-16.0, 32.0), (-3.0, 8.0), (0.0, 100.0)];
                scale.map(|(least, range)| least + range * rng.random::<f64>())
            })
            .collect()
    }

    #[test]
    fn samples_of_a_batch_do_not_see_each_other() {
        let (config, device) = (little(), Device::flex());
        let encoder = SparseEncoder::init(N_VOXEL_FEATURES, &config.encoder, &device);
        let encode = |clouds: &[&Voxels]| {
            let batch = VoxelBatch::stack(clouds, &config, &device);
            encoder.forward(batch.features, &batch.rulebooks, clouds.len())
        };
        let clouds = [points(1), vec![], points(2)].map(|points| voxelize(&points, &config.voxels));
        let together = encode(&clouds.each_ref());
        for (sample_idx, cloud) in clouds.iter().enumerate() {
            let alone = encode(&[cloud]);
            let [channels, n_y, n_x] = config.encoded_shape();
            assert_eq!(alone.dims(), [1, channels, n_y, n_x]);
            let difference = alone - together.clone().narrow(0, sample_idx, 1);
            assert!(difference.abs().max().into_scalar::<f32>() < 1e-5);
        }
    }

    /// Weights are drawn by whichever test comes first, and ReLUs of one network in fifteen blank the only point: so it is
    /// asked of many.
    #[test]
    fn a_point_shows_in_the_cell_that_holds_it() {
        const N_NETWORKS: usize = 24;
        let (config, device) = (little(), Device::flex());
        // One voxel in the last column and the first row of cells.
        let cloud = voxelize(&[[31.9, -15.9, 0.0, 50.0]], &config.voxels);
        let [_, n_y, n_x] = config.encoded_shape();
        let mut n_shown = 0;
        for _ in 0..N_NETWORKS {
            let encoder = SparseEncoder::init(N_VOXEL_FEATURES, &config.encoder, &device);
            let batch = VoxelBatch::stack(&[&cloud], &config, &device);
            let map = encoder.forward(batch.features, &batch.rulebooks, 1);
            let per_cell: Vec<f32> = map.abs().sum_dim(1).into_data().try_to_vec().unwrap();
            let lit: Vec<usize> = (0..n_y * n_x).filter(|&cell| per_cell[cell] > 0.0).collect();
            assert!(lit.iter().all(|&cell| cell / n_x <= 1 && cell % n_x >= n_x - 2), "{lit:?}");
            n_shown += usize::from(lit.contains(&(n_x - 1)));
        }
        assert!(n_shown > N_NETWORKS / 2, "{n_shown} of {N_NETWORKS}");
    }
}
