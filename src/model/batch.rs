//! Several samples' inputs as tensors.

use burn::tensor::{Device, Int, Tensor, TensorData};

use super::config::ModelConfig;
use super::input::{Input, N_POINT_FEATURES, n_features};

/// Inputs of `batch` samples; points and pillars of all samples stand in one list.
#[derive(Debug, Clone)]
pub struct Batch {
    pub n_samples: usize,
    /// `[point, N_POINT_FEATURES]`; `None` when no sample has a LiDAR point in the grid.
    pub point_features: Option<Tensor<2>>,
    /// `[pillar * max_points]`: rows of `point_features`.
    pub pillar_points: Option<Tensor<1, Int>>,
    /// `[pillar]`: `(batch * n_pillars_y + y) * n_pillars_x + x`.
    pub pillar_cells: Option<Tensor<1, Int>>,
    /// The camera's inputs; `None` in the LiDAR-only stage.
    pub camera: Option<CameraBatch>,
    /// `[batch * state, 2]`: scaled speed and steering; every sample has as many states.
    pub numeric: Tensor<2>,
}

/// The camera's inputs of a batch.
#[derive(Debug, Clone)]
pub struct CameraBatch {
    /// `[batch, 3, y, x]`, about zero mean and unit variance.
    pub image: Tensor<4>,
    /// `[batch, 2, feature_y, feature_x]`: LiDAR depth over 50 m, and whether there is one.
    pub depth: Tensor<4>,
    /// `[frustum]`: index into `[batch, feature_y, feature_x]`.
    pub frustum_features: Tensor<1, Int>,
    /// `[frustum]`: index into `[batch, feature_y, feature_x, depth_bin]`.
    pub frustum_depths: Tensor<1, Int>,
    /// `[frustum]`: index into `[batch, cell_y, cell_x]`.
    pub frustum_cells: Tensor<1, Int>,
}

fn indices(values: Vec<i64>, device: &Device) -> Tensor<1, Int> {
    let n = values.len();
    Tensor::from_data(TensorData::new(values, [n]), device)
}

impl Batch {
    /// Stacks inputs; all images must have one size.
    ///
    /// # Panics
    /// If `inputs` is empty, or their numbers of states differ.
    #[must_use]
    pub fn stack(inputs: &[&Input], config: &ModelConfig, with_camera: bool, device: &Device) -> Self {
        assert!(!inputs.is_empty(), "a batch holds at least one sample");
        let n_samples = inputs.len();
        let pillars_per_map = config.grid.n_pillars_x() * config.grid.n_pillars_y();
        let mut features = Vec::new();
        let (mut rows, mut cells) = (Vec::new(), Vec::new());
        for (sample_idx, input) in inputs.iter().enumerate() {
            let first_row = (features.len() / N_POINT_FEATURES) as i64;
            features.extend_from_slice(&input.point_features);
            rows.extend(input.pillar_points.iter().map(|&row| first_row + i64::from(row)));
            let first_cell = (sample_idx * pillars_per_map) as i64;
            cells.extend(input.pillar_cells.iter().map(|&cell| first_cell + i64::from(cell)));
        }
        let n_points = features.len() / N_POINT_FEATURES;
        let has_points = n_points > 0;
        let n_states = inputs[0].numeric.len();
        assert!(inputs.iter().all(|input| input.numeric.len() == n_states), "as many states everywhere");
        let numeric: Vec<f32> =
            inputs.iter().flat_map(|input| input.numeric.iter().flatten().copied()).collect();
        Self {
            n_samples,
            point_features: has_points
                .then(|| Tensor::from_data(TensorData::new(features, [n_points, N_POINT_FEATURES]), device)),
            pillar_points: has_points.then(|| indices(rows, device)),
            pillar_cells: has_points.then(|| indices(cells, device)),
            camera: with_camera.then(|| CameraBatch::stack(inputs, config, device)),
            numeric: Tensor::from_data(TensorData::new(numeric, [n_samples * n_states, 2]), device),
        }
    }
}

impl CameraBatch {
    fn stack(inputs: &[&Input], config: &ModelConfig, device: &Device) -> Self {
        let n_samples = inputs.len();
        let (width_px, height_px) = (config.camera.image_width_px, inputs[0].image_height_px);
        let (n_x, n_y) = (n_features(width_px), n_features(height_px));
        let n_cells = config.grid.n_cells_x() * config.grid.n_cells_y();
        let mut image = Vec::with_capacity(n_samples * 3 * width_px * height_px);
        let mut depth = Vec::with_capacity(n_samples * 2 * n_x * n_y);
        let (mut of_features, mut of_depths, mut of_cells) = (Vec::new(), Vec::new(), Vec::new());
        for (sample_idx, input) in inputs.iter().enumerate() {
            image.extend(input.image.iter().map(|&value| (f32::from(value) - 115.0) / 58.0));
            depth.extend(input.depth.iter().map(|&d| d / 50.0));
            depth.extend(input.depth.iter().map(|&d| f32::from(u8::from(d > 0.0))));
            for (&point, &cell) in input.frustum.points.iter().zip(&input.frustum.cells) {
                let (bin, pixel) = (point as usize / (n_x * n_y), point as usize % (n_x * n_y));
                let feature = sample_idx * n_x * n_y + pixel;
                of_features.push(feature as i64);
                of_depths.push((feature * config.camera.n_depth_bins + bin) as i64);
                of_cells.push((sample_idx * n_cells + cell as usize) as i64);
            }
        }
        Self {
            image: Tensor::from_data(TensorData::new(image, [n_samples, 3, height_px, width_px]), device),
            depth: Tensor::from_data(TensorData::new(depth, [n_samples, 2, n_y, n_x]), device),
            frustum_features: indices(of_features, device),
            frustum_depths: indices(of_depths, device),
            frustum_cells: indices(of_cells, device),
        }
    }
}
