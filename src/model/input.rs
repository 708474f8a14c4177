//! From what the car measured to the arrays a network eats; no truth passes here.

use image::imageops::{FilterType, resize};
use thiserror::Error;

use super::config::ModelConfig;
use crate::geometry::{Camera, Ego, Pinhole, Point, Transform};
use crate::sample::{EgoState, Measured};

/// Numbers for each LiDAR point that enters the pillar encoder.
pub const N_POINT_FEATURES: usize = 10;

/// One sample's inputs, ready to be batched.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// `[point, N_POINT_FEATURES]`: x, y, z, intensity, offset from the pillar's mean point (3),
    /// offset from its centre (2), log of its point count; all scaled to about one.
    pub point_features: Vec<f32>,
    /// `[pillar, max_points]`: rows of `point_features`; a short pillar repeats its first point.
    pub pillar_points: Vec<u32>,
    /// `[pillar]`: cell index `y * n_pillars_x + x`.
    pub pillar_cells: Vec<u32>,
    /// `[3, y, x]`, 8-bit RGB, resized.
    pub image: Vec<u8>,
    pub image_height_px: usize,
    /// `[feature_y, feature_x]` at an eighth of the resized image: nearest LiDAR depth in metres, 0 for none.
    pub depth: Vec<f32>,
    /// Frustum points that fall into the bird's-eye grid.
    pub frustum: Frustum,
    /// Speed over 10 m/s and steering over 0.35 rad, of each state the sample is asked about.
    pub numeric: Vec<[f32; 2]>,
}

/// Which frustum point lands in which bird's-eye cell.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Frustum {
    /// Index into `[depth_bin, feature_y, feature_x]`.
    pub points: Vec<u32>,
    /// Bird's-eye cell `y * n_cells_x + x` of the same point.
    pub cells: Vec<u32>,
}

/// Why a sample cannot be an input.
#[derive(Debug, Error)]
pub enum InputError {
    #[error("the camera image cannot be unpacked: {0}")]
    Image(#[from] image::ImageError),
    #[error("{field} is {found}; a finite number is needed")]
    NotFinite { field: &'static str, found: f64 },
}

/// Stride of the camera features over the resized image.
pub const IMAGE_STRIDE: usize = 8;

/// Feature rows or columns after three stride-2 convolutions with padding 1.
#[must_use]
pub fn n_features(n_px: usize) -> usize {
    n_px.div_ceil(2).div_ceil(2).div_ceil(2)
}

impl Input {
    /// Prepares a sample. With `mirror`, everything is reflected in the ego's x-z plane, the steering
    /// angle too, which leaves every box's label as it was.
    ///
    /// # Errors
    /// The image is broken, or speed or steering is not finite.
    pub fn prepare(measured: &Measured, config: &ModelConfig, mirror: bool) -> Result<Self, InputError> {
        let side = if mirror { -1.0 } else { 1.0 };
        let mut full = measured.image.decode()?;
        let mut intrinsics = measured.intrinsics;
        let mut ego_from_camera = measured.ego_from_camera;
        if mirror {
            image::imageops::flip_horizontal_in_place(&mut full);
            intrinsics.cx_px = f64::from(intrinsics.width_px) - intrinsics.cx_px;
            ego_from_camera = mirrored(&ego_from_camera);
        }
        let scale = config.camera.image_width_px as f64 / f64::from(full.width());
        let image_height_px = (f64::from(full.height()) * scale).round() as usize;
        let small =
            resize(&full, config.camera.image_width_px as u32, image_height_px as u32, FilterType::Triangle);
        let n_pixels = config.camera.image_width_px * image_height_px;
        let mut image = vec![0; 3 * n_pixels];
        for (i, pixel) in small.pixels().enumerate() {
            for channel in 0..3 {
                image[channel * n_pixels + i] = pixel[channel];
            }
        }

        let points: Vec<[f64; 4]> = measured
            .points
            .iter()
            .map(|p| {
                let in_lidar = Point::new(f64::from(p.x_m), f64::from(p.y_m), f64::from(p.z_m));
                let in_ego = measured.ego_from_lidar * in_lidar;
                [in_ego.x(), side * in_ego.y(), in_ego.z(), f64::from(p.intensity)]
            })
            .filter(|p| p.iter().all(|value| value.is_finite()))
            .collect();
        let (point_features, pillar_points, pillar_cells) = pillars(&points, config);
        let small_camera = scaled(&intrinsics, scale, config.camera.image_width_px, image_height_px);
        let input = Self {
            point_features,
            pillar_points,
            pillar_cells,
            depth: sparse_depth(&points, &small_camera, &ego_from_camera),
            frustum: frustum(&small_camera, &ego_from_camera, config),
            image,
            image_height_px,
            numeric: Vec::new(),
        };
        input.with_states(std::slice::from_ref(&measured.ego_state), mirror)
    }

    /// The same input at other speeds and steering angles (both given before mirroring).
    ///
    /// # Errors
    /// Speed or steering is not finite.
    pub fn with_states(mut self, states: &[EgoState], mirror: bool) -> Result<Self, InputError> {
        self.numeric = states
            .iter()
            .map(|state| {
                for (field, found) in
                    [("speed_mps", state.speed_mps), ("steering_angle_rad", state.steering_angle_rad)]
                {
                    if !found.is_finite() {
                        return Err(InputError::NotFinite { field, found });
                    }
                }
                let side = if mirror { -1.0 } else { 1.0 };
                Ok([(state.speed_mps / 10.0) as f32, (side * state.steering_angle_rad / 0.35) as f32])
            })
            .collect::<Result<_, _>>()?;
        Ok(self)
    }
}

/// The camera pose reflected in the ego's x-z plane; its image is flipped left to right with it.
fn mirrored(ego_from_camera: &Transform<Ego, Camera>) -> Transform<Ego, Camera> {
    let mut isometry = ego_from_camera.isometry;
    isometry.translation.y = -isometry.translation.y;
    // Reflection in y on the ego side and in x (its image) on the camera side keeps a rotation; for a
    // quaternion of a body frame that means flipping the parts about x and z, seen in ego axes.
    let reflect_ego = nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, -1.0, 1.0));
    let reflect_camera = nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::new(-1.0, 1.0, 1.0));
    let rotation = reflect_ego * isometry.rotation.to_rotation_matrix().into_inner() * reflect_camera;
    isometry.rotation = nalgebra::UnitQuaternion::from_matrix(&rotation);
    Transform::from_isometry(isometry)
}

