//! What KITTI's object layout cannot hold of a sample, in files of our own that its tools do not look for.
//!
//! `ego_state/NNNNNN.json` and `ring/NNNNNN.bin`. `harmzone import kitti` reads both where they are.

use nalgebra::Isometry3;
use serde::Serialize;

use crate::episode::Split;
use crate::sample::{LidarPoint, Measured};

/// `ego_state/NNNNNN.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct EgoStateFile<'a> {
    pub episode: &'a str,
    pub sample_idx: usize,
    pub split: Split,
    time_ns: u64,
    speed_mps: f64,
    steering_angle_rad: f64,
    yaw_rate_rps: f64,
    acceleration_mps2: f64,
    wheelbase_m: f64,
    front_bumper_x_m: f64,
    /// Rows of the 4 x 4 matrices.
    world_from_ego: [[f64; 4]; 4],
    ego_from_lidar: [[f64; 4]; 4],
}

impl<'a> EgoStateFile<'a> {
    pub(super) fn new(episode: &'a str, sample_idx: usize, split: Split, measured: &Measured) -> Self {
        let state = &measured.ego_state;
        Self {
            episode,
            sample_idx,
            split,
            time_ns: measured.time_ns,
            speed_mps: state.speed_mps,
            steering_angle_rad: state.steering_angle_rad,
            yaw_rate_rps: state.yaw_rate_rps,
            acceleration_mps2: state.acceleration_mps2,
            wheelbase_m: state.wheelbase_m,
            front_bumper_x_m: state.front_bumper_x_m,
            world_from_ego: rows(&measured.world_from_ego.isometry),
            ego_from_lidar: rows(&measured.ego_from_lidar.isometry),
        }
    }
}

fn rows(of: &Isometry3<f64>) -> [[f64; 4]; 4] {
    let matrix = of.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]))
}

/// `velodyne/NNNNNN.bin`: x, y, z and reflectance of 0 to 1 as little-endian floats.
pub(super) fn cloud_bytes(points: &[LidarPoint]) -> Vec<u8> {
    let floats = |point: &LidarPoint| [point.x_m, point.y_m, point.z_m, reflectance(point.intensity)];
    points.iter().flat_map(floats).flat_map(f32::to_le_bytes).collect()
}

/// `ring/NNNNNN.bin`: 16 bits a point, little endian.
pub(super) fn ring_bytes(points: &[LidarPoint]) -> Vec<u8> {
    points.iter().flat_map(|point| point.ring.to_le_bytes()).collect()
}

/// An intensity of 0 to 255 on KITTI's scale: the number whose product with 255 is the intensity, bit for bit, where there is one.
fn reflectance(intensity: f32) -> f32 {
    let nearest = intensity / 255.0;
    let candidates = [nearest, nearest.next_up(), nearest.next_down()];
    candidates.into_iter().find(|candidate| candidate * 255.0 == intensity).unwrap_or(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_intensities_come_back_bit_for_bit_and_others_to_the_last_bit() {
        for level in 0..=255_u8 {
            let intensity = f32::from(level);
            assert_eq!(reflectance(intensity) * 255.0, intensity);
        }
        let (mut n_exact, n) = (0, 100_000);
        for i in 0..n {
            let intensity = 255.0 * (i as f32 / n as f32).sqrt();
            let back = reflectance(intensity) * 255.0;
            n_exact += usize::from(back == intensity);
            assert!((back - intensity).abs() <= intensity * f32::EPSILON, "{intensity}");
        }
        assert!(n_exact > n * 99 / 100, "{n_exact} of {n}");
    }

    #[test]
    fn a_point_takes_sixteen_bytes_and_two_for_its_ring() {
        let point = LidarPoint { x_m: 1.5, y_m: -2.0, z_m: 0.25, intensity: 255.0, ring: 258 };
        let bytes = cloud_bytes(&[point]);
        assert_eq!((bytes.len(), &bytes[12..]), (16, &1.0_f32.to_le_bytes()[..]));
        assert_eq!(ring_bytes(&[point]), [2, 1]);
    }
}
