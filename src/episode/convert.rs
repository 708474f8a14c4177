//! Samples to messages and back, exactly; what no consumer could use is a [`Fault`].

use foxglove::messages as fox;
use foxglove::messages::packed_element_field::NumericType;
use nalgebra::{Isometry3, Quaternion, Translation3, Unit};

use super::error::Fault;
use super::messages::{fox_identity, fox_parts, fox_time, own_time, wire};
use crate::geometry::{Box3, BoxError, Frame, Pinhole, Point, Transform};
use crate::object::{Detection, Distribution, Event, Harm, Kind, ObjectTruth};
use crate::sample::{EgoState, EncodedImage, ImageFormat, LidarPoint, Sample};

const FINITE: &str = "a finite number is needed";

pub(super) fn check_finite(field: &'static str, found: f64) -> Result<(), Fault> {
    if found.is_finite() { Ok(()) } else { Err(Fault::new(field, found, FINITE)) }
}

/// Whether every number of a sample is one that a reader will take.
pub(super) fn check_sample(sample: &Sample) -> Result<(), Fault> {
    check_state(&sample.measured.ego_state)?;
    check_pinhole(&sample.measured.intrinsics)?;
    sample.truth.objects.iter().try_for_each(|object| {
        check_box(&object.box_in_ego, object.velocity_in_ego_mps).map_err(|fault| fault.of(&object.id))
    })
}

fn check_state(state: &EgoState) -> Result<(), Fault> {
    [
        ("speed_mps", state.speed_mps),
        ("steering_angle_rad", state.steering_angle_rad),
        ("yaw_rate_rps", state.yaw_rate_rps),
        ("acceleration_mps2", state.acceleration_mps2),
        ("wheelbase_m", state.wheelbase_m),
        ("front_bumper_x_m", state.front_bumper_x_m),
    ]
    .into_iter()
    .try_for_each(|(field, found)| check_finite(field, found))
}

fn check_pinhole(pinhole: &Pinhole) -> Result<(), Fault> {
    for (field, focal_px) in [("K[0]", pinhole.fx_px), ("K[4]", pinhole.fy_px)] {
        if !(focal_px.is_finite() && focal_px > 0.0) {
            return Err(Fault::new(field, focal_px, "a focal length above zero is needed"));
        }
    }
    check_finite("K[2]", pinhole.cx_px)?;
    check_finite("K[5]", pinhole.cy_px)
}

pub(super) fn check_box<F: Frame>(found: &Box3<F>, velocity_mps: [f64; 2]) -> Result<(), Fault> {
    found.check().map_err(|error| match error {
        BoxError::NotFinite { field, found } => Fault::new(field, found, FINITE),
        BoxError::NotPositive { field, found } => Fault::new(field, found, "a size above zero is needed"),
    })?;
    check_finite("vx_mps", velocity_mps[0])?;
    check_finite("vy_mps", velocity_mps[1])
}

pub(super) fn state_message(time_ns: u64, state: &EgoState) -> wire::EgoState {
    wire::EgoState {
        timestamp: Some(own_time(time_ns)),
        speed_mps: state.speed_mps,
        steering_angle_rad: state.steering_angle_rad,
        yaw_rate_rps: state.yaw_rate_rps,
        acceleration_mps2: state.acceleration_mps2,
        wheelbase_m: state.wheelbase_m,
        front_bumper_x_m: state.front_bumper_x_m,
    }
}

pub(super) fn state_of(message: &wire::EgoState) -> Result<EgoState, Fault> {
    let state = EgoState {
        speed_mps: message.speed_mps,
        steering_angle_rad: message.steering_angle_rad,
        yaw_rate_rps: message.yaw_rate_rps,
        acceleration_mps2: message.acceleration_mps2,
        wheelbase_m: message.wheelbase_m,
        front_bumper_x_m: message.front_bumper_x_m,
    };
    check_state(&state)?;
    Ok(state)
}

pub(super) fn transform_message<A: Frame, B: Frame>(
    time_ns: u64,
    a_from_b: &Transform<A, B>,
) -> fox::FrameTransform {
    let (translation, rotation) = fox_parts(a_from_b);
    fox::FrameTransform {
        timestamp: Some(fox_time(time_ns)),
        parent_frame_id: A::NAME.to_owned(),
        child_frame_id: B::NAME.to_owned(),
        translation: Some(translation),
        rotation: Some(rotation),
    }
}