fn scaled(intrinsics: &Pinhole, scale: f64, width_px: usize, height_px: usize) -> Pinhole {
    Pinhole {
        width_px: width_px as u32,
        height_px: height_px as u32,
        fx_px: intrinsics.fx_px * scale,
        fy_px: intrinsics.fy_px * scale,
        cx_px: intrinsics.cx_px * scale,
        cy_px: intrinsics.cy_px * scale,
    }
}

/// Groups points by pillar in cell order; see [`Input`] for the arrays.
fn pillars(points: &[[f64; 4]], config: &ModelConfig) -> (Vec<f32>, Vec<u32>, Vec<u32>) {
    let grid = &config.grid;
    let (n_x, n_y) = (grid.n_pillars_x(), grid.n_pillars_y());
    let mut by_cell: Vec<(u32, u32)> = points
        .iter()
        .enumerate()
        .filter_map(|(i, p)| {
            let x = ((p[0] - grid.x_min_m) / grid.pillar_size_m).floor();
            let y = ((p[1] - grid.y_min_m) / grid.pillar_size_m).floor();
            let inside = (0.0..n_x as f64).contains(&x)
                && (0.0..n_y as f64).contains(&y)
                && (grid.z_min_m..grid.z_max_m).contains(&p[2]);
            inside.then(|| ((y as usize * n_x + x as usize) as u32, i as u32))
        })
        .collect();
    by_cell.sort_unstable();

    let mut features = Vec::new();
    let mut pillar_points = Vec::new();
    let mut pillar_cells = Vec::new();
    for pillar in by_cell.chunk_by(|a, b| a.0 == b.0) {
        let cell = pillar[0].0;
        let n = pillar.len();
        let mean: [f64; 3] = std::array::from_fn(|axis| {
            pillar.iter().map(|&(_, i)| points[i as usize][axis]).sum::<f64>() / n as f64
        });
        let center = [
            grid.x_min_m + (f64::from(cell % n_x as u32) + 0.5) * grid.pillar_size_m,
            grid.y_min_m + (f64::from(cell / n_x as u32) + 0.5) * grid.pillar_size_m,
        ];
        let kept = n.min(config.max_points_per_pillar);
        let first_row = (features.len() / N_POINT_FEATURES) as u32;
        for k in 0..kept {
            // An even pick, so that a crowded pillar keeps points from all of its beams.
            let p = points[pillar[k * n / kept].1 as usize];
            features.extend(
                [
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
                ]
                .map(|value| value as f32),
            );
        }
        pillar_points.extend(
            (0..config.max_points_per_pillar).map(|k| first_row + if k < kept { k as u32 } else { 0 }),
        );
        pillar_cells.push(cell);
    }
    (features, pillar_points, pillar_cells)
}

/// Nearest LiDAR depth in each feature cell of the image.
fn sparse_depth(points: &[[f64; 4]], camera: &Pinhole, ego_from_camera: &Transform<Ego, Camera>) -> Vec<f32> {
    let (n_x, n_y) = (n_features(camera.width_px as usize), n_features(camera.height_px as usize));
    let camera_from_ego = ego_from_camera.inverse();
    let mut depth = vec![0f32; n_x * n_y];
    for p in points {
        let in_camera = camera_from_ego * Point::new(p[0], p[1], p[2]);
        let Some((u, v)) = camera.project(&in_camera).filter(|&(u, v)| camera.contains(u, v)) else {
            continue;
        };
        // Feature k of a stride-2 chain with padding 1 looks at pixel 8 k.
        let (x, y) = ((u / IMAGE_STRIDE as f64).round() as usize, (v / IMAGE_STRIDE as f64).round() as usize);
        if x < n_x && y < n_y {
            let cell = &mut depth[y * n_x + x];
            let found = in_camera.z() as f32;
            if *cell == 0.0 || found < *cell {
                *cell = found;
            }
        }
    }
    depth
}

