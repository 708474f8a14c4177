//! The rig of a sample as KITTI's calibration file tells it, and places in the rectified camera's frame.
//!
//! KITTI's labels know a rotation about the rectified camera's y axis only, so that axis should point straight down in the ego
//! frame. It does where the camera has neither pitch nor roll; `R0_rect` is the identity then and `P2` is `K` as it is. Otherwise
//! `R0_rect` turns the camera's axes upright and `P2 = K * camera_from_rect` turns them back, so that `P2 * R0_rect * Tr_velo_to_cam` hits
//! the same pixels and boxes stay exact. `K` is copied digit for digit.
//!
//! Samples that were imported from KITTI keep the rectified camera 0 that their labels and everybody's results are in: its axes are the
//! front camera's, and it lies a baseline beside it.

use std::fmt::Write as _;

use nalgebra::{
    Isometry3, Matrix3, Matrix3x4, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3,
};

use crate::episode::LogFacts;
use crate::geometry::{Box3, Ego, Point};
use crate::import::RECTIFIED_CAMERA;
use crate::sample::Measured;

/// Axes closer than this to upright count as upright.
const UPRIGHT: f64 = 1e-9;
/// A camera that looks up or down more steeply than this (86 degrees) has no forward direction on the ground.
const LEAST_FORWARD: f64 = 0.07;
/// Boxes are cut here before the camera, metres.
const NEAR_M: f64 = 0.1;

/// A sample's rig.
#[derive(Debug, Clone, PartialEq)]
pub struct KittiRig {
    rect_from_ego: Isometry3<f64>,
    rect_from_camera: Isometry3<f64>,
    /// Of points in the rectified camera's frame.
    projection: Matrix3x4<f64>,
    lidar_from_ego: Isometry3<f64>,
    size_px: [f64; 2],
}

/// A box in the picture, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PictureBox {
    /// Left, top, right, bottom, cut at the picture's edges.
    pub edges_px: [f64; 4],
    /// Share of the uncut box that lies outside the picture.
    pub truncation: f64,
}

/// A box as a row of KITTI has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RectifiedBox {
    /// Height, width, length.
    pub size_m: [f64; 3],
    /// The bottom's centre.
    pub bottom_m: [f64; 3],
    pub rotation_y_rad: f64,
}

impl KittiRig {
    /// The rig of a sample; `log` is what its episode says of where it comes from.
    ///
    /// # Errors
    /// The camera looks straight up or down.
    pub fn of(measured: &Measured, log: Option<&LogFacts>) -> Result<Self, String> {
        let ego_from_camera = measured.ego_from_camera.isometry;
        let rect_from_camera = match log.and_then(rectified_camera) {
            Some(camera_from_rect) => camera_from_rect.inverse(),
            None => upright(&ego_from_camera)?,
        };
        let of = &measured.intrinsics;
        let k = Matrix3::new(of.fx_px, 0.0, of.cx_px, 0.0, of.fy_px, of.cy_px, 0.0, 0.0, 1.0);
        let camera_from_rect = rect_from_camera.inverse().to_homogeneous();
        Ok(Self {
            rect_from_ego: rect_from_camera * ego_from_camera.inverse(),
            projection: k * camera_from_rect.fixed_view::<3, 4>(0, 0),
            rect_from_camera,
            lidar_from_ego: measured.ego_from_lidar.isometry.inverse(),
            size_px: [of.width_px, of.height_px].map(f64::from),
        })
    }

    /// `calib/NNNNNN.txt`, in digits that give the same numbers back.
    #[must_use]
    pub fn calibration_text(&self) -> String {
        let mut text = String::new();
        for camera in 0..4 {
            write_row(&mut text, &format!("P{camera}"), self.projection.transpose().iter());
        }
        let turn = self.rect_from_camera.rotation;
        write_row(&mut text, "R0_rect", turn.to_rotation_matrix().matrix().transpose().iter());
        let camera_from_lidar = turn.inverse() * self.rect_from_ego * self.lidar_from_ego.inverse();
        for (name, of) in [("Tr_velo_to_cam", &camera_from_lidar), ("Tr_imu_to_velo", &self.lidar_from_ego)] {
            let matrix = of.to_homogeneous();
            write_row(&mut text, name, matrix.fixed_rows::<3>(0).transpose().iter());
        }
        text
    }

