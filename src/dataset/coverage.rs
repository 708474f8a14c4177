//! Where a sample's truth speaks: what its log annotates, regions that nobody annotated, and the camera that says where
//! in the picture a box lies.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::episode::LogFacts;
use crate::geometry::{Box3, Camera, Ego, Pinhole, Point, Transform};
use crate::sample::Measured;

/// Nearest depth at which a part of a box counts as seen, metres: pixels run to infinity at the camera itself.
const NEAREST_M: f64 = 0.1;

/// The front camera: where it is mounted and how it projects. Rotations as nuScenes has them, `[w, x, y, z]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFacts {
    /// Of the camera in the ego frame, metres.
    pub translation: [f64; 3],
    /// From the camera's optical axes (x right, y down, z forward) to the ego's.
    pub rotation: [f64; 4],
    pub width_px: u32,
    pub height_px: u32,
    pub fx_px: f64,
    pub fy_px: f64,
    pub cx_px: f64,
    pub cy_px: f64,
}

/// A rectangle of a picture, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureRectangle {
    pub left_px: f64,
    pub top_px: f64,
    pub right_px: f64,
    pub bottom_px: f64,
}

impl PictureRectangle {
    /// Square pixels; zero where it is empty.
    #[must_use]
    pub fn area(&self) -> f64 {
        (self.right_px - self.left_px).max(0.0) * (self.bottom_px - self.top_px).max(0.0)
    }

    /// The part that two rectangles share; its area is zero where they share nothing.
    #[must_use]
    pub fn shared_with(&self, other: &Self) -> Self {
        Self {
            left_px: self.left_px.max(other.left_px),
            top_px: self.top_px.max(other.top_px),
            right_px: self.right_px.min(other.right_px),
            bottom_px: self.bottom_px.min(other.bottom_px),
        }
    }
}

impl CameraFacts {
    /// The camera of a sample.
    #[must_use]
    pub fn of(measured: &Measured) -> Self {
        let isometry = &measured.ego_from_camera.isometry;
        let (t, q) = (isometry.translation.vector, isometry.rotation.quaternion());
        let Pinhole { width_px, height_px, fx_px, fy_px, cx_px, cy_px } = measured.intrinsics;
        Self {
            translation: [t.x, t.y, t.z],
            rotation: [q.w, q.i, q.j, q.k],
            width_px,
            height_px,
            fx_px,
            fy_px,
            cx_px,
            cy_px,
        }
    }

    fn intrinsics(&self) -> Pinhole {
        let Self { width_px, height_px, fx_px, fy_px, cx_px, cy_px, .. } = *self;
        Pinhole { width_px, height_px, fx_px, fy_px, cx_px, cy_px }
    }

    fn camera_from_ego(&self) -> Transform<Camera, Ego> {
        let [w, x, y, z] = self.rotation;
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        Transform::<Ego, Camera>::new(Vector3::from(self.translation), rotation).inverse()
    }

    /// Whether a point lies between the left and the right edge of the picture, as the cloud is cut.
    #[must_use]
    pub fn sees_across(&self, point: Point<Ego>) -> bool {
        let pixel = self.intrinsics().project(&(self.camera_from_ego() * point));
        pixel.is_some_and(|(u_px, _)| (0.0..f64::from(self.width_px)).contains(&u_px))
    }

    /// The rectangle around a box in the picture, cut at the picture's edges; `None` where nothing of it is seen.
    #[must_use]
    pub fn rectangle_of(&self, of: &Box3<Ego>) -> Option<PictureRectangle> {
        let camera_from_ego = self.camera_from_ego();
        let corners = of.corners().map(|corner| camera_from_ego * corner);
        let mut seen: Vec<Point<Camera>> =
            corners.iter().copied().filter(|corner| corner.z() >= NEAREST_M).collect();
        // Where an edge passes the nearest depth, the box is cut.
        for i in 0..4 {
            for (a, b) in [(i, (i + 1) % 4), (4 + i, 4 + (i + 1) % 4), (i, 4 + i)] {
                let (a, b) = (corners[a], corners[b]);
                if (a.z() < NEAREST_M) != (b.z() < NEAREST_M) {
                    let t = (NEAREST_M - a.z()) / (b.z() - a.z());
                    let between = a.coords + t * (b.coords - a.coords);
                    seen.push(Point::from_coords(between));
                }
            }
        }
        let pixels = seen.iter().filter_map(|point| self.intrinsics().project(point));
        let none = PictureRectangle {
            left_px: f64::INFINITY,
            top_px: f64::INFINITY,
            right_px: f64::NEG_INFINITY,
            bottom_px: f64::NEG_INFINITY,
        };
        let around = pixels.fold(none, |around, (u_px, v_px)| PictureRectangle {
            left_px: around.left_px.min(u_px),
            top_px: around.top_px.min(v_px),
            right_px: around.right_px.max(u_px),
            bottom_px: around.bottom_px.max(v_px),
        });
        let (right_px, bottom_px) = (f64::from(self.width_px), f64::from(self.height_px));
        let picture = PictureRectangle { left_px: 0.0, top_px: 0.0, right_px, bottom_px };
        let seen = around.shared_with(&picture);
        (seen.area() > 0.0).then_some(seen)
    }
}

