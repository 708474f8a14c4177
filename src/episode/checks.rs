//! Checks of what a reader takes from a file that others may have written: frames, axes, sizes, units.
//!
//! What no consumer could use is a [`MessageFault`]. What can be read rightly is read so: a cloud's pose and frame, its
//! intensities from 0 to 1, and points outside the camera's view, of which the network never saw any.

use foxglove::messages as fox;
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::error::MessageFault;
use crate::geometry::{Ego, Frame, Lidar, Pinhole, Point, Transform, World};
use crate::sample::{EncodedImage, ImageFormat, LidarPoint, Measured, Sample};
use crate::sensors::lidar::is_in_view;

/// No LiDAR for cars reaches farther; a cloud that does is in millimetres.
const MAX_RANGE_M: f32 = 2_000.0;

/// Intensities of a cloud that reach no higher are from 0 to 1.
const MAX_UNIT_INTENSITY: f32 = 1.0;

/// The cosine of the largest angle between where a sensor's axis points and where it should.
const MIN_ALIGNMENT: f64 = 0.5;

/// Turns the points of a message into `lidar_top`, where its `frame_id` and `pose` say otherwise.
pub(super) fn bring_into_lidar(
    message: &fox::PointCloud,
    ego_from_lidar: &Transform<Ego, Lidar>,
    points: &mut [LidarPoint],
) -> Result<(), MessageFault> {
    let frame_from_points = pose_of(message)?;
    let lidar_from_points = match message.frame_id.as_str() {
        id if id == Lidar::NAME => frame_from_points,
        id if id == Ego::NAME => ego_from_lidar.isometry.inverse() * frame_from_points,
        other => {
            return Err(MessageFault::new(
                "frame_id of the cloud",
                format!("`{other}`"),
                "`lidar_top` or `ego` is needed",
            ));
        }
    };
    if lidar_from_points == Isometry3::identity() {
        return Ok(());
    }
    for point in points {
        let at = Point3::new(f64::from(point.x_m), f64::from(point.y_m), f64::from(point.z_m));
        let at = lidar_from_points * at;
        (point.x_m, point.y_m, point.z_m) = (at.x as f32, at.y as f32, at.z as f32);
    }
    Ok(())
}

/// The pose of a cloud's origin in its frame; the identity where the message has none.
fn pose_of(message: &fox::PointCloud) -> Result<Isometry3<f64>, MessageFault> {
    let pose = message.pose.unwrap_or_default();
    let position = pose.position.unwrap_or_default();
    let translation = Translation3::new(position.x, position.y, position.z);
    // An absent or an all-zero quaternion is protobuf's default.
    let rotation = pose
        .orientation
        .map(|q| Quaternion::new(q.w, q.x, q.y, q.z))
        .filter(|q| q.norm() != 0.0)
        .unwrap_or_else(Quaternion::identity);
    let is_finite = [position.x, position.y, position.z].iter().all(|value| value.is_finite());
    if !is_finite || !((rotation.norm() - 1.0).abs() < 1e-6) {
        let found = format!("{translation} and {rotation}");
        return Err(MessageFault::new(
            "pose of the cloud",
            found,
            "finite numbers and a quaternion of length 1 are needed",
        ));
    }
    Ok(Isometry3::from_parts(translation, UnitQuaternion::new_unchecked(rotation)))
}

/// Where a LiDAR was in the world, by the pose of a cloud in `map`.
pub(super) fn pose_in_world(message: &fox::PointCloud) -> Result<Transform<World, Lidar>, MessageFault> {
    if message.frame_id != World::NAME {
        let found = format!("`{}`", message.frame_id);
        return Err(MessageFault::new("frame_id of the sweep", found, "`map` is needed"));
    }
    pose_of(message).map(Transform::from_isometry)
}

/// Refuses a measurement whose axes, picture or points no consumer could use.
pub(super) fn check_measured(measured: &Measured) -> Result<(), MessageFault> {
    check_axes(measured)?;
    check_picture_size(&measured.image, &measured.intrinsics)?;
    check_unit(&measured.points)
}

