//! A log's cloud as an episode has it: finite points, axes forward and left, one instant, intensities of 0 to 255, rings.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{UnitQuaternion, Vector3};

use super::config::CheckedImport;
use super::intensity::Scale;
use super::motion::{Motion, shifted_ns};
use super::rings::rings_of;
use super::{Notes, RawPoint};
use crate::geometry::{Ego, Lidar, Transform};
use crate::sample::LidarPoint;

/// Returns further away than this are no metres.
const MAX_RANGE_M: f64 = 2000.0;
/// The LiDAR's z axis lies this far along the car's, up or down.
const MIN_UP: f64 = 0.5;
/// A turn takes less than this.
const MAX_OFFSET_S: f32 = 1.0;

/// Makes the clouds of a drive, all alike.
pub(super) struct CloudMaker<'a> {
    pub(super) config: &'a CheckedImport,
    pub(super) motion: &'a Motion<'a>,
    /// Whether points with stamps are moved.
    pub(super) compensates: bool,
    /// Found at the first frame.
    pub(super) scale: Option<Scale>,
    /// Whether any point was moved, and whether any ring was computed.
    pub(super) has_moved: bool,
    pub(super) has_ringed: bool,
    pub(super) has_turned: bool,
}

impl<'a> CloudMaker<'a> {
    pub(super) fn new(config: &'a CheckedImport, motion: &'a Motion<'a>, is_compensated: bool) -> Self {
        let compensates = config.compensate_motion && !is_compensated && motion.has_poses();
        let (has_moved, has_ringed, has_turned) = (false, false, false);
        Self { config, motion, compensates, scale: None, has_moved, has_ringed, has_turned }
    }

    /// The mounting and the cloud of a sample. An error is a sentence: what was found, what would be right.
    pub(super) fn cloud(
        &mut self,
        ego_from_lidar: Transform<Ego, Lidar>,
        points: Vec<RawPoint>,
        time_ns: u64,
        notes: &mut Notes,
    ) -> Result<(Transform<Ego, Lidar>, Vec<LidarPoint>), String> {
        let mut points = drop_empty(points, notes)?;
        let ego_from_lidar = self.set_upright(ego_from_lidar, &mut points)?;
        let rings = self.rings(&points, notes);
        if self.compensates {
            self.compensate(&ego_from_lidar, &mut points, time_ns)?;
        }
        let ego_from_lidar = self.turn(ego_from_lidar, &mut points);
        let scale = match self.scale {
            Some(scale) => scale,
            None => *self.scale.insert(Scale::find(&points, self.config.intensity, notes)?),
        };
        let mut n_outside = 0;
        let mut finish = |(point, ring): (&RawPoint, u16)| {
            let (intensity, is_inside) = scale.apply(point.intensity);
            n_outside += usize::from(!is_inside);
            LidarPoint { x_m: point.x_m, y_m: point.y_m, z_m: point.z_m, intensity, ring }
        };
        let cloud: Vec<LidarPoint> = points.iter().zip(rings).map(&mut finish).collect();
        if n_outside > 0 {
            let sentence = "points have an intensity outside the drive's scale, which was cut to it";
            notes.tell_share(n_outside, cloud.len(), sentence);
        }
        Ok((ego_from_lidar, cloud))
    }

    fn rings(&mut self, points: &[RawPoint], notes: &mut Notes) -> Vec<u16> {
        let given: Vec<u16> = points.iter().filter_map(|point| point.ring).collect();
        if given.len() == points.len() {
            return given;
        }
        if !given.is_empty() {
            notes.tell("a part of the points has no ring; all rings were computed from the elevation");
        }
        self.has_ringed = true;
        rings_of(points, &self.config.rings)
    }