    /// The box in the rectified camera's frame.
    #[must_use]
    pub fn rectified(&self, of: &Box3<Ego>) -> RectifiedBox {
        let center = self.rect_from_ego * of.center.coords;
        // The rotation whose heading has the box's yaw in the ego frame: cos(r) right - sin(r) ahead is along the yaw.
        let ego_from_rect = self.rect_from_ego.rotation.inverse();
        let [right, ahead] = [Vector3::x(), Vector3::z()].map(|axis| ego_from_rect * axis);
        let (sin, cos) = of.yaw_rad.sin_cos();
        let across = |axis: Vector3<f64>| axis.x * sin - axis.y * cos;
        let (rise, run) = (across(right), across(ahead));
        let is_forward = (run * right - rise * ahead).xy().dot(&Vector2::new(cos, sin)) >= 0.0;
        let (rise, run) = if is_forward { (rise, run) } else { (-rise, -run) };
        RectifiedBox {
            size_m: [of.height_m, of.width_m, of.length_m],
            bottom_m: [center.x, center.y + of.height_m / 2.0, center.z],
            rotation_y_rad: rise.atan2(run),
        }
    }

    /// The box of a row in the ego frame.
    #[must_use]
    pub fn in_ego(&self, of: &RectifiedBox) -> Box3<Ego> {
        let ([height_m, width_m, length_m], [x, y, z]) = (of.size_m, of.bottom_m);
        let ego_from_rect = self.rect_from_ego.inverse();
        let center = Point::from_coords(ego_from_rect * Point3::new(x, y - height_m / 2.0, z));
        let (sin, cos) = of.rotation_y_rad.sin_cos();
        let heading = ego_from_rect.rotation * Vector3::new(cos, 0.0, -sin);
        Box3 { center, length_m, width_m, height_m, yaw_rad: heading.y.atan2(heading.x) }
    }

    /// Where a box's bottom and top are seen; `None` where nothing of it is in the picture.
    pub(super) fn picture_box(&self, of: &Box3<Ego>) -> Option<PictureBox> {
        self.frame_columns(&of.corners().map(|corner| corner.coords))
    }

    /// Where an upright prism is seen: its corners at the bottom, then those at the top in the same order.
    pub(super) fn frame_columns(&self, corners_in_ego: &[Point3<f64>]) -> Option<PictureBox> {
        let n = corners_in_ego.len() / 2;
        let corners: Vec<Point3<f64>> =
            corners_in_ego.iter().map(|corner| self.rect_from_ego * corner).collect();
        let mut whole = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
        for i in 0..n {
            let next = (i + 1) % n;
            for (from, to) in [(i, next), (n + i, n + next), (i, n + i)] {
                for end in cut_near(corners[from], corners[to]).into_iter().flatten() {
                    let pixel = self.projection * end.to_homogeneous();
                    let (u, v) = (pixel.x / pixel.z, pixel.y / pixel.z);
                    whole = [whole[0].min(u), whole[1].min(v), whole[2].max(u), whole[3].max(v)];
                }
            }
        }
        let [width, height] = self.size_px;
        let cut = [whole[0].max(0.0), whole[1].max(0.0), whole[2].min(width), whole[3].min(height)];
        let area = |of: [f64; 4]| (of[2] - of[0]) * (of[3] - of[1]);
        let is_seen = cut[0] < cut[2] && cut[1] < cut[3];
        is_seen.then(|| PictureBox {
            edges_px: cut,
            truncation: (1.0 - area(cut) / area(whole)).clamp(0.0, 1.0),
        })
    }
}

/// The turn from the camera's axes to upright ones.
fn upright(ego_from_camera: &Isometry3<f64>) -> Result<Isometry3<f64>, String> {
    let [down, forward] = [Vector3::y(), Vector3::z()].map(|axis| ego_from_camera.rotation * axis);
    if (down + Vector3::z()).norm() < UPRIGHT {
        return Ok(Isometry3::identity());
    }
    let ahead = Vector3::new(forward.x, forward.y, 0.0);
    if ahead.norm() < LEAST_FORWARD {
        return Err("the camera looks straight up or down; KITTI needs one that looks ahead".to_owned());
    }
    let (ahead, down) = (ahead.normalize(), -Vector3::z());
    // Columns: the rectified camera's axes in the ego frame.
    let ego_from_rect = Matrix3::from_columns(&[down.cross(&ahead), down, ahead]);
    let ego_from_rect =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(ego_from_rect));
    Ok(Isometry3::from_parts(Translation3::identity(), ego_from_rect.inverse() * ego_from_camera.rotation))
}

/// KITTI's own rectified camera, where the episode was imported from it: [`RECTIFIED_CAMERA`] ends in the rows of `camera_from_rect`.
fn rectified_camera(log: &LogFacts) -> Option<Isometry3<f64>> {
    let told = log.methods.get(RECTIFIED_CAMERA).filter(|_| log.format == "kitti")?;
    let rows: [f64; 12] = serde_json::from_str(&told[told.find('[')?..]).ok()?;
    let rotation = Matrix3::from_fn(|row, column| rows[4 * row + column]);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Some(Isometry3::from_parts(Translation3::new(rows[3], rows[7], rows[11]), turn))
}

