//! Pillars: LiDAR points by vertical column of the grid (PointPillars, Lang et al. 2019), half a feature cell wide.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};

use super::ground::GroundMap;
use crate::kernels::PillarPlan;
use crate::model::config::{ModelConfig, PillarConfig};

/// Numbers for each LiDAR point that enters the pillar encoder, without its height over a fitted ground.
const N_PLAIN_FEATURES: usize = 10;

impl PillarConfig {
    /// Numbers for each LiDAR point that enters the pillar encoder.
    #[must_use]
    pub fn n_point_features(&self) -> usize {
        N_PLAIN_FEATURES + usize::from(self.ground)
    }
}

/// One sample's pillars.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Pillars {
    /// `[point, n_point_features]`: x, y, z, intensity, offset from the pillar's mean point (3),
    /// offset from its centre (2), log of its point count, and the height over the ground if the config asks for it; all
    /// scaled to about one.
    pub point_features: Vec<f32>,
    /// `[point]`: index of each row's point in the cloud.
    pub sources: Vec<u32>,
    /// `[pillar, max_points]`: rows of `point_features`; a short pillar repeats its first point.
    pub points: Vec<u32>,
    /// `[pillar]`: cell index `y * 2 n_cells_x + x`.
    pub cells: Vec<u32>,
}

impl Pillars {
    /// Groups points (x, y, z in the ego frame, intensity) by pillar, in cell order.
    #[must_use]
    pub fn group(points: &[[f64; 4]], config: &ModelConfig) -> Self {
        let grid = config.grid.with_cell_size(config.grid.cell_size_m / 2.0);
        let (n_x, cell_of) = (grid.n_cells_x(), grid.cell_finder());
        let of_pillars = &config.lidar.pillars;
        let ground = of_pillars.ground.then(|| GroundMap::fit(points, &config.grid));
        let over_ground_m = |p: &[f64; 4]| p[2] - ground.as_ref().map_or(0.0, |map| map.height_m(p[0], p[1]));
        let mut by_cell: Vec<(u32, u32)> = points
            .iter()
            .enumerate()
            .filter_map(|(i, p)| Some((cell_of([p[0], p[1], over_ground_m(p)])?, i as u32)))
            .collect();
        by_cell.sort_unstable();

        let (max_points, n_features) = (of_pillars.max_points, of_pillars.n_point_features());
        let mut pillars = Self::default();
        for pillar in by_cell.chunk_by_mut(|a, b| a.0 == b.0) {
            let cell = pillar[0].0;
            let n = pillar.len();
            let mean: [f64; 3] = std::array::from_fn(|axis| {
                pillar.iter().map(|&(_, i)| points[i as usize][axis]).sum::<f64>() / n as f64
            });
            let center = grid.cell_center_m(cell as usize, n_x, 1);
            let n_kept = n.min(max_points);
            let first_row = (pillars.point_features.len() / n_features) as u32;
            if n > n_kept {
                let height_m = |i: u32| points[i as usize][2];
                pillar.sort_by(|&(_, a), &(_, b)| height_m(a).total_cmp(&height_m(b)));
            }
            for k in 0..n_kept {
                // Even over the heights, the lowest and the highest among them, whatever order a LiDAR has.
                let source = pillar[if n > n_kept { k * (n - 1) / (n_kept - 1).max(1) } else { k }].1;
                let p = points[source as usize];
                let features = [
                    p[0] / 50.0,
                    p[1] / 30.0,
                    p[2],
                    p[3] / 255.0,
                    p[0] - mean[0],
                    p[1] - mean[1],
                    p[2] - mean[2],
                    p[0] - center[0],
                    p[1] - center[1],
                    (n as f64).ln() / 3.0,
                ];
                pillars.point_features.extend(features.map(|value| value as f32));
                if ground.is_some() {
                    pillars.point_features.push(over_ground_m(&p) as f32);
                }
                pillars.sources.push(source);
            }
            let row = |k: usize| first_row + if k < n_kept { k as u32 } else { 0 };
            pillars.points.extend((0..max_points).map(row));
            pillars.cells.push(cell);
        }
        pillars
    }
}