    /// Moves each point to where the LiDAR would have seen it at the sample's time, were the world at rest.
    fn compensate(
        &mut self,
        ego_from_lidar: &Transform<Ego, Lidar>,
        points: &mut [RawPoint],
        time_ns: u64,
    ) -> Result<(), String> {
        let lidar_from_world = (self.motion.pose_beyond(time_ns) * *ego_from_lidar).inverse();
        let mut last = None;
        for point in points {
            let Some(offset_s) = point.time_offset_s.filter(|offset_s| *offset_s != 0.0) else { continue };
            if !(offset_s.abs() <= MAX_OFFSET_S) {
                return Err(format!(
                    "a point's stamp lies {offset_s} s from the sample's; at most {MAX_OFFSET_S} s is needed"
                ));
            }
            // Points of one firing share their stamp.
            let moved = match last {
                Some((of_s, moved)) if of_s == offset_s => moved,
                _ => {
                    let at_ns = shifted_ns(time_ns, f64::from(offset_s));
                    lidar_from_world * self.motion.pose_beyond(at_ns) * *ego_from_lidar
                }
            };
            last = Some((offset_s, moved));
            let at = moved.isometry * nalgebra::Point3::from(point.position_m());
            (point.x_m, point.y_m, point.z_m) = (at.x as f32, at.y as f32, at.z as f32);
            self.has_moved = true;
        }
        Ok(())
    }

    /// Turns a LiDAR that hangs upside down; refuses one that stands on its side. Exact in floats.
    fn set_upright(
        &mut self,
        ego_from_lidar: Transform<Ego, Lidar>,
        points: &mut [RawPoint],
    ) -> Result<Transform<Ego, Lidar>, String> {
        let up = ego_from_lidar.rotate(&Vector3::z());
        if up.z.abs() < MIN_UP {
            let [x, y, z] = [up.x, up.y, up.z].map(|part| (part * 100.0).round() / 100.0);
            return Err(format!(
                "the LiDAR's z axis points along ({x}, {y}, {z}) of the car; up is needed: are axes swapped in its mounting?"
            ));
        }
        if up.z > 0.0 {
            return Ok(ego_from_lidar);
        }
        self.has_turned = true;
        for point in points {
            (point.y_m, point.z_m) = (-point.y_m, -point.z_m);
        }
        let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        Ok(ego_from_lidar * Transform::<Lidar, Lidar>::new(Vector3::zeros(), over))
    }

    /// Turns a LiDAR that is mounted by quarter turns, so that its x axis points ahead. Exact in floats.
    fn turn(
        &mut self,
        ego_from_lidar: Transform<Ego, Lidar>,
        points: &mut [RawPoint],
    ) -> Transform<Ego, Lidar> {
        let quarters = (ego_from_lidar.yaw_rad() / FRAC_PI_2).round().rem_euclid(4.0) as u8;
        if quarters == 0 {
            return ego_from_lidar;
        }
        self.has_turned = true;
        for point in points {
            let (x, y) = (point.x_m, point.y_m);
            (point.x_m, point.y_m) = match quarters {
                1 => (-y, x),
                2 => (-x, -y),
                _ => (y, -x),
            };
        }
        let back_rad = [0.0, -FRAC_PI_2, PI, FRAC_PI_2][usize::from(quarters)];
        let back = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), back_rad);
        ego_from_lidar * Transform::<Lidar, Lidar>::new(Vector3::zeros(), back)
    }
}

