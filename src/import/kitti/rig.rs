//! The car of KITTI: where the Velodyne sits in the ego frame, and cameras by their numbers.

use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};

use super::RECTIFIED_CAMERA;
use super::calib::Calibration;
use crate::files;
use crate::geometry::{Camera, Ego, Lidar, Transform};
use crate::import::error::read;
use crate::import::{Distortion, GroundHeight, ImportConfig, ImportError, Notes, RawCamera, RawImage};
use crate::sample::{EncodedImage, ImageFormat};

/// The left colour camera, which labels are for.
pub(super) const FRONT: usize = 2;
/// Of most rectified pictures: the days differ by some pixels.
const USUAL_SIZE_PX: [u32; 2] = [1242, 375];

/// How the ego's axes lie against the sensors: KITTI states no tilt of the car against either, and they differ by up to a degree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Mounting {
    /// The rectified camera's axes, about which the labels of the object and tracking sets are upright; the Velodyne is at this place.
    Camera([f64; 3]),
    /// The Velodyne's axes, about which the tracklets of raw recordings are upright; it is at this place.
    Velodyne([f64; 3]),
    /// As an export of this program states it.
    Stated(Isometry3<f64>),
}

/// What of the config the readers need.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rig {
    pub(super) mounting: Mounting,
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
        Ok(Self { mounting: Mounting::Camera(config.lidar_mount_m), other_cameras })
    }

    /// The same rig with the Velodyne's axes for the ego.
    pub(super) fn along_velodyne(&self) -> Self {
        let mounting = match self.mounting {
            Mounting::Camera(place_m) => Mounting::Velodyne(place_m),
            other => other,
        };
        Self { mounting, ..self.clone() }
    }

    pub(super) fn ego_from_velo(&self, calibration: &Calibration) -> Isometry3<f64> {
        match self.mounting {
            Mounting::Camera([x, y, z]) => {
                // x ahead is the camera's z, y to the left its -x, z up its -y.
                let axes = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
                let axes = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
                let rotation = axes * calibration.rect_from_velo.rotation;
                Isometry3::from_parts(Translation3::new(x, y, z), rotation)
            }
            Mounting::Velodyne([x, y, z]) => Isometry3::translation(x, y, z),
            Mounting::Stated(ego_from_velo) => ego_from_velo,
        }
    }

    pub(super) fn ego_from_lidar(&self, calibration: &Calibration) -> Transform<Ego, Lidar> {
        Transform::from_isometry(self.ego_from_velo(calibration))
    }

    pub(super) fn ego_from_rect(&self, calibration: &Calibration) -> Isometry3<f64> {
        self.ego_from_velo(calibration) * calibration.rect_from_velo.inverse()
    }

    /// A sentence on the ego's axes.
    pub(super) fn axes(&self) -> (&'static str, String) {
        let sentence = match self.mounting {
            Mounting::Camera(_) => "the rectified camera's, about which the labels are upright",
            Mounting::Velodyne(_) => "the Velodyne's, about which the tracklets are upright",
            Mounting::Stated(_) => "as exported",
        };
        ("ego_axes", sentence.to_owned())
    }

    pub(super) fn ground() -> GroundHeight {
        let source = "the road 1.73 m under the Velodyne, by KITTI's drawing of the sensor setup".to_owned();
        GroundHeight::Known { z_m: 0.0, source }
    }

    /// Where the rectified camera 0 is, for those who bring or take results.
    pub(super) fn rectified_camera(calibration: &Calibration) -> Option<(&'static str, String)> {
        let matrix = calibration.camera(FRONT).ok()?.camera_from_rect.to_homogeneous();
        let rows: Vec<f64> =
            matrix.fixed_rows::<3>(0).transpose().iter().map(|number| number + 0.0).collect();
        Some((RECTIFIED_CAMERA, format!("that of KITTI's labels; camera_from_rect is {rows:?}")))
    }

    /// A camera with its picture, which is PNG or JPEG; a black one where not even the folder of its pictures is there, as clouds can be
    /// had without them.
    pub(super) fn camera(
        &self,
        number: usize,
        calibration: &Calibration,
        picture: &Path,
        time_ns: u64,
        notes: &mut Notes,
    ) -> Result<RawCamera, ImportError> {
        let camera = calibration.camera(number)?;
        let rect_from_camera = camera.camera_from_rect.inverse();
        let ego_from_camera = self.ego_from_rect(calibration) * rect_from_camera;
        let folder = picture.parent().unwrap_or(picture);
        let (size_px, image) = if files::is_dir(folder)? {
            let is_png = picture.extension().is_some_and(|suffix| suffix == "png");
            let format = if is_png { ImageFormat::Png } else { ImageFormat::Jpeg };
            (None, RawImage::Encoded(EncodedImage { format, bytes: read(picture)? }))
        } else {
            notes.tell(format!(
                "there are no pictures of `{}` ({} is missing); a black one stands for each",
                name_of(number),
                folder.display()
            ));
            (Some(USUAL_SIZE_PX), RawImage::Black)
        };
        Ok(RawCamera {
            name: name_of(number).to_owned(),
            time_ns,
            ego_from_camera: Transform::<Ego, Camera>::from_isometry(ego_from_camera),
            size_px,
            k: camera.k,
            distortion: Distortion::None,
            image,
        })
    }
}

fn name_of(number: usize) -> &'static str {
    ["cam_gray_left", "cam_gray_right", "cam_front", "cam_front_right"][number]
}

/// The picture of a frame in a folder: PNG, else JPEG; what cannot be looked at is no JPEG, and reading the PNG tells why.
pub(super) fn picture_path(folder: &Path, stem: &str) -> std::path::PathBuf {
    let png = folder.join(format!("{stem}.png"));
    let jpeg = folder.join(format!("{stem}.jpg"));
    let is_jpeg = files::is_file(&png).is_ok_and(|is_png| !is_png) && files::is_file(&jpeg).unwrap_or(false);
    if is_jpeg { jpeg } else { png }
}