/// The transform between two frames that a `/tf` message holds.
pub(super) fn transform_of<A: Frame, B: Frame>(
    message: &fox::FrameTransforms,
) -> Result<Transform<A, B>, Fault> {
    let found = message
        .transforms
        .iter()
        .find(|one| one.parent_frame_id == A::NAME && one.child_frame_id == B::NAME)
        .ok_or_else(|| {
            Fault::new("transforms", format!("without {} -> {}", A::NAME, B::NAME), "it is needed")
        })?;
    let (Some(t), Some(r)) = (&found.translation, &found.rotation) else {
        return Err(Fault::new("transforms", "incomplete", "translation and rotation are needed"));
    };
    let rotation = Quaternion::new(r.w, r.x, r.y, r.z);
    [("translation.x", t.x), ("translation.y", t.y), ("translation.z", t.z)]
        .into_iter()
        .try_for_each(|(field, found)| check_finite(field, found))?;
    // Kept as written, bit by bit, so it must be a rotation already.
    if !((rotation.norm() - 1.0).abs() < 1e-6) {
        return Err(Fault::new("rotation", rotation, "a quaternion of length 1 is needed"));
    }
    let isometry = Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), Unit::new_unchecked(rotation));
    Ok(Transform::from_isometry(isometry))
}

pub(super) fn image_message(time_ns: u64, frame_id: &str, image: &EncodedImage) -> fox::CompressedImage {
    let format = match image.format {
        ImageFormat::Jpeg => "jpeg",
        ImageFormat::Png => "png",
    };
    fox::CompressedImage {
        timestamp: Some(fox_time(time_ns)),
        frame_id: frame_id.to_owned(),
        data: image.bytes.clone().into(),
        format: format.to_owned(),
    }
}

pub(super) fn image_of(message: fox::CompressedImage) -> Result<EncodedImage, Fault> {
    let format = match message.format.as_str() {
        "jpeg" | "jpg" => ImageFormat::Jpeg,
        "png" => ImageFormat::Png,
        other => return Err(Fault::new("format", other, "jpeg or png is needed")),
    };
    Ok(EncodedImage { format, bytes: message.data.into() })
}