/// The points that are there. An error is a sentence.
fn drop_empty(mut points: Vec<RawPoint>, notes: &mut Notes) -> Result<Vec<RawPoint>, String> {
    if points.is_empty() {
        return Err("the cloud has no points".to_owned());
    }
    let n_found = points.len();
    points.retain(|point| [point.x_m, point.y_m, point.z_m].iter().all(|part| part.is_finite()));
    if points.len() < n_found {
        notes.tell_share(n_found - points.len(), n_found, "points are not finite and were dropped");
    }
    let n_finite = points.len();
    points.retain(|point| [point.x_m, point.y_m, point.z_m] != [0.0; 3]);
    if points.len() < n_finite {
        let sentence = "points lie at the LiDAR's own origin and were dropped: they are no returns";
        notes.tell_share(n_finite - points.len(), n_finite, sentence);
    }
    if points.is_empty() {
        return Err(format!("the cloud has {n_found} points, of which none is a return"));
    }
    let mut ranges: Vec<f64> = points.iter().map(|point| point.position_m().norm()).collect();
    let middle = ranges.len() / 2;
    let (_, &mut median_m, _) = ranges.select_nth_unstable_by(middle, f64::total_cmp);
    if median_m > MAX_RANGE_M {
        return Err(format!(
            "half of the points lie further than {median_m:.0} m away; metres are needed, not millimetres"
        ));
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{ImportConfig, Odometry};

    fn point(x_m: f32, y_m: f32, time_offset_s: Option<f32>) -> RawPoint {
        RawPoint { x_m, y_m, z_m: 0.0, intensity: 0.5, ring: Some(3), time_offset_s }
    }

    type Made = (Transform<Ego, Lidar>, Vec<LidarPoint>, Vec<String>);

    fn cloud(odometry: &Odometry, yaw_rad: f64, points: Vec<RawPoint>) -> Result<Made, String> {
        let motion = Motion { odometry, tolerance_ns: 50_000_000, smoothing_ns: 500_000_000 };
        let config = CheckedImport::new(ImportConfig::default()).unwrap();
        let mut notes = Notes::default();
        let ego_from_lidar = Transform::from_xyz_yaw(1.0, 0.0, 1.8, yaw_rad);
        let made =
            CloudMaker::new(&config, &motion, false).cloud(ego_from_lidar, points, 1_000_000_000, &mut notes);
        made.map(|(mounting, cloud)| (mounting, cloud, notes.sentences().collect()))
    }

    #[test]
    fn a_lidar_with_x_to_the_right_is_turned_and_its_points_stay_where_they_are() {
        let (mounting, points, _) =
            cloud(&Odometry::default(), -FRAC_PI_2, vec![point(2.0, 10.0, None)]).unwrap();
        assert_eq!((points[0].x_m, points[0].y_m), (10.0, -2.0));
        assert!(mounting.yaw_rad().abs() < 1e-12, "{mounting:?}");
        assert_eq!((points[0].intensity, points[0].ring), (127.5, 3));
    }

    #[test]
    fn a_point_seen_later_by_a_moving_car_is_put_where_it_was_at_the_samples_time() {
        let pose = |i: u64| (i * 500_000_000, Transform::from_xyz_yaw(5.0 * i as f64, 0.0, 0.0, 0.0));
        let odometry = Odometry { poses: (0..4).map(pose).collect(), ..Odometry::default() };
        // 10 m/s: 0.1 s later the car is 1 m further on, and the wall 1 m nearer.
        let (_, points, _) = cloud(&odometry, 0.0, vec![point(19.0, 0.0, Some(0.1))]).unwrap();
        assert!((points[0].x_m - 20.0).abs() < 1e-5, "{points:?}");
        assert!(cloud(&odometry, 0.0, vec![point(19.0, 0.0, Some(40.0))]).unwrap_err().contains("40 s"));
    }

    #[test]
    fn a_lidar_that_hangs_upside_down_is_turned_and_one_on_its_side_is_refused() {
        let odometry = Odometry::default();
        let motion = Motion { odometry: &odometry, tolerance_ns: 50_000_000, smoothing_ns: 500_000_000 };
        let config = CheckedImport::new(ImportConfig::default()).unwrap();
        let hung = |roll_rad: f64| {
            let roll = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll_rad);
            let mounting = Transform::new(Vector3::new(1.0, 0.0, 2.0), roll);
            let found = vec![RawPoint { z_m: 1.5, ..point(10.0, 2.0, None) }];
            CloudMaker::new(&config, &motion, false).cloud(mounting, found, 0, &mut Notes::default())
        };
        let (mounting, points) = hung(PI).unwrap();
        assert_eq!((points[0].y_m, points[0].z_m), (-2.0, -1.5));
        assert!((mounting.rotate(&Vector3::z()).z - 1.0).abs() < 1e-12);
        assert!(hung(FRAC_PI_2).unwrap_err().contains("swapped"));
    }

    #[test]
    fn what_is_no_return_is_dropped_and_told() {
        let found = vec![point(f32::NAN, 0.0, None), point(0.0, 0.0, None), point(4.0, 0.0, None)];
        let (_, points, told) = cloud(&Odometry::default(), 0.0, found).unwrap();
        assert_eq!((points.len(), told.len()), (1, 3), "{told:?}");
        assert!(cloud(&Odometry::default(), 0.0, Vec::new()).unwrap_err().contains("no points"));
        let millimetres = vec![point(8000.0, 0.0, None)];
        assert!(cloud(&Odometry::default(), 0.0, millimetres).unwrap_err().contains("metres"));
    }
}