impl RectifiedBox {
    /// KITTI's observation angle: the rotation as seen along the ray to the object, in (-pi, pi].
    pub(super) fn alpha_rad(&self) -> f64 {
        let [x, _, z] = self.bottom_m;
        let alpha = self.rotation_y_rad - x.atan2(z);
        alpha.sin().atan2(alpha.cos())
    }
}

/// The part of an edge that lies before the camera.
fn cut_near(from: Point3<f64>, to: Point3<f64>) -> Option<[Point3<f64>; 2]> {
    if from.z < NEAR_M && to.z < NEAR_M {
        return None;
    }
    let cut = |point: Point3<f64>, other: Point3<f64>| {
        if point.z >= NEAR_M {
            point
        } else {
            point + (other - point) * ((NEAR_M - point.z) / (other.z - point.z))
        }
    };
    Some([cut(from, to), cut(to, from)])
}

fn write_row<'a>(text: &mut String, name: &str, numbers: impl Iterator<Item = &'a f64>) {
    text.push_str(name);
    text.push(':');
    for number in numbers {
        // Adding zero: no -0.
        write!(text, " {:e}", number + 0.0).expect("writing to a string cannot fail");
    }
    text.push('\n');
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::dataset::test_data;
    use crate::geometry::Transform;

    fn measured(pitch_rad: f64, roll_rad: f64) -> Measured {
        let mut measured = test_data::dataset(1).samples()[0].measured.clone();
        let level: Transform<Ego, crate::geometry::Camera> =
            Transform::looking_forward(Vector3::new(1.7, 0.1, 1.5), pitch_rad);
        let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll_rad);
        measured.ego_from_camera = Transform::from_isometry(level.isometry * roll);
        measured
    }

    /// The numbers of a row of the calibration.
    fn row(text: &str, name: &str) -> Vec<f64> {
        let line = text.lines().find(|line| line.starts_with(&format!("{name}:"))).expect("the row is there");
        line.split_whitespace().skip(1).map(|word| word.parse().expect("a number")).collect()
    }

    #[test]
    fn a_level_camera_has_the_identity_and_its_own_k() {
        let measured = measured(0.0, 0.0);
        let text = KittiRig::of(&measured, None).unwrap().calibration_text();
        let of = &measured.intrinsics;
        assert_eq!(
            row(&text, "P2"),
            [of.fx_px, 0.0, of.cx_px, 0.0, 0.0, of.fy_px, of.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0]
        );
        assert_eq!(row(&text, "R0_rect"), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let imu = row(&text, "Tr_imu_to_velo");
        assert_eq!([imu[3], imu[7], imu[11]], [-0.9, 0.0, -1.8], "the imu is the ego's origin");
        assert!(KittiRig::of(&self::measured(1.57, 0.0), None).unwrap_err().contains("straight up or down"));
    }

    #[test]
    fn a_car_on_the_left_that_drives_towards_us_turns_by_a_quarter() {
        let rig = KittiRig::of(&measured(0.0, 0.0), None).unwrap();
        let center = Point::new(21.7, 4.1, 0.75);
        let car = Box3 { center, length_m: 4.0, width_m: 1.8, height_m: 1.5, yaw_rad: std::f64::consts::PI };
        let found = rig.rectified(&car);
        // rotation_y is 0 along the camera's right, and grows clockwise seen from above: towards us is +90 degrees.
        assert!((found.rotation_y_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert!((Vector3::from(found.bottom_m) - Vector3::new(-4.0, 1.5, 20.0)).norm() < 1e-12);
        assert!((found.alpha_rad() - (std::f64::consts::FRAC_PI_2 - (-0.2_f64).atan())).abs() < 1e-12);
    }

    #[test]
    fn a_box_half_out_of_the_picture_is_truncated_and_one_behind_is_not_seen() {
        let rig = KittiRig::of(&measured(0.0, 0.0), None).unwrap();
        let flat = |x, y| Box3 {
            center: Point::new(x, y, 1.5),
            length_m: 0.001,
            width_m: 2.0,
            height_m: 1.0,
            yaw_rad: 0.0,
        };
        let ahead = rig.picture_box(&flat(11.7, 0.1)).unwrap();
        assert!(ahead.truncation == 0.0 && (ahead.edges_px[0] + ahead.edges_px[2] - 160.0).abs() < 1e-6);
        // The left edge of the view lies tan(35 deg) = 0.7002 to the left of each metre ahead.
        let half = rig.picture_box(&flat(11.7, 0.1 + 7.002)).unwrap();
        assert!((half.truncation - 0.5).abs() < 0.01 && half.edges_px[0] == 0.0, "{half:?}");
        assert_eq!(rig.picture_box(&flat(-11.7, 0.1)), None);
        assert_eq!(rig.picture_box(&flat(11.7, 20.0)), None);
        let around = Box3 {
            center: Point::new(3.0, 0.1, 0.5),
            length_m: 4.0,
            width_m: 2.0,
            height_m: 1.0,
            yaw_rad: 0.0,
        };
        let partly = rig.picture_box(&around).unwrap();
        assert!(partly.truncation > 0.5 && partly.edges_px[3] == 90.0, "{partly:?}");
    }

    #[test]
    fn a_frame_of_kitti_keeps_its_rectified_camera() {
        // KITTI's camera 2 lies 6 cm left of camera 0, and both look down a little.
        let measured = measured(0.02, 0.004);
        let told = "camera_from_rect is [1, 0, 0, 0.0598, 0, 1, 0, -0.0004, 0, 0, 1, 0.0027]".to_owned();
        let log = |format: &str| LogFacts {
            format: format.to_owned(),
            drive: String::new(),
            methods: [(RECTIFIED_CAMERA.to_owned(), told.clone())].into(),
            first_cloud_sha256: String::new(),
            sample_names: std::collections::BTreeMap::new(),
            labelled: None,
        };
        let rig = KittiRig::of(&measured, Some(&log("kitti"))).unwrap();
        let text = rig.calibration_text();
        assert_eq!(row(&text, "R0_rect"), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let (p, of) = (row(&text, "P2"), &measured.intrinsics);
        assert!(
            (p[3] - (of.fx_px * 0.0598 + of.cx_px * 0.0027)).abs() < 1e-12
                && p[0] == of.fx_px
                && p[11] == 0.0027
        );
        // KITTI's own rule: the middle is half a height above the bottom along the camera's y.
        let center = Point::new(30.0, -4.0, 0.9);
        let given = Box3 { center, length_m: 4.2, width_m: 1.7, height_m: 1.4, yaw_rad: 2.5 };
        let row = rig.rectified(&given);
        let in_camera = measured.ego_from_camera.inverse() * center;
        let wanted = in_camera.coords - Vector3::new(0.0598, -0.0004 - 0.7, 0.0027);
        assert!((Vector3::from(row.bottom_m) - wanted.coords).norm() < 1e-9);
        let back = rig.in_ego(&row);
        assert!((back.yaw_rad - 2.5).abs() < 1e-12 && (back.center.coords - center.coords).norm() < 1e-9);
        assert_ne!(KittiRig::of(&measured, Some(&log("nuscenes"))).unwrap(), rig);
    }

    proptest! {
        #[test]
        fn boxes_come_back_and_points_hit_the_same_pixel_however_the_camera_is_turned(
            pitch in -0.5..0.5, roll in -0.3..0.3, x in 6.0..60.0, y in -20.0..20.0, yaw in -3.1..3.1, z in -2.0..3.0,
        ) {
            let measured = measured(pitch, roll);
            let rig = KittiRig::of(&measured, None).unwrap();
            let given = Box3 { center: Point::new(x, y, z), length_m: 4.2, width_m: 1.7, height_m: 1.4, yaw_rad: yaw };
            let back = rig.in_ego(&rig.rectified(&given));
            prop_assert!((back.center.coords - given.center.coords).norm() < 1e-9);
            prop_assert!((back.yaw_rad - yaw).sin().abs() < 1e-9 && (back.yaw_rad - yaw).cos() > 0.0);
            // P2 * R0_rect * Tr_velo_to_cam against the camera itself.
            let text = rig.calibration_text();
            let [p, rect, velo] = ["P2", "R0_rect", "Tr_velo_to_cam"].map(|name| row(&text, name));
            let in_lidar = measured.ego_from_lidar.isometry.inverse() * given.center.coords;
            let velo = Matrix3x4::from_row_slice(&velo);
            let in_rect = Matrix3::from_row_slice(&rect) * (velo * in_lidar.to_homogeneous());
            let pixel = Matrix3x4::from_row_slice(&p) * Point3::from(in_rect).to_homogeneous();
            let in_camera = measured.ego_from_camera.inverse() * given.center;
            if let Some((u, v)) = measured.intrinsics.project(&in_camera) {
                prop_assert!((pixel.x / pixel.z - u).abs() < 1e-6 && (pixel.y / pixel.z - v).abs() < 1e-6);
            }
        }
    }
}
