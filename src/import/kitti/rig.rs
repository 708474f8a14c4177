//! The car of KITTI: where the Velodyne sits in the ego frame, and cameras by their numbers.

use std::path::Path;

use nalgebra::{Isometry3, Translation3};

use super::calib::Calibration;
use crate::geometry::{Camera, Ego, Lidar, Transform};
use crate::import::error::read;
use crate::import::{Distortion, Ground, ImportConfig, ImportError, RawCamera, RawImage};
use crate::sample::{EncodedImage, ImageFormat};

/// The left colour camera, which labels are for.
pub(super) const FRONT: usize = 2;

/// What of the config the readers need.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rig {
    pub(super) ego_from_velo: Isometry3<f64>,
    /// Numbers of further cameras.
    pub(super) other_cameras: Vec<usize>,
}

impl Rig {
    /// # Errors
    /// A further camera that KITTI does not have.
    pub(super) fn new(config: &ImportConfig, source: &Path) -> Result<Self, ImportError> {
        let number = |name: &String| {
            let digits = name.trim_start_matches("image_");
            let number = digits.parse().ok().filter(|number| *number < 4 && *number != FRONT);
            let message = || {
                format!("the camera `{name}` is not one of KITTI's further ones: image_0, image_1, image_3")
            };
            number.ok_or_else(|| ImportError::at(source, message()))
        };
        let other_cameras = config.cameras.iter().map(number).collect::<Result<_, _>>()?;
        let [x, y, z] = config.lidar_mount_m;
        Ok(Self {
            ego_from_velo: Isometry3::from_parts(Translation3::new(x, y, z), Default::default()),
            other_cameras,
        })
    }

    pub(super) fn ego_from_lidar(&self) -> Transform<Ego, Lidar> {
        Transform::from_isometry(self.ego_from_velo)
    }

    pub(super) fn ego_from_rect(&self, calibration: &Calibration) -> Isometry3<f64> {
        self.ego_from_velo * calibration.rect_from_velo.inverse()
    }

    pub(super) fn ground() -> Ground {
        let source = "the road 1.73 m under the Velodyne, by KITTI's drawing of the sensor setup".to_owned();
        Ground::Known { z_m: 0.0, source }
    }

    /// A camera with its picture, which is PNG or JPEG.
    pub(super) fn camera(
        &self,
        number: usize,
        calibration: &Calibration,
        picture: &Path,
        time_ns: u64,
    ) -> Result<RawCamera, ImportError> {
        let camera = calibration.camera(number, picture)?;
        let rect_from_camera = camera.camera_from_rect.inverse();
        let ego_from_camera = self.ego_from_rect(calibration) * rect_from_camera;
        let is_png = picture.extension().is_some_and(|suffix| suffix == "png");
        let format = if is_png { ImageFormat::Png } else { ImageFormat::Jpeg };
        Ok(RawCamera {
            name: name_of(number).to_owned(),
            time_ns,
            ego_from_camera: Transform::<Ego, Camera>::from_isometry(ego_from_camera),
            size_px: None,
            k: camera.k,
            distortion: Distortion::None,
            image: RawImage::Encoded(EncodedImage { format, bytes: read(picture)? }),
        })
    }
}

fn name_of(number: usize) -> &'static str {
    ["cam_gray_left", "cam_gray_right", "cam_front", "cam_front_right"][number]
}

/// The picture of a frame in a folder: PNG, else JPEG.
pub(super) fn picture_path(folder: &Path, stem: &str) -> std::path::PathBuf {
    let png = folder.join(format!("{stem}.png"));
    let jpeg = folder.join(format!("{stem}.jpg"));
    if !png.is_file() && jpeg.is_file() { jpeg } else { png }
}
