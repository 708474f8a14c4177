//! Measurements as messages and back, exactly; values that no consumer could use are a [`MessageFault`].

use foxglove::messages as fox;
use foxglove::messages::packed_element_field::NumericType;
use nalgebra::{Isometry3, Quaternion, Translation3, Unit};

use super::error::MessageFault;
use super::messages::{fox_identity, fox_parts, fox_time, own_time, wire};
use crate::geometry::{Ego, Frame, Pinhole, Transform, World};
use crate::sample::{
    Around, CameraView, EgoState, EncodedImage, ImageFormat, LidarPoint, LidarView, Measured, Sample, Sweep,
};

pub(super) const FINITE: &str = "a finite number is needed";

pub(super) fn check_finite(field: &'static str, found: f64) -> Result<(), MessageFault> {
    if found.is_finite() { Ok(()) } else { Err(MessageFault::new(field, found, FINITE)) }
}

/// Whether a reader will accept every number of the measurement.
pub(super) fn check_measured(measured: &Measured) -> Result<(), MessageFault> {
    check_state(&measured.ego_state)?;
    check_pinhole(&measured.intrinsics)
}

pub(super) fn check_pinhole(pinhole: &Pinhole) -> Result<(), MessageFault> {
    for (field, focal_px) in [("K[0]", pinhole.fx_px), ("K[4]", pinhole.fy_px)] {
        if !(focal_px.is_finite() && focal_px > 0.0) {
            return Err(MessageFault::new(field, focal_px, "a focal length above zero is needed"));
        }
    }
    check_finite("K[2]", pinhole.cx_px)?;
    check_finite("K[5]", pinhole.cy_px)
}

/// The ego's state has the same fields in a message.
macro_rules! state_fields {
    ($($field:ident),*) => {
        pub(super) fn check_state(state: &EgoState) -> Result<(), MessageFault> {
            $(check_finite(stringify!($field), state.$field)?;)*
            Ok(())
        }

        /// The state of a sample; of the measured one only speed and steering angle, where a true one lies beside it.
        pub(super) fn state_message(sample: &Sample) -> wire::EgoState {
            let (measured, state) = (&sample.measured, sample.true_state());
            let errs = sample.truth.as_ref().is_some_and(|truth| truth.ego_state.is_some());
            wire::EgoState {
                timestamp: Some(own_time(measured.time_ns)),
                $($field: state.$field,)*
                measured_speed_mps: errs.then_some(measured.ego_state.speed_mps),
                measured_steering_angle_rad: errs.then_some(measured.ego_state.steering_angle_rad),
            }
        }

        /// The state as the car measures it, and the true one if it is another.
        pub(super) fn states_of(message: &wire::EgoState) -> Result<(EgoState, Option<EgoState>), MessageFault> {
            let state = EgoState { $($field: message.$field),* };
            check_state(&state)?;
            let told = (message.measured_speed_mps, message.measured_steering_angle_rad);
            if told == (None, None) {
                return Ok((state, None));
            }
            let measured = EgoState {
                speed_mps: told.0.unwrap_or(state.speed_mps),
                steering_angle_rad: told.1.unwrap_or(state.steering_angle_rad),
                ..state
            };
            check_state(&measured)?;
            Ok((measured, Some(state)))
        }
    };
}
state_fields!(speed_mps, steering_angle_rad, yaw_rate_rps, acceleration_mps2, wheelbase_m, front_bumper_x_m);

pub(super) fn transforms_message(measured: &Measured, around: Around<'_>) -> fox::FrameTransforms {
    let time_ns = measured.time_ns;
    let own = [
        transform_message(time_ns, &measured.world_from_ego),
        transform_message(time_ns, &measured.ego_from_lidar),
        transform_message(time_ns, &measured.ego_from_camera),
    ];
    let of_view = |view: &CameraView| fox::FrameTransform {
        child_frame_id: view.name.clone(),
        ..transform_message(time_ns, &view.ego_from_camera)
    };
    let of_cloud = |cloud: &LidarView| fox::FrameTransform {
        child_frame_id: cloud.name.clone(),
        ..transform_message(time_ns, &cloud.ego_from_lidar)
    };
    let others = around.views.iter().map(of_view).chain(around.clouds.iter().map(of_cloud));
    fox::FrameTransforms { transforms: own.into_iter().chain(others).collect() }
}

