//! The messages on the wire: harmzone's own, with their schemas, and small helpers for foxglove's.

use foxglove::Encode;
use foxglove::messages as fox;

use crate::geometry::{Box3, Ego, Frame, Point, Transform};

#[expect(clippy::all, clippy::pedantic, reason = "made by prost")]
pub(super) mod wire {
    include!(concat!(env!("OUT_DIR"), "/harmzone.rs"));
}

/// A message that a topic can carry: protobuf with its whole descriptor set.
pub trait TopicMessage: prost::Message + Default {
    /// Full name of the schema and its binary `FileDescriptorSet`.
    fn schema() -> (String, Vec<u8>);
}

macro_rules! own_message {
    ($($name:ident),*) => {$(
        impl TopicMessage for wire::$name {
            fn schema() -> (String, Vec<u8>) {
                let descriptors = include_bytes!(concat!(env!("OUT_DIR"), "/", stringify!($name), ".desc"));
                (concat!("harmzone.", stringify!($name)).to_owned(), descriptors.to_vec())
            }
        }
    )*};
}
own_message!(
    EgoState,
    Objects,
    IgnoredRegions,
    HarmLabels,
    Detections,
    DriveCommand,
    ViewNumbers,
    ViewObjects
);

macro_rules! foxglove_message {
    ($($name:ident),*) => {$(
        impl TopicMessage for fox::$name {
            fn schema() -> (String, Vec<u8>) {
                let schema = <Self as Encode>::get_schema().expect("foxglove's messages have schemas");
                (schema.name, schema.data.into_owned())
            }
        }
    )*};
}
foxglove_message!(
    FrameTransforms,
    PoseInFrame,
    CompressedImage,
    CameraCalibration,
    PointCloud,
    SceneUpdate,
    ImageAnnotations
);

const NS_PER_S: u64 = 1_000_000_000;

/// The time as harmzone's messages hold it.
pub(super) fn own_time(time_ns: u64) -> prost_types::Timestamp {
    prost_types::Timestamp {
        seconds: i64::try_from(time_ns / NS_PER_S).expect("2^64 ns are far fewer than 2^63 s"),
        nanos: i32::try_from(time_ns % NS_PER_S).expect("a remainder of 10^9 fits"),
    }
}

/// The time as foxglove's messages hold it: seconds of 32 bits, saturated in the year 2106.
pub(super) fn fox_time(time_ns: u64) -> fox::Timestamp {
    let nanos = u32::try_from(time_ns % NS_PER_S).expect("a remainder of 10^9 fits");
    u32::try_from(time_ns / NS_PER_S)
        .map_or(fox::Timestamp::MAX, |seconds| fox::Timestamp::new(seconds, nanos))
}

/// A span below 2 seconds, as foxglove's messages hold it.
pub(super) fn fox_span(span_ns: u32) -> fox::Duration {
    fox::Duration::new(0, span_ns)
}

pub(super) fn fox_vector(x: f64, y: f64, z: f64) -> fox::Vector3 {
    fox::Vector3 { x, y, z }
}

pub(super) fn fox_point<F: Frame>(point: &Point<F>) -> fox::Point3 {
    fox::Point3 { x: point.x(), y: point.y(), z: point.z() }
}

/// Translation and rotation of a transform, as foxglove's messages hold them.
pub(super) fn fox_parts<A: Frame, B: Frame>(transform: &Transform<A, B>) -> (fox::Vector3, fox::Quaternion) {
    let (position, rotation) = (transform.isometry.translation.vector, transform.isometry.rotation.coords);
    (
        fox_vector(position.x, position.y, position.z),
        fox::Quaternion { x: rotation.x, y: rotation.y, z: rotation.z, w: rotation.w },
    )
}

/// The pose that changes nothing.
pub(super) fn fox_identity() -> fox::Pose {
    fox::Pose {
        position: Some(fox_vector(0.0, 0.0, 0.0)),
        orientation: Some(fox::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
    }
}

/// A box as a cube of foxglove's.
pub(super) fn fox_cube(box_in_ego: &Box3<Ego>, color: fox::Color) -> fox::CubePrimitive {
    let (sin, cos) = (box_in_ego.yaw_rad / 2.0).sin_cos();
    let center = box_in_ego.center;
    fox::CubePrimitive {
        pose: Some(fox::Pose {
            position: Some(fox_vector(center.x(), center.y(), center.z())),
            orientation: Some(fox::Quaternion { x: 0.0, y: 0.0, z: sin, w: cos }),
        }),
        size: Some(fox_vector(box_in_ego.length_m, box_in_ego.width_m, box_in_ego.height_m)),
        color: Some(color),
    }
}