/// Pillars of several samples; points and pillars of all samples stand in one list.
#[derive(Debug, Clone)]
pub struct PillarBatch {
    /// `[point, n_point_features]`.
    pub point_features: Tensor<2>,
    /// Points of each pillar, and pillars of each map `[2 n_cells_y, 2 n_cells_x]`.
    pub plan: Arc<PillarPlan>,
}

impl PillarBatch {
    /// Stacks pillars; `None` when no sample has a LiDAR point in the grid.
    #[must_use]
    pub fn stack(samples: &[&Pillars], config: &ModelConfig, device: &Device) -> Option<Self> {
        let pillars_per_map = 4 * config.grid.n_cells();
        let n_features = config.lidar.pillars.n_point_features();
        let mut features = Vec::new();
        let (mut rows, mut cells) = (Vec::new(), Vec::new());
        for (sample_idx, pillars) in samples.iter().enumerate() {
            let first_row = (features.len() / n_features) as u32;
            features.extend_from_slice(&pillars.point_features);
            rows.extend(pillars.points.iter().map(|&row| first_row + row));
            let first_cell = (sample_idx * pillars_per_map) as u32;
            cells.extend(pillars.cells.iter().map(|&cell| first_cell + cell));
        }
        let n_points = features.len() / n_features;
        (n_points > 0).then(|| Self {
            point_features: Tensor::from_data(TensorData::new(features, [n_points, n_features]), device),
            plan: Arc::new(PillarPlan::new(n_points, [samples.len(), pillars_per_map], rows, cells)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn without_ground() -> ModelConfig {
        let mut config = ModelConfig::default();
        config.lidar.pillars.ground = false;
        config
    }

    #[test]
    fn points_of_one_pillar_share_it_and_points_outside_are_left_out() {
        let config = without_ground();
        let points =
            [[10.1, 0.1, 0.5, 0.0], [10.2, 0.2, 1.5, 0.0], [10.1, 0.1, 9.0, 0.0], [60.0, 0.0, 1.0, 0.0]];
        let Pillars { point_features: features, sources, points: rows, cells } =
            Pillars::group(&points, &config);
        assert_eq!(cells, [80 * 128 + 25]);
        assert_eq!((features.len(), sources), (2 * N_PLAIN_FEATURES, vec![0, 1]));
        assert_eq!(rows[..3], [0, 1, 0]);
        assert!((features[6] + 0.5).abs() < 1e-6, "z of the first point lies 0.5 m under the mean");
    }

    #[test]
    fn a_crowded_pillar_keeps_the_configured_number_of_points() {
        let config = without_ground();
        let points: Vec<[f64; 4]> = (0..100).map(|i| [10.1, 0.1, 0.01 * f64::from(i), 0.0]).collect();
        let Pillars { point_features: features, points: rows, .. } = Pillars::group(&points, &config);
        assert_eq!(features.len() / N_PLAIN_FEATURES, config.lidar.pillars.max_points);
        assert_eq!(rows.len(), config.lidar.pillars.max_points);
    }

    #[test]
    fn on_a_hill_points_tell_their_height_over_the_ground() {
        let config = ModelConfig::default();
        // A road that rises by a tenth, and a box of half a metre on it, 35 m ahead and 3.5 m above the wheels.
        let on_road = |x: f64, y: f64| [x, y, 0.1 * x, 50.0];
        let mut points: Vec<[f64; 4]> =
            (0..1600).map(|i| on_road(3.0 + f64::from(i / 20), f64::from(i % 20) - 9.5)).collect();
        points.push([35.1, 0.1, 3.5 + 0.5, 50.0]);
        let of = Pillars::group(&points, &config);
        let row = of.sources.iter().position(|&source| source == 1600).expect("it lies in the grid");
        let features = &of.point_features[row * 11..][..11];
        assert!((features[10] - 0.5).abs() < 0.1 && (features[2] - 4.0).abs() < 1e-6, "{features:?}");
    }
}
