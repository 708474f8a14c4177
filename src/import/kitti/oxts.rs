//! KITTI's GPS/IMU packets: poses by the raw development kit's Mercator formulas, speed, turning and acceleration as measured.

use std::path::Path;

use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use crate::geometry::{Ego, Transform, World};
use crate::import::{ImportError, Odometry, Series};

/// Equatorial radius of the development kit, metres.
const EARTH_RADIUS_M: f64 = 6_378_137.0;
const COLUMNS: usize = 30;

/// One packet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Packet {
    /// Latitude, longitude (degrees), altitude, roll, pitch, yaw (0 is east, counter-clockwise).
    place: [f64; 6],
    forward_mps: f64,
    forward_mps2: f64,
    upward_rps: f64,
}

impl Packet {
    /// Reads one line; `path` for the message.
    pub(super) fn parse(line: &str, path: &Path) -> Result<Self, ImportError> {
        let numbers: Option<Vec<f64>> = line.split_whitespace().map(|word| word.parse().ok()).collect();
        let numbers = numbers.filter(|numbers| {
            numbers.len() >= COLUMNS && numbers[..COLUMNS].iter().all(|number| number.is_finite())
        });
        let Some(numbers) = numbers else {
            let message = format!("a packet of the GPS/IMU is `{line}`; {COLUMNS} finite numbers are needed");
            return Err(ImportError::at(path, message));
        };
        Ok(Self {
            place: std::array::from_fn(|i| numbers[i]),
            forward_mps: numbers[8],
            forward_mps2: numbers[14],
            upward_rps: numbers[22],
        })
    }

    /// The IMU's pose on the development kit's Mercator plane: x east, y north, z up.
    fn mercator_from_imu(&self, scale: f64) -> Isometry3<f64> {
        let [latitude, longitude, altitude_m, roll, pitch, yaw] = self.place;
        let east_m = scale * longitude.to_radians() * EARTH_RADIUS_M;
        let north_m = scale * EARTH_RADIUS_M * ((90.0 + latitude).to_radians() / 2.0).tan().ln();
        // Roll, then pitch, then yaw.
        let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        Isometry3::from_parts(Translation3::new(east_m, north_m, altitude_m), rotation)
    }
}

/// The odometry of a sequence; the world's origin is the IMU's place at the first packet.
pub(super) fn odometry_of(packets: &[(u64, Packet)], imu_from_ego: &Isometry3<f64>) -> Odometry {
    let Some((_, first)) = packets.first() else { return Odometry::default() };
    let scale = first.place[0].to_radians().cos();
    let origin = first.mercator_from_imu(scale).translation.inverse();
    let pose = |packet: &Packet| {
        let world_from_ego = origin * packet.mercator_from_imu(scale) * imu_from_ego;
        Transform::<World, Ego>::from_isometry(world_from_ego)
    };
    let series = |value: fn(&Packet) -> f64| {
        let values = packets.iter().map(|(time_ns, packet)| (*time_ns, value(packet))).collect();
        Some(Series { source: "measured by the GPS/IMU".to_owned(), values })
    };
    Odometry {
        poses: packets.iter().map(|(time_ns, packet)| (*time_ns, pose(packet))).collect(),
        speed_mps: series(|packet| packet.forward_mps),
        steering_angle_rad: None,
        yaw_rate_rps: series(|packet| packet.upward_rps),
        acceleration_mps2: series(|packet| packet.forward_mps2),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(latitude: f64, longitude: f64, yaw: f64) -> Packet {
        let mut numbers = [0.0; COLUMNS];
        (numbers[0], numbers[1], numbers[5], numbers[8], numbers[22]) = (latitude, longitude, yaw, 9.0, 0.1);
        let line: Vec<String> = numbers.iter().map(ToString::to_string).collect();
        Packet::parse(&line.join(" "), Path::new("oxts")).unwrap()
    }

    #[test]
    fn a_thousandth_of_a_degree_north_is_111_metres_and_the_first_pose_is_the_origin() {
        let packets = [(0, packet(49.0, 8.4, 0.3)), (100_000_000, packet(49.001, 8.4, 0.3))];
        let odometry = odometry_of(&packets, &Isometry3::identity());
        let [(_, first), (_, second)] = odometry.poses.as_slice() else { panic!() };
        assert_eq!(first.isometry.translation.vector.norm(), 0.0);
        let moved = second.isometry.translation.vector;
        assert!((moved.y - 111.32).abs() < 0.01 && moved.x.abs() < 1e-6, "{moved:?}");
        assert!((second.yaw_rad() - 0.3).abs() < 1e-12);
        assert_eq!(odometry.speed_mps.unwrap().values, [(0, 9.0), (100_000_000, 9.0)]);
    }

    #[test]
    fn a_short_packet_is_told() {
        let told = Packet::parse("49.0 8.4 112", Path::new("oxts/0001.txt")).unwrap_err().to_string();
        assert!(told.contains("30 finite numbers") && told.contains("0001.txt"), "{told}");
    }
}