/// Frustum points (feature cells at each depth bin's middle) that lie in the grid.
fn frustum(camera: &Pinhole, ego_from_camera: &Transform<Ego, Camera>, config: &ModelConfig) -> Frustum {
    let (n_x, n_y) = (n_features(camera.width_px as usize), n_features(camera.height_px as usize));
    let grid = &config.grid;
    let bin_m = (config.camera.depth_max_m - config.camera.depth_min_m) / config.camera.n_depth_bins as f64;
    let mut kept = Frustum::default();
    for bin in 0..config.camera.n_depth_bins {
        let depth_m = config.camera.depth_min_m + (bin as f64 + 0.5) * bin_m;
        for y in 0..n_y {
            for x in 0..n_x {
                let (u, v) = ((x * IMAGE_STRIDE) as f64 + 0.5, (y * IMAGE_STRIDE) as f64 + 0.5);
                let p = *ego_from_camera
                    * Point::new(
                        (u - camera.cx_px) / camera.fx_px * depth_m,
                        (v - camera.cy_px) / camera.fy_px * depth_m,
                        depth_m,
                    );
                let cell_x = ((p.x() - grid.x_min_m) / grid.cell_size_m()).floor();
                let cell_y = ((p.y() - grid.y_min_m) / grid.cell_size_m()).floor();
                let inside = (0.0..grid.n_cells_x() as f64).contains(&cell_x)
                    && (0.0..grid.n_cells_y() as f64).contains(&cell_y)
                    && (grid.z_min_m..grid.z_max_m).contains(&p.z());
                if inside {
                    kept.points.push(((bin * n_y + y) * n_x + x) as u32);
                    kept.cells.push((cell_y as usize * grid.n_cells_x() + cell_x as usize) as u32);
                }
            }
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn camera() -> (Pinhole, Transform<Ego, Camera>) {
        (
            Pinhole::from_horizontal_fov(400, 225, 70f64.to_radians()),
            Transform::looking_forward(Vector3::new(1.7, 0.2, 1.5), 0.02),
        )
    }

    #[test]
    fn points_of_one_pillar_share_it_and_points_outside_are_left_out() {
        let config = ModelConfig::default();
        let points =
            [[10.1, 0.1, 0.5, 0.0], [10.2, 0.2, 1.5, 0.0], [10.1, 0.1, 9.0, 0.0], [60.0, 0.0, 1.0, 0.0]];
        let (features, rows, cells) = pillars(&points, &config);
        assert_eq!(cells, [80 * 128 + 25]);
        assert_eq!(features.len(), 2 * N_POINT_FEATURES);
        assert_eq!(rows[..3], [0, 1, 0]);
        assert!((features[6] + 0.5).abs() < 1e-6, "z of the first point lies 0.5 m under the mean");
    }

    #[test]
    fn a_crowded_pillar_keeps_the_configured_number_of_points() {
        let config = ModelConfig::default();
        let points: Vec<[f64; 4]> = (0..100).map(|i| [10.1, 0.1, 0.01 * f64::from(i), 0.0]).collect();
        let (features, rows, _) = pillars(&points, &config);
        assert_eq!(features.len() / N_POINT_FEATURES, config.max_points_per_pillar);
        assert_eq!(rows.len(), config.max_points_per_pillar);
    }

    #[test]
    fn a_mirrored_camera_sees_a_mirrored_point_in_the_flipped_column() {
        let (pinhole, ego_from_camera) = camera();
        let flipped = mirrored(&ego_from_camera);
        let seen = pinhole.project(&(ego_from_camera.inverse() * Point::new(12.0, 3.0, 0.7))).unwrap();
        let mirror = pinhole.project(&(flipped.inverse() * Point::new(12.0, -3.0, 0.7))).unwrap();
        assert!((seen.0 + mirror.0 - 400.0).abs() < 1e-9 && (seen.1 - mirror.1).abs() < 1e-9);
    }

    #[test]
    fn the_depth_image_keeps_the_nearest_point() {
        let (pinhole, ego_from_camera) = camera();
        let far = ego_from_camera * Point::new(0.0, 0.0, 20.0);
        let near = ego_from_camera * Point::new(0.0, 0.0, 7.0);
        let points = [far, near].map(|p| [p.x(), p.y(), p.z(), 0.0]);
        let depth = sparse_depth(&points, &pinhole, &ego_from_camera);
        assert_eq!(depth.iter().filter(|&&d| d > 0.0).count(), 1);
        assert!((depth.iter().copied().fold(0.0, f32::max) - 7.0).abs() < 1e-5);
    }

    #[test]
    fn frustum_points_fall_into_cells_of_the_grid_only() {
        let (pinhole, ego_from_camera) = camera();
        let config = ModelConfig::default();
        let kept = frustum(&pinhole, &ego_from_camera, &config);
        let n_cells = (config.grid.n_cells_x() * config.grid.n_cells_y()) as u32;
        assert!(kept.points.len() > 10_000 && kept.cells.iter().all(|&cell| cell < n_cells));
    }
}