fn transform_message<A: Frame, B: Frame>(time_ns: u64, a_from_b: &Transform<A, B>) -> fox::FrameTransform {
    let (translation, rotation) = fox_parts(a_from_b);
    fox::FrameTransform {
        timestamp: Some(fox_time(time_ns)),
        parent_frame_id: A::NAME.to_owned(),
        child_frame_id: B::NAME.to_owned(),
        translation: Some(translation),
        rotation: Some(rotation),
    }
}

pub(super) fn pose_message(time_ns: u64, world_from_ego: &Transform<World, Ego>) -> fox::PoseInFrame {
    let (position, orientation) = fox_parts(world_from_ego);
    fox::PoseInFrame {
        timestamp: Some(fox_time(time_ns)),
        frame_id: World::NAME.to_owned(),
        pose: Some(fox::Pose { position: Some(position), orientation: Some(orientation) }),
    }
}

/// The transform between two frames that a `/tf` message holds.
pub(super) fn transform_of<A: Frame, B: Frame>(
    message: &fox::FrameTransforms,
) -> Result<Transform<A, B>, MessageFault> {
    transform_to(message, B::NAME)
}

/// As [`transform_of`], for a frame of this name.
pub(super) fn transform_to<A: Frame, B: Frame>(
    message: &fox::FrameTransforms,
    child: &str,
) -> Result<Transform<A, B>, MessageFault> {
    let found = message
        .transforms
        .iter()
        .find(|one| one.parent_frame_id == A::NAME && one.child_frame_id == child)
        .ok_or_else(|| {
            MessageFault::new("transforms", format!("without {} -> {child}", A::NAME), "it is needed")
        })?;
    let (Some(t), Some(r)) = (&found.translation, &found.rotation) else {
        return Err(MessageFault::new("transforms", "incomplete", "translation and rotation are needed"));
    };
    let rotation = Quaternion::new(r.w, r.x, r.y, r.z);
    [("translation.x", t.x), ("translation.y", t.y), ("translation.z", t.z)]
        .into_iter()
        .try_for_each(|(field, found)| check_finite(field, found))?;
    // It is kept as written, bit by bit, so it must be a rotation already.
    if !((rotation.norm() - 1.0).abs() < 1e-6) {
        return Err(MessageFault::new("rotation", rotation, "a quaternion of length 1 is needed"));
    }
    let isometry = Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), Unit::new_unchecked(rotation));
    Ok(Transform::from_isometry(isometry))
}

pub(super) fn image_message(time_ns: u64, camera: &str, image: &EncodedImage) -> fox::CompressedImage {
    let format = match image.format {
        ImageFormat::Jpeg => "jpeg",
        ImageFormat::Png => "png",
    };
    fox::CompressedImage {
        timestamp: Some(fox_time(time_ns)),
        frame_id: camera.to_owned(),
        data: image.bytes.clone().into(),
        format: format.to_owned(),
    }
}

pub(super) fn image_of(message: fox::CompressedImage) -> Result<EncodedImage, MessageFault> {
    let format = match message.format.as_str() {
        "jpeg" | "jpg" => ImageFormat::Jpeg,
        "png" => ImageFormat::Png,
        other => return Err(MessageFault::new("format", other, "jpeg or png is needed")),
    };
    Ok(EncodedImage { format, bytes: message.data.into() })
}