/// Refuses points that cannot be metres.
fn check_unit(points: &[LidarPoint]) -> Result<(), MessageFault> {
    let reach = |point: &LidarPoint| point.x_m.abs().max(point.y_m.abs()).max(point.z_m.abs());
    let farthest = points.iter().map(reach).filter(|reach| reach.is_finite()).fold(0.0, f32::max);
    if farthest <= MAX_RANGE_M {
        return Ok(());
    }
    let found = format!("up to {farthest} m away");
    Err(MessageFault::new("points", found, "metres are needed, so at most 2000; millimetres look like this"))
}

/// Whether the intensities may be from 0 to 1: some are above 0, and none is above 1.
pub(super) fn has_unit_intensity(points: &[LidarPoint]) -> bool {
    let highest = points.iter().map(|point| point.intensity).fold(0.0, f32::max);
    highest > 0.0 && highest <= MAX_UNIT_INTENSITY
}

/// Refuses sensors whose axes do not point as the frames say.
fn check_axes(measured: &Measured) -> Result<(), MessageFault> {
    let lidar = measured.ego_from_lidar.isometry.rotation;
    let camera = measured.ego_from_camera.isometry.rotation;
    let (forward, up) = (Vector3::x(), Vector3::z());
    let points_along = |turned: Vector3<f64>, wanted: &Vector3<f64>| turned.dot(wanted) >= MIN_ALIGNMENT;
    if !points_along(lidar * up, &up) {
        let found = format!("mounted so that its z axis points along {}", arrow(&(lidar * up)));
        return Err(MessageFault::new("lidar_top", found, "z must point up in the ego frame"));
    }
    let is_optical =
        points_along(camera * Vector3::z(), &forward) && points_along(camera * Vector3::y(), &-up);
    if is_optical {
        return Ok(());
    }
    let (z, y) = (arrow(&(camera * Vector3::z())), arrow(&(camera * Vector3::y())));
    Err(MessageFault::new(
        "cam_front",
        format!("mounted so that its z axis points along {z} and its y axis along {y} in the ego frame"),
        "a camera that looks ahead, in optical axes (x right, y down, z forward), is needed",
    ))
}

fn arrow(of: &Vector3<f64>) -> String {
    format!("({:.2}, {:.2}, {:.2})", of.x, of.y, of.z)
}

/// Refuses a picture of another size than its calibration says. What is no picture is left to who unpacks it.
pub(super) fn check_picture_size(image: &EncodedImage, intrinsics: &Pinhole) -> Result<(), MessageFault> {
    let (width_px, height_px) = (intrinsics.width_px, intrinsics.height_px);
    let Some(found) = picture_size_px(image) else { return Ok(()) };
    if found == (width_px, height_px) {
        return Ok(());
    }
    Err(MessageFault::new(
        "picture",
        format!("{} x {} px, and its calibration says {width_px} x {height_px}", found.0, found.1),
        "both must be of one size",
    ))
}

/// Width and height in the head of a picture; `None` if it has no readable one.
pub(super) fn picture_size_px(image: &EncodedImage) -> Option<(u32, u32)> {
    let format = match image.format {
        ImageFormat::Jpeg => image::ImageFormat::Jpeg,
        ImageFormat::Png => image::ImageFormat::Png,
    };
    let bytes = std::io::Cursor::new(&image.bytes);
    image::ImageReader::with_format(bytes, format).into_dimensions().ok()
}

/// Leaves out the points that the camera does not have between its left and right edge. Where there are such, the points on
/// each object are counted anew: what is out of view was hit, but a detector is not shown it.
pub(super) fn cut_to_view(sample: &mut Sample) {
    let measured = &mut sample.measured;
    let camera_from_lidar = measured.ego_from_camera.inverse() * measured.ego_from_lidar;
    let (intrinsics, n_whole) = (measured.intrinsics, measured.points.len());
    measured.points.retain(|point| is_in_view(&position(point), &intrinsics, &camera_from_lidar));
    let Some(truth) = sample.truth.as_mut().filter(|_| measured.points.len() < n_whole) else { return };
    let at = |point: &LidarPoint| measured.ego_from_lidar * Point::from_coords(position(point).into());
    let points: Vec<Point<Ego>> = measured.points.iter().map(at).collect();
    for object in &mut truth.objects {
        object.n_lidar_points = Some(object.box_in_ego.count_inside(&points));
    }
}

fn position(point: &LidarPoint) -> Vector3<f64> {
    Vector3::new(point.x_m, point.y_m, point.z_m).cast()
}