pub(super) fn camera_message(time_ns: u64, frame_id: &str, camera: &Pinhole) -> fox::CameraCalibration {
    let (fx, fy, cx, cy) = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px);
    fox::CameraCalibration {
        timestamp: Some(fox_time(time_ns)),
        frame_id: frame_id.to_owned(),
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
pub(super) fn camera_of(message: &fox::CameraCalibration) -> Result<Pinhole, Fault> {
    let [fx_px, _, cx_px, _, fy_px, cy_px, ..] = *message.k.as_slice() else {
        return Err(Fault::new("K", format!("{:?}", message.k), "nine numbers are needed"));
    };
    if message.d.iter().any(|&coefficient| coefficient != 0.0) {
        return Err(Fault::new(
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

pub(super) fn cloud_message(time_ns: u64, frame_id: &str, points: &[LidarPoint]) -> fox::PointCloud {
    let mut data = Vec::with_capacity(points.len() * POINT_STRIDE);
    for point in points {
        for value in [point.x_m, point.y_m, point.z_m, point.intensity] {
            data.extend_from_slice(&value.to_le_bytes());
        }
        data.extend_from_slice(&point.ring.to_le_bytes());
    }
    fox::PointCloud {
        timestamp: Some(fox_time(time_ns)),
        frame_id: frame_id.to_owned(),
        pose: Some(fox_identity()),
        point_stride: u32::try_from(POINT_STRIDE).expect("18 fits"),
        fields: point_fields(),
        data: data.into(),
    }
}

pub(super) fn points_of(message: &fox::PointCloud) -> Result<Vec<LidarPoint>, Fault> {
    if message.fields != point_fields() || message.point_stride as usize != POINT_STRIDE {
        let found: Vec<&str> = message.fields.iter().map(|field| field.name.as_str()).collect();
        let wanted = "x, y, z, intensity (float32) and ring (uint16), packed in 18 bytes, are needed";
        return Err(Fault::new("fields", format!("{found:?} in {} bytes", message.point_stride), wanted));
    }
    if !message.data.len().is_multiple_of(POINT_STRIDE) {
        return Err(Fault::new(
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

pub(super) fn objects_message(time_ns: u64, objects: &[ObjectTruth]) -> wire::Objects {
    let objects = objects.iter().map(|object| {
        let found = &object.box_in_ego;
        wire::Object {
            id: object.id.clone(),
            category: object.category.clone(),
            kind: match object.kind {
                Kind::Vehicle => wire::Kind::Vehicle,
                Kind::Pedestrian => wire::Kind::Pedestrian,
                Kind::Static => wire::Kind::Static,
            }
            .into(),
            distribution: match object.distribution {
                Distribution::Id => wire::Distribution::Id,
                Distribution::Ood => wire::Distribution::Ood,
            }
            .into(),
            x_m: found.center.x(),
            y_m: found.center.y(),
            z_m: found.center.z(),
            length_m: found.length_m,
            width_m: found.width_m,
            height_m: found.height_m,
            yaw_rad: found.yaw_rad,
            vx_mps: object.velocity_in_ego_mps[0],
            vy_mps: object.velocity_in_ego_mps[1],
            n_lidar_points: object.n_lidar_points,
            visible_px: object.visible_px,
            visible_fraction: object.visible_fraction,
            event: match object.event {
                Event::None => wire::Event::None,
                Event::Lies => wire::Event::Lies,
                Event::Falls => wire::Event::Falls,
                Event::Rolls => wire::Event::Rolls,
                Event::Thrown => wire::Event::Thrown,
            }
            .into(),
        }
    });
    wire::Objects { timestamp: Some(own_time(time_ns)), objects: objects.collect() }
}

pub(super) fn object_of(message: wire::Object) -> Result<ObjectTruth, Fault> {
    let fail = |field, found, wanted| Fault::new(field, found, wanted).of(&message.id);
    let kind = match wire::Kind::try_from(message.kind) {
        Ok(wire::Kind::Vehicle) => Kind::Vehicle,
        Ok(wire::Kind::Pedestrian) => Kind::Pedestrian,
        Ok(wire::Kind::Static) => Kind::Static,
        _ => return Err(fail("kind", message.kind, "vehicle (1), pedestrian (2) or static (3) is needed")),
    };
    let distribution = match wire::Distribution::try_from(message.distribution) {
        Ok(wire::Distribution::Id) => Distribution::Id,
        Ok(wire::Distribution::Ood) => Distribution::Ood,
        _ => return Err(fail("distribution", message.distribution, "id (1) or ood (2) is needed")),
    };
    let event = match wire::Event::try_from(message.event) {
        Ok(wire::Event::None) => Event::None,
        Ok(wire::Event::Lies) => Event::Lies,
        Ok(wire::Event::Falls) => Event::Falls,
        Ok(wire::Event::Rolls) => Event::Rolls,
        Ok(wire::Event::Thrown) => Event::Thrown,
        Err(_) => return Err(fail("event", message.event, "a number from 0 to 4 is needed")),
    };
    let box_in_ego = Box3 {
        center: Point::new(message.x_m, message.y_m, message.z_m),
        length_m: message.length_m,
        width_m: message.width_m,
        height_m: message.height_m,
        yaw_rad: message.yaw_rad,
    };
    let velocity_in_ego_mps = [message.vx_mps, message.vy_mps];
    check_box(&box_in_ego, velocity_in_ego_mps).map_err(|fault| fault.of(&message.id))?;
    Ok(ObjectTruth {
        id: message.id,
        category: message.category,
        kind,
        distribution,
        box_in_ego,
        velocity_in_ego_mps,
        n_lidar_points: message.n_lidar_points,
        visible_px: message.visible_px,
        visible_fraction: message.visible_fraction,
        event,
    })
}

pub(super) fn harm_number(harm: Harm) -> i32 {
    match harm {
        Harm::Harmful => wire::Harm::Harmful,
        Harm::Harmless => wire::Harm::Harmless,
    }
    .into()
}

pub(super) fn harm_of(number: i32) -> Result<Harm, Fault> {
    match wire::Harm::try_from(number) {
        Ok(wire::Harm::Harmful) => Ok(Harm::Harmful),
        Ok(wire::Harm::Harmless) => Ok(Harm::Harmless),
        _ => Err(Fault::new("harm", number, "harmful (1) or harmless (2) is needed")),
    }
}

pub(super) fn detections_message(time_ns: u64, detections: &[Detection]) -> wire::Detections {
    let detections = detections.iter().map(|detection| {
        let found = &detection.box_in_ego;
        wire::Detection {
            x_m: found.center.x(),
            y_m: found.center.y(),
            z_m: found.center.z(),
            length_m: found.length_m,
            width_m: found.width_m,
            height_m: found.height_m,
            yaw_rad: found.yaw_rad,
            vx_mps: detection.velocity_in_ego_mps[0],
            vy_mps: detection.velocity_in_ego_mps[1],
            harm: harm_number(detection.harm),
            score: detection.score,
        }
    });
    wire::Detections { timestamp: Some(own_time(time_ns)), detections: detections.collect() }
}

pub(super) fn check_detection(detection: &Detection) -> Result<(), Fault> {
    check_box(&detection.box_in_ego, detection.velocity_in_ego_mps)?;
    if !(0.0..=1.0).contains(&detection.score) {
        return Err(Fault::new("score", detection.score, "a number from 0 to 1 is needed"));
    }
    Ok(())
}

pub(super) fn detection_of(message: &wire::Detection) -> Result<Detection, Fault> {
    let detection = Detection {
        box_in_ego: Box3 {
            center: Point::new(message.x_m, message.y_m, message.z_m),
            length_m: message.length_m,
            width_m: message.width_m,
            height_m: message.height_m,
            yaw_rad: message.yaw_rad,
        },
        velocity_in_ego_mps: [message.vx_mps, message.vy_mps],
        harm: harm_of(message.harm)?,
        score: message.score,
    };
    check_detection(&detection)?;
    Ok(detection)
}
