//! All that is known at one instant: what the car measured, and, kept apart from it, the truth.
//!
//! Network inputs are built from [`Measured`] alone, so that truth cannot leak into them.

use image::ImageError;
use image::error::{DecodingError, ImageFormatHint};
use serde::{Deserialize, Serialize};

use crate::geometry::{Camera, Ego, Lidar, Pinhole, Point2, Transform, World};
use crate::object::Object;

/// The ego's own state: in [`Measured`] with speed and steering as its sensors tell them, in [`Truth`] as they are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
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

impl LidarPoint {
    /// Distance from the LiDAR.
    #[must_use]
    pub fn range_m(&self) -> f64 {
        let [x_m, y_m, z_m] = [self.x_m, self.y_m, self.z_m].map(f64::from);
        x_m.hypot(y_m).hypot(z_m)
    }
}

/// How an image's bytes are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageFormat {
    Jpeg,
    Png,
}

/// Most pixels of a picture that is unpacked, which take 192 MiB. The largest cameras of cars have some 20 million.
const MAX_PIXELS: u64 = 1 << 26;

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
    /// The bytes are not an image of the stated format, or one of more than 2^26 pixels, by its head.
    pub fn decode(&self) -> Result<image::RgbImage, ImageError> {
        let format = match self.format {
            ImageFormat::Jpeg => image::ImageFormat::Jpeg,
            ImageFormat::Png => image::ImageFormat::Png,
        };
        let picture = || image::ImageReader::with_format(std::io::Cursor::new(&self.bytes), format);
        let (width_px, height_px) = picture().into_dimensions()?;
        if u64::from(width_px) * u64::from(height_px) > MAX_PIXELS {
            let message = format!("it has {width_px} x {height_px} pixels; up to {MAX_PIXELS} are unpacked");
            return Err(ImageError::Decoding(DecodingError::new(ImageFormatHint::Exact(format), message)));
        }
        Ok(picture().decode()?.into_rgb8())
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
    /// In the LiDAR frame, cut to the camera's horizontal field of view by who reads or simulates them.
    pub points: Vec<LidarPoint>,
}

/// The picture of a further camera, beside the front one.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraView {
    /// Its topics begin with it: `cam_back_left`. Lower case letters, digits and `_`.
    pub name: String,
    pub ego_from_camera: Transform<Ego, Camera>,
    pub intrinsics: Pinhole,
    pub image: EncodedImage,
}

/// The cloud of a further LiDAR, beside the top one.
#[derive(Debug, Clone, PartialEq)]
pub struct LidarView {
    /// Its topic is named so: `lidar_left`. It begins with `lidar_`.
    pub name: String,
    pub ego_from_lidar: Transform<Ego, Lidar>,
    /// In its own frame.
    pub points: Vec<LidarPoint>,
}

/// A cloud between two samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Sweep {
    /// The LiDAR's name: `lidar_top`.
    pub lidar: String,
    /// Nanoseconds since the Unix epoch, as of the samples.
    pub time_ns: u64,
    /// Where the LiDAR was at that time.
    pub world_from_lidar: Transform<World, Lidar>,
    /// In the LiDAR frame of that time.
    pub points: Vec<LidarPoint>,
}

/// What other sensors than the front camera and the top LiDAR measured, and sweeps since the sample before.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Around<'a> {
    pub views: &'a [CameraView],
    pub clouds: &'a [LidarView],
    /// In order of time.
    pub sweeps: &'a [Sweep],
}

/// A part of the world of which the truth says nothing, although other parts are labelled.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IgnoredRegion {
    /// A rectangle of the front picture, pixels (KITTI's `DontCare`).
    Image { left_px: f64, top_px: f64, right_px: f64, bottom_px: f64 },
    /// A convex polygon on the ground, in the ego frame.
    Ground { corners_in_ego_m: Vec<Point2> },
}

/// What is annotated in a sample: objects, and regions that nobody annotated.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Truth {
    pub objects: Vec<Object>,
    pub ignored: Vec<IgnoredRegion>,
    /// The ego's true state, where its sensors err in speed and steering; `None` where the measured one is the best known.
    pub ego_state: Option<EgoState>,
}

/// One instant of an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    pub measured: Measured,
    /// `None` in a log that nobody annotated.
    pub truth: Option<Truth>,
}

impl Sample {
    /// The annotated objects; none where nobody annotated.
    #[must_use]
    pub fn objects(&self) -> &[Object] {
        self.truth.as_ref().map_or(&[], |truth| &truth.objects)
    }

    /// The ego's true state, which labels and zones take: the measured one where no other is known.
    #[must_use]
    pub fn true_state(&self) -> &EgoState {
        self.truth.as_ref().and_then(|truth| truth.ego_state.as_ref()).unwrap_or(&self.measured.ego_state)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    /// A part of a PNG file. Its checksum comes last.
    fn part(kind: &[u8], data: &[u8]) -> Vec<u8> {
        let mut crc = flate2::Crc::new();
        crc.update(kind);
        crc.update(data);
        [&(data.len() as u32).to_be_bytes()[..], kind, data, &crc.sum().to_be_bytes()].concat()
    }

    /// A grey PNG of zeros, with `n_bytes` of them.
    fn png([width_px, height_px]: [u32; 2], n_bytes: usize) -> EncodedImage {
        let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(&vec![0; n_bytes]).unwrap();
        let head = [&width_px.to_be_bytes()[..], &height_px.to_be_bytes(), &[8, 0, 0, 0, 0]].concat();
        let parts = [part(b"IHDR", &head), part(b"IDAT", &packed.finish().unwrap()), part(b"IEND", &[])];
        let bytes = [b"\x89PNG\r\n\x1a\n".to_vec(), parts.concat()].concat();
        EncodedImage { format: ImageFormat::Png, bytes }
    }

    #[test]
    fn a_picture_that_unpacks_to_more_than_a_camera_gives_is_refused() {
        assert_eq!(png([30, 20], 31 * 20).decode().unwrap().dimensions(), (30, 20));
        let bomb = png([10_000, 10_000], 10_001 * 10_000);
        assert!(bomb.bytes.len() < 1 << 20, "{} bytes", bomb.bytes.len());
        let told = bomb.decode().unwrap_err().to_string();
        assert!(told.contains("10000 x 10000") && told.contains("up to 67108864"), "{told}");
    }
}
