//! Files of sensors, in nuScenes' axes.

use nalgebra::Isometry3;

use crate::geometry::Pinhole;
use crate::nuscenes::quarter_turn;
use crate::sample::{EncodedImage, ImageFormat, LidarPoint, Measured};

/// The LiDAR's channel.
pub(super) const LIDAR: &str = "LIDAR_TOP";

/// A file of a sensor, at a sample or between two.
pub(super) struct SensorFile {
    pub channel: String,
    pub is_key_frame: bool,
    pub ego_from_sensor: Isometry3<f64>,
    pub intrinsics: Option<Pinhole>,
    pub filename: String,
    pub format: &'static str,
}

/// The file of a cloud of the top LiDAR.
pub(super) fn cloud_file(measured: &Measured, filename: String) -> SensorFile {
    SensorFile {
        channel: LIDAR.into(),
        is_key_frame: true,
        ego_from_sensor: measured.ego_from_lidar.isometry * quarter_turn(),
        intrinsics: None,
        filename,
        format: "pcd",
    }
}

/// A point in nuScenes' axes, x right and y forward; signs alone change.
pub(super) fn in_their_axes(point: &LidarPoint) -> [f32; 5] {
    [-point.y_m, point.x_m, point.z_m, point.intensity, f32::from(point.ring)]
}

pub(super) fn ending(image: &EncodedImage) -> &'static str {
    match image.format {
        ImageFormat::Jpeg => "jpg",
        ImageFormat::Png => "png",
    }
}
