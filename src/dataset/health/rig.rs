//! Whether the sensors stay where they are mounted: over the samples of an episode, and as the rig in its metadata has them.
//!
//! Simulated sensors are mounted exactly. Logs state a camera at the time of its picture in the ego of the LiDAR's time, so
//! that it moves with the car's speed.

use super::check::{Aspect, Remark};
use crate::episode::EpisodeMeta;
use crate::geometry::{Camera, Ego, Frame, Lidar, Pinhole, Transform};
use crate::sample::Measured;
use crate::sensors::{Rig, RigConfig};

/// Rounding of what should be exact: metres and radians.
const ROUNDING: f64 = 1e-5;
/// Rounding of focal lengths and principal points, pixels.
const ROUNDING_PX: f64 = 1e-4;
/// A LiDAR of a log may be moved by the compensation of its motion, metres and radians.
const LOG_LIDAR: (f64, f64) = (0.3, 0.05);
/// Its camera by a car of 50 m/s within 50 ms, and a turn of that time.
const LOG_CAMERA: (f64, f64) = (3.0, 0.26);

/// Where the sensors are, and how the camera projects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Calibration {
    ego_from_lidar: Transform<Ego, Lidar>,
    ego_from_camera: Transform<Ego, Camera>,
    intrinsics: Pinhole,
}

impl Calibration {
    pub(super) fn of(measured: &Measured) -> Self {
        let Measured { ego_from_lidar, ego_from_camera, intrinsics, .. } = measured;
        Self { ego_from_lidar: *ego_from_lidar, ego_from_camera: *ego_from_camera, intrinsics: *intrinsics }
    }

    fn of_rig(rig: &Rig) -> Self {
        let (camera, lidar) = (rig.front(), rig.top());
        let (ego_from_lidar, ego_from_camera) = (lidar.ego_from_lidar, camera.ego_from_camera);
        Self { ego_from_lidar, ego_from_camera, intrinsics: camera.intrinsics }
    }

    /// What differs between two, in words; `None` where nothing does.
    fn difference(&self, wanted: &Self, lidar: (f64, f64), camera: (f64, f64)) -> Option<String> {
        let of_lidar = moved("lidar_top", &self.ego_from_lidar, &wanted.ego_from_lidar, lidar);
        let of_camera = || moved("cam_front", &self.ego_from_camera, &wanted.ego_from_camera, camera);
        of_lidar.or_else(of_camera).or_else(|| changed(&self.intrinsics, &wanted.intrinsics))
    }

    /// Whether two are one rig.
    pub(super) fn is(&self, other: &Self) -> bool {
        self.difference(other, (ROUNDING, ROUNDING), (ROUNDING, ROUNDING)).is_none()
    }
}

fn moved<To: Frame, From: Frame>(
    name: &str,
    found: &Transform<To, From>,
    wanted: &Transform<To, From>,
    (most_m, most_rad): (f64, f64),
) -> Option<String> {
    let (found, wanted) = (&found.isometry, &wanted.isometry);
    let away_m = (found.translation.vector - wanted.translation.vector).norm();
    let turned_rad = found.rotation.angle_to(&wanted.rotation);
    (away_m > most_m || turned_rad > most_rad).then(|| {
        let turned_deg = turned_rad.to_degrees();
        format!("`{name}` is {away_m:.3} m and {turned_deg:.2} degrees away from where it is mounted")
    })
}

fn changed(found: &Pinhole, wanted: &Pinhole) -> Option<String> {
    let sizes = |of: &Pinhole| (of.width_px, of.height_px);
    let numbers = |of: &Pinhole| [of.fx_px, of.fy_px, of.cx_px, of.cy_px];
    let is_same = sizes(found) == sizes(wanted)
        && numbers(found)
            .iter()
            .zip(numbers(wanted))
            .all(|(found, wanted)| (found - wanted).abs() < ROUNDING_PX);
    (!is_same).then(|| {
        format!(
            "the camera has {} x {} px and fx, fy, cx, cy of {:.2?} px in place of {} x {} px and {:.2?} px",
            found.width_px,
            found.height_px,
            numbers(found),
            wanted.width_px,
            wanted.height_px,
            numbers(wanted)
        )
    })
}

