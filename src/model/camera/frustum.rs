//! Where rays and points fall: frustum points to bird's-eye cells, LiDAR points to pixels.

use super::picture::CameraGeometry;
use crate::geometry::Point;
use crate::kernels::PoolPlan;
use crate::model::config::DepthLssConfig;

/// The pixel coordinate through which feature `i` of `n` looks: even steps from the middle of the first pixel to
/// the middle of the last (as published: `linspace(0, n_px - 1, n)` over pixel indices, plus half a pixel).
fn feature_px(i: usize, n: usize, n_px: u32) -> f64 {
    let step_px = if n > 1 { f64::from(n_px - 1) / (n - 1) as f64 } else { 0.0 };
    i as f64 * step_px + 0.5
}

/// Finds the pooled cell `y * n_x + x` of each feature's ray at each depth bin.
///
/// Cells are found by rounding down: a point just under the low edge lies outside (the published code rounds
/// towards zero and keeps points up to a cell outside).
///
/// # Arguments
/// - `features`: rows and columns of the image features
/// - `view`: the view of the network's image
#[must_use]
pub fn pool_plan(config: &DepthLssConfig, features: [usize; 2], view: &CameraGeometry) -> PoolPlan {
    let ([n_y, n_x], camera) = (features, &view.intrinsics);
    let (grid, n_bins) = (config.pooled_grid(), config.n_depth_bins());
    let cell_of = grid.cell_finder();
    let mut cells = Vec::with_capacity(n_y * n_x * n_bins);
    for row in 0..n_y {
        let ray_y = (feature_px(row, n_y, camera.height_px) - camera.cy_px) / camera.fy_px;
        for column in 0..n_x {
            let ray_x = (feature_px(column, n_x, camera.width_px) - camera.cx_px) / camera.fx_px;
            cells.extend((0..n_bins).map(|bin| {
                let depth_m = config.depth_min_m + bin as f64 * config.depth_step_m;
                let p = view.ego_from_camera * Point::new(ray_x * depth_m, ray_y * depth_m, depth_m);
                cell_of([p.x(), p.y(), p.z()]).unwrap_or(PoolPlan::OUTSIDE)
            }));
        }
    }
    PoolPlan::new(n_bins, grid.n_cells(), cells)
}

/// Finds the depths of the LiDAR points that the camera sees: `(y * width + x, depth in metres)`, sorted by pixel.
///
/// Points behind the camera are left out. A pixel with several points keeps the nearest, so that the order of the
/// points does not matter (the published code keeps the one written last).
#[must_use]
pub fn sparse_depth(points: &[[f64; 4]], view: &CameraGeometry) -> Vec<(u32, f32)> {
    let width_px = view.intrinsics.width_px;
    let pixel = |(u, v, depth_m): (f64, f64, f32)| (v as u32 * width_px + u as u32, depth_m);
    let mut seen: Vec<(u32, f32)> = view.see(points).map(pixel).collect();
    seen.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    seen.dedup_by_key(|&mut (pixel, _)| pixel);
    seen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Camera, Pinhole, Transform};
    use nalgebra::Vector3;

    fn view() -> CameraGeometry {
        // The optical axis runs along the ego's x axis at 1.5 m, through the middle of pixel (50, 20).
        let intrinsics =
            Pinhole { width_px: 101, height_px: 41, fx_px: 100.0, fy_px: 100.0, cx_px: 50.5, cy_px: 20.5 };
        CameraGeometry {
            intrinsics,
            ego_from_camera: Transform::looking_forward(Vector3::new(1.0, 0.0, 1.5), 0.0),
        }
    }

    fn config() -> DepthLssConfig {
        DepthLssConfig {
            depth_min_m: 1.0,
            depth_max_m: 5.0,
            depth_step_m: 1.0,
            x_min_m: 0.0,
            x_max_m: 5.0,
            y_min_m: -1.5,
            y_max_m: 1.5,
            cell_size_m: 1.0,
            ..DepthLssConfig::default()
        }
    }

    #[test]
    fn the_middle_ray_walks_straight_ahead_until_the_grid_ends() {
        let view = view();
        let plan = pool_plan(&config(), [3, 3], &view);
        assert_eq!((plan.n_pixels(), plan.n_bins(), plan.n_cells()), (9, 4, 15));
        // x = 2, 3, 4 and 5 m on the row around y = 0; 5 m is outside.
        assert_eq!(plan.cell_of_point()[4 * 4..5 * 4], [5 + 2, 5 + 3, 5 + 4, PoolPlan::OUTSIDE]);
        // The left column looks through pixel 0, half a metre to the left (+y) a metre ahead: at 4 m, y = 2 m.
        assert_eq!(plan.cell_of_point()[3 * 4..4 * 4][..3], [10 + 2, 10 + 3, PoolPlan::OUTSIDE]);
    }

    #[test]
    fn a_point_just_under_the_low_edge_is_outside() {
        let view = view();
        // Rays at x = 2.0 m: the grid starts at 2.5 m, less than a cell further.
        let late = DepthLssConfig { x_min_m: 2.5, x_max_m: 5.5, ..config() };
        let plan = pool_plan(&late, [3, 3], &view);
        assert_eq!(plan.cell_of_point()[4 * 4..5 * 4], [PoolPlan::OUTSIDE, 3, 4, 5]);
        let low = DepthLssConfig { z_max_m: 1.5, ..config() };
        assert_eq!(pool_plan(&low, [1, 1], &view).points().len(), 0, "the ray climbs above 1.5 m");
    }

    #[test]
    fn a_pixel_keeps_its_nearest_point_and_points_behind_are_left_out() {
        let view = view();
        let at = |x, y, z| {
            let p = view.ego_from_camera * Point::<Camera>::new(x, y, z);
            [p.x(), p.y(), p.z(), 0.0]
        };
        let mut points =
            [at(0.0, 0.0, 9.0), at(0.0, 0.0, 4.0), at(0.1, 0.0, 1.0), at(0.0, 0.0, -3.0), at(9.0, 0.0, 1.0)];
        let seen = sparse_depth(&points, &view);
        assert_eq!(seen.iter().map(|s| s.0).collect::<Vec<_>>(), [20 * 101 + 50, 20 * 101 + 60]);
        assert!((seen[0].1 - 4.0).abs() < 1e-6 && (seen[1].1 - 1.0).abs() < 1e-6);
        points.reverse();
        assert_eq!(seen, sparse_depth(&points, &view));
    }
}
