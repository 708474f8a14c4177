//! One sample as the player takes it: what is there as JSON, the camera's picture as it lies in the episode, and the
//! LiDAR's points in few bytes. The page draws boxes and zone over them itself.
//!
//! Metres, radians, the ego frame. Points: three little-endian `i16` each, x, y, z in centimetres.

use axum::body::Bytes;
use serde::Serialize;

use super::ServeError;
use super::sets::OpenEpisode;
use crate::eval::FaultKind;
use crate::geometry::{Box3, Ego, Point};
use crate::object::{Detection, Harm, Object};
use crate::sample::{ImageFormat, Measured, Sample};

/// A sample's parts, as they are sent.
#[derive(Debug, Clone)]
pub struct SampleFrame {
    pub json: Bytes,
    pub image: Bytes,
    /// The picture's media type.
    pub image_type: &'static str,
    pub points: Bytes,
}

/// The content of [`SampleFrame::json`].
#[derive(Debug, Serialize)]
struct FrameFacts {
    /// Since the episode's first sample.
    time_s: f64,
    speed_mps: f64,
    /// Positive to the left.
    steering_deg: f64,
    front_bumper_x_m: f64,
    camera: CameraModel,
    zone: Option<Vec<[f64; 2]>>,
    /// `None` where nobody annotated.
    objects: Option<Vec<ShownObject>>,
    detections: Option<Vec<ShownDetection>>,
    /// Distance of centres on the ground below which a detection is on an object.
    match_m: f64,
    n_points: usize,
}

/// The front camera, as the page needs it to draw over its picture.
#[derive(Debug, Serialize)]
struct CameraModel {
    width_px: u32,
    height_px: u32,
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    /// The upper three rows of the matrix, row by row.
    camera_from_ego: Vec<f64>,
}

/// A box: centre; length, width, height; yaw.
#[derive(Debug, Serialize)]
struct ShownBox {
    center: [f64; 3],
    size: [f64; 3],
    yaw: f64,
}

#[derive(Debug, Serialize)]
struct ShownObject {
    #[serde(flatten)]
    place: ShownBox,
    id: Option<String>,
    category: Option<String>,
    kind: Option<&'static str>,
    is_unfamiliar: bool,
    harm: Option<&'static str>,
    fault: Option<FaultKind>,
    n_lidar_points: Option<u32>,
}

#[derive(Debug, Serialize)]
struct ShownDetection {
    #[serde(flatten)]
    place: ShownBox,
    harm: &'static str,
    score: f64,
    fault: Option<FaultKind>,
}

impl SampleFrame {
    /// Reads a sample.
    ///
    /// # Errors
    /// There is no such sample, or it is damaged.
    pub fn read(episode: &OpenEpisode, sample_idx: usize) -> Result<Self, ServeError> {
        let Sample { measured, truth } = episode.reader.sample(sample_idx)?;
        let state = truth.as_ref().and_then(|truth| truth.ego_state).unwrap_or(measured.ego_state);
        let start_ns = episode.reader.times_ns().first().copied().unwrap_or_default();
        let labels = episode.labels.as_ref().and_then(|labels| labels.samples().get(sample_idx));
        let found = episode.found.as_ref().and_then(|found| found.samples().get(sample_idx));
        let all_faults = episode.facts.faults.iter().flatten();
        let faults: Vec<_> = all_faults.filter(|fault| fault.sample_idx == sample_idx).collect();
        let fault_at = |place: &Box3<Ego>, is_miss: bool| {
            let of_place =
                faults.iter().find(|fault| fault.kind.is_miss() == is_miss && fault.place == *place);
            of_place.map(|fault| fault.kind)
        };
        let objects = truth.map(|truth| {
            let shown = |(i, object): (usize, Object)| {
                let harm = labels.and_then(|labels| labels.labels.get(i)).map(|label| label.harm);
                ShownObject::new(&object, harm, fault_at(&object.box_in_ego, true))
            };
            truth.objects.into_iter().enumerate().map(shown).collect()
        });
        let detections = found.map(|found| {
            let kept = found.detections.iter().filter(|of| of.score >= episode.min_score);
            kept.map(|of| ShownDetection::new(of, fault_at(&of.box_in_ego, false))).collect()
        });
        let facts = FrameFacts {
            time_s: measured.time_ns.saturating_sub(start_ns) as f64 * 1e-9,
            speed_mps: state.speed_mps,
            steering_deg: state.steering_angle_rad.to_degrees(),
            front_bumper_x_m: state.front_bumper_x_m,
            camera: CameraModel::of(&measured),
            zone: labels.map(|labels| labels.zone_corners.iter().map(|p| [p.x_m, p.y_m]).collect()),
            objects,
            detections,
            match_m: episode.match_m,
            n_points: measured.points.len(),
        };
        let json = serde_json::to_vec(&facts).expect("facts have a JSON form").into();
        let points = pack_points(&measured);
        let image_type = match measured.image.format {
            ImageFormat::Jpeg => "image/jpeg",
            ImageFormat::Png => "image/png",
        };
        Ok(Self { json, image: measured.image.bytes.into(), image_type, points })
    }

