//! Inputs of the small camera branch: a resized image, LiDAR depths at its features, and where its frustum falls.

use std::sync::Arc;

use burn::tensor::{Device, Int, Tensor, TensorData};

use super::picture::{CameraGeometry, NetworkImage};
use crate::geometry::{Pinhole, Point};
use crate::kernels::PoolPlan;
use crate::model::config::ModelConfig;

/// Stride of the camera features over the resized image.
const IMAGE_STRIDE: usize = 8;
/// Stride of the map that points take features from.
pub const PAINT_STRIDE: usize = 4;
/// A point that the picture does not show.
const NOT_SEEN: u32 = u32::MAX;

/// One sample's inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct CnnInput {
    /// `[3, y, x]`, 8-bit RGB, resized.
    pub image: Vec<u8>,
    pub image_height_px: usize,
    pub view: CameraGeometry,
    /// `[feature_y, feature_x]` at an eighth of the resized image: nearest LiDAR depth in metres, 0 for none.
    pub depth: Vec<f32>,
    /// `[point]`: place `y * n_x + x` of each point that takes features along, in the map at a quarter of the image, or
    /// [`NOT_SEEN`]; empty if none does.
    pub pixel_of_point: Vec<u32>,
    /// Bird's-eye cell `y * n_cells_x + x` of each frustum point, `[feature_y * feature_x, depth_bin]`.
    pub plan: Arc<PoolPlan>,
}

/// Feature rows or columns after three stride-2 convolutions with padding 1.
#[must_use]
pub fn n_features(n_px: usize) -> usize {
    n_paint_pixels(n_px).div_ceil(2)
}

/// Rows or columns of the map that points take features from.
#[must_use]
pub fn n_paint_pixels(n_px: usize) -> usize {
    n_px.div_ceil(2).div_ceil(2)
}

impl CnnInput {
    /// # Arguments
    /// - `view`: the view of `image`
    /// - `points`: in the ego frame
    /// - `sources`: indices of the points that take features along
    #[must_use]
    pub fn prepare(
        image: &NetworkImage,
        view: &CameraGeometry,
        points: &[[f64; 4]],
        sources: &[u32],
        config: &ModelConfig,
    ) -> Self {
        Self {
            pixel_of_point: pixels_of(points, sources, view),
            image: image.planes(),
            image_height_px: image.pixels.height() as usize,
            view: *view,
            depth: sparse_depth(points, view),
            plan: Arc::new(pool_plan(view, config)),
        }
    }
}

/// Inputs of several samples.
#[derive(Debug, Clone)]
pub struct CnnBatch {
    /// `[batch, 3, y, x]`, about zero mean and unit variance.
    pub image: Tensor<4>,
    /// `[batch, 2, feature_y, feature_x]`: LiDAR depth over 50 m, and whether there is one.
    pub depth: Tensor<4>,
    /// `[point]` of all samples: where each takes its features, as [`super::paint::take_pixels`] needs it; `None` if
    /// none does.
    pub pixels_of_points: Option<Tensor<1, Int>>,
    /// For each sample, the cells of its frustum.
    pub plans: Vec<Arc<PoolPlan>>,
}

impl CnnBatch {
    /// Stacks inputs; all images must have one size.
    #[must_use]
    pub fn stack(inputs: &[&CnnInput], device: &Device) -> Self {
        let n_samples = inputs.len();
        let height_px = inputs[0].image_height_px;
        let width_px = inputs[0].image.len() / 3 / height_px;
        let (n_x, n_y) = (n_features(width_px), n_features(height_px));
        let mut image = Vec::with_capacity(n_samples * 3 * width_px * height_px);
        let mut depth = Vec::with_capacity(n_samples * 2 * n_x * n_y);
        for input in inputs {
            image.extend(input.image.iter().map(|&value| (f32::from(value) - 115.0) / 58.0));
            depth.extend(input.depth.iter().map(|&d| d / 50.0));
            depth.extend(input.depth.iter().map(|&d| f32::from(u8::from(d > 0.0))));
        }
        let n_pixels = n_paint_pixels(width_px) * n_paint_pixels(height_px);
        let place = |(sample_idx, &pixel): (usize, &u32)| match pixel {
            NOT_SEEN => (n_samples * n_pixels) as i64,
            pixel => (sample_idx * n_pixels) as i64 + i64::from(pixel),
        };
        let places =
            inputs.iter().enumerate().flat_map(|(i, of)| of.pixel_of_point.iter().map(move |p| (i, p)));
        let places: Vec<i64> = places.map(place).collect();
        let n_places = places.len();
        Self {
            pixels_of_points: (n_places > 0)
                .then(|| Tensor::from_data(TensorData::new(places, [n_places]), device)),
            image: Tensor::from_data(TensorData::new(image, [n_samples, 3, height_px, width_px]), device),
            depth: Tensor::from_data(TensorData::new(depth, [n_samples, 2, n_y, n_x]), device),
            plans: inputs.iter().map(|input| Arc::clone(&input.plan)).collect(),
        }
    }
}

/// Where the map at a quarter of the image shows each of these points.
fn pixels_of(points: &[[f64; 4]], sources: &[u32], view: &CameraGeometry) -> Vec<u32> {
    let Pinhole { width_px, height_px, .. } = view.intrinsics;
    let [n_x, n_y] = [width_px, height_px].map(|n_px| n_paint_pixels(n_px as usize));
    let camera_from_ego = view.ego_from_camera.inverse();
    let pixel = |&source: &u32| {
        let [x_m, y_m, z_m, _] = points[source as usize];
        let seen = view.intrinsics.project(&(camera_from_ego * Point::new(x_m, y_m, z_m)));
        let Some((u, v)) = seen.filter(|&(u, v)| view.intrinsics.contains(u, v)) else { return NOT_SEEN };
        let [x, y] = [u, v].map(|px| (px / PAINT_STRIDE as f64).round() as usize);
        (y.min(n_y - 1) * n_x + x.min(n_x - 1)) as u32
    };
    sources.iter().map(pixel).collect()
}