/// Keeps what the front camera has in view. A rig may see all round, and a network that reads that camera is not asked for the
/// rest; of a log its facts say what is annotated, and all is kept.
pub fn keep_in_view<T>(
    log: Option<&LogFacts>,
    measured: &Measured,
    objects: &mut Vec<T>,
    box_of: impl Fn(&T) -> &Box3<Ego>,
) {
    if log.is_some() {
        return;
    }
    let camera = CameraFacts::of(measured);
    objects.retain(|object| camera.rectangle_of(box_of(object)).is_some());
}

/// How many LiDAR points lie in each of some boxes.
#[must_use]
pub fn count_points<'a>(measured: &Measured, boxes: impl IntoIterator<Item = &'a Box3<Ego>>) -> Vec<u32> {
    let in_ego = |point: &crate::sample::LidarPoint| {
        let [x_m, y_m, z_m] = [point.x_m, point.y_m, point.z_m].map(f64::from);
        measured.ego_from_lidar * Point::new(x_m, y_m, z_m)
    };
    let points: Vec<Point<Ego>> = measured.points.iter().map(in_ego).collect();
    boxes.into_iter().map(|of| of.count_inside(&points)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    fn car(x_m: f64, y_m: f64) -> Box3<Ego> {
        Box3 { center: Point::new(x_m, y_m, 0.75), length_m: 4.0, width_m: 2.0, height_m: 1.5, yaw_rad: 0.0 }
    }

    fn camera() -> CameraFacts {
        CameraFacts::of(&test_data::dataset(1).samples()[0].measured)
    }

    #[test]
    fn a_camera_written_as_facts_projects_as_the_samples_own() {
        let measured = test_data::dataset(1).samples()[0].measured.clone();
        let (facts, point) = (CameraFacts::of(&measured), Point::new(20.0, -3.0, 1.0));
        let own = measured.intrinsics.project(&(measured.ego_from_camera.inverse() * point)).unwrap();
        let ours = facts.intrinsics().project(&(facts.camera_from_ego() * point)).unwrap();
        assert!((own.0 - ours.0).abs() + (own.1 - ours.1).abs() < 1e-9);
    }

    #[test]
    fn the_rectangle_of_a_box_is_cut_at_the_picture_and_at_the_camera() {
        // 160 x 90 pixels, 70 degrees: fx is 114.25; the camera is at x 1.7, z 1.5.
        let ahead = camera().rectangle_of(&car(20.0, 0.0)).unwrap();
        let half_px = 114.252 / (18.0 - 1.7);
        assert!(
            (ahead.left_px - (80.0 - half_px)).abs() < 0.01
                && (ahead.right_px - (80.0 + half_px)).abs() < 0.01
        );
        assert!((ahead.top_px - 45.0).abs() < 0.01 && ahead.bottom_px > 55.0);
        assert_eq!(camera().rectangle_of(&car(-20.0, 0.0)), None);
        // The camera looks out of this box: its rectangle is the whole lower half.
        let around = camera().rectangle_of(&car(2.0, 0.0)).unwrap();
        assert_eq!((around.left_px, around.right_px, around.bottom_px), (0.0, 160.0, 90.0));
    }

    #[test]
    fn what_is_beside_the_picture_is_not_seen_but_what_is_below_it_is() {
        let sees = |x_m, y_m, z_m| camera().sees_across(Point::new(x_m, y_m, z_m));
        assert!(sees(20.0, 0.0, 0.5) && sees(2.2, 0.0, 0.0));
        assert!(!sees(10.0, 9.0, 0.5) && !sees(-10.0, 0.0, 0.5));
    }

    #[test]
    fn what_only_another_camera_sees_is_not_the_front_cameras_truth() {
        let sample = test_data::dataset(1).samples()[0].clone();
        let at = |box_in_ego| {
            let mut object = sample.objects[0].clone();
            object.truth.box_in_ego = box_in_ego;
            object
        };
        let mut objects =
            vec![at(car(20.0, 0.0)), at(car(-20.0, 0.0)), at(car(5.0, 15.0)), at(car(8.0, 5.0))];
        keep_in_view(None, &sample.measured, &mut objects, |object| &object.truth.box_in_ego);
        let kept: Vec<f64> = objects.iter().map(|object| object.truth.box_in_ego.center.x()).collect();
        assert_eq!(kept, [20.0, 8.0], "the last one is in view in part");
    }

    #[test]
    fn points_are_counted_as_one_by_one() {
        let dataset = test_data::dataset(2);
        for sample in dataset.samples() {
            let boxes: Vec<Box3<Ego>> = sample.objects.iter().map(|object| object.truth.box_in_ego).collect();
            let counted = count_points(&sample.measured, &boxes);
            for (of, n) in boxes.iter().zip(counted) {
                let inside = sample.measured.points.iter().filter(|point| {
                    let [x_m, y_m, z_m] = [point.x_m, point.y_m, point.z_m].map(f64::from);
                    of.contains(&(sample.measured.ego_from_lidar * Point::new(x_m, y_m, z_m)), 0.0)
                });
                assert_eq!(inside.count(), n as usize);
                assert!(n > 10, "{n}");
            }
        }
    }
}
