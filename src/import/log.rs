//! What an importer of one format gives to the pipeline: a log of drives, a drive of frames, in units that all formats share.
//!
//! An importer reads; the pipeline ([`super::run()`]) makes the state, compensates motion, computes rings, scales intensities, shifts to
//! the ground, rectifies, counts points and writes. Metres, seconds, radians, nanoseconds since any epoch of the log.

use std::path::PathBuf;

use image::RgbImage;
use nalgebra::Vector3;

use super::{ImportError, Notes};
use crate::episode::MapDrawing;
use crate::files::sha256_hex;
use crate::geometry::{Box3, Camera, Ego, Lidar, Transform, World};
use crate::sample::{EncodedImage, IgnoredRegion};

/// A log in one format: a folder or a file with one or more drives.
pub trait Log {
    /// Names of the drives in their order: unique, and fit for file names (letters, digits, `-`, `_`, `.`).
    fn drives(&self) -> &[String];

    /// What episodes depend on beside the import's config, as TOML: episodes that were made with other settings are not kept.
    fn settings_toml(&self) -> String {
        String::new()
    }

    /// Reads what a drive needs before its frames: calibration, poses, times, tables.
    ///
    /// # Errors
    /// A file is missing, torn or not valid.
    fn open(&self, drive: &str, notes: &mut Notes) -> Result<Box<dyn Drive>, ImportError>;
}

/// One drive of a log, which becomes one episode.
pub trait Drive {
    fn facts(&self) -> &DriveFacts;

    /// Times of the samples, each after the one before.
    fn times_ns(&self) -> &[u64];

    /// Whether a sample of a drive with annotations has some, as far as this is known before its frame is read.
    fn is_annotated(&self, _sample_idx: usize) -> bool {
        true
    }

    /// The log's own name of a sample (a token, a frame's number), where it has one.
    fn sample_name(&self, _sample_idx: usize) -> Option<String> {
        None
    }

    /// The file of a sample's cloud, for messages.
    fn cloud_path(&self, _sample_idx: usize) -> PathBuf {
        self.facts().path.clone()
    }

    /// The file of a camera's picture at a sample, for messages.
    fn picture_path(&self, _sample_idx: usize, _camera: &RawCamera) -> PathBuf {
        self.facts().path.clone()
    }

    fn odometry(&self) -> &Odometry;

    /// Reads the frame of a sample. It is read twice where the pipeline fits the ground first.
    ///
    /// # Errors
    /// A file is missing, torn or not valid.
    fn frame(&self, sample_idx: usize, notes: &mut Notes) -> Result<RawFrame, ImportError>;
}

/// What holds for a whole drive.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveFacts {
    /// The drive's folder or file, for messages.
    pub path: PathBuf,
    /// The place: a city, a map; the format's name where nothing is known.
    pub town: String,
    pub description: String,
    /// Rear axle to front axle, where the log says it; else the config's.
    pub wheelbase_m: Option<f64>,
    /// The front bumper's x in the ego frame, where the log says it; else the config's.
    pub front_bumper_x_m: Option<f64>,
    /// Whether objects are annotated at all.
    pub is_labelled: bool,
    /// How high the ground lies in the ego frame that the importer uses.
    pub ground: GroundHeight,
    /// Whether the log's own clouds are compensated for the ego's motion within a turn; one sentence says how this is known.
    pub compensated: Option<String>,
    /// How rings were found, where the importer gives them in another way than the log's own field.
    pub rings: Option<String>,
    /// What else the importer has to say of how parts were obtained, by part (`camera`, `lidar`, `velocity`, ..), one sentence each.
    pub methods: Vec<(&'static str, String)>,
    /// The drawing of the map.
    pub map: MapDrawing,
}

/// Where the ground is, under the rear axle, in the ego frame of an importer.
#[derive(Debug, Clone, PartialEq)]
pub enum GroundHeight {
    /// At this z, as `source`, a sentence, says.
    Known { z_m: f64, source: String },
    /// Not known; near this z at a guess. It is fitted.
    Unknown { guess_m: f64 },
}