    /// Bytes that it takes.
    #[must_use]
    pub fn size(&self) -> usize {
        self.json.len() + self.image.len() + self.points.len()
    }
}

fn pack_points(measured: &Measured) -> Bytes {
    let mut bytes = Vec::with_capacity(6 * measured.points.len());
    for point in &measured.points {
        let in_lidar = Point::new(f64::from(point.x_m), f64::from(point.y_m), f64::from(point.z_m));
        let in_ego = measured.ego_from_lidar * in_lidar;
        for value_m in [in_ego.x(), in_ego.y(), in_ego.z()] {
            // Saturates at 327 m, beyond what is drawn.
            bytes.extend_from_slice(&((100.0 * value_m).round() as i16).to_le_bytes());
        }
    }
    bytes.into()
}

impl CameraModel {
    fn of(measured: &Measured) -> Self {
        let of = &measured.intrinsics;
        let matrix = measured.ego_from_camera.inverse().isometry.to_homogeneous();
        Self {
            width_px: of.width_px,
            height_px: of.height_px,
            fx_px: of.fx_px,
            fy_px: of.fy_px,
            cx_px: of.cx_px,
            cy_px: of.cy_px,
            camera_from_ego: (0..3).flat_map(|row| (0..4).map(move |column| matrix[(row, column)])).collect(),
        }
    }
}

impl ShownBox {
    fn of(of: &Box3<Ego>) -> Self {
        Self {
            center: [of.center.x(), of.center.y(), of.center.z()],
            size: [of.length_m, of.width_m, of.height_m],
            yaw: of.yaw_rad,
        }
    }
}

impl ShownObject {
    fn new(object: &Object, harm: Option<Harm>, fault: Option<FaultKind>) -> Self {
        Self {
            place: ShownBox::of(&object.box_in_ego),
            id: object.id.clone(),
            category: object.category.clone(),
            kind: object.kind.map(crate::object::Kind::name),
            is_unfamiliar: object.is_ood(),
            harm: harm.map(Harm::name),
            fault,
            n_lidar_points: object.n_lidar_points,
        }
    }
}

impl ShownDetection {
    fn new(of: &Detection, fault: Option<FaultKind>) -> Self {
        Self { place: ShownBox::of(&of.box_in_ego), harm: of.harm.name(), score: of.score, fault }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    #[test]
    fn points_are_centimetres_in_the_ego_frame() {
        let measured = test_data::dataset(1).samples()[0].measured.clone();
        let bytes = pack_points(&measured);
        assert_eq!(bytes.len(), 6 * measured.points.len());
        let value = |i: usize| f64::from(i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]])) / 100.0;
        let first = &measured.points[0];
        // The LiDAR stands 0.9 m ahead of the origin and 1.8 m above it.
        for (found, wanted) in
            [(value(0), first.x_m + 0.9), (value(1), first.y_m), (value(2), first.z_m + 1.8)]
        {
            assert!((found - f64::from(wanted)).abs() < 0.006, "{found} {wanted}");
        }
    }

    #[test]
    fn the_page_projects_with_the_same_camera() {
        let measured = test_data::dataset(1).samples()[0].measured.clone();
        let model = CameraModel::of(&measured);
        let point: Point<Ego> = Point::new(20.0, 3.0, 1.0);
        let row = |i: usize| {
            let of = &model.camera_from_ego[4 * i..4 * i + 4];
            of[0] * point.x() + of[1] * point.y() + of[2] * point.z() + of[3]
        };
        let (u, v) =
            (model.cx_px + model.fx_px * row(0) / row(2), model.cy_px + model.fy_px * row(1) / row(2));
        let wanted = measured.intrinsics.project(&(measured.ego_from_camera.inverse() * point)).unwrap();
        assert!((u - wanted.0).abs() < 1e-9 && (v - wanted.1).abs() < 1e-9);
    }
}
