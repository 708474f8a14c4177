//! Six cameras, as nuScenes has: those that an episode lacks get one black picture.
//!
//! mmdetection3d's converter looks up all six and fails where one is missing. The places and matrices of the missing ones are
//! those of a car of nuScenes: `docs/real_logs.md` says so.

use nalgebra::Vector3;

use crate::geometry::{Camera, Ego, Frame, Pinhole, Transform};

/// A camera of nuScenes' car: channel, place in the ego frame, direction, focal length and principal point.
struct StandIn {
    channel: &'static str,
    position_m: [f64; 3],
    yaw_deg: f64,
    pitch_up_deg: f64,
    focal_px: f64,
    center_px: [f64; 2],
}

/// From the calibration of one of nuScenes' samples; the front one is there in every episode.
const STAND_INS: [StandIn; 5] = [
    StandIn {
        channel: "CAM_FRONT_RIGHT",
        position_m: [1.551, -0.493, 1.496],
        yaw_deg: -56.4,
        pitch_up_deg: -0.8,
        focal_px: 1260.8,
        center_px: [808.0, 495.3],
    },
    StandIn {
        channel: "CAM_FRONT_LEFT",
        position_m: [1.524, 0.495, 1.509],
        yaw_deg: 55.2,
        pitch_up_deg: 0.1,
        focal_px: 1272.6,
        center_px: [826.6, 479.8],
    },
    StandIn {
        channel: "CAM_BACK",
        position_m: [0.028, 0.004, 1.579],
        yaw_deg: 179.9,
        pitch_up_deg: 1.0,
        focal_px: 809.2,
        center_px: [829.2, 481.8],
    },
    StandIn {
        channel: "CAM_BACK_LEFT",
        position_m: [1.036, 0.485, 1.591],
        yaw_deg: 108.6,
        pitch_up_deg: -0.9,
        focal_px: 1256.7,
        center_px: [792.1, 492.8],
    },
    StandIn {
        channel: "CAM_BACK_RIGHT",
        position_m: [1.015, -0.481, 1.562],
        yaw_deg: -110.8,
        pitch_up_deg: -0.9,
        focal_px: 1259.5,
        center_px: [807.3, 501.2],
    },
];

/// A missing camera's calibration.
pub(super) struct MissingCamera {
    pub channel: &'static str,
    pub ego_from_camera: Transform<Ego, Camera>,
    pub intrinsics: Pinhole,
}

/// The channel of a camera: `cam_back_left` is `CAM_BACK_LEFT`.
pub(super) fn channel_of(camera: &str) -> String {
    camera.to_ascii_uppercase()
}

/// The channel of the front camera.
pub(super) fn front() -> String {
    channel_of(Camera::NAME)
}

/// nuScenes' cameras that an episode with these further ones lacks.
pub(super) fn missing(cameras: &[String]) -> Vec<MissingCamera> {
    let lacks = |stand_in: &&StandIn| !cameras.iter().any(|camera| channel_of(camera) == stand_in.channel);
    let place = |stand_in: &StandIn| {
        let turn = Transform::<Ego, Ego>::from_xyz_yaw(0.0, 0.0, 0.0, stand_in.yaw_deg.to_radians());
        let forward = Transform::looking_forward(Vector3::zeros(), -stand_in.pitch_up_deg.to_radians());
        let rotation = (turn * forward).isometry.rotation;
        let [cx_px, cy_px] = stand_in.center_px;
        let (fx_px, fy_px) = (stand_in.focal_px, stand_in.focal_px);
        MissingCamera {
            channel: stand_in.channel,
            ego_from_camera: Transform::new(stand_in.position_m.into(), rotation),
            intrinsics: Pinhole { width_px: 1600, height_px: 900, fx_px, fy_px, cx_px, cy_px },
        }
    };
    STAND_INS.iter().filter(lacks).map(place).collect()
}

/// The black picture of missing cameras, JPEG.
pub(super) fn black_picture() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let black = image::RgbImage::new(1600, 900);
    black.write_to(&mut bytes, image::ImageFormat::Jpeg).expect("a black picture has a JPEG form");
    bytes.into_inner()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_back_camera_looks_back_and_cameras_that_are_there_are_not_missing() {
        let found = missing(&["cam_back_left".to_owned()]);
        assert_eq!(found.len(), 4);
        let back = found.iter().find(|camera| camera.channel == "CAM_BACK").unwrap();
        let forward = back.ego_from_camera.rotate(&Vector3::z());
        assert!(forward.x < -0.99 && forward.z > 0.0, "{forward:?}");
        let left = missing(&[]).into_iter().find(|camera| camera.channel == "CAM_FRONT_LEFT").unwrap();
        assert!(left.ego_from_camera.rotate(&Vector3::z()).y > 0.7);
    }
}