/// Where the ego was and what its odometry measured, at any rates.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Odometry {
    /// In order of time. Empty: no poses are known, and the ego is at the world's origin.
    pub poses: Vec<(u64, Transform<World, Ego>)>,
    /// Along the ego's x, metres per second.
    pub speed_mps: Option<Series>,
    /// Road-wheel angle, radians, positive to the left.
    pub steering_angle_rad: Option<Series>,
    /// About +z, radians per second.
    pub yaw_rate_rps: Option<Series>,
    /// Along the ego's x, metres per second squared.
    pub acceleration_mps2: Option<Series>,
}

/// Measured values in order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// A sentence on where they come from: `measured by the GPS/IMU`.
    pub source: String,
    /// Nanoseconds and value.
    pub values: Vec<(u64, f64)>,
}

/// The sensors' data at one sample, and what is annotated there.
#[derive(Debug, Clone, PartialEq)]
pub struct RawFrame {
    pub ego_from_lidar: Transform<Ego, Lidar>,
    /// The whole turn, in the LiDAR frame, in the log's own order.
    pub points: Vec<RawPoint>,
    /// The front camera; `None` where the log has no picture or no calibration, and a virtual black one is made.
    pub camera: Option<RawCamera>,
    /// Further cameras by choice.
    pub other_cameras: Vec<RawCamera>,
    /// `None`: nothing is annotated here.
    pub objects: Option<Vec<RawObject>>,
    pub ignored: Vec<IgnoredRegion>,
}

/// One return as the log has it, in the LiDAR frame. What is not finite is dropped by the pipeline, which tells it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RawPoint {
    pub x_m: f32,
    pub y_m: f32,
    pub z_m: f32,
    /// In the log's own scale: 0 to 1 or 0 to 255.
    pub intensity: f32,
    /// 0 the lowest beam; `None` where the log does not say it.
    pub ring: Option<u16>,
    /// From the sample's time; `None` where the log does not say it.
    pub time_offset_s: Option<f32>,
}

/// A camera's picture with its calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct RawCamera {
    /// `cam_front`, `cam_back_left`, ..
    pub name: String,
    /// When it was taken.
    pub time_ns: u64,
    pub ego_from_camera: Transform<Ego, Camera>,
    /// The size that the calibration is for, where it says one; else the picture's.
    pub size_px: Option<[u32; 2]>,
    /// Row by row, digit for digit as the log has it: none says whether pixel (0, 0) is a pixel's centre or its corner.
    pub k: [f64; 9],
    pub distortion: Distortion,
    pub image: RawImage,
}

/// A picture as the log has it.
#[derive(Debug, Clone, PartialEq)]
pub enum RawImage {
    /// Kept byte by byte unless it must be rectified.
    Encoded(EncodedImage),
    Pixels(RgbImage),
    /// The log has none here: a black one of the calibration's size stands for it.
    Black,
}

/// How a lens bends the picture: OpenCV's models and orders of coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    None,
    /// k1, k2, p1, p2, k3.
    PlumbBob([f64; 5]),
    /// k1, k2, p1, p2, k3, k4, k5, k6.
    Rational([f64; 8]),
    /// OpenCV's fisheye, ROS's `equidistant`: k1, k2, k3, k4.
    Fisheye([f64; 4]),
}

/// An annotated object.
#[derive(Debug, Clone, PartialEq)]
pub struct RawObject {
    /// Unique in the frame and the same over a drive, where the log knows it.
    pub id: String,
    /// The log's own name, which the config maps.
    pub category: String,
    pub box_in_ego: Box3<Ego>,
    /// Over ground, in the ego's axes; NaN where unknown.
    pub velocity_in_ego_mps: [f64; 2],
}

impl RawFrame {
    /// SHA-256 of the points as the log has them.
    #[must_use]
    pub fn cloud_sha256(&self) -> String {
        let numbers = |point: &RawPoint| [point.x_m, point.y_m, point.z_m, point.intensity];
        let bytes: Vec<u8> = self.points.iter().flat_map(numbers).flat_map(f32::to_le_bytes).collect();
        sha256_hex(&bytes)
    }
}

impl RawPoint {
    /// The point's place in the LiDAR frame.
    #[must_use]
    pub fn position_m(&self) -> Vector3<f64> {
        Vector3::new(self.x_m.into(), self.y_m.into(), self.z_m.into())
    }
}
