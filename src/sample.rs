//! All that is known at one instant: what the car measured, and, kept apart from it, the truth.
//!
//! Network inputs are built from [`Measured`] alone, so that truth cannot leak into them.

use crate::geometry::{Camera, Ego, Lidar, Pinhole, Transform, World};
use crate::object::Object;

/// The ego's own state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EgoState {
    /// Signed along the ego's x axis.
    pub speed_mps: f64,
    /// Road-wheel (Ackermann mean) angle, positive to the left.
    pub steering_angle_rad: f64,
    pub yaw_rate_rps: f64,
    /// Along the ego's x axis.
    pub acceleration_mps2: f64,
    pub wheelbase_m: f64,
    /// The front bumper's x in the ego frame: where the danger zone begins.
    pub front_bumper_x_m: f64,
}

/// One LiDAR return, in the LiDAR frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LidarPoint {
    pub x_m: f32,
    pub y_m: f32,
    pub z_m: f32,
    /// 0 to 255.
    pub intensity: f32,
    /// Beam index, 0 the lowest.
    pub ring: u16,
}

/// How an image's bytes are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageFormat {
    Jpeg,
    Png,
}

/// A compressed RGB image, as the episode holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct EncodedImage {
    pub format: ImageFormat,
    pub bytes: Vec<u8>,
}

impl EncodedImage {
    /// Unpacks to 8-bit RGB, row by row from the top.
    ///
    /// # Errors
    /// The bytes are not an image of the stated format.
    pub fn decode(&self) -> Result<image::RgbImage, image::ImageError> {
        let format = match self.format {
            ImageFormat::Jpeg => image::ImageFormat::Jpeg,
            ImageFormat::Png => image::ImageFormat::Png,
        };
        Ok(image::load_from_memory_with_format(&self.bytes, format)?.into_rgb8())
    }
}

/// What the car's sensors and odometry say at one instant; holds no truth about objects.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Nanoseconds since the Unix epoch; simulated, from a fixed start.
    pub time_ns: u64,
    pub ego_state: EgoState,
    pub world_from_ego: Transform<World, Ego>,
    pub ego_from_lidar: Transform<Ego, Lidar>,
    pub ego_from_camera: Transform<Ego, Camera>,
    pub intrinsics: Pinhole,
    pub image: EncodedImage,
    /// In the LiDAR frame, cut to the camera's horizontal field of view.
    pub points: Vec<LidarPoint>,
}

/// The annotated objects of a sample.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Truth {
    pub objects: Vec<Object>,
}

/// One instant of an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    pub measured: Measured,
    pub truth: Truth,
}