/// The rig in an episode's metadata; `None` where it has none that this version reads.
pub(super) fn rig_of(meta: &EpisodeMeta) -> Option<(RigConfig, Rig)> {
    if meta.rig_toml.trim().is_empty() {
        return None;
    }
    let config: RigConfig = toml::from_str(&meta.rig_toml).ok()?;
    let rig = Rig::try_from(&config).ok()?;
    Some((config, rig))
}

/// The calibrations of an episode.
pub(super) struct Mounting {
    is_log: bool,
    wanted: Option<Calibration>,
    first: Option<Calibration>,
}

impl Mounting {
    pub(super) fn new(is_log: bool, rig: Option<&Rig>) -> Self {
        Self { is_log, wanted: rig.map(Calibration::of_rig), first: None }
    }

    pub(super) fn first(&self) -> Option<Calibration> {
        self.first
    }

    /// Adds a sample's.
    pub(super) fn add(&mut self, measured: &Measured) -> Vec<Remark> {
        let found = Calibration::of(measured);
        let first = *self.first.get_or_insert(found);
        let (lidar, camera) =
            if self.is_log { (LOG_LIDAR, LOG_CAMERA) } else { ((ROUNDING, ROUNDING), (ROUNDING, ROUNDING)) };
        let drifted = found.difference(&first, lidar, camera).map(|what| {
            let text = format!("{what} in the first sample; a rig stays as it is through an episode");
            Remark::unless(self.is_log, Aspect::Rig, "drift", text)
        });
        let other = self.wanted.filter(|_| drifted.is_none()).and_then(|wanted| {
            let what = found.difference(&wanted, (ROUNDING, ROUNDING), (ROUNDING, ROUNDING))?;
            let text = format!("{what} by the rig in the episode's metadata; both should agree");
            Some(Remark::fault(Aspect::Rig, "other mounting", text))
        });
        [drifted, other, principal_point(&found.intrinsics)].into_iter().flatten().collect()
    }
}

/// Focal lengths above zero are the reader's business.
fn principal_point(camera: &Pinhole) -> Option<Remark> {
    (!camera.contains(camera.cx_px, camera.cy_px)).then(|| {
        let text = format!(
            "the principal point is at ({:.1}, {:.1}) px of a picture of {} x {} px; it should lie inside",
            camera.cx_px, camera.cy_px, camera.width_px, camera.height_px
        );
        Remark::fault(Aspect::Camera, "principal point", text)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::to_toml;
    use crate::dataset::test_data;
    use nalgebra::{Translation3, UnitQuaternion};

    /// What is found in the second of two samples, the second changed.
    fn kinds(is_log: bool, rig: Option<&Rig>, change: impl Fn(&mut Measured)) -> Vec<&'static str> {
        let mut measured = test_data::dataset(1).samples()[0].measured.clone();
        let mut mounting = Mounting::new(is_log, rig);
        mounting.add(&measured);
        change(&mut measured);
        mounting.add(&measured).iter().map(|remark| remark.kind).collect()
    }

    fn shift(measured: &mut Measured, by_m: f64) {
        measured.ego_from_camera.isometry.append_translation_mut(&Translation3::new(0.0, by_m, 0.0));
    }

    #[test]
    fn a_moved_camera_is_drift_and_that_of_a_moving_log_is_not() {
        assert_eq!(kinds(false, None, |_| ()), [""; 0]);
        assert_eq!(kinds(false, None, |of| shift(of, 0.01)), ["drift"]);
        assert_eq!(kinds(true, None, |of| shift(of, 0.5)), [""; 0]);
        assert_eq!(kinds(true, None, |of| shift(of, 5.0)), ["drift"]);
        let turn = |of: &mut Measured| {
            let by = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.1);
            of.ego_from_lidar.isometry.append_rotation_mut(&by);
        };
        assert_eq!(kinds(true, None, turn), ["drift"]);
        assert_eq!(kinds(false, None, |of| of.intrinsics.fx_px += 1.0), ["drift"]);
        assert_eq!(kinds(true, None, |of| of.intrinsics.cx_px = -3.0), ["drift", "principal point"]);
    }

    #[test]
    fn a_rig_that_is_not_the_metadatas_is_told_for_every_sample() {
        let mut meta = test_data::episode_meta("ClearNoon", "");
        assert!(rig_of(&meta).is_none());
        meta.rig_toml = to_toml(&RigConfig::default());
        let (config, rig) = rig_of(&meta).unwrap();
        assert_eq!(config, RigConfig::default());
        assert_eq!(kinds(false, Some(&rig), |_| ()), ["other mounting"]);
    }
}