pub(super) fn camera_message(time_ns: u64, name: &str, camera: &Pinhole) -> fox::CameraCalibration {
    let (fx, fy, cx, cy) = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px);
    fox::CameraCalibration {
        timestamp: Some(fox_time(time_ns)),
        frame_id: name.to_owned(),
        width: camera.width_px,
        height: camera.height_px,
        distortion_model: String::new(),
        d: Vec::new(),
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
}

#[expect(clippy::similar_names, reason = "the usual names of the intrinsics")]
pub(super) fn camera_of(message: &fox::CameraCalibration) -> Result<Pinhole, MessageFault> {
    let [fx_px, _, cx_px, _, fy_px, cy_px, ..] = *message.k.as_slice() else {
        return Err(MessageFault::new("K", format!("{:?}", message.k), "nine numbers are needed"));
    };
    if message.d.iter().any(|&coefficient| coefficient != 0.0) {
        return Err(MessageFault::new(
            "D",
            format!("{:?}", message.d),
            "a rectified image without distortion is needed",
        ));
    }
    let pinhole = Pinhole { width_px: message.width, height_px: message.height, fx_px, fy_px, cx_px, cy_px };
    check_pinhole(&pinhole)?;
    Ok(pinhole)
}

/// Bytes of a packed point: four `float32` and a `uint16`, little endian.
const POINT_STRIDE: usize = 18;

fn point_fields() -> Vec<fox::PackedElementField> {
    let float = NumericType::Float32;
    [
        ("x", 0, float),
        ("y", 4, float),
        ("z", 8, float),
        ("intensity", 12, float),
        ("ring", 16, NumericType::Uint16),
    ]
    .map(|(name, offset, numeric)| fox::PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: numeric.into(),
    })
    .to_vec()
}

pub(super) fn cloud_message(time_ns: u64, lidar: &str, points: &[LidarPoint]) -> fox::PointCloud {
    let mut data = Vec::with_capacity(points.len() * POINT_STRIDE);
    for point in points {
        for value in [point.x_m, point.y_m, point.z_m, point.intensity] {
            data.extend_from_slice(&value.to_le_bytes());
        }
        data.extend_from_slice(&point.ring.to_le_bytes());
    }
    fox::PointCloud {
        timestamp: Some(fox_time(time_ns)),
        frame_id: lidar.to_owned(),
        pose: Some(fox_identity()),
        point_stride: u32::try_from(POINT_STRIDE).expect("18 fits"),
        fields: point_fields(),
        data: data.into(),
    }
}

/// A cloud between samples: its points in the LiDAR frame, its `pose` that of the LiDAR in `map` at its time.
pub(super) fn sweep_message(sweep: &Sweep) -> fox::PointCloud {
    let (position, orientation) = fox_parts(&sweep.world_from_lidar);
    fox::PointCloud {
        pose: Some(fox::Pose { position: Some(position), orientation: Some(orientation) }),
        ..cloud_message(sweep.time_ns, World::NAME, &sweep.points)
    }
}

pub(super) fn points_of(message: &fox::PointCloud) -> Result<Vec<LidarPoint>, MessageFault> {
    if message.fields != point_fields() || message.point_stride as usize != POINT_STRIDE {
        let found: Vec<&str> = message.fields.iter().map(|field| field.name.as_str()).collect();
        let wanted = "x, y, z, intensity (float32) and ring (uint16), packed in 18 bytes, are needed";
        return Err(MessageFault::new(
            "fields",
            format!("{found:?} in {} bytes", message.point_stride),
            wanted,
        ));
    }
    if !message.data.len().is_multiple_of(POINT_STRIDE) {
        return Err(MessageFault::new(
            "data",
            format!("{} bytes", message.data.len()),
            "a multiple of 18 is needed",
        ));
    }
    let points = message.data.chunks_exact(POINT_STRIDE).map(|bytes| {
        let float = |at: usize| f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        LidarPoint {
            x_m: float(0),
            y_m: float(4),
            z_m: float(8),
            intensity: float(12),
            ring: u16::from_le_bytes([bytes[16], bytes[17]]),
        }
    });
    Ok(points.collect())
}
