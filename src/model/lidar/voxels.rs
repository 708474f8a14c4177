//! Hard voxelization: the mean of the first points of each voxel, in the ego frame.
//!
//! As published (mmcv's hard voxelization on the CPU): a point's cell is the floor of its offset over the voxel
//! size; points outside the grid are dropped. Points come in order; a full voxel takes no more points, and a full
//! cloud opens no more voxels. Computed in f64. The published net takes a fifth number, the time since the key
//! frame; our samples hold one sweep, where it would be zero for every point, so it is left out.

use burn::tensor::{Device, Tensor, TensorData};

use super::sparse::{EncoderRulebooks, Sites};
use crate::model::config::{LidarVoxelConfig, VoxelConfig};

/// Numbers of a voxel: the means of x, y, z (metres, ego frame) and intensity (0 to 255).
pub const N_VOXEL_FEATURES: usize = 4;

/// The voxels of one cloud, ordered by z, then y, then x.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Voxels {
    /// `[voxel, N_VOXEL_FEATURES]`.
    pub features: Vec<f32>,
    /// `[voxel]`: cell along z, y, x; strictly rising.
    pub cells: Vec<[u16; 3]>,
}

/// Voxelizes points: x, y, z in the ego frame and intensity. Points that are not finite are dropped.
///
/// The config has passed its check.
#[must_use]
pub fn voxelize(points: &[[f64; 4]], config: &VoxelConfig) -> Voxels {
    let (shape, axes) = (config.shape(), config.axes());
    // Grouped by sorting: the point's index keeps a voxel's points in their order.
    let mut by_cell: Vec<([u16; 3], u32)> = points
        .iter()
        .enumerate()
        .filter_map(|(point_idx, p)| {
            let mut cell = [0; 3];
            for (axis, value) in [p[2], p[1], p[0]].into_iter().enumerate() {
                let (low, _, size) = axes[axis];
                let found = ((value - low) / size).floor();
                if !(0.0..shape[axis] as f64).contains(&found) {
                    return None;
                }
                cell[axis] = found as u16;
            }
            p[3].is_finite().then_some((cell, point_idx as u32))
        })
        .collect();
    by_cell.sort_unstable();

    let mut groups: Vec<&[([u16; 3], u32)]> = by_cell.chunk_by(|a, b| a.0 == b.0).collect();
    if groups.len() > config.max_voxels {
        // A voxel opens with its first point; the voxels that open last are dropped.
        groups.sort_unstable_by_key(|group| group[0].1);
        groups.truncate(config.max_voxels);
        groups.sort_unstable_by_key(|group| group[0].0);
    }

    let mut voxels = Voxels::default();
    for group in groups {
        let kept = &group[..group.len().min(config.max_points_per_voxel)];
        voxels.cells.push(group[0].0);
        voxels.features.extend((0..N_VOXEL_FEATURES).map(|k| {
            let sum: f64 = kept.iter().map(|&(_, point_idx)| points[point_idx as usize][k]).sum();
            (sum / kept.len() as f64) as f32
        }));
    }
    voxels
}

/// The voxels of several samples, and the rulebooks built from their cells once for all layers.
#[derive(Debug, Clone)]
pub struct VoxelBatch {
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
            features: Tensor::from_data(TensorData::new(features, dims), device),
            rulebooks: EncoderRulebooks::build(sites, &config.encoder),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::golden::Golden;

    /// Two voxels of one metre along each axis.
    fn small() -> VoxelConfig {
        VoxelConfig {
            x_min_m: 0.0,
            x_max_m: 2.0,
            y_min_m: -1.0,
            y_max_m: 1.0,
            z_min_m: 0.0,
            z_max_m: 2.0,
            size_xy_m: 1.0,
            size_z_m: 1.0,
            max_points_per_voxel: 2,
            max_voxels: 8,
        }
    }

    #[test]
    fn a_voxel_is_the_mean_of_its_first_points() {
        let points = [[0.2, -0.5, 0.5, 10.0], [0.4, -0.7, 0.7, 30.0], [0.9, -0.9, 0.9, 255.0]];
        let voxels = voxelize(&points, &small());
        assert_eq!(voxels.cells, [[0, 0, 0]]);
        assert!(voxels.features.iter().zip([0.3, -0.6, 0.6, 20.0]).all(|(a, b)| (a - b).abs() < 1e-6));
    }

    #[test]
    fn cells_are_floors_and_points_outside_are_dropped() {
        let inside = [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0], [1.999, -0.001, 0.0, 0.0]];
        let outside = [[2.0, 0.0, 0.0, 0.0], [-0.001, 0.0, 0.0, 0.0], [0.5, 1.0, 0.5, 0.0]];
        let broken = [[f64::NAN, 0.0, 0.0, 0.0], [0.5, 0.5, f64::INFINITY, 0.0], [0.5, 0.5, 0.5, f64::NAN]];
        let voxels = voxelize(&[&inside[..], &outside, &broken].concat(), &small());
        assert_eq!(voxels.cells, [[0, 0, 0], [0, 0, 1], [1, 1, 1]]);
        assert!(voxelize(&[], &small()).cells.is_empty());
    }

    #[test]
    fn beyond_the_limit_the_last_voxels_to_open_are_dropped_while_open_ones_still_fill() {
        let config = VoxelConfig { max_voxels: 2, ..small() };
        let points =
            [[1.5, 0.5, 1.5, 1.0], [0.5, 0.5, 0.5, 1.0], [0.5, -0.5, 0.5, 1.0], [1.5, 0.5, 1.5, 3.0]];
        let voxels = voxelize(&points, &config);
        assert_eq!(voxels.cells, [[0, 1, 0], [1, 1, 1]]);
        assert_eq!(voxels.features[7], 2.0, "the first voxel took its second point after the limit was met");
    }

    #[test]
    fn equals_a_plain_loop_over_the_points() {
        let golden = Golden::read("voxel");
        let points: Vec<[f64; 4]> = golden.numbers("points").as_chunks().0.to_vec();
        let config = VoxelConfig {
            x_min_m: 0.0,
            x_max_m: 3.0,
            y_min_m: -2.0,
            y_max_m: 2.0,
            z_min_m: -1.0,
            z_max_m: 1.0,
            size_xy_m: 0.25,
            size_z_m: 0.5,
            max_points_per_voxel: 10,
            max_voxels: 300,
        };
        let voxels = voxelize(&points, &config);
        let cells: Vec<f64> = voxels.cells.iter().flatten().map(|&cell| f64::from(cell)).collect();
        assert_eq!(cells, golden.numbers("cells"));
        let expected = golden.numbers("features");
        assert_eq!(voxels.features.len(), expected.len());
        let is_near = |(&a, &b): (&f32, &f64)| (f64::from(a) - b).abs() <= 1e-6 * b.abs().max(1.0);
        assert!(voxels.features.iter().zip(&expected).all(is_near));
    }
}