/// Nearest LiDAR depth in each feature cell of the image.
fn sparse_depth(points: &[[f64; 4]], view: &CameraGeometry) -> Vec<f32> {
    let [n_y, n_x] = features_of(&view.intrinsics);
    let mut depth = vec![0f32; n_x * n_y];
    for (u, v, found) in view.see(points) {
        // Feature k of a stride-2 chain with padding 1 looks at pixel 8 k.
        let (x, y) = ((u / IMAGE_STRIDE as f64).round() as usize, (v / IMAGE_STRIDE as f64).round() as usize);
        if x < n_x && y < n_y {
            let cell = &mut depth[y * n_x + x];
            if *cell == 0.0 || found < *cell {
                *cell = found;
            }
        }
    }
    depth
}

/// Rows and columns of the image features.
fn features_of(camera: &Pinhole) -> [usize; 2] {
    [camera.height_px, camera.width_px].map(|n_px| n_features(n_px as usize))
}

/// The cell of each frustum point: a feature, at the middle of each depth bin.
fn pool_plan(view: &CameraGeometry, config: &ModelConfig) -> PoolPlan {
    let camera = &view.intrinsics;
    let [n_y, n_x] = features_of(camera);
    let (grid, config) = (&config.grid, &config.camera.cnn);
    let n_bins = config.n_depth_bins;
    let bin_m = (config.depth_max_m - config.depth_min_m) / n_bins as f64;
    let cell_of = grid.cell_finder();
    let at = |x_m: f64, y_m: f64, z_m: f64| view.ego_from_camera * Point::new(x_m, y_m, z_m);
    let origin = at(0.0, 0.0, 0.0);
    let mut cells = Vec::with_capacity(n_x * n_y * n_bins);
    for y in 0..n_y {
        for x in 0..n_x {
            let (u, v) = ((x * IMAGE_STRIDE) as f64 + 0.5, (y * IMAGE_STRIDE) as f64 + 0.5);
            let at_1_m = at((u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, 1.0);
            let along = [at_1_m.x() - origin.x(), at_1_m.y() - origin.y(), at_1_m.z() - origin.z()];
            cells.extend((0..n_bins).map(|bin| {
                let depth_m = config.depth_min_m + (bin as f64 + 0.5) * bin_m;
                let [x_m, y_m, z_m] = along.map(|along| along * depth_m);
                let cell = cell_of([origin.x() + x_m, origin.y() + y_m, origin.z() + z_m]);
                cell.unwrap_or(PoolPlan::OUTSIDE)
            }));
        }
    }
    PoolPlan::new(n_bins, grid.n_cells(), cells)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Transform;
    use nalgebra::Vector3;

    fn view() -> CameraGeometry {
        CameraGeometry {
            intrinsics: Pinhole::from_horizontal_fov(400, 225, 70f64.to_radians()),
            ego_from_camera: Transform::looking_forward(Vector3::new(1.7, 0.2, 1.5), 0.02),
        }
    }

    #[test]
    fn the_depth_image_keeps_the_nearest_point() {
        let view = view();
        let far = view.ego_from_camera * Point::new(0.0, 0.0, 20.0);
        let near = view.ego_from_camera * Point::new(0.0, 0.0, 7.0);
        let points = [far, near].map(|p| [p.x(), p.y(), p.z(), 0.0]);
        let depth = sparse_depth(&points, &view);
        assert_eq!(depth.iter().filter(|&&d| d > 0.0).count(), 1);
        assert!((depth.iter().copied().fold(0.0, f32::max) - 7.0).abs() < 1e-5);
    }

    #[test]
    fn frustum_points_fall_into_cells_of_the_grid_only() {
        let view = view();
        let CameraGeometry { intrinsics: pinhole, ego_from_camera } = &view;
        let config = ModelConfig::default();
        let plan = pool_plan(&view, &config);
        assert!(plan.points().len() > 10_000);
        // Straight ahead, 20 m off: half of the picture's width, and the bin that holds 20 m.
        let (n_x, cnn) = (n_features(400), &config.camera.cnn);
        let bin_m = (cnn.depth_max_m - cnn.depth_min_m) / cnn.n_depth_bins as f64;
        let (pixel, bin) = (14 * n_x + 25, ((20.0 - cnn.depth_min_m) / bin_m) as usize);
        let depth_m = cnn.depth_min_m + (bin as f64 + 0.5) * bin_m;
        let [u, v] = [200.5, 112.5];
        let p = *ego_from_camera
            * Point::new(
                (u - pinhole.cx_px) / pinhole.fx_px * depth_m,
                (v - pinhole.cy_px) / pinhole.fy_px * depth_m,
                depth_m,
            );
        let cell = |m: f64, min_m: f64| ((m - min_m) / config.grid.cell_size_m) as usize;
        let expected =
            cell(p.y(), config.grid.y_min_m) * config.grid.n_cells_x() + cell(p.x(), config.grid.x_min_m);
        assert_eq!(plan.cell_of_point()[pixel * cnn.n_depth_bins + bin] as usize, expected);
    }
}
