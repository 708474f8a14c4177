//! Velocities of annotated objects from where they are at other times of their drive, as nuScenes' devkit makes them.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::motion::signed_s;
use crate::geometry::{Ego, Transform, World};

/// Neighbouring annotations further apart than this tell no velocity (nuScenes' devkit).
const MAX_STEP_S: f64 = 1.5;

/// Centres of objects in the world, by id and time.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Tracks {
    by_id: BTreeMap<String, Vec<(u64, Point3<f64>)>>,
}

impl Tracks {
    /// Adds an object's centre; of each object in order of time.
    pub(super) fn add(&mut self, id: &str, time_ns: u64, center_in_world: Point3<f64>) {
        self.by_id.entry(id.to_owned()).or_default().push((time_ns, center_in_world));
    }

    /// The velocity over ground in the ego's axes: from the annotation before to the one after, or from the one where there is no other;
    /// NaN where both are too far.
    pub(super) fn velocity_in_ego_mps(
        &self,
        id: &str,
        time_ns: u64,
        world_from_ego: &Transform<World, Ego>,
    ) -> [f64; 2] {
        const UNKNOWN: [f64; 2] = [f64::NAN; 2];
        let Some(track) = self.by_id.get(id) else { return UNKNOWN };
        let here = track.partition_point(|(at_ns, _)| *at_ns < time_ns);
        if track.get(here).is_none_or(|(at_ns, _)| *at_ns != time_ns) {
            return UNKNOWN;
        }
        let (from, to) = (here.saturating_sub(1), (here + 1).min(track.len() - 1));
        let is_near = |other: usize| signed_s(track[here].0, track[other].0).abs() <= MAX_STEP_S;
        let (from, to) = (if is_near(from) { from } else { here }, if is_near(to) { to } else { here });
        if from == to {
            return UNKNOWN;
        }
        let ((from_ns, from), (to_ns, to)) = (track[from], track[to]);
        let in_world = (to - from) / signed_s(from_ns, to_ns);
        let in_ego = world_from_ego.isometry.rotation.inverse() * in_world;
        [in_ego.x, in_ego.y]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_that_drives_north_past_an_ego_that_looks_north_moves_ahead() {
        let mut tracks = Tracks::default();
        for i in 0..3u64 {
            tracks.add("7", i * 500_000_000, Point3::new(1.0, 2.0 * i as f64, 0.0));
        }
        tracks.add("8", 0, Point3::origin());
        let north = Transform::from_xyz_yaw(0.0, 0.0, 0.0, std::f64::consts::FRAC_PI_2);
        for time_ns in [0, 500_000_000, 1_000_000_000] {
            let [ahead, left] = tracks.velocity_in_ego_mps("7", time_ns, &north);
            assert!((ahead - 4.0).abs() < 1e-9 && left.abs() < 1e-9, "{ahead} {left}");
        }
        assert!(tracks.velocity_in_ego_mps("8", 0, &north)[0].is_nan());
        assert!(tracks.velocity_in_ego_mps("7", 3, &north)[0].is_nan());
    }
}
